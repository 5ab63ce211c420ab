"""Differences between all pairs of runs, each at its tightest accuracy; they do not depend on the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbdae.compare.rows import Row, asked_for
from mbdae.system.base import Array


@dataclass(frozen=True)
class TightestRun:
    """Of the runs with the same label (solver, form, model) that have finished so far, the one with the smallest tolerance: its
    label, accuracy asked, rtol, and values that are compared."""

    label: str
    asked: str
    rtol: float | None
    values: Array  #: values (nt, ...) of the run that are compared


@dataclass(frozen=True)
class Pairwise:
    """Largest difference over time of every pair of runs, in the unit of the measure; `differences` is symmetric."""

    runs: tuple[str, ...]  #: label of each run
    asked: tuple[str, ...]  #: accuracy that each run was asked for
    differences: tuple[tuple[float, ...], ...]

    @property
    def largest(self) -> tuple[float, str, str] | None:
        """The largest difference and the labels of its two runs; None where fewer than two runs finished."""
        pairs = [(d, self.runs[i], self.runs[j]) for i, row in enumerate(self.differences) for j, d in enumerate(row[:i])]
        return max(pairs) if pairs else None

    def __str__(self) -> str:
        if self.largest is None:
            return "Fewer than two runs finished: there is nothing to cross-check."
        d, a, b = self.largest
        return f"At the tightest accuracy no two runs differ by more than {d:.1e}, in the unit of the error ({b} and {a})."


def tightest(tightest_runs: dict[str, TightestRun], row: Row, values: Array) -> None:
    """Store the values of a run in `tightest_runs`, unless it holds a run with the same label and a smaller tolerance."""
    before = tightest_runs.get(row.label)
    if before is None or before.rtol is None or row.rtol is None or row.rtol <= before.rtol:
        tightest_runs[row.label] = TightestRun(row.label, asked_for(row.accuracy), row.rtol, values)


def pairwise(tightest_runs: Sequence[TightestRun], error: Callable[[Array, Array], float]) -> Pairwise:
    """Differences of all pairs of runs; error: function of the values of two runs that returns their largest difference."""
    n = len(tightest_runs)
    table = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            table[i, j] = table[j, i] = error(tightest_runs[i].values, tightest_runs[j].values)
    differences = tuple(tuple(float(d) for d in row) for row in table)
    return Pairwise(tuple(f.label for f in tightest_runs), tuple(f.asked for f in tightest_runs), differences)
