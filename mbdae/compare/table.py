"""A comparison as plain text."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbdae.compare.rows import Row

if TYPE_CHECKING:
    from mbdae.compare.comparison import Comparison

WIDTH = 128
COLUMNS = ("run", "asked", "rtol", "error", "CPU s", "spread", "steps", "rejected", "residuals", "Jacobians", "factoris.", "")


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
    for (label, reason), asked in _by_reason(w.failures).items():
        console.print(f"failed: {label} asked for {', '.join(asked)}: {reason}")
    console.print(w.verdict)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def _by_reason(failures: Sequence[Row]) -> dict[tuple[str, str], list[str]]:
    """Accuracies asked, by run and reason: the same reason is told once."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in failures:
        reasons.setdefault((row.label, row.failure or ""), []).append(_number(row.accuracy, ".0e"))
    return reasons


def cells(row: Row) -> tuple[str, ...]:
    """One run as texts, in the order of COLUMNS."""
    counts = [str(n) for n in (row.steps, row.rejected, row.residuals, row.jacobians, row.factorisations)]
    mark = "failed" if row.failure else "*" if row.pareto else ""
    times = (_number(row.cpu_s, ".3f"), _number(row.cpu_spread_s, ".3f"))
    asked = (_number(row.accuracy, ".0e"), _number(row.rtol, ".0e"))
    return (row.label, *asked, _number(row.error, ".1e"), *times, *counts, mark)


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
