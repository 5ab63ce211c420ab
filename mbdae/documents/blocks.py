"""The blocks of a document: text, equations, tables, pictures, and sections of them; tokens of formulas and where they break."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, pairwise
from typing import Any, TypeVar

# -- Small vector drawings of lines, dots and letters, written as TikZ for LaTeX and as SVG for HTML pages (`html.svg`)


COLOURS = {"#333": "black!80", "#999": "black!40", "#0072b2": "blue!70!black", "#bf5400": "orange!80!black",
           "#008060": "green!50!black"}
Point = tuple[float, float]


@dataclass
class Drawing:
    """A drawing with width and height in pixels, y downwards, and a title in words."""

    width: float
    height: float
    title: str
    marks: list[tuple[Any, ...]] = field(default_factory=list)

    def line(self, points: Sequence[Point], colour: str = "#333", width: float = 1, arrow: bool = False, fill: str = "") -> None:
        """Draw a line through points (x, y), in pixels as the line's width; arrow: a head at its end; fill: colour of its
        inside."""
        self.marks.append(("line", [(float(x), float(y)) for x, y in points], colour, width, arrow, fill))

    def text(self, x: float, y: float, latex: str, anchor: str = "middle", colour: str = "#333") -> None:
        r"""Draw text at a point (pixels); a part between dollar signs is set as a symbol: letters, a subscript, `\mathbf`.
        anchor: which part of the text is at x, "start", "middle" or "end"."""
        self.marks.append(("text", float(x), float(y), latex, anchor, colour))

    def fit(self, margin: float = 22.0) -> None:
        """Shift the content into the drawing and set the drawing's size to that of its content plus a margin (pixels)."""
        points = [p for mark in self.marks for p in (mark[1] if mark[0] == "line" else [(mark[1], mark[2])])]
        (left, top), (right, low) = (tuple(pick(c) for c in zip(*points, strict=True)) for pick in (min, max))
        dx, dy = margin - left, margin - top
        self.width, self.height = right - left + 2 * margin, low - top + 2 * margin
        for i, mark in enumerate(self.marks):
            if mark[0] == "line":
                self.marks[i] = ("line", [(x + dx, y + dy) for x, y in mark[1]], *mark[2:])
            else:
                self.marks[i] = ("text", mark[1] + dx, mark[2] + dy, *mark[3:])

    def tikz(self) -> str:
        """The drawing for LaTeX, with the package tikz."""
        scale = min(0.03, 15.0 / self.width)
        lines = [rf"\begin{{tikzpicture}}[x={scale:.4f}cm,y=-{scale:.4f}cm,>=latex,font=\small]"]
        for mark in self.marks:
            if mark[0] == "line":
                _, points, colour, width, arrow, fill = mark
                path = " -- ".join(f"({x:.1f},{y:.1f})" for x, y in points)
                filled = f",fill={COLOURS.get(fill, 'black!8')}" if fill else ""
                drawn = f"{COLOURS.get(colour, 'black')},line width={0.5 * width:.2f}pt{',->' if arrow else ''}{filled}"
                lines.append(rf"\draw[{drawn}] {path};")
            else:
                _, x, y, latex, anchor, colour = mark
                side = {"start": "right,", "end": "left,"}.get(anchor, "")
                set_ = f"{side}text={COLOURS.get(colour, 'black')},inner sep=1pt"
                lines.append(rf"\node[{set_}] at ({x:.1f},{y - 4:.1f}) {{{latex}}};")
        return "\n".join([*lines, r"\end{tikzpicture}"])


T = TypeVar("T")


@dataclass(frozen=True)
class Paragraph:
    """Text; a part between two dollar signs is LaTeX mathematics, a backslash makes a dollar sign literal."""

    text: str


@dataclass(frozen=True)
class Equation:
    r"""A displayed equation in LaTeX (a double backslash starts a line), its number, and a remark in plain text with `$...$`."""

    latex: str
    number: int | str | None = None
    note: str = ""


