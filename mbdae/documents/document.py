"""A document for people to read: a title over blocks, written as HTML, Markdown or LaTeX."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from mbdae.display import framed
from mbdae.documents.blocks import Block, Picture, Section, every
from mbdae.documents.html import html
from mbdae.documents.latex import latex
from mbdae.documents.markdown import markdown
from mbdae.errors import NamesArguments, OptionError
from mbdae.files import write_file
from mbdae.values import file_to_write, option, shown

COMPILERS = ("pdflatex", "lualatex")
INSTALL_TEX = "install TeX (Debian: texlive-latex-recommended, texlive-pictures, lmodern)"


@dataclass(frozen=True)
class Document(NamesArguments):
    """A title and blocks, which can be written as HTML, Markdown, LaTeX or PDF."""

    title: str
    blocks: Sequence[Block] = ()

    def __repr__(self) -> str:
        sections = ", ".join(block.title for block in self.blocks if isinstance(block, Section))
        return f"Document({self.title!r}: {sections or 'no sections'}; .save(path) writes .html, .md, .tex or .pdf)"

    def to_html(self) -> str:
        """An HTML page that loads no other file: mathematics as MathML, pictures embedded."""
        return html(self.title, self.blocks)

    def to_markdown(self) -> str:
        """Markdown with mathematics between dollar signs; pictures are replaced by their captions."""
        return markdown(self.title, self.blocks)

    def to_latex(self) -> str:
        """A LaTeX article that needs only packages of a basic installation; pictures are replaced by their captions."""
        return latex(self.title, self.blocks)

    def _repr_html_(self) -> str:
        return framed(self.to_html())

    def save(self, path: str | Path) -> Path:
        """Write the document in the format of the suffix, .html, .md, .tex or .pdf; returns the path.

        Pictures are embedded in .html; for .md and .tex they become files next to it. A .pdf needs lualatex or pdflatex
        (Debian: texlive-latex-recommended, texlive-pictures, lmodern). Raises OptionError without them, or for another suffix."""
        file: Path = option("path", path, file_to_write, "write .html, .md, .tex or .pdf into a folder that exists",
                            suffixes=(".html", ".md", ".tex", ".pdf"))  # fmt: skip
        if file.suffix.lower() == ".pdf":
            return self._typeset(file)
        writers: dict[str, Callable[[], str]] = {
            ".html": self.to_html, ".md": lambda: self._with_pictures(file), ".tex": lambda: self._with_pictures(file),
        }  # fmt: skip
        return write_file(file, writers[file.suffix.lower()]())

    def _typeset(self, file: Path) -> Path:
        """Compile the document's LaTeX to a PDF; OptionError without a TeX installation."""
        compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
        if compiler is None:
            raise OptionError(f"path = {shown(str(file))}: there is none of {', '.join(COMPILERS)} here; write .tex, or "
                              f"{INSTALL_TEX}")
        with TemporaryDirectory() as folder:
            self.save(Path(folder) / "report.tex")
            command = [compiler, "-interaction=nonstopmode", "-halt-on-error", "report.tex"]
            for _ in range(2):  # the second run knows the column widths of the tables
                done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
            if done.returncode:
                output = done.stdout.decode(errors="replace")
                last_output = output.partition("\n! ")[2][:300] or output[-300:].strip() or "it printed nothing"
                raise OptionError(f"path = {shown(str(file))}: {Path(compiler).name} stopped: {last_output}; write .tex, or "
                                  f"{INSTALL_TEX}")
            return write_file(file, (Path(folder) / "report.pdf").read_bytes())

    def _with_pictures(self, file: Path) -> str:
        """Markdown or LaTeX text of the document, after its pictures were written to the same folder (LaTeX cannot include SVG:
        such a picture is replaced by its caption)."""
        files = {}
        for i, picture in enumerate(self.pictures()):
            if picture.suffix == ".png" or file.suffix.lower() == ".md":
                place = file.with_name(f"{file.stem}-{i + 1}{picture.suffix}")
                write_file(place, picture.file)
                files[id(picture)] = place.name
        return (markdown if file.suffix.lower() == ".md" else latex)(self.title, self.blocks, files)

    def pictures(self) -> Iterator[Picture]:
        """All pictures in their order."""
        return every(Picture, self.blocks)
