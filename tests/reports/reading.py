"""Reads a report: what its formulas define and what they use."""

from __future__ import annotations

import re

from mbdae.documents.blocks import Equation, Paragraph, Section, Table, split_text

VECTORS = re.compile(r"\\(?:mathbf|boldsymbol)\{(?:[^{}]|\{[^{}]*\})*\}(?:_[a-z])?")
SCALARS = re.compile(r"\\(?:eta|lambda|varphi|mu|sigma)_(?:\{(?:[^{}]|\{[^{}]*\})*\}|[a-z0-9])")


def blocks_of(blocks):
    for block in blocks:
        yield block
        if isinstance(block, Section):
            yield from blocks_of(block.blocks)


def formulas(document):
    """(what defines, what is used) of all formulas."""
    defined, used = [], []
    for block in blocks_of(document.blocks):
        if isinstance(block, Equation):
            for line in block.latex.split(r" \\ "):
                defined.append(line.split("=")[0].split(r"\approx")[0])
                used.append(line)
            defined += [part for formula, part in split_text(block.note) if formula]
        elif isinstance(block, Paragraph):
            defined += [part for formula, part in split_text(block.text) if formula]
        elif isinstance(block, Table):
            symbols = list(block.head)[:1] == ["symbol"]
            for row in [block.head, *block.rows]:
                for cell in row[:1] if symbols else row:
                    found = defined if symbols or row is block.head else used
                    found.extend(part for formula, part in split_text(cell) if formula)
    return " ".join(defined), " ".join(used)


def holds_and_defines(document, name):
    """Its checks hold, every symbol it uses is defined in it, its documents are complete."""
    text = document.to_markdown()
    assert "NOT EQUAL" not in text, re.search("NOT EQUAL[^|]*", text)[0]
    assert "NEGATIVE" not in text
    assert "nan" not in text.lower().split()
    defined, used = formulas(document)
    for symbol in {*VECTORS.findall(used), *SCALARS.findall(used)}:
        if symbol == r"\mathbf{0}":
            continue
        plain = symbol.removeprefix(r"\mathbf{\bar").strip()
        assert plain in defined or re.sub(r"_[klm]$", "", plain) in defined, f"{name}: {symbol} is not defined"
    html, tex = document.to_html(), document.to_latex()
    assert ("<math" in html) == bool((defined + used).strip())
    assert tex.count("{") - tex.count(r"\{") == tex.count("}") - tex.count(r"\}")
    assert tex.count(r"\begin{") == tex.count(r"\end{")
    assert tex.count(r"\left") == tex.count(r"\right")