@dataclass(frozen=True)
class Table:
    """A table; cells are text in which `$...$` is mathematics."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    folded: bool = False  #: whether an HTML page shows only the caption until it is opened


@dataclass(frozen=True)
class Code:
    """Text shown as it is, in a monospaced font."""

    text: str


@dataclass(frozen=True)
class Picture:
    """A picture (bytes of a PNG, text of an SVG, or a drawing) and its caption."""

    content: bytes | str | Drawing
    caption: str

    @property
    def suffix(self) -> str:
        """Suffix of a file with this picture."""
        return ".png" if isinstance(self.content, bytes) else ".svg"


@dataclass(frozen=True)
class Section:
    """Blocks under a title; its level follows from its nesting unless it is given (2 is the level below the document's title)."""

    title: str
    blocks: Sequence[Block] = ()
    level: int | None = None


Block = Paragraph | Equation | Table | Code | Picture | Section


def every(kind: type[T], blocks: Iterable[Block]) -> Iterator[T]:
    """All blocks of a kind, `Picture` or `Equation`, in the given blocks and their sections, in order."""
    for block in blocks:
        if isinstance(block, kind):
            yield block
        elif isinstance(block, Section):
            yield from every(kind, block.blocks)


def numbered(blocks: Sequence[Block], numbers: Iterator[int] | None = None) -> list[Block]:
    """The blocks with all equations numbered consecutively from 1."""
    numbers = count(1) if numbers is None else numbers
    out: list[Block] = []
    for block in blocks:
        if isinstance(block, Section):
            block = replace(block, blocks=numbered(block.blocks, numbers))
        out.append(replace(block, number=next(numbers)) if isinstance(block, Equation) else block)
    return out


# -- Splitting of LaTeX formulas: tokens, and the places where a long formula may be broken

_TOKEN = re.compile(r"\\[A-Za-z]+\*?|\\.|[^\\]", re.DOTALL)
_OPEN, _CLOSE = {"{", r"\left", r"\begin", "(", "[", r"\{", r"\lbrack"}, {"}", r"\right", r"\end", ")", "]", r"\}", r"\rbrack"}
#: relations; a line may be broken before them and before the signs of BINARY, outside of all brackets
RELATIONS = {"=", "<", ">", r"\le", r"\ge", r"\ne", r"\approx", r"\equiv", r"\Leftrightarrow", r"\Rightarrow", r"\in"}
BINARY = {"+", "-", r"\pm"}
#: commands that are as wide as their argument
AROUND = {rf"\{name}" for name in ["mathbf", "boldsymbol", "mathsf", "mathrm", "text", "dot", "ddot", "tilde", "bar", "sqrt"]}
SPACES = {r"\quad", r"\qquad"}
#: functions, which are as wide as their names
NAMED = {r"\sin", r"\cos", r"\tan", r"\exp", r"\ln", r"\arcsin", r"\arccos", r"\arctan", r"\sinh", r"\cosh", r"\tanh"}


def tokens(latex: str) -> list[str]:
    """Commands and characters of a formula, in order."""
    return _TOKEN.findall(latex)


def split_text(text: str) -> Iterator[tuple[bool, str]]:
    r"""Parts of a text with `$...$`, as (whether the part is mathematics, the part); `\$` is a dollar sign."""
    for i, part in enumerate(re.split(r"(?<!\\)\$", text)):
        if part:
            yield (True, part) if i % 2 else (False, part.replace(r"\$", "$"))


def escaped(text: str) -> str:
    """Text whose dollar signs do not start mathematics."""
    return text.replace("$", r"\$")


def pieces(latex: str) -> list[list[str]]:
    r"""Lines (separated by `\\` outside braces), each as a list of pieces between which it may be broken."""
    lines, parts = list[list[str]](), tokens(latex)
    ends = [i for i, depth in _breaks(parts, {r"\\"}) if not depth]
    for start, end in pairwise([0, *ends, len(parts)]):
        if not lines or (start and parts[start] == r"\\"):
            lines.append([])
        lines[-1].append("".join(parts[start + (parts[start : start + 1] == [r"\\"]) : end]))
    return [[piece for piece in line if piece.strip()] for line in lines if any(piece.strip() for piece in line)]


def inside(piece: str) -> list[str]:
    """A piece broken within its outermost brackets that hold sums; the brackets stay open over the lines, so that they no longer
    grow by themselves and get the size of what they hold. A piece that cannot be broken stays one."""
    parts = tokens(piece)
    if r"\middle" in parts:  # which TeX takes between brackets that grow alone
        return [piece]
    places = [(i, depth) for i, depth in _breaks(parts, set()) if i and "".join(parts[:i]).strip()]
    cuts = [i for i, depth in places if depth == min(d for _, d in places)]
    opened = list[int]()
    for i, token in enumerate(parts):
        if token == r"\left":
            opened.append(i)
        elif token == r"\right" and opened:
            start = opened.pop()
            if any(start < cut < i for cut in cuts):
                held = {*parts[start : i + 2]}
                size = r"\Bigg" if r"\begin" in held else r"\bigg" if r"\frac" in held else r"\big" if "." in held else ""
                parts[start], parts[i] = (f"{size}l", f"{size}r") if size else ("", "")
    return ["".join(parts[start:end]) for start, end in pairwise([0, *cuts, len(parts)])]


def _breaks(parts: Sequence[str], ends: set[str]) -> Iterator[tuple[int, int]]:
    """Places where a formula may be broken, in front of a token, and how many brackets are open there more than at its beginning:
    at signs between terms, behind spaces and at `ends`, not within scripts, fractions and tables."""
    depth, braces, before, gap = 0, 0, "", False
    for i, token in enumerate(parts):
        sign = token in RELATIONS | BINARY and before not in RELATIONS | BINARY | _OPEN | {"", ",", "^", "_", "/", r"\,"}
        if braces == 0 and (sign or gap or token in ends):
            yield i, depth
        fence = before in (r"\left", r"\right")  # \left and \right are counted, so that brackets after them are not
        change = 0 if fence else (token in _OPEN) - (token in _CLOSE)
        if braces or token in ("{", r"\begin"):
            braces += change
        else:
            depth += change
        gap = token in SPACES and not depth and not braces
        if token.strip():
            before = "" if token in SPACES | ends else token


def width(latex: str) -> float:
    """Estimated width of a formula in letters."""
    total, depth = 0.0, 0
    for token in tokens(re.sub(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right|begin|end|dot|tilde|hat|bar)\b", "", latex)):
        if token == "{":
            depth += 1
        elif token == "}":
            depth -= 1
        elif token.strip() and token not in {"^", "_", r"\,", r"\!", r"\;"}:
            total += 1.6 if token in RELATIONS | BINARY | {r"\times", r"\cdot"} else 0.8
    return total


def folded(latex: str, letters: float = 78.0, measure: Callable[[str], float] = width) -> list[str]:
    """A formula broken into lines of at most about `letters` where possible. measure: width of a part in letters."""
    lines: list[str] = []
    for parts in pieces(latex):
        line, used = "", 0.0
        for part, depth in (found for piece in parts for found in _narrow(piece, 0, letters, measure)):
            size = measure(part)
            if line and used + size > letters and line.strip() != parts[0].strip():
                lines.append(line)
                line, used = r"\quad " * (depth + 1) + part, size + 2 * (depth + 1)
            else:
                line, used = line + part, used + size
        lines.append(line)
    return lines


def _narrow(piece: str, depth: int, letters: float, measure: Callable[[str], float]) -> Iterator[tuple[str, int]]:
    """A piece, broken within brackets where it is wider than a line, and how deep its parts are in them."""
    parts = inside(piece) if measure(piece) > letters else [piece]
    if len(parts) == 1:
        yield piece, depth
    else:
        yield from (found for i, part in enumerate(parts) for found in _narrow(part, depth + (i > 0), letters, measure))


def extent(latex: str) -> float:
    """Estimated width of a formula in em: fractions by their longer part, matrices by their widest row, scripts small."""
    return _Extent(tokens(latex)).row(set())


class _Extent:
    """Estimates the widths (em) of the parts of a formula."""

    def __init__(self, parts: list[str]) -> None:
        self.parts, self.i = [t for t in parts if not t.isspace()], 0

    def row(self, stop: set[str]) -> float:
        """Width up to a token of `stop`, which is consumed."""
        total = 0.0
        while self.i < len(self.parts):
            token = self.parts[self.i]
            if token in stop:
                self.i += 1
                break
            total += self.atom()
        return total

    def atom(self) -> float:
        """Width of one symbol, group, fraction or matrix."""
        token = self.parts[self.i] if self.i < len(self.parts) else ""
        self.i += 1
        if token == "{":
            return self.row({"}"})
        if token in ("^", "_"):
            both = 0.62 * self.atom()
            other = self.i < len(self.parts) and self.parts[self.i] in ("^", "_")
            return max(both, self.atom()) if other else both
        if token in (r"\frac", r"\tfrac"):
            return max(self.atom(), self.atom()) + 0.3
        if token == r"\begin":
            return self.matrix()
        if token in (r"\left", r"\right"):
            self.i += 1
            return 0.5
        if token in AROUND:
            return self.atom()
        if token in NAMED:
            return 0.45 * len(token)
        if token in RELATIONS | BINARY | {r"\times", r"\cdot"}:
            return 1.25
        return 0.2 if token in (r"\,", "(", ")", ",") else 0.17 * len(token) if token in (r"\quad",) else 0.56

    def matrix(self) -> float:
        """Width of a matrix: sum of the widest cells of its columns."""
        cases = "".join(self.parts[self.i : self.i + 6]) == "{cases"
        self.atom()
        rows: list[list[float]] = [[0.0]]
        while self.i < len(self.parts) and self.parts[self.i] != r"\end":
            token = self.parts[self.i]
            if token in ("&", r"\\"):
                self.i += 1
                rows[-1].append(0.0) if token == "&" else rows.append([0.0])
            else:
                rows[-1][-1] += self.atom()
        self.i += 1
        self.atom()
        count = max(map(len, rows))
        wide = sum(max((r[j] for r in rows if j < len(r)), default=0.0) for j in range(count))
        return wide + 0.9 * count + (0.0 if cases else 0.4)
