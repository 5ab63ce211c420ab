"""Which constraint rows of an over-constrained mechanism are integrated during a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from mbdae.deferred import issparse
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.rank.large import SparseRows
from mbdae.system.rank.rows import DEPENDENT, WORN, Rows, best_rows, smallest, unit_rows
from mbdae.system.rank.sparse_redundancy import numbers_of_joints

#: an earlier choice of rows is used again if its smallest singular value is at least this part of that of the best choice
GOOD = 0.5
#: margin: smallest singular value of the rows in force less the limit below which they are replaced (WORN). They are checked
#: again after the positions have changed by this part of the margin at the last check, assuming that a singular value changes by
#: about as much
SHARE = 0.5


class RowsInForce:
    """The rows that are integrated of an over-constrained mechanism, and when they have to be replaced by others.

    all_rows: mechanics with all rows; rank: that of all rows; always: numbers of rows that recursive joints and shared
    displacements satisfy, which are always kept; rows: those in force; known: earlier choices, whose equations are compiled
    already, so that they are preferred where they are good enough (GOOD)."""

    def __init__(self, all_rows: Mechanics, rank: int, always: Sequence[int], rows: Rows, known: Iterable[Rows] = ()) -> None:
        self.all_rows, self.rank, self.always, self.known = all_rows, rank, list(always), known
        self._number = {row: i for i, row in enumerate(all_rows.rows)}
        self.numbers = self._numbers(rows)
        self._units = all_rows.position_units
        self.seen: tuple[Array, float] | None = None  # positions at the last check, and the margin there, see SHARE

    def smallest(self, t: float, q: Array) -> float:
        """Smallest singular value of all rows that is not 0 by redundancy. Where it is near 0, the position is singular: no
        choice of rows determines the motion."""
        return smallest(self._unit_rows(t, q), self.rank)

    def _numbers(self, rows: Rows) -> list[int]:
        return [self._number[row] for row in rows]

    def better(self, t: float, q: Array) -> Rows | None:
        """The rows to be integrated from the present positions q (nq,) of all nodes on; None where those in force are still
        good."""
        if self.seen is not None and self._distance(q) < SHARE * self.seen[1]:
            return None
        B = self._unit_rows(t, q)
        others = self._choice(B)
        reached = smallest(B[others], self.rank)
        slack = smallest(B[self.numbers], self.rank) - WORN * reached
        if slack >= 0 or reached <= DEPENDENT:  # in a singular position (reached <= DEPENDENT) no choice is good
            self.seen = q.copy(), max(slack, 0.0)
            return None
        for rows in self.known:
            if smallest(B[self._numbers(rows)], self.rank) >= GOOD * reached:
                return rows
        return tuple(self.all_rows.rows[i] for i in sorted(others))

    def _choice(self, B: Any) -> list[int]:
        """Numbers of independent, well-conditioned rows: by `best_rows`, or for many rows by sparse elimination."""
        if not issparse(B):
            return best_rows(B, self.rank, self.always)
        return [int(i) for i in SparseRows(B, self.always, numbers_of_joints(self.all_rows.rows)).kept]

    def _unit_rows(self, t: float, q: Array) -> Any:
        return unit_rows(self.all_rows, self.all_rows.constraint_matrix(np.array([t]), q))

    def _distance(self, q: Array) -> float:
        """Largest change of the positions since the last check, over the scene's length, or rad."""
        assert self.seen is not None
        return float(np.max(np.abs(q - self.seen[0]) / self._units, initial=0.0))
