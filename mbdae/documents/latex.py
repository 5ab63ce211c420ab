r"""A document as a LaTeX article."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from mbdae.documents.blocks import Block, Code, Equation, Paragraph, Picture, Section, Table
from mbdae.documents.drawing import Drawing
from mbdae.documents.formulas import extent, folded, split_text, width
from mbdae.documents.tex import PACKAGES, plain, signs, verbatim

HEAD = r"\documentclass[a4paper,10pt]{article}" + "\n" + PACKAGES + r"""\usepackage[margin=22mm]{geometry}
\usepackage{amsmath,amssymb,bm,graphicx,longtable,array,tikz}
\setlength{\parindent}{0pt}\setlength{\parskip}{4pt}
\setlength{\tabcolsep}{3pt}\raggedright\sloppy\allowdisplaybreaks
"""
#: text between two consecutive equations: a line end replaces it, so that they share one display
_NEXT = "\n\\end{gather*}\n\n\\begin{gather*}\n"
_SPACE = r"\s+(?=[^$]*(?:\$[^$]*\$[^$]*)*$)"  #: regular expression of the blanks between words, outside of `$...$`
WIDEST = 44.0  #: width of a line in em above which the whole formula is scaled to 0.9 of the text width
LETTERS = 76.0  #: largest width of a line in letters; wider formulas are broken between terms
_LEVELS = {2: "section", 3: "subsection", 4: "subsubsection"}


def latex(title: str, blocks: Sequence[Block], files: Mapping[int, str] | None = None) -> str:
    """The LaTeX text of a document; `files`: name of the file of a picture by the picture's id."""
    body = "\n\n".join(_block(block, 2, files or {}) for block in blocks).replace(_NEXT, " \\\\\n")
    return f"{HEAD}\\begin{{document}}\n{{\\LARGE\\bfseries {_text(title)}\\par}}\n\\medskip\n\n{body}\n\\end{{document}}\n"


def _text(text: str) -> str:
    out = []
    for formula, part in split_text(text):
        if formula:
            out.append(f"${signs(part)}$")
            continue
        for i, piece in enumerate(part.split("`")):
            out.append(f"\\texttt{{{plain(piece)}}}" if i % 2 else plain(piece))
    return "".join(out)


def _block(block: Block, level: int, files: Mapping[int, str]) -> str:
    if isinstance(block, Section):
        level = block.level or level
        command = _LEVELS.get(level, "paragraph")
        return "\n\n".join([f"\\{command}*{{{_text(block.title)}}}", *(_block(b, level + 1, files) for b in block.blocks)])
    if isinstance(block, Paragraph):
        return _text(block.text)
    if isinstance(block, Equation):
        return _equation(block)
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Code):
        return f"{{\\small\n\\begin{{verbatim}}\n{verbatim(block.text)}\n\\end{{verbatim}}}}"
    return _picture(block, files)


def displayed(formula: str) -> str:
    """A formula that fits the text width: broken between its terms, scaled down where a single term is wider."""
    lines = folded(signs(formula), LETTERS, lambda part: max(width(part), 2 * extent(part)))
    body = "\\begin{aligned}\n& " + " \\\\\n& ".join(lines) + "\n\\end{aligned}" if len(lines) > 1 else lines[0]
    return f"\\resizebox{{0.9\\linewidth}}{{!}}{{$\\displaystyle {body}$}}" if max(map(extent, lines)) > WIDEST else body


def _equation(equation: Equation) -> str:
    tag, body = f" \\tag{{{equation.number}}}" if equation.number is not None else "", displayed(equation.latex)
    note = f"\n\n{{\\small {_text(equation.note)}}}" if equation.note else ""
    return f"\\begin{{gather*}}\n{body}{tag}\n\\end{{gather*}}{note}"


def _table(table: Table) -> str:
    columns = "".join(f">{{\\raggedright\\arraybackslash}}p{{{share:.3f}\\linewidth}}" for share in _shares(table))
    head = " & ".join(f"\\textbf{{{_text(cell)}}}" for cell in table.head)
    rows = " \\\\\n".join(" & ".join(map(_text, row)) for row in table.rows)
    caption = f"{_text(table.caption)}\n\n" if table.caption else ""
    below = r"\hline\noalign{\smallskip}"
    body = f"{head} \\\\\n{below}\n\\endhead\n{rows} \\\\\n"
    size = "small" if len(table.head) < 6 else "scriptsize"
    return f"{caption}{{\\{size}\\begin{{longtable}}{{{columns}}}\n{body}\\end{{longtable}}}}"


def _shares(table: Table) -> list[float]:
    """Column widths by content: no narrower than the longest word, with the remaining width given to long texts."""
    cells = list(zip(table.head, *table.rows, strict=True))
    words = [max(1.25 * _letters(word) + 1.2 for cell in column for word in re.split(_SPACE, cell)) for column in cells]
    texts = [max(map(_letters, column)) for column in cells]
    need, spare = sum(words), 86.0 - 2.2 * len(cells)
    more = [max(0.0, text - word) for text, word in zip(texts, words, strict=True)]
    room = max(0.0, spare - need)
    share = min(1.0, room / max(sum(more), 1e-9))
    wide = [word + share * m for word, m in zip(words, more, strict=True)]
    return [(0.98 - 0.014 * len(cells)) * w / max(sum(wide), spare) for w in wide]


def _letters(word: str) -> float:
    """Estimated width of a text in letters; underscores outside of formulas count extra."""
    return width(word) + sum(0.8 * part.count("_") for formula, part in split_text(word) if not formula)


def _picture(picture: Picture, files: Mapping[int, str]) -> str:
    name = files.get(id(picture))
    if isinstance(picture.content, Drawing):
        return f"\\begin{{center}}\n{signs(picture.content.tikz())}\n\n{_text(picture.caption)}\n\\end{{center}}"
    shown = f"\\includegraphics[width=\\linewidth,height=0.5\\textheight,keepaspectratio]{{{name}}}\n\n" if name else "Picture: "
    return f"{shown}{_text(picture.caption)}"
