r"""Displayed equations of TeX and Markdown files, with the numbers, labels and macros of their authors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
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
    it ("" where none is), its label, the title of its section."""

    latex: str
    line: int
    number: str = ""
    label: str = ""
    section: str = ""


class MacroError(MbdaeError):
    """A macro that cannot be replaced."""


def displays(text: str, markdown: bool = False) -> list[Display]:
    """The displayed equations of a file, in order; each row of `align`, `gather` and their like is one of its own, unless it goes
    on with the row before it."""
    text = _plain(text, markdown)
    macros = dict(_macros(text))
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
            out.append(Display(_replaced(clean, macros).strip(), line, number, label[1] if label else "", title))
    return list(_joined(out))


def _plain(text: str, markdown: bool) -> str:
    """The text without comments and listings, its lines kept."""
    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    if markdown:
        fences = r"<!--.*?-->|^(`{3,}|~{3,})([^\n]*)\n.*?^\1"
        text = re.sub(fences, lambda m: m[0] if (m[2] or "").strip() == "math" else blank(m), text, flags=re.S | re.M)
    else:
        text = re.sub(r"(?<!\\)((?:\\\\)*)%[^\n]*", r"\1", text)
        text = re.sub(r"\\begin\{(verbatim|lstlisting|comment)\}.*?\\end\{\1\}", blank, text, flags=re.S)
    return text


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
        body = _group(text, found.end())
        if found["word"]:
            yield found["word"], (0, None, rf"\operatorname{{{body}}}")
        elif found["old"]:
            yield found["old"], (found["marks"].count("#"), None, body)
        else:
            yield found["new"], (int(found["count"] or 0), found["first"], body)


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
