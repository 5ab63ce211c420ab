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
