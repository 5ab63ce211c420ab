r"""Displayed equations of TeX and Markdown files, with the numbers, labels and macros of their authors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from mbdae.documents.blocks import tokens
from mbdae.errors import MbdaeError

Macro = tuple[int, str | None, str]  #: number of arguments, what stands for the first where it is left out, and the text
_ROWS = ("align", "alignat", "flalign", "gather", "eqnarray")
_NAMES = "|".join((*_ROWS, "equation", "multline", "displaymath", "dmath"))
_FOUND = re.compile(
    rf"\\begin\{{(?P<env>{_NAMES})(?P<star>\*?)\}}(?P<body>.*?)\\end\{{(?P=env)(?P=star)\}}|(?<!\\)\\\[(?P<bracket>.*?)\\\]|"
    r"(?<!\\)\$\$(?P<dollars>.*?)\$\$(?P<after>[ \t]*\{#[^}]*\})?|^```+ *math\s*\n(?P<fenced>.*?)^```+|"
    r"\\(?P<kind>section|begin|end)\*?\{(?P<title>[^{}]*(?:\{[^{}]*\}[^{}]*)*)\}|"
    r"^(?P<hashes>#{1,3})[ \t]+(?P<heading>[^\n]+)$", re.S | re.M)
_DEFINED = re.compile(r"\\(?:(?:re|provide)?newcommand|DeclareRobustCommand)\*?\s*\{?\\(?P<new>[A-Za-z]+)\}?\s*"
                      r"(?:\[(?P<count>\d)\])?\s*(?:\[(?P<first>[^\]]*)\])?\s*(?=\{)|\\def\s*\\(?P<old>[A-Za-z]+)(?P<marks>(?:#\d)*)\s*(?=\{)|"
                      r"\\DeclareMathOperator(?P<stars>\*?)\s*\{?\\(?P<word>[A-Za-z]+)\}?\s*(?=\{)")
_GOES_ON = re.compile(r"\s*(?:\{\})?\s*&\s*(?:\{\})?\s*(?:\\q?quad)*\s*(?:=|\+|-|\\cdot|\\times|\\le|\\ge|\\approx)")
_TAG, _LABEL = re.compile(r"\\tag\*?\s*\{([^{}]*)\}"), re.compile(r"\\label\s*\{([^{}]*)\}")
DEEPEST = 40  #: macros within macros that are replaced


@dataclass(frozen=True)
class Display:
    """A displayed equation: its TeX with the author's macros replaced, the line it begins in, the number that is printed beside
    it ("" where none is), its label, the title of its section; trouble: why its macros cannot be replaced, "" where they are."""

    latex: str
    line: int
    number: str = ""
    label: str = ""
    section: str = ""
    trouble: str = ""


class MacroError(MbdaeError):
    """A macro that cannot be replaced."""


def displays(text: str, markdown: bool = False) -> list[Display]:
    """The displayed equations of a file, in order; each row of `align`, `gather` and their like is one of its own, unless it goes
    on with the row before it."""
    text = _plain(text, markdown)
    macros = dict(_macros(text))
    if (begin := text.find(r"\begin{document}")) >= 0:
        text = "\n" * text.count("\n", 0, begin) + text[begin:]
    text = _with_displays(text, macros)
    within = re.search(r"\\numberwithin\{equation\}\{section\}", text) is not None
    out, count, section, title, parent = list[Display](), 0, 0, "", ""
    inner = 0
    for found in _FOUND.finditer(text):
        if found["heading"] or found["kind"] == "section":
            section, title = section + 1, (found["heading"] or found["title"]).strip()
            count = 0 if within else count
            continue
        if found["kind"]:
            if found["title"] == "subequations":
                count, inner = count + (found["kind"] == "begin"), 0
                parent = str(count) if found["kind"] == "begin" else ""
            continue
        body = next(found[n] for n in ("body", "bracket", "dollars", "fenced") if found[n] is not None)
        start = next(found.start(n) for n in ("body", "bracket", "dollars", "fenced") if found[n] is not None)
        counted = bool(found["env"]) and not found["star"] and found["env"] != "displaymath"
        for latex, at in _rows(body, found["env"] or ""):
            tag, label = _TAG.search(latex), _LABEL.search(latex + (found["after"] or "").replace("{#", r"\label{"))
            typed = re.search(r"\\q?quad\s*\(([\w.]+)\)[\s.,]*$", latex)  # numbers typed by hand stand after a gap
            latex = latex[: typed.start()] if typed else latex
            number = tag[1].strip("$ ") if tag else typed[1] if typed else ""
            if counted and not tag and not re.search(r"\\(nonumber|notag)\b", latex):
                inner, count = (inner + 1, count) if parent else (0, count + 1)
                number = (f"{section}." if within else "") + (f"{parent}{chr(96 + inner)}" if parent else str(count))
            clean = re.sub(r"\\(nonumber|notag)\b", "", _LABEL.sub("", _TAG.sub("", latex)))
            line = text.count("\n", 0, start + at + len(latex) - len(latex.lstrip())) + 1
            try:
                whole, trouble = _replaced(clean, macros).strip(), ""
            except (MacroError, RecursionError) as error:
                whole, trouble = clean.strip(), str(error)
            out.append(Display(whole, line, number, label[1] if label else "", title, trouble))
    return list(_joined(out))


def _plain(text: str, markdown: bool) -> str:
    """The text that is typeset: without comments, listings and code, and in TeX without what stands between `\iffalse` and `\fi`
    or after the end of the document, its lines kept; of what stands before its beginning the definitions alone."""
    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    if markdown:
        code = r"<!--.*?-->|^ *(`{3,}|~{3,})([^\n]*)\n.*?(?:^ *\1|\Z)|(?<!`)(`+)(?!`)(?:(?!\n\s*\n).)+?(?<!`)\3(?!`)"
        text = re.sub(code, lambda m: m[0] if (m[2] or "").strip() == "math" else f"{blank(m)} ", text, flags=re.S | re.M)
        return _without_indented(text)
    text = re.sub(r"\\verb\*?([^\w\s*]).*?\1", blank, text)
    text = re.sub(r"(?<!\\)((?:\\\\)*)%[^\n]*", r"\1", text)
    text = re.sub(r"\\begin\{(verbatim|Verbatim|lstlisting|minted|comment|filecontents)(\*?)\}.*?\\end\{\1\2\}", blank, text,
                  flags=re.S)
    text = re.sub(r"\\end\{document\}.*", blank, text, flags=re.S)
    hidden, depth, out, at = re.compile(r"\\(iffalse|if[a-zA-Z]+|else|fi)(?![a-zA-Z])"), 0, list[str](), 0
    for match in hidden.finditer(text):
        opens = match[1].startswith("if") and match[1] not in ("iff", "ifx") and (depth or match[1] == "iffalse")
        ends = depth and (match[1] == "fi" or (match[1] == "else" and depth == 1))
        if opens and not depth:
            out.append(text[at : match.start()])
            at = match.start()
        depth += 1 if opens else -1 if ends else 0
        if ends and not depth:
            out.append("\n" * text.count("\n", at, match.end()))
            at = match.end()
    return "".join([*out, "\n" * text.count("\n", at) if depth else text[at:]])


def _without_indented(text: str) -> str:
    """Markdown without code that is indented by four places after an empty line, which in a list is no code."""
    out, code, listed, before = list[str](), False, False, ""
    for line in text.split("\n"):
        if line.strip() and not line.startswith("    "):
            listed = re.match(r"\s*(?:[-*+]|\d+[.)])\s", line) is not None or (listed and line.startswith(" "))
        code = bool(line.strip()) and line.startswith("    ") and not listed and (code or not before.strip())
        out.append("" if code else line)
        before = "" if code else line
    return "\n".join(out)


def _rows(body: str, env: str) -> Iterator[tuple[str, int]]:
    """Rows of a display, each with its place; `\\\\` within braces or environments ends none. Columns of `align` come in pairs:
    between two pairs stands a gap, as between statements."""
    depth, start, at, split, columns = 0, 0, 0, env in _ROWS, 0
    body = re.sub(r"\\(?:short)?intertext\s*\{[^{}]*\}", lambda m: " " * len(m[0]), body)
    row = ""
    for token in tokens(body) if split else ():
        depth += (token in ("{", "\\begin")) - (token in ("}", "\\end"))
        at += len(token)
        if token == "\\\\" and depth == 0:
            yield re.sub(r"^\s*\[[\d.]+\s*[a-z]{2}\]", "", row), start
            start, row, columns = at, "", 0
            continue
        columns += token == "&" and depth == 0
        row += "\\quad " if token == "&" and depth == 0 and columns % 2 == 0 and "align" in env else token
    last = re.sub(r"^\s*\[[\d.]+\s*[a-z]{2}\]", "", row if split else body)
    if not split:
        last = re.sub(r"\\\\", " ", last) if not re.search(r"\\begin\{", last) else last
    if last.strip() or not start:
        yield last, start


def _joined(rows: Sequence[Display]) -> Iterator[Display]:
    """Rows that begin with a relation or a sign after `&`, or follow one that ends so, joined to the row before them."""
    held: Display | None = None
    for row in rows:
        if held is not None and held.section == row.section and _GOES_ON.match(row.latex):
            number, label = row.number or held.number, row.label or held.label
            held = replace(held, latex=f"{held.latex} {row.latex}", number=number, label=label)
            continue
        if held is not None:
            yield held
        held = row
    if held is not None:
        yield held


def _macros(text: str) -> Iterator[tuple[str, Macro]]:
    for found in _DEFINED.finditer(text):
        try:
            body = _group(text, found.end())
        except MacroError:  # where it is used, its name is said to be unknown
            continue
        if found["word"]:
            yield found["word"], (0, None, rf"\operatorname{{{body}}}")
        elif found["old"]:
            yield found["old"], (found["marks"].count("#"), None, body)
        else:
            yield found["new"], (int(found["count"] or 0), found["first"], body)


def _with_displays(text: str, macros: dict[str, Macro]) -> str:
    """The text in which definitions hold no displays, and macros that begin or end a display are replaced by what they stand
    for."""
    for found in reversed(list(_DEFINED.finditer(text))):
        with suppress(MacroError):
            end = found.end() + len(_group(text, found.end())) + 2
            text = text[: found.start()] + "\n" * text.count("\n", found.start(), end) + text[end:]
    for name, (count, _, body) in macros.items():
        if not count and re.search(rf"\\(?:begin|end)\s*\{{(?:{_NAMES})\*?\}}|\\\[|\\\]|\$\$", body):
            text = re.sub(rf"\\{name}(?![A-Za-z])[ \t]*", " ".join(body.split()).replace("\\", r"\\"), text)
    return text


def _group(text: str, at: int) -> str:
    """The text in the braces that open at a place."""
    depth, start = 0, at + 1
    for match in re.finditer(r"(?<!\\)[{}]", text[at:]):
        depth += 1 if match[0] == "{" else -1
        if depth == 0:
            return text[start : at + match.start()]
    raise MacroError(f"a macro has no end: {text[at : at + 40]!r}")


def _replaced(latex: str, macros: Mapping[str, Macro], depth: int = 0) -> str:
    """TeX with the macros of its author replaced by what they stand for."""
    if depth > DEEPEST:
        raise MacroError("macros contain each other without end")
    parts, out, i = tokens(latex), list[str](), 0

    def argument() -> str:
        nonlocal i
        while i < len(parts) and parts[i].isspace():
            i += 1
        if i >= len(parts):
            return ""
        if parts[i] != "{":
            i += 1
            return parts[i - 1]
        inside = _group("".join(parts[i:]), 0)
        i += len(tokens("{" + inside + "}"))
        return inside

    while i < len(parts):
        token = parts[i]
        i += 1
        if token[1:] not in macros or not token.startswith("\\"):
            out.append(token)
            continue
        count, first, body = macros[token[1:]]
        given = []
        if first is not None and count:
            if parts[i : i + 1] == ["["]:
                end = i + parts[i:].index("]")
                given, i = ["".join(parts[i + 1 : end])], end + 1
            else:
                given = [first]
        given += [argument() for _ in range(count - len(given))]
        for n, value in enumerate(given, 1):
            body = body.replace(f"#{n}", value)
        gap = " " if re.search(r"\\[A-Za-z]+$", body) else ""
        out.append(_replaced(body, macros, depth + 1) + gap)
    return "".join(out)
