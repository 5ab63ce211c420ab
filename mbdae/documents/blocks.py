"""The blocks of a document: text, equations, tables, pictures, and sections of them; tokens of formulas and where they break."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import count
from typing import Any, TypeVar

# -- Small vector drawings of lines, dots and letters, written as SVG for HTML pages and as TikZ for LaTeX


COLOURS = {"#333": "black!80", "#999": "black!40", "#0072b2": "blue!70!black", "#d55e00": "orange!80!black",
           "#009e73": "green!50!black"}
FONT = "system-ui, Liberation Sans, sans-serif"
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

    def svg(self) -> str:
        """The drawing as an SVG element."""
        body = "".join(self._svg_line(*mark[1:]) if mark[0] == "line" else self._svg_text(*mark[1:]) for mark in self.marks)
        size = f'viewBox="0 0 {self.width:g} {self.height:g}" width="{self.width:g}" font-family="{FONT}" font-size="13"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(self.title)}" {size}>{body}</svg>'

    @staticmethod
    def _svg_line(points: list[Point], colour: str, width: float, arrow: bool, fill: str) -> str:
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        shown = f'<path d="{path}" stroke="{colour}" stroke-width="{width:g}" fill="{fill or "none"}"/>'
        if not arrow:
            return shown
        (x0, y0), (x1, y1) = points[-2:]
        size = max(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5, 1e-9)
        u, v = (x1 - x0) / size, (y1 - y0) / size
        tip = [(x1, y1), (x1 - 8 * u + 3 * v, y1 - 8 * v - 3 * u), (x1 - 8 * u - 3 * v, y1 - 8 * v + 3 * u)]
        return shown + f'<path d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in tip)}Z" fill="{colour}"/>'

    @staticmethod
    def _svg_text(x: float, y: float, latex: str, anchor: str, colour: str) -> str:
        out = []
        for i, part in enumerate(latex.split("$")):
            if i % 2 == 0:
                out.append(escape(part))
                continue
            name, _, below = part.partition("_")
            bold = re.fullmatch(r"\\mathbf\{(.*)\}", name)
            style = "font-weight:700" if bold else "font-style:italic"
            letter = {r"\varphi": "φ"}.get(name, bold[1] if bold else name)
            out.append(f'<tspan style="{style}">{escape(letter)}</tspan>')
            if below:
                out.append(f'<tspan dy="4" font-size="10">{escape(below.strip("{}"))}</tspan><tspan dy="-4">\u200b</tspan>')
        return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{"".join(out)}</text>'

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

    @property
    def file(self) -> bytes | str:
        """Content of a file with this picture."""
        return self.content.svg() if isinstance(self.content, Drawing) else self.content


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
    lines: list[list[str]] = [[""]]
    depth, before = 0, ""
    for token in tokens(latex):
        if depth == 0 and token == r"\\":
            lines.append([""])
            before = ""
            continue
        if depth == 0 and token in RELATIONS | BINARY and before not in RELATIONS | BINARY | {"", ",", "^", "_", "/", r"\,"}:
            lines[-1].append("")
        lines[-1][-1] += token
        fence = before in (r"\left", r"\right")  # \left and \right are counted, so that brackets after them are not
        depth += 0 if fence else (token in _OPEN) - (token in _CLOSE)
        if depth == 0 and token in SPACES:
            lines[-1].append("")
        if token.strip():
            before = "" if token in SPACES else token
    return [[piece for piece in line if piece.strip()] for line in lines if any(piece.strip() for piece in line)]


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
        for part in parts:
            size = measure(part)
            if line and used + size > letters and line.strip() != parts[0].strip():
                lines.append(line)
                line, used = r"\quad " + part, size + 2
            else:
                line, used = line + part, used + size
        lines.append(line)
    return lines


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
