"""A document as Markdown with mathematics between dollar signs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from mbdae.documents.blocks import Block, Code, Equation, Paragraph, Picture, Section, Table
from mbdae.documents.formulas import folded


def markdown(title: str, blocks: Sequence[Block], files: Mapping[int, str] | None = None) -> str:
    """The Markdown text of a document; `files`: name of the file of a picture by the picture's id."""
    parts = [f"# {_plain(title)}", *(_block(block, 2, files or {}) for block in blocks)]
    return "\n\n".join(parts) + "\n"


def _block(block: Block, level: int, files: Mapping[int, str]) -> str:
    if isinstance(block, Section):
        level = block.level or level
        return "\n\n".join([f"{'#' * level} {_plain(block.title)}", *(_block(b, level + 1, files) for b in block.blocks)])
    if isinstance(block, Paragraph):
        return _plain(block.text)
    if isinstance(block, Equation):
        return _equation(block)
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Code):
        return f"```text\n{block.text}\n```"
    return _picture(block, files)


def _equation(equation: Equation) -> str:
    lines = folded(equation.latex)
    tag = f" \\tag{{{equation.number}}}" if equation.number is not None else ""
    body = lines[0] if len(lines) == 1 else "\\begin{aligned}\n& " + " \\\\\n& ".join(lines) + "\n\\end{aligned}"
    note = f"\n\n{_plain(equation.note)}" if equation.note else ""
    return f"$$\n{body}{tag}\n$$" + note


def _table(table: Table) -> str:
    head = "| " + " | ".join(map(_cell, table.head)) + " |\n|" + "---|" * len(table.head)
    rows = "\n".join("| " + " | ".join(map(_cell, row)) + " |" for row in table.rows)
    caption = f"{_plain(table.caption)}\n\n" if table.caption else ""
    return f"{caption}{head}\n{rows}"


def _cell(text: str) -> str:
    return _plain(text).replace("|", r"\|").replace("\n", " ")


def _plain(text: str) -> str:
    """Text in which `<` outside of code and mathematics is escaped, so that it starts no HTML."""
    return re.sub(r"(`[^`]*`|(?<!\\)\$[^$]*\$)|<", lambda m: m[1] or r"\<", text)


def _picture(picture: Picture, files: Mapping[int, str]) -> str:
    name = files.get(id(picture))
    caption = _plain(picture.caption)
    return f"![{caption}]({name})" if name else f"*Picture: {caption}*"
