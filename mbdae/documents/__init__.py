"""A document for people to read: a title over blocks, written as HTML, Markdown or LaTeX.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from sys import modules
from tempfile import TemporaryDirectory
from typing import Any

from mbdae.documents.blocks import (
    Block,
    Code,
    Drawing,
    Equation,
    Paragraph,
    Picture,
    Section,
    Table,
    every,
    extent,
    folded,
    split_text,
    width,
)
from mbdae.documents.html import file_of, html
from mbdae.documents.mathml import plain, signs, verbatim
from mbdae.errors import NamesArguments, OptionError
from mbdae.files import write_file
from mbdae.notation import framed
from mbdae.values import file_to_write, option, optional, shown, text
from mbdae.values import path as path_of

# -- A document as a LaTeX article


#: packages needed for the text that this module writes
PACKAGES = r"""\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{lmodern}
"""
LOOSE = r"\setlength{\tabcolsep}{3pt}\raggedright\sloppy" + "\n"  #: names of classes do not break
HEAD = r"\documentclass[a4paper,10pt]{article}" + "\n" + PACKAGES + r"""\usepackage[margin=22mm]{geometry}
\usepackage{amsmath,amssymb,bm,graphicx,longtable,array,tikz}
\setlength{\parindent}{0pt}\setlength{\parskip}{4pt}
\allowdisplaybreaks
""" + LOOSE
#: text between two consecutive equations: a line end replaces it, so that they share one display
_NEXT = "\n\\end{gather*}\n\n\\begin{gather*}\n"
_SPACE = r"\s+(?=[^$]*(?:\$[^$]*\$[^$]*)*$)"  #: regular expression of the blanks between words, outside of `$...$`
WIDEST = 39.0  #: estimated width of a line in em above which a formula is scaled to 0.9 of the text width if it is wider
#: scales what follows in braces to a part of the text width where it is wider
_FITTING = r"\resizebox{\ifdim\width>%s\linewidth %s\linewidth\else\width\fi}{!}"
LETTERS = 76.0  #: largest width of a line in letters; wider formulas are broken between terms
NARROW = 54.0  #: the same for pieces of other documents, of which not even the text width of LaTeX's article is sure
_LEVELS = {2: "section", 3: "subsection", 4: "subsubsection"}


def latex(title: str, blocks: Sequence[Block], files: Mapping[int, str] | None = None) -> str:
    """The LaTeX text of a document; `files`: name of the file of a picture by the picture's id."""
    body = _close("\n\n".join(_tex_block(block, 2, files or {}) for block in blocks).replace(_NEXT, " \\\\\n"))
    return f"{HEAD}\\begin{{document}}\n{{\\LARGE\\bfseries {_text(title)}\\par}}\n\\medskip\n\n{body}\n\\end{{document}}\n"


def _close(body: str) -> str:
    """Displays belong to the paragraph above them; below a heading the empty line is taken back that TeX puts over a display."""
    display = r"\n(?=\\begin\{gather\*\})"
    headed = re.sub(rf"(\\(?:sub)*section\*\{{.*\}}\n){display}", r"\1\\vspace{-\\baselineskip}\n\n", body)
    return re.sub(rf"(?<!baselineskip\}})\n{display}", "\n", headed)


def _text(text: str) -> str:
    out = []
    for formula, part in split_text(text):
        if formula:
            out.append(f"${signs(part)}$")
            continue
        for i, piece in enumerate(part.split("`")):
            out.append(f"\\texttt{{{plain(piece)}}}" if i % 2 else plain(piece))
    return "".join(out)


