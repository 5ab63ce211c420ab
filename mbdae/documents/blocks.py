"""The blocks of a document: text, equations, tables, pictures, and sections of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
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


def curve(x: Any, y: Any, across: str, up: str) -> Drawing:
    """A curve y(x) with its axes; across, up: labels of the axes."""
    width, height, margin = 520, 260, 46
    low, high = min(0.0, float(min(y))), max(0.0, float(max(y)))
    span, first, last = (high - low) or 1.0, float(min(x)), float(max(x))

    def at(a: float, b: float) -> Point:
        return margin + (a - first) / (last - first) * (width - margin - 12), height - 34 - (b - low) / span * (height - 52)

    found = Drawing(width, height, f"{up} over {across}")
    found.line([at(first, 0), at(last, 0)], "#999")
    found.line([at(first, low), at(first, high)], "#999")
    found.line([at(float(a), float(b)) for a, b in zip(x, y, strict=True)], "#0072b2", 2)
    for value in dict.fromkeys((low, 0.0, high)):
        found.text(margin - 6, at(first, value)[1] + 4, f"{value:.3g}", "end")
    for value in (first, last):
        found.text(at(value, 0)[0], height - 18, f"{value:.3g}")
    found.text((width + margin) / 2, height - 4, across)
    found.text(margin + 6, 14, up, "start")
    return found


def pattern(entries: Any, n: int, title: str) -> Drawing:
    """Entries (row, column) of a square matrix as dots; in a large matrix neighbouring dots merge."""
    size = 420.0
    cell, found = size / max(n, 1), Drawing(size, size, title)
    found.line([(0, 0), (size, 0), (size, size), (0, size), (0, 0)], "#999")
    side = max(cell * 0.92, 0.7)
    for i, j in entries:
        x, y = j * cell, i * cell
        found.line([(x, y), (x + side, y), (x + side, y + side), (x, y + side)], "#0072b2", 0, fill="#0072b2")
    return found


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
