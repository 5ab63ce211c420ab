"""A document to be read by people: sections of text, equations, tables and pictures, written as HTML, Markdown or LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mbdae.files import write_file
from mbdae.values import file_to_write, option


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


@dataclass(frozen=True)
class Code:
    """Text as it stands, in letters of equal width."""

    text: str


@dataclass(frozen=True)
class Picture:
    """A picture (PNG as bytes, or the text of an SVG) and what it shows."""

    content: bytes | str
    caption: str

    @property
    def suffix(self) -> str:
        """Of a file that holds it."""
        return ".png" if isinstance(self.content, bytes) else ".svg"


@dataclass(frozen=True)
class Section:
    """Blocks under a title; its level follows from where it stands unless it is given (2 below the document's title)."""

    title: str
    blocks: Sequence[Block] = ()
    level: int | None = None


Block = Paragraph | Equation | Table | Code | Picture | Section


@dataclass(frozen=True)
class Document:
    """A title and blocks."""

    title: str
    blocks: Sequence[Block] = field(default=())

    def to_html(self) -> str:
        """One page that needs nothing else: mathematics as MathML, pictures inside."""
        from mbdae.documents.html import html

        return html(self)

    def to_markdown(self) -> str:
        """Markdown with mathematics between dollar signs; of a picture its caption."""
        from mbdae.documents.markdown import markdown

        return markdown(self)

    def to_latex(self) -> str:
        """A LaTeX article that needs no package beyond a basic installation; of a picture its caption."""
        from mbdae.documents.latex import latex

        return latex(self)

    def save(self, path: str | Path) -> Path:
        """Write the format of the suffix, .html, .md or .tex; returns the path.

        Pictures are inside the page of .html; beside .md and .tex they are files of their own."""
        file: Path = option("path", path, file_to_write, "a report is written as .html, .md or .tex into a folder that exists",
                            suffixes=(".html", ".md", ".tex"))  # fmt: skip
        writers: dict[str, Callable[[], str]] = {
            ".html": self.to_html, ".md": lambda: self._beside(file), ".tex": lambda: self._beside(file),
        }  # fmt: skip
        return write_file(file, writers[file.suffix.lower()]())

    def _beside(self, file: Path) -> str:
        """Text with its pictures in files beside it (LaTeX reads no SVG: there of an SVG the caption only)."""
        from mbdae.documents.latex import latex
        from mbdae.documents.markdown import markdown

        files = {}
        for i, picture in enumerate(self.pictures()):
            if picture.suffix == ".png" or file.suffix.lower() == ".md":
                place = file.with_name(f"{file.stem}-{i + 1}{picture.suffix}")
                write_file(place, picture.content)
                files[id(picture)] = place.name
        return (markdown if file.suffix.lower() == ".md" else latex)(self, files)

    def pictures(self) -> Iterator[Picture]:
        """All pictures in their order."""
        yield from _pictures(self.blocks)


def _pictures(blocks: Sequence[Block]) -> Iterator[Picture]:
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Section):
            yield from _pictures(block.blocks)