def _tex_block(block: Block, level: int, files: Mapping[int, str], letters: float = LETTERS) -> str:
    if isinstance(block, Section):
        level = block.level or level
        command = _LEVELS.get(level, "paragraph")
        inside = (_tex_block(b, level + 1, files, letters) for b in block.blocks)
        return "\n\n".join([f"\\{command}*{{{_text(block.title)}}}", *inside])
    if isinstance(block, Paragraph):
        return _text(block.text)
    if isinstance(block, Equation):
        tag, body = f" \\tag{{{block.number}}}" if block.number is not None else "", displayed(block.latex, letters)
        note = f"\n\n{{\\small {_text(block.note)}}}" if block.note else ""
        return f"\\begin{{gather*}}\n{body}{tag}\n\\end{{gather*}}{note}"
    if isinstance(block, Table):
        return _tex_table(block, letters)
    if isinstance(block, Code):
        return f"{{\\small\n\\begin{{verbatim}}\n{verbatim(block.text)}\n\\end{{verbatim}}}}"
    name = files.get(id(block))
    if isinstance(block.content, Drawing):
        drawn = f"{_FITTING % (1, 1)}{{{signs(block.content.tikz())}}}"
        return f"\\begin{{center}}\n{drawn}\n\n{_text(block.caption)}\n\\end{{center}}"
    shown = f"\\includegraphics[width=\\linewidth,height=0.5\\textheight,keepaspectratio]{{{name}}}\n\n" if name else "Picture: "
    return f"{shown}{_text(block.caption)}"


# -- Pieces of a document for the text of another


NEEDED = "amsmath, amssymb, bm, graphicx, longtable, array and tikz"  #: packages of a text that takes the pieces in


def pieces_of(name: str, blocks: Sequence[Block]) -> dict[str, str]:
    """LaTeX of every section, by the name of its file: displays with labels, which the document numbers that takes them in."""
    taken = set[str]()

    def once(text: str) -> str:
        found = next(name for i in count(1) if (name := text if i == 1 else f"{text}-{i}") not in taken)
        taken.add(found)
        return found

    first = [b for b in blocks if not isinstance(b, Section)]
    parts = [("introduction", first), *((slug(b.title), b.blocks) for b in blocks if isinstance(b, Section))]
    own, left = list[dict[Any, str]](), ""
    for _, inside in parts:  # in a document of several reports each counts its equations
        own.append({})
        for e in every(Equation, inside):
            left = e.latex.partition("=")[0].strip() or left
            own[-1][e.number] = once(f"eq:{name}:{slug(left) or 'display'}")
    labels = {number: label for found in own for number, label in found.items()}
    return {once(f"{name}-{part}"): _piece(inside, labels | found) for (part, inside), found in zip(parts, own, strict=True)
            if inside}


def _piece(blocks: Sequence[Block], labels: Mapping[Any, str]) -> str:
    """Blocks of a section; displays as `equation` with their labels, numbers in tables as references."""
    body = _close("\n\n".join(_tex_block(block, 4, {}, NARROW) for block in blocks))
    display = re.compile(r"\\begin\{gather\*\}\n(.*?) \\tag\{(\d+)\}\n\\end\{gather\*\}", re.DOTALL)
    body = display.sub(lambda m: f"\\begin{{equation}}\\label{{{labels[int(m[2])]}}}\n{m[1]}\n\\end{{equation}}", body)
    body = re.sub(r"(?m)^\((\d+)\)(?= )", lambda m: f"\\eqref{{{labels[int(m[1])]}}}", body)
    return f"% needs the packages {NEEDED}\n{{{LOOSE}\n{body}\n\\par}}\n"


def slug(latex: str) -> str:
    """A text or formula in small letters, digits and hyphens, for labels and names of files."""
    latex = re.sub(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right|operatorname|begin|end)\b", " ", latex)
    return "-".join(re.findall(r"[a-z0-9]+", latex.lower())) if len(latex) < 200 else ""


def displayed(formula: str, letters: float = LETTERS) -> str:
    """A formula that fits a text width of so many letters: broken between its terms, scaled down where a term is wider."""
    lines = folded(signs(formula), letters, lambda part: max(width(part) if r"\begin" not in part else 0, 2 * extent(part)))
    body = "\\begin{aligned}\n& " + " \\\\\n& ".join(lines) + "\n\\end{aligned}" if len(lines) > 1 else lines[0]
    wide = max(map(extent, lines)) > WIDEST * letters / LETTERS
    return f"{_FITTING % (0.9, 0.9)}{{$\\displaystyle {body}$}}" if wide else body


