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

#: smallest singular value of an earlier choice, over that of the best one, above which the earlier one is taken again
GOOD = 0.5
SHARE = 0.5  #: distance moved, over the margin to `WORN` at the last check, from which the rows are checked again


class RowsInForce:
    """The rows that are integrated of an over-constrained mechanism, and when they have to be replaced by others.

    all_rows: mechanics with all rows; rank: of all rows; always: numbers of rows that recursive joints and shared displacements
    satisfy, which are always kept; rows: those in force; known: earlier choices, whose equations are compiled already and which
    are taken again where they are good."""

    def __init__(self, all_rows: Mechanics, rank: int, always: Sequence[int], rows: Rows, known: Iterable[Rows] = ()) -> None:
        self.all_rows, self.rank, self.always, self.known = all_rows, rank, list(always), known
        self._number = {row: i for i, row in enumerate(all_rows.rows)}
        self.numbers = self._numbers(rows)
        self._units = all_rows.position_units
        self.seen: tuple[Array, float] | None = None  # positions at the last check, and the margin to `WORN` there

    def smallest(self, t: float, q: Array) -> float:
        """Smallest singular value of all rows that does not count as 0; near 0 in singular positions, for any choice of rows."""
        return smallest(self._unit_rows(t, q), self.rank)

    def _numbers(self, rows: Rows) -> list[int]:
        return [self._number[row] for row in rows]

    def better(self, t: float, q: Array) -> Rows | None:
        """Rows to be integrated from positions q (nq,) of all nodes on; None where those in force are good enough."""
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
        """Well-conditioned rows that span all; of many rows those that sparse elimination chooses."""
        if not issparse(B):
            return best_rows(B, self.rank, self.always)
        return [int(i) for i in SparseRows(B, self.always, numbers_of_joints(self.all_rows.rows)).kept]

    def _unit_rows(self, t: float, q: Array) -> Any:
        return unit_rows(self.all_rows, self.all_rows.constraint_matrix(np.array([t]), q))

    def _distance(self, q: Array) -> float:
        """Largest change of the positions since the last check, over the scene's length, or rad."""
        assert self.seen is not None
        return float(np.max(np.abs(q - self.seen[0]) / self._units, initial=0.0))
