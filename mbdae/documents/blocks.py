"""The blocks of a document: text, equations, tables, pictures, and sections of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TypeVar

from mbdae.documents.drawing import Drawing

T = TypeVar("T")


@dataclass(frozen=True)
class Paragraph:
    """Text; what stands between two dollar signs is LaTeX mathematics, a backslash makes a dollar sign plain."""

    text: str


@dataclass(frozen=True)
class Equation:
    r"""A displayed equation in LaTeX (a double backslash starts a line), its number and a remark in plain text with `$...$`."""

    latex: str
    number: int | str | None = None
    note: str = ""


@dataclass(frozen=True)
class Table:
    """Cells are text in which `$...$` is mathematics."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    folded: bool = False  #: whether a page shows its caption alone until it is opened


@dataclass(frozen=True)
class Code:
    """Text as it stands, in letters of equal width."""

    text: str


@dataclass(frozen=True)
class Picture:
    """A picture (PNG as bytes, the text of an SVG, or a drawing) and what it shows."""

    content: bytes | str | Drawing
    caption: str

    @property
    def suffix(self) -> str:
        """Of a file that holds it."""
        return ".png" if isinstance(self.content, bytes) else ".svg"

    @property
    def file(self) -> bytes | str:
        """What stands in that file."""
        return self.content.svg() if isinstance(self.content, Drawing) else self.content


@dataclass(frozen=True)
class Section:
    """Blocks under a title; its level follows from where it stands unless it is given (2 below the document's title)."""

    title: str
    blocks: Sequence[Block] = ()
    level: int | None = None


Block = Paragraph | Equation | Table | Code | Picture | Section


def every(kind: type[T], blocks: Iterable[Block]) -> Iterator[T]:
    """All blocks of a kind, `Picture` or `Equation`, in blocks and their sections, in order."""
    for block in blocks:
        if isinstance(block, kind):
            yield block
        elif isinstance(block, Section):
            yield from every(kind, block.blocks)


def numbered(blocks: Sequence[Block], numbers: Iterator[int] | None = None) -> list[Block]:
    """The same blocks with consecutive numbers, from 1, at all equations."""
    numbers = count(1) if numbers is None else numbers
    out: list[Block] = []
    for block in blocks:
        if isinstance(block, Section):
            block = replace(block, blocks=numbered(block.blocks, numbers))
        out.append(replace(block, number=next(numbers)) if isinstance(block, Equation) else block)
    return out