def _high(row: str) -> str:
    """A row of a table, higher where letters have both a superscript and a subscript."""
    return r"\rule[-1.2ex]{0pt}{3.8ex}" * bool(re.search(r"\^(\{[^$]*\}|\S)_|_(\{[^$]*\}|\S)\^", row)) + row


def _tex_table(table: Table, letters: float) -> str:
    shares, fits = _shares(table)
    columns = "".join(f">{{\\raggedright\\arraybackslash}}p{{{share:.3f}\\linewidth}}" for share in shares)
    head = " & ".join(f"\\textbf{{{_text(cell)}}}" for cell in table.head)
    rows = " \\\\\n".join(_high(" & ".join(map(_text, row))) for row in table.rows)
    caption = f"{_text(table.caption)}\n\n" if table.caption else ""
    below = r"\hline\noalign{\smallskip}"
    body = f"{head} \\\\\n{below}\n\\endhead\n{rows} \\\\\n"
    size = "small" if fits and len(table.head) < (6 if letters > NARROW else 3) else "scriptsize"
    return f"{caption}{{\\{size}\\begin{{longtable}}{{{columns}}}\n{body}\\end{{longtable}}}}"


def _shares(table: Table) -> tuple[list[float], bool]:
    """Column widths by content: no narrower than the longest word, the remaining width given to long texts; whether the words
    fit in small type."""
    cells = list(zip(table.head, *table.rows, strict=True))
    words = [max(1.25 * _letters(word) + 1.2 for cell in column for word in re.split(_SPACE, cell)) for column in cells]
    texts = [max(map(_letters, column)) for column in cells]
    need, spare = sum(words), 86.0 - 2.2 * len(cells)
    more = [max(0.0, text - word) for text, word in zip(texts, words, strict=True)]
    room = max(0.0, spare - need)
    share = min(1.0, room / max(sum(more), 1e-9))
    wide = [word + share * m for word, m in zip(words, more, strict=True)]
    return [(0.98 - 0.014 * len(cells)) * w / max(sum(wide), spare) for w in wide], need <= spare


def _letters(word: str) -> float:
    """Estimated width of a text in letters; underscores outside of formulas count extra."""
    return width(word) + sum(0.8 * part.count("_") for formula, part in split_text(word) if not formula)


# -- A document as Markdown with mathematics between dollar signs


def markdown(title: str, blocks: Sequence[Block], files: Mapping[int, str] | None = None) -> str:
    """The Markdown text of a document; `files`: name of the file of a picture by the picture's id."""
    return "\n\n".join([f"# {_plain(title)}", *(_markdown_block(block, 2, files or {}) for block in blocks)]) + "\n"


def _markdown_block(block: Block, level: int, files: Mapping[int, str]) -> str:
    if isinstance(block, Section):
        level = block.level or level
        parts = (_markdown_block(b, level + 1, files) for b in block.blocks)
        return "\n\n".join([f"{'#' * level} {_plain(block.title)}", *parts])
    if isinstance(block, Paragraph):
        return _plain(block.text)
    if isinstance(block, Equation):
        lines = folded(block.latex)
        tag = f" \\tag{{{block.number}}}" if block.number is not None else ""
        body = lines[0] if len(lines) == 1 else "\\begin{aligned}\n& " + " \\\\\n& ".join(lines) + "\n\\end{aligned}"
        note = f"\n\n{_plain(block.note)}" if block.note else ""
        return f"$$\n{body}{tag}\n$$" + note
    if isinstance(block, Table):
        return _markdown_table(block)
    if isinstance(block, Code):
        return f"```text\n{block.text}\n```"
    name, caption = files.get(id(block)), _plain(block.caption)
    return f"![{caption}]({name})" if name else f"*Picture: {caption}*"


def _markdown_table(table: Table) -> str:
    head = "| " + " | ".join(map(_cell, table.head)) + " |\n|" + "---|" * len(table.head)
    rows = "\n".join("| " + " | ".join(map(_cell, row)) + " |" for row in table.rows)
    caption = f"{_plain(table.caption)}\n\n" if table.caption else ""
    return f"{caption}{head}\n{rows}"


