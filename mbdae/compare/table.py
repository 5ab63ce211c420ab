"""A comparison as plain text."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from mbdae.compare.rows import Row

if TYPE_CHECKING:
    from mbdae.compare.comparison import Comparison

WIDTH = 128
COLUMNS = ("run", "asked", "error", "CPU s", "spread", "steps", "rejected", "residuals", "Jacobians", "factoris.", "")


def table(w: Comparison) -> str:
    """Heading, one line per run, failures with their reasons, verdict."""
    from rich.console import Console
    from rich.table import Table

    grid = Table(*COLUMNS, box=None, pad_edge=False, header_style="", show_edge=False)
    for column in grid.columns[1:-1]:
        column.justify = "right"
    for column in grid.columns:
        column.no_wrap = True
    for row in w.runs:
        grid.add_row(*cells(row))
    out = io.StringIO()
    console = Console(file=out, width=WIDTH, color_system=None, force_terminal=False, highlight=False, markup=False)
    console.print(f"scene '{w.scene}' to t = {w.t_end:g} s", f"error: {w.what}", f"reference: {w.reference}", "", sep="\n")
    console.print(grid)
    console.print("* no other run is both cheaper and more accurate", "", sep="\n")
    for row in w.failures:
        console.print(f"failed: {row.label} asked for {_number(row.accuracy, '.0e')}: {row.failure}")
    console.print(w.verdict)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def cells(row: Row) -> tuple[str, ...]:
    """One run as texts, in the order of COLUMNS."""
    counts = [str(n) for n in (row.steps, row.rejected, row.residuals, row.jacobians, row.factorisations)]
    mark = "failed" if row.failure else "*" if row.pareto else ""
    return (row.label, _number(row.accuracy, ".0e"), _number(row.error, ".1e"), _number(row.cpu_s, ".3f"),
            _number(row.cpu_spread_s, ".3f"), *counts, mark)  # fmt: skip


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
