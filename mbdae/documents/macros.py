r"""The TeX that a file typesets: without comments, listings and code, with the macros of its author replaced."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress

from mbdae.documents.blocks import tokens
from mbdae.errors import MbdaeError

Macro = tuple[int, str | None, str]  #: number of arguments, what stands for the first where it is left out, and the text
_DEFINED = re.compile(r"\\(?:(?:re|provide)?newcommand|DeclareRobustCommand)\*?\s*\{?\\(?P<new>[A-Za-z]+)\}?\s*"
                      r"(?:\[(?P<count>\d)\])?\s*(?:\[(?P<first>[^\]]*)\])?\s*(?=\{)|\\def\s*\\(?P<old>[A-Za-z]+)(?P<marks>(?:#\d)*)\s*(?=\{)|"
                      r"\\DeclareMathOperator(?P<stars>\*?)\s*\{?\\(?P<word>[A-Za-z]+)\}?\s*(?=\{)|"
                      r"\\(?:re)?newenvironment\*?\s*\{(?P<around>\w+)(?P<like>\*?)\}\s*(?:\[(?P<given>\d)\])?\s*(?:\[(?P<default>[^\]]*)\])?\s*(?=\{)|"
                      r"\\let\s*\\(?P<same>[A-Za-z]+)\s*=?\s*\\(?P<as>[A-Za-z]+)")
#: derivatives of the packages physics, commath and derivative, with the sign of the differentials
DERIVATIVES = {r"\dv": "d", r"\od": "d", r"\odv": "d", r"\pdv": r"\partial", r"\pd": r"\partial"}
#: commands that change the font up to the end of a group, as commands with an argument
SWITCHES = {r"\rm": "mathrm", r"\bf": "mathbf", r"\it": "mathit", r"\sf": "mathsf", r"\cal": "mathcal", r"\mit": "mathnormal",
            r"\sl": "mathit", r"\tt": "mathrm"}
ENDS = {"}", "&", "\\\\", r"\right", r"\end"}  #: what ends a group
DEEPEST = 40  #: macros within macros that are replaced


class MacroError(MbdaeError):
    """A macro that cannot be replaced."""


def typeset(text: str, markdown: bool) -> str:
    r"""The text that is typeset: without comments, listings and code, and in TeX without what stands between `\iffalse` and `\fi`
    or after the end of the document, its lines kept; of what stands before its beginning the definitions alone."""
    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    if markdown:
        code = r"<!--.*?-->|^ *(`{3,}|~{3,})([^\n]*)\n.*?(?:^ *\1|\Z)|(?<!`)(`+)(?!`)(?:(?!\n\s*\n).)+?(?<!`)\3(?!`)"
        shown = ("math", "{math}")
        text = re.sub(code, lambda m: m[0] if (m[2] or "").strip() in shown else f"{blank(m)} ", text, flags=re.S | re.M)
        return _without_indented(text)
    text = re.sub(r"\\verb\*?([^\w\s*]).*?\1", blank, text)
    text = re.sub(r"(?<!\\)((?:\\\\)*)%[^\n]*", r"\1", text)
    text = re.sub(r"\\(begin|end)[ \t]*\{[ \t]*([A-Za-z]+\*?)[ \t]*\}", r"\\\1{\2}", text)
    listings = "verbatim|Verbatim|lstlisting|minted|comment|filecontents|tikzpicture|pgfpicture|picture"
    text = re.sub(rf"\\begin\{{({listings})(\*?)\}}.*?\\end\{{\1\2\}}", blank, text, flags=re.S)
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


def macros_of(text: str) -> Iterator[tuple[str, Macro]]:
    r"""The macros that a text defines; of an environment \begin{name} and \end{name}."""
    for found in _DEFINED.finditer(text):
        try:
            body = "" if found["same"] else _group(text, found.end())
            ends = re.compile(r"\s*(?=\{)").match(text, found.end() + len(body) + 2) if found["around"] else None
            if found["same"]:
                yield found["same"], (0, None, f"\\{found['as']}")
            elif found["word"]:
                yield found["word"], (0, None, rf"\operatorname{{{body}}}")
            elif found["old"]:
                yield found["old"], (found["marks"].count("#"), None, body)
            elif found["new"]:
                yield found["new"], (int(found["count"] or 0), found["first"], body)
            elif ends:
                name = found["around"] + found["like"]
                yield f"begin{{{name}}}", (int(found["given"] or 0), found["default"], body)
                yield f"end{{{name}}}", (0, None, _group(text, ends.end()))
        except MacroError:  # where it is used, its name is said to be unknown
            continue


def with_displays(text: str, macros: dict[str, Macro], begins: re.Pattern[str]) -> str:
    """The text in which definitions hold no displays, and environments and macros that begin or end a display are replaced by
    what they stand for. begins: what begins or ends a display."""
    for found in reversed(list(_DEFINED.finditer(text))):
        with suppress(MacroError):
            end = found.end() if found["same"] else found.end() + len(_group(text, found.end())) + 2
            if found["around"] and (ends := re.compile(r"\s*(?=\{)").match(text, end)):
                end = ends.end() + len(_group(text, ends.end())) + 2
            if found["new"] != "theequation":
                text = text[: found.start()] + "\n" * text.count("\n", found.start(), end) + text[end:]
    said = {name: body for name, (_, _, body) in macros.items()}
    wanted = {name for name in macros if name.startswith(("begin{", "end{"))}
    for _ in range(DEEPEST):
        used = re.compile(r"\\(?:" + "|".join(re.escape(n) + r"(?![A-Za-z])" for n in sorted(wanted)) + ")") if wanted else begins
        wanted = wanted | {name for name, body in said.items() if begins.search(body) or used.search(body)}
    for _ in range(DEEPEST if wanted else 0):
        names = "|".join(re.escape(name) + ("" if name.endswith("}") else r"(?![A-Za-z])") for name in sorted(wanted))
        new = re.sub(rf"\\({names})[ \t]*", lambda m: f"\0{m[1]}\0", text)
        if new == text:
            break
        text = _in_place(new, macros)
    return text


def _in_place(text: str, macros: Mapping[str, Macro]) -> str:
    """The text with the macros that are marked, each between two zeros, replaced; lines stay where they are."""
    out, at = list[str](), 0
    while (start := text.find("\0", at)) >= 0:
        end = text.index("\0", start + 1)
        name, stop = text[start + 1 : end], end + 1
        count, first, body = macros[name]
        given = list[str]()
        while len(given) < count:
            if not given and first is not None:
                option = re.compile(r"\s*\[([^\]]*)\]").match(text, stop)
                given, stop = [option[1] if option else first], option.end() if option else stop
                continue
            rest = re.compile(r"\s*").match(text, stop)
            place = rest.end() if rest else stop
            try:
                inside = _group(text, place) if text[place : place + 1] == "{" else text[place : place + 1]
            except MacroError:
                inside = ""
            given, stop = [*given, inside], place + len(inside) + 2 * (text[place : place + 1] == "{")
        for n, value in enumerate(given, 1):
            body = body.replace(f"#{n}", value)
        whole = " ".join(body.split()) + (" " if re.search(r"\\[A-Za-z]+$", body) else "")
        out += [text[at:start], whole, "\n" * text.count("\n", end, stop)]
        at = stop
    return "".join([*out, text[at:]]).replace("\0", "\\")


def _group(text: str, at: int) -> str:
    """The text in the braces that open at a place."""
    depth, start = 0, at + 1
    for match in re.finditer(r"(?<!\\)[{}]", text[at:]):
        depth += 1 if match[0] == "{" else -1
        if depth == 0:
            return text[start : at + match.start()]
    raise MacroError(f"a macro has no end: {text[at : at + 40]!r}")


def replaced(latex: str, macros: Mapping[str, Macro], depth: int = 0) -> str:
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
        if token in DERIVATIVES and token[1:] not in macros:
            i += parts[i : i + 1] == ["*"]
            end = i + parts[i:].index("]") if parts[i : i + 1] == ["["] and "]" in parts[i:] else i - 1
            order, i, given = "".join(parts[i + 1 : end]).rpartition("=")[2], end + 1, list[str]()
            while len(given) < 3 and "".join(parts[i:]).lstrip()[:1] == "{":
                given.append(replaced(argument(), macros, depth + 1))
            out.append(_derivative(DERIVATIVES[token], order, given))
            continue
        if token[1:] not in macros or not token.startswith("\\"):
            out.append(token)
            continue
        count, first, body = macros[token[1:]]
        given = list[str]()
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
        out.append(replaced(body, macros, depth + 1) + gap)
    return "".join(out)


def _derivative(sign: str, order: str, given: list[str]) -> str:
    """A derivative as a fraction. given: what stands in its braces, the letters by which it derives last."""
    by = given[1:] or given
    by = [letter for one in by for letter in one.split(",")]
    power = f"^{{{order or len(by)}}}" if order or len(by) > 1 else ""
    below = "".join(f"{sign} {letter}" + (power if len(by) == 1 else "") for letter in by)
    return rf"\frac{{{sign}{power} {given[0] if given[1:] else ''}}}{{{below}}}"


def switched(latex: str) -> str:
    """TeX in which fonts that hold up to the end of a group, as in `k_{\\rm s}`, are commands with an argument."""
    parts, out, i = tokens(latex), list[str](), 0
    while i < len(parts):
        font, i = SWITCHES.get(parts[i]), i + 1
        if font is None:
            out.append(parts[i - 1])
            continue
        end, depth = i, 0
        while end < len(parts) and not (depth == 0 and (parts[end] in SWITCHES or parts[end] in ENDS)):
            depth += {"{": 1, "\\left": 1, "\\begin": 1, "}": -1, "\\right": -1, "\\end": -1}.get(parts[end], 0)
            end += 1
        inside = "".join(parts[i:end]).strip()
        out.append(f"\\{font}{{{inside}}}" if inside else "")
        i = end
    return "".join(out)