def _cell(text: str) -> str:
    return _plain(text).replace("|", r"\|").replace("\n", " ")


def _plain(text: str) -> str:
    """Text in which `<` outside of code and mathematics is escaped, so that it starts no HTML."""
    return re.sub(r"(`[^`]*`|(?<!\\)\$[^$]*\$)|<", lambda m: m[1] or r"\<", text)


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

    def to_html(self, path: Any = None) -> str:
        """An HTML page that loads no other file: mathematics as MathML, pictures embedded; also written to `path`, if given."""
        return self._text(html, path)

    def to_markdown(self, path: Any = None) -> str:
        """Markdown with mathematics between dollar signs; pictures are replaced by their captions. path: as in `to_html`."""
        return self._text(markdown, path)

    def to_latex(self, path: Any = None) -> str:
        """A LaTeX article that needs only packages of a basic installation; pictures are replaced by their captions. path: as in
        `to_html`."""
        return self._text(latex, path)

    def _text(self, made: Callable[..., str], path: Any) -> str:
        place = optional("path", path, file_to_write, "give the path of a file in a folder that exists, or None")
        found = made(self.title, self.blocks)
        if place is not None:
            write_file(place, found)
        return found

    def _repr_html_(self) -> str:
        return framed(self.to_html())

    def save(self, path: str | Path) -> Path:
        """Write the document in the format of the suffix, .html, .md, .tex or .pdf; returns the path.

        Pictures are embedded in .html; for .md and .tex they become files next to it. A .pdf needs lualatex or pdflatex
        (Debian: texlive-latex-recommended, texlive-pictures, lmodern). Raises OptionError without them, or for another suffix."""
        file: Path = option("path", path, file_to_write, "write .html, .md, .tex or .pdf into a folder that exists",
                            suffixes=(".html", ".md", ".tex", ".pdf"))
        if file.suffix.lower() == ".pdf":
            return self._typeset(file)
        writers: dict[str, Callable[[], str]] = {
            ".html": self.to_html, ".md": lambda: self._with_pictures(file), ".tex": lambda: self._with_pictures(file),
        }
        return write_file(file, writers[file.suffix.lower()]())

    def fragments(self, folder: str | Path, name: str | None = None) -> list[Path]:
        r"""Write every section as a file for `\\input`, and `<name>.bib` with the origin of the formulas; returns the paths.

        folder: made where it is missing; name: first word of files, labels and the key of the BibTeX entry, by default the title.
        Displays are `equation` with labels such as `eq:revolute-joint:m-l`: the document that takes a piece in numbers them.
        Raises OptionError for a folder that cannot be made."""
        key = slug(self.title if name is None else option("name", name, text, "give a word, such as \"revolute\"")) or "report"
        place: Path = option("folder", folder, path_of, "give the path of a folder")
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OptionError(f"folder = {shown(str(folder))}: {error.strerror or error}; give another folder") from None
        made = {f"{file}.tex": body for file, body in pieces_of(key, self.blocks).items()}
        hashes = re.findall(r"`([0-9a-f]{32,64})…?`", self.to_markdown())
        said = f" The sha256 of the derived equations begins with {hashes[0][:32]}." if hashes else ""
        fields = {"title": f"{{{plain(self.title)}}}", "howpublished": f"Derivation by mbdae {modules['mbdae'].__version__}",
                  "note": f"Every equation was read back as printed and compared with those that are integrated.{said}"}
        said = "".join(f"  {word} = {{{value}}},\n" for word, value in fields.items())
        made[f"{key}.bib"] = f"@misc{{{key},\n{said}}}\n"
        return [write_file(place / file, body) for file, body in made.items()]

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
                write_file(place, file_of(picture))
                files[id(picture)] = place.name
        return (markdown if file.suffix.lower() == ".md" else latex)(self.title, self.blocks, files)

    def pictures(self) -> Iterator[Picture]:
        """All pictures in their order."""
        return every(Picture, self.blocks)
