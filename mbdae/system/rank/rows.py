"""Constraint rows that follow from each other: their rank, and which of them are integrated.

An over-constrained mechanism has more rows than its motion needs. Which of them can be left out depends on the position: rows
that determine the motion here may depend on each other there, although all rows together never lose their rank. So the rows
in force are chosen from the geometry of the present position, and chosen again before they become dependent (`RowsInForce`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mbdae.deferred import qr
from mbdae.system.base import Array
from mbdae.system.model.numbering import Row
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics

DEPENDENT = 2e-6  #: independent part of a row of unit length below which it counts as dependent on the rows before it
CLEAR = 0.1  #: the same, above which a row is taken in the order of the scene
Rows = tuple[Row, ...]
GOOD = 0.5  #: smallest singular value of an earlier choice over that of the best one, above which it is taken again
WORN = 0.2  #: smallest singular value of the rows in force over that of the best choice, below which they are chosen again
SHARE = 0.5  #: distance moved, over the margin to `WORN` at the last look, at which the rows are looked at again


def unit_rows(mechanics: Mechanics, G: Array) -> Array:
    """G over unit displacements (the scene's length, 1 rad), with rows of unit length."""
    B = G * mechanics.velocity_units
    return np.asarray(B / row_lengths(B))


def smallest(B: Array, rank: int) -> float:
    """The smallest singular value that counts of rows of a given rank; 1 where there are none."""
    return float(np.linalg.svd(B, compute_uv=False)[rank - 1]) if rank else 1.0


def independent_parts(B: Array) -> Array:
    """(m,) distance of every row (unit length) from the span of the rows before it that are new themselves."""
    basis = np.zeros((0, B.shape[1]))
    out = np.zeros(len(B))
    for i, row in enumerate(B):
        left = _without(row, basis)
        out[i] = np.linalg.norm(left)
        if out[i] > DEPENDENT:
            basis = np.vstack([basis, left / out[i]])
    return out


def rows_in_order(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of rows that span all: those in `always`, in their order those that are clearly new, then the newest."""
    chosen, basis = list[int](), np.zeros((0, B.shape[1]))
    left = B.copy()

    def take(i: int) -> None:
        nonlocal basis, left
        direction = _without(left[i], basis)
        direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
        basis, left = np.vstack([basis, direction]), left - np.outer(left @ direction, direction)
        chosen.append(i)

    for i in always:
        take(i)
    for i in range(len(B)):
        if i not in chosen and len(chosen) < rank and np.linalg.norm(left[i]) > CLEAR:
            take(i)
    while len(chosen) < rank:
        sizes = np.linalg.norm(left, axis=1)
        sizes[chosen] = -1.0
        take(int(np.argmax(sizes)))
    return chosen


def best_rows(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of rows that span all as well as any: those in `always`, then by QR with pivots."""
    basis = np.linalg.qr(B[list(always)].T)[0] if len(always) else np.zeros((B.shape[1], 0))
    others = np.array([i for i in range(len(B)) if i not in set(always)], dtype=int)
    left = B[others] - (B[others] @ basis) @ basis.T
    _, order = qr(left.T, mode="r", pivoting=True)
    return [*always, *(int(i) for i in others[order[: rank - len(always)]])]


def chosen_rows(B: Array, rank: int, always: Sequence[int]) -> list[int]:
    """Numbers (rank,) of the rows to begin with: in their order where that is good enough."""
    ordered, other = rows_in_order(B, rank, always), best_rows(B, rank, always)
    return ordered if smallest(B[ordered], rank) >= WORN * smallest(B[other], rank) else other


def _without(row: Array, basis: Array) -> Array:
    """A row without what an orthonormal basis (k, n) spans; twice, for rounding."""
    for _ in range(2):
        row = row - basis.T @ (basis @ row)
    return row


class RowsInForce:
    """The rows that are integrated of an over-constrained mechanism, and when others have to be.

    all_rows: all rows; rank: of all of them; always: numbers of the rows that recursive joints and shared displacements
    satisfy, which stay; rows: those in force; known: choices that were made before and are taken again where they are good,
    because equations are at hand for them."""

    def __init__(self, all_rows: Mechanics, rank: int, always: Sequence[int], rows: Rows, known: Iterable[Rows] = ()) -> None:
        self.all_rows, self.rank, self.always, self.known = all_rows, rank, list(always), known
        self._number = {row: i for i, row in enumerate(all_rows.rows)}
        self.numbers = self._numbers(rows)
        self._units = all_rows.position_units
        self._seen: tuple[Array, float] | None = None  # positions at which the rows were looked at last, and their slack

    def smallest(self, t: float, q: Array) -> float:
        """Smallest singular value that counts of all rows: 0 in a singular position, whichever rows are in force."""
        return smallest(self._unit_rows(t, q), self.rank)

    def _numbers(self, rows: Rows) -> list[int]:
        return [self._number[row] for row in rows]

    def better(self, t: float, q: Array) -> Rows | None:
        """Rows to go on with from positions q (nq,) of all nodes; None where those in force are good enough."""
        if self._seen is not None and self._distance(q) < SHARE * self._seen[1]:
            return None
        B = self._unit_rows(t, q)
        others = best_rows(B, self.rank, self.always)
        reached = smallest(B[others], self.rank)
        slack = smallest(B[self.numbers], self.rank) - WORN * reached
        if slack >= 0 or reached <= DEPENDENT:  # the second: a singular position, where no choice is good
            self._seen = q.copy(), max(slack, 0.0)
            return None
        for rows in self.known:
            if smallest(B[self._numbers(rows)], self.rank) >= GOOD * reached:
                return rows
        return tuple(self.all_rows.rows[i] for i in sorted(others))

    def _unit_rows(self, t: float, q: Array) -> Array:
        return unit_rows(self.all_rows, self.all_rows.constraint_jacobian(np.array([t]), q[None])[0])

    def _distance(self, q: Array) -> float:
        """How far positions are from those looked at last, over the scene's length, or rad."""
        assert self._seen is not None
        return float(np.max(np.abs(q - self._seen[0]) / self._units, initial=0.0))
