r"""Meanings of the symbols in a formula as plain text, from the tables of symbols in its document."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from mbdae.documents.blocks import Block, Section, Table
from mbdae.documents.formulas import tokens
from mbdae.documents.mathml import GREEK

_DROPPED = re.compile(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right)|[{}$]|\\[,;! ]")
_MARKS = {r"\dot": "\u0307", r"\ddot": "\u0308", r"\tilde": "\u0303", r"\hat": "\u0302", r"\bar": "\u0304"}


def key_of(latex: str) -> tuple[str, ...]:
    """A formula as tokens without spaces."""
    return tuple(t for t in tokens(latex) if not t.isspace() and t not in (r"\,", r"\ ", r"\;"))


def _tables(blocks: Sequence[Block]) -> Iterator[Table]:
    for block in blocks:
        if isinstance(block, Section):
            yield from _tables(block.blocks)
        elif isinstance(block, Table) and [*block.head][:3] == ["symbol", "unit", "meaning"]:
            yield block


def symbols_of(blocks: Sequence[Block]) -> dict[tuple[str, ...], str]:
    """From tables of symbols: tokens of a symbol -> its letter, meaning and unit in plain text."""
    found = {}
    for table in _tables(blocks):
        for symbol, unit, meaning in table.rows:
            said = f", {plain(unit)}" if unit not in ("", "1") else ""
            found[key_of(symbol.strip("$"))] = f"{plain(symbol)}: {plain(meaning)}{said}"
    return found


def plain(latex: str) -> str:
    """A short formula, or text with formulas, in plain letters."""
    for command, mark in _MARKS.items():
        latex = re.sub(re.escape(command) + r"\{?(\\[a-z]+\{?[A-Za-z\\]+\}?|[A-Za-z])\}?", rf"\1{mark}", latex)
    latex = re.sub(r"\\([A-Za-z]+)", lambda m: GREEK.get(m[1], m[0]), latex)
    return _DROPPED.sub("", latex)


def explained(latex: str, symbols: Mapping[tuple[str, ...], str]) -> str:
    """The meanings of the symbols in a formula, one a line; at every place the longest known symbol is taken."""
    line, found, i = key_of(latex), dict[str, None](), 0
    beginning: dict[str, list[tuple[str, ...]]] = {}
    for key in symbols:
        beginning.setdefault("".join(key[:1]), []).append(key)
    while i < len(line):
        here = [key for key in beginning.get(line[i], ()) if line[i : i + len(key)] == key]
        best = max(here, key=len, default=())
        found |= {symbols[best]: None} if best else {}
        i += max(1, len(best))
    return "\n".join(found)
