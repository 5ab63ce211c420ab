r"""Displayed equations of TeX and Markdown files, with the numbers, labels and macros of their authors.

Nothing that looks like a display is left out: what is not known, not closed or stands in another file is a display with the
reason why it is not read. Numbers counted after it are not known, so that the equations there have none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from mbdae.documents.blocks import tokens
from mbdae.documents.macros import MacroError, macros_of, replaced, switched, typeset, with_displays

_ROWS = ("align", "alignat", "flalign", "xalignat", "xxalignat", "gather", "eqnarray", "IEEEeqnarray")
_CASES = ("numcases", "subnumcases")
_NAMES = "|".join((*_ROWS, *_CASES, "equation", "multline", "displaymath", "dmath", "empheq"))
_WITHIN = r"(?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*"  #: text in which braces match, three deep
_TITLE = r"\\(?P<kind>chapter|section|begin|end)(?P<plain>\*?)\{(?P<title>[^{}]*(?:\{[^{}]*\}[^{}]*)*)\}"
_OPENS = (rf"\\begin\{{(?P<env>{_NAMES})(?P<star>\*?)\}}|(?<!\\)(?P<bracket>\\\[)|(?<!\\)(?P<dollars>\$\$)|"
          r"^(?P<fence>`{3,}|~{3,}) *(?:math|\{math\})[^\n]*$")
_FORMAT = rf"\\renewcommand\*?\s*\{{?\\theequation\}}?\s*\{{(?P<format>{_WITHIN})\}}"
_FOUND = re.compile(
    rf"{_OPENS}|\\end\{{(?P<closed>{_NAMES})\*?\}}|(?<!\\)(?P<closes>\\\])|{_TITLE}|"
    r"(?<!\\)(?P<inline>\$(?:[^$\\\n]|\\.|\n(?!\s*\n))+\$|\\\(.*?\\\))|"
    r"\\(?P<file>input|include|subfile|(?:sub)?import\s*\{[^{}]*\})(?![A-Za-z])\s*(?:\{(?P<name>[^{}]*)\}|(?P<word>[\w./-]+))|"
    rf"\\(?P<counter>setcounter|addtocounter|stepcounter|refstepcounter)\s*\{{equation\}}(?:\s*\{{(?P<to>{_WITHIN})\}})?|"
    r"(?P<appendix>\\appendix\b)|"
    rf"{_FORMAT}|"
    r"^(?P<hashes>#{1,3})[ \t]+(?P<heading>[^\n]+)$", re.S | re.M)
_STOPS = re.compile(rf"{_OPENS}|\\end\{{(?P<closed>{_NAMES})(?P<unnumbered>\*?)\}}|(?<!\\)(?P<closes>\\\])|"
                    r"\\(?:chapter|(?:sub)*section)\b|^#{1,3}[ \t]", re.S | re.M)
#: what begins or ends a display
_BEGINS = re.compile(rf"\\(?:begin|end)\s*\{{(?:{_NAMES})\*?\}}|\\\[|\\\]|\$\$|\\(?:end)?(?:{_NAMES})(?![A-Za-z])")
_GOES_ON = re.compile(r"(?:\s|\{\}|\\q?quad|\\[,;!])*&(?:\s|\{\})*(?:\\q?quad\s*)*&?\s*"
                      r"(?:(?P<relation>=|\\le|\\ge|\\approx)|\+|-|\\cdot|\\times)")
_TAG = re.compile(rf"\\tag\*?\s*\{{({_WITHIN})\}}")
_LABEL = re.compile(r"\\label\s*\{([^{}]*)\}|^\s*:label:\s*(\S+)\s*$", re.M)
_NO_NUMBER = re.compile(r"\\(?:IEEE)?(?:nonumber|notag)(?![A-Za-z])")
_LAYOUT = re.compile(r"\\IEEE(?:yesnumber|eqnarraynumspace|eqnarraystrut\w*)\*?(?![A-Za-z])|"
                     r"\\IEEEeqnarraymulticol\s*\{\d\}\s*\{\w+\}")
#: what stands in formulas only, signs between two sides, and text in whose arguments stands no formula
_MATH = re.compile(r"\\(?:[dt]?frac|d{0,3}dot|sqrt|sum|int|partial|math(?:bf|cal|sf|bb)|boldsymbol|vec|hat|tilde|bar|left|cdot|"
                   r"times|alpha|beta|gamma|delta|epsilon|theta|(?:var)?phi|psi|lambda|mu|rho|sigma|tau|omega|Omega|Delta)(?![A-Za-z])")
_SIGN = re.compile(r"=|\\(?:leq?|geq?|approx|equiv)(?![A-Za-z])|(?<![\w\\])[<>](?![\w/])")
_NO_FORMULA = re.compile(r"\\(?:label|\w*ref|cite\w*|includegraphics|url|href|text\w*|mbox|hspace|vspace|begin|end|item)\*?\s*"
                         r"(?:\[[^\]]*\]\s*)?(?:\{[^{}]*\})?|(?<!\\)\[[^\[\]]*\]")
_PAIR = re.compile(r"\\b(?P<of>[A-Za-z]{1,6})(?![A-Za-z]).*?\\e(?P=of)(?![A-Za-z])", re.S)
#: what environments take before their formulas
_TAKES = {
    **dict.fromkeys(("alignat", "xalignat", "xxalignat"), r"\s*\{\d+\}"),
    **dict.fromkeys(_CASES, rf"\s*\{{(?P<left>{_WITHIN})\}}"),
    "IEEEeqnarray": rf"\s*(?:\[[^\]]*\])?\s*\{{{_WITHIN}\}}", "dmath": r"\s*(?:\[(?P<options>[^\]]*)\])?",
    "empheq": r"\s*(?:\[(?P<options>(?:[^\[\]]|\[[^\]]*\])*)\])?\s*\{(?P<inner>\w+)(?P<star>\*?)(?:=\d+)?\}"}
_TYPED = re.compile(r"\\(?:q?quad\s*|l?eqno\s*)\(([\w.]+)\)[\s.,]*$")  #: numbers typed by hand stand after a gap
UNKNOWN = "the numbers of equations after it are not known either, which are named by their lines"


@dataclass(frozen=True)
class Display:
    """A displayed equation: its TeX with the author's macros replaced, the line it begins in, the number that is printed beside
    it ("" where none is, or none that is known), its label, the title of its section; trouble: why it cannot be read, "" where
    nothing is known against it."""

    latex: str
    line: int
    number: str = ""
    label: str = ""
    section: str = ""
    trouble: str = ""


@dataclass(frozen=True)
class _Piece:
    """What is displayed, or changes the numbers of what follows, with its place in the text. kinds: display, unread, chapter,
    section, appendix, begin, end, counter, format."""

    at: int
    kind: str
    body: str = ""
    env: str = ""
    trouble: str = ""


def displays(text: str, markdown: bool = False) -> list[Display]:
    """The displayed equations of a file, in order; each row of `align`, `gather` and their like is one of its own, unless it goes
    on with the row before it. What cannot be read as one is in its place too, with the reason."""
    text = typeset(text, markdown)
    macros, numbers = dict(macros_of(text)), _Numbers(text)
    if (begin := text.find(r"\begin{document}")) >= 0:
        text = "\n" * text.count("\n", 0, begin) + text[begin:]
    text = with_displays(text, macros, _BEGINS)
    text = re.sub(rf"\\(end)?({_NAMES})(?![A-Za-z@*])", lambda m: f"\\{m[1] or 'begin'}{{{m[2]}}}", text)  # of plain TeX
    out, title = list[Display](), ""
    for piece in sorted(_pieces(text, markdown), key=lambda p: p.at):
        line = text.count("\n", 0, piece.at) + 1
        trouble = piece.trouble or numbers.change(piece)
        if piece.kind.rstrip("*") in ("chapter", "section"):
            title = piece.body.strip()
        if trouble:
            out.append(Display(" ".join(_LABEL.sub("", piece.body).split()), line, "", _label(piece.body), title, trouble))
            numbers.known = False
        elif piece.kind == "display":
            rows = list[Display]()
            for latex, at in _rows(piece.body, piece.env.rstrip("*")):
                number = numbers.of(latex, piece.env)
                clean = latex
                for left_out in (_LABEL, _TAG, _TYPED, _NO_NUMBER, _LAYOUT):
                    clean = left_out.sub("", clean)
                line = text.count("\n", 0, piece.at + at + len(latex) - len(latex.lstrip())) + 1
                try:
                    whole, why = switched(replaced(clean, macros)).strip(), ""
                except (MacroError, RecursionError) as error:
                    whole, why = clean.strip(), str(error)
                rows.append(Display(whole, line, number, _label(latex), title, why))
            out += _joined(rows)
    return out


def _label(latex: str) -> str:
    found = _LABEL.search(latex)
    return (found[1] or found[2]) if found else ""


class _Numbers:
    """Counts equations as TeX does; known: whether the count is certain."""

    def __init__(self, text: str) -> None:
        within = re.search(r"\\(?:numberwithin|counterwithin|@addtoreset)\*?\s*\{equation\}\s*\{(\w+)\}", text)
        book = re.search(r"\\documentclass\s*(?:\[[^\]]*\])?\s*\{(?:report|book|scrbook|scrreprt|memoir)\}", text)
        self.within = within[1] if within else "chapter" if book else ""
        self.format = (rf"\the{self.within}." if self.within else "") + r"\arabic{equation}"
        before = re.search(rf"{_FORMAT}(?=.*\\begin\{{document\}})", text, re.S)
        self.format = before["format"] if before else self.format
        self.known, self.letters = True, False
        self.count = self.chapter = self.section = self.inner = 0
        self.parent = ""

    def change(self, piece: _Piece) -> str:
        """What a piece of the text changes; the reason where the numbers after it cannot be known, else ""."""
        if piece.kind in ("chapter", "section"):
            self.section = 0 if piece.kind == "chapter" else self.section + 1
            self.chapter += piece.kind == "chapter"
            if self.within == piece.kind or (self.within and piece.kind == "chapter"):
                self.count, self.known = 0, True
        elif piece.kind == "appendix":
            self.letters, self.chapter, self.section = True, 0, 0
        elif piece.kind == "format":
            self.format = piece.body
        elif piece.kind in ("begin", "end"):
            self.count, self.inner = self.count + (piece.kind == "begin"), 0
            self.parent = self._print() if piece.kind == "begin" else ""
        elif piece.kind == "counter":
            to = piece.body.strip() or "1"
            if not re.fullmatch(r"-?\d+", to):
                return f"it sets the numbers of equations to `{to}`: {UNKNOWN}"
            self.known = self.known or piece.env == "setcounter"
            self.count = int(to) if piece.env == "setcounter" else self.count + int(to)
        return ""

    def of(self, latex: str, env: str) -> str:
        """The number that is printed beside a display, or a row of one: what its author typed, else the next of the count."""
        tag, typed = _TAG.search(latex), _TYPED.search(latex)
        counted = env not in ("", "displaymath") and not tag and not _NO_NUMBER.search(latex)
        if not counted or (env.endswith("*") and not re.search(r"\\IEEEyesnumber(?![A-Za-z])", latex)):
            return tag[1].strip("$ ()") if tag else typed[1] if typed else ""
        if env in _CASES:
            rows = len([row for row in re.split(r"\\\\", latex) if row.strip()])
            self.count += 1 if env == "subnumcases" else rows
            return self._print(self.count + (0 if env == "subnumcases" else 1 - rows))
        self.inner, self.count = (self.inner + 1, self.count) if self.parent else (0, self.count + 1)
        if not self.parent:
            return self._print()
        return f"{self.parent}{chr(96 + self.inner)}" if self.known and self.inner < 27 else ""

    def _print(self, count: int | None = None) -> str:
        """A number as it is printed; "" where that is not known."""
        chapter, section = (chr(64 + n) if self.letters and n else str(n) for n in (self.chapter, self.section))
        whole = {r"\thechapter": chapter, r"\thesection": f"{self.chapter}.{section}" if self.chapter else section,
                 r"\arabic{chapter}": str(self.chapter), r"\arabic{section}": str(self.section),
                 r"\Alph{section}": chr(64 + self.section), r"\arabic{equation}": str(self.count if count is None else count)}
        text = self.format
        for name, value in whole.items():
            text = text.replace(name, value)
        text = text.removeprefix("0.") if self.within == "chapter" else text
        return text.replace("{", "").replace("}", "").strip() if self.known and "\\" not in text else ""


def _pieces(text: str, markdown: bool) -> Iterator[_Piece]:
    """What a text displays and what changes its numbers; of the rest, what looks like a formula."""
    rest, at = list[str](), 0
    while found := _FOUND.search(text, at):
        start, end = found.span()
        opened = found["env"] or found["bracket"] or found["dollars"] or found["fence"]
        if opened:
            piece, end = _displayed(text, found)
            yield piece
        elif found["closed"] or found["closes"]:
            yield _Piece(start, "unread", found[0], trouble=f"`{found[0]}` closes no display that is open; {UNKNOWN}")
        elif found["kind"] in ("chapter", "section"):
            yield _Piece(start, found["kind"] + found["plain"], found["title"])
        elif found["title"] == "subequations":
            yield _Piece(start, found["kind"])
        elif found["title"] == "dgroup" and found["kind"] == "begin":
            yield _Piece(start, "unread", found[0], trouble=f"how `dgroup` counts is not known; {UNKNOWN}")
        elif found["file"] and not re.search(r"\.(tikz|pgf|pdf_tex)$", name := found["name"] or found["word"]):
            why = f"what `{name}` displays is not read: put its text here, or audit it as a file of its own; {UNKNOWN}"
            yield _Piece(start, "unread", found[0], trouble=why)
        elif found["counter"]:
            yield _Piece(start, "counter", found["to"] or "", found["counter"])
        elif found["appendix"] or found["format"] is not None or found["heading"]:
            kind = "appendix" if found["appendix"] else "section" if found["heading"] else "format"
            yield _Piece(start, kind, found["heading"] or found["format"] or "")
        blank = ("\f" if opened else " ") + re.sub(r"[^\n]", " ", text[start + 1 : end])
        rest += [text[at:start], text[start:end] if found["kind"] in ("begin", "end") else blank]
        at = end
    yield from _outside("".join([*rest, text[at:]]), markdown)


def _displayed(text: str, found: re.Match[str]) -> tuple[_Piece, int]:
    """The display that opens at a place, and where the text goes on."""
    start, env, star = found.end(), found["env"] or "", found["star"] or ""
    given = re.compile(_TAKES.get(env, ""), re.S).match(text, start)
    if given is None:
        return _Piece(found.start(), "unread", found[0], trouble=f"after `{found[0]}` stands not what it takes; {UNKNOWN}"), start
    start, inside = given.end(), given.groupdict()
    opened = rf"\end{{{env}{star}}}" if env else r"\]" if found["bracket"] else found["dollars"] or found["fence"]
    ends = re.compile(rf"^[ >]*{found['fence']}[`~]*[ \t]*$", re.M) if found["fence"] else _STOPS
    stop, empty = ends.search(text, start), re.compile(r"\n[ \t]*\n").search(text, start)
    while stop and not found["fence"] and stop["dollars"] and not found["dollars"]:
        stop = ends.search(text, stop.end())
    closed = stop is not None and (stop[0] == opened or bool(found["fence"]))
    if stop is None or not closed or (found["dollars"] and empty and empty.start() < stop.start()):
        end = min([m.start() for m in (stop, empty) if m] or [len(text)])
        wrong = stop is not None and stop.start() == end and bool(stop["closed"] or stop["closes"])
        why = (f"it is closed by `{stop[0]}`" if stop and wrong else
               f"it is not closed by `{opened}` before line {text.count(chr(10), 0, end) + 1}")
        piece = _Piece(found.start(), "unread", text[found.start() : end], trouble=f"{why}; {UNKNOWN}")
        return piece, stop.end() if stop and wrong else end
    body, options, end = text[start : stop.start()], inside.get("options") or "", stop.end()
    left = re.search(r"left\s*=\s*(?!\{?\\empheq\w+\}?\s*(?:,|$))", options)
    if env == "empheq" and (left or not re.fullmatch(_NAMES, inside["inner"])):
        why = f"what `empheq` puts beside its formulas, `{options}`, is not read; {UNKNOWN}"
        return _Piece(found.start(), "unread", body, trouble=why), end
    if env in _CASES:
        body = f"{inside['left']} \\begin{{cases}}{_with_words(body)}\\end{{cases}}"
    if after := re.compile(r"[ \t]*\{#([^}\s]*)[^}]*\}").match(text, end) if found["dollars"] else None:
        body, end = f"{body}\\label{{{after[1]}}}", after.end()
    if label := re.search(r"label\s*=\s*\{?([^{},]+)", options) if env == "dmath" else None:
        body += f"\\label{{{label[1]}}}"
    if re.search(r"^[ \t]*>[^\n]*\Z", text[: found.start()], re.M):  # in a quotation of Markdown
        body = re.sub(r"\n[ \t]*>", "\n ", body)
    return _Piece(start, "display", body, inside.get("inner", env) + (inside.get("star") or star)), end


def _with_words(body: str) -> str:
    """Rows of `numcases`, whose second column is text with formulas between dollars, as those of `cases`."""
    rows = []
    for row in re.split(r"\\\\", body):
        value, sign, told = row.partition("&")
        parts = [part if i % 2 else f"\\text{{{part.strip()}}}" if part.strip() else "" for i, part in enumerate(told.split("$"))]
        rows.append(value + sign + " ".join(parts))
    return r"\\".join(rows)


def _outside(rest: str, markdown: bool) -> Iterator[_Piece]:
    """What stands outside of all displays and looks like a formula: in an environment or between macros that are not known."""
    edges = {0, len(rest), *(m.end() for m in re.finditer(r"\n\s*\n|\f", rest))}
    for m in re.finditer(r"\\(begin|end)\{(?!aligned|split|d?cases|[bpvBV]?matrix|array|gathered)[^{}]*\}", rest):
        edges.add(m.start() if m[1] == "begin" else m.end())
    for start, end in pairwise(sorted(edges)):
        block = rest[start:end]
        said = _NO_FORMULA.sub(" ", block)
        while (shorter := _NO_FORMULA.sub(" ", said)) != said:
            said = shorter
        pair = None if markdown else _PAIR.search(block)
        typed = not markdown and (pair or re.search(r"(?<!\\)[_^]", said) or not re.search(r"(?<![\\A-Za-z])[A-Za-z]{3,}", said))
        if not _SIGN.search(said) or not (typed or _MATH.search(said)):
            continue
        within = re.search(r"\\begin\{([^{}]*)\}", block)
        where = (f"the environment `{within[1]}` is not known" if within else "it stands outside of all displays" if not pair else
                 f"the macros `\\b{pair['of']}` and `\\e{pair['of']}` are defined nowhere in this file")
        yield _Piece(start + len(block) - len(block.lstrip()), "unread", block.strip(),
                     trouble=f"{where}: it looks like a formula and is not read; {UNKNOWN}")


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
        on = _GOES_ON.match(row.latex)
        if on and not on["relation"] and held is not None:  # a row that begins with a sign may be an equation of its own
            on = on if not re.match(r"\s*&", held.latex) or not re.search("=", row.latex) else None
        if held is not None and not held.trouble and on:
            number, label = row.number or held.number, row.label or held.label
            held = replace(held, latex=f"{held.latex} {row.latex}", number=number, label=label)
            continue
        if held is not None:
            yield held
        held = row
    if held is not None:
        yield held
