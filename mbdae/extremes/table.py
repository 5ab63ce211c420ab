"""A map of extremes as plain text, and the sentences that its page shows too."""

from __future__ import annotations

import re
from textwrap import shorten

from mbdae.compare.table import grid
from mbdae.extremes.cell import FAILED, MET, NEAR, SILENT, TOLD, UNKNOWN, VERDICTS, Cell
from mbdae.extremes.data import Block, ExtremesData
from mbdae.notation import counted

#: matches numbers and details of failures: of several warnings or errors that are equal without these only the first is shown
NUMBERS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\(resisting most: [^)]*\)+|; the iteration matrix is singular[^;(]*"
                     r"|Convergence tests failed too many times, or reached min step size"
                     r"|the step became smaller than the round-off of the time t")  # fmt: skip
#: mark of each verdict, also for readers who cannot tell the colours
MARKS = {MET: "=", NEAR: "~", TOLD: "!", SILENT: "SILENT", FAILED: "x", UNKNOWN: "?"}


def table(m: ExtremesData) -> str:
    """A grid per parameter, the reasons of failures, and the counts."""
    lines = [f"scene '{m.scene}' to t = {m.t_end:g} s, accuracy {m.accuracy:g} unless varied", f"error: {m.what}"]
    for block in m.blocks:
        lines += ["", block.parameter, *grid(rows(block)), *(f"  {note}" for note in notes(block))]
    lines += ["", *(f"{MARKS[name]:>6}  {n:4d}  {name}: {VERDICTS[name]}" for name, n in m.counts.items())]
    return "\n".join([*lines, f"{m.cpu_s:.1f} s of CPU time"])


def rows(block: Block) -> list[tuple[str, ...]]:
    """Heading, and one line per way with mark and error at every value."""
    lines = [("", *(f"{value:g}" for value in block.values))]
    for label in block.labels:
        lines.append((label, *(text(block.at(label, value), True) for value in block.values)))
    return lines


def text(cell: Cell | None, mark: bool = False) -> str:
    """Text of a cell: its error, "failed", or "-" where the error is not known."""
    if cell is None:
        return ""
    shown = "failed" if cell.verdict == FAILED else "-" if cell.error is None else f"{cell.error:.0e}"
    return f"{MARKS[cell.verdict]} {shown}" if mark else shown


def notes(block: Block) -> list[str]:
    """Warnings and errors of runs, each sentence once with the cells it concerns; silent misses first."""
    said: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], str] = {}
    for cell in sorted(block.cells, key=lambda c: c.verdict != SILENT):
        where = f"{cell.label} at {cell.value:g}"
        if cell.verdict == SILENT:
            reason = "error inf or nan" if cell.error is None else f"error {cell.error:.1e}, estimated {cell.estimated}"
            said.setdefault((SILENT, reason), []).append(where)
        for kind, sentence in (("failed", cell.failure), *(("said", w) for w in cell.warnings)):
            if sentence:
                alike = kind, NUMBERS.sub("#", sentence)
                first.setdefault(alike, shorten(sentence, 300, placeholder="..."))
                said.setdefault(alike, []).append(where)
    return [f"{kind}: {first.get((kind, sentence), sentence)} "
            f"({runs[0]}{' and ' + counted(len(runs) - 1, 'more run') if runs[1:] else ''})"
            for (kind, sentence), runs in said.items()]  # fmt: skip


def doubted(block: Block) -> list[tuple[float, str]]:
    """Values at which not all runs could be judged, each with its reference in words."""
    open_ = {cell.value for cell in block.cells if cell.verdict == UNKNOWN}
    return [(value, told) for value, told in zip(block.values, block.references, strict=True) if value in open_]
