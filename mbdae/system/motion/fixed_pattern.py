"""Accelerations and multipliers of many states with sparse matrices of one sparsity pattern."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import entries_of
from mbdae.native.elimination import Entries
from mbdae.native.pivots import largest_pivots
from mbdae.native.sparse import Factors, Orders, SingularMatrixError
from mbdae.system.base import Array

#: where rows are redundant or K is singular, constraints get this small compliance, which makes K regular; relative to 1 / mass
#: in unit displacements
GIVE = 1e-10
#: number of solutions with this compliance: every one after the first corrects the error that the compliance causes and reduces
#: it by about the factor GIVE
CORRECTIONS = 4
CLOSE = 1e-8  #: K counts as singular where the norm of the residual over that of the right-hand side is larger


class FixedPattern:
    """Solves K x = right with K = [[M, G^T - slope], [G, 0]] at many states, whose K have the same sparsity pattern.

    M (nu, nu): sparse, equal in all states; m: number of constraint rows; rows, columns (k,): of the entries of G (m, nu); slope
    (nt, nu, m): derivative of friction by lambda, or None. The order of elimination is found once, and again where pivots become
    too small."""

    def __init__(self, M: Any, m: int, rows: Any, columns: Any, slope: Array | None) -> None:
        nu, (of_mass, by_mass, self._mass) = M.shape[0], entries_of(M)
        self.n, self.m = nu + m, m
        self._slope = None if slope is None else np.nonzero(np.any(slope != 0, axis=0))
        of_slope = self._slope or (np.zeros(0, dtype=np.intp),) * 2
        own = nu + np.arange(m)
        i = np.concatenate([of_mass, columns, nu + rows, of_slope[0], own]).astype(np.int64)
        j = np.concatenate([by_mass, nu + rows, columns, nu + of_slope[1], own]).astype(np.int64)
        places, where = np.unique(j * self.n + i, return_inverse=True)
        self.entries = Entries(self.n, np.searchsorted(places, np.arange(self.n + 1) * self.n), places % self.n)
        self._order = np.argsort(where, kind="stable")
        self._first = np.searchsorted(where[self._order], np.arange(len(places)))
        self._own = where[len(where) - m :]
        self._exact, self._near = (Factors(Orders(self.entries, (largest_pivots,)), float) for _ in range(2))

    def values(self, G: Array, slope: Array | None) -> Array:
        """Entries (nt, nnz) of K, from entries (nt, k) of G."""
        parts = [np.broadcast_to(self._mass, (len(G), len(self._mass))), G, G]
        if slope is not None and self._slope is not None:
            parts.append(-slope[:, self._slope[0], self._slope[1]])
        together = np.hstack([*parts, np.zeros((len(G), self.m))])
        return np.asarray(np.add.reduceat(together[:, self._order], self._first, axis=1))

    def at(self, values: NDArray[np.float64], give: Array, redundant: bool) -> Callable[[Array], Array]:
        """The function right-hand side (n,) -> x (n,) at one state with entries of K `values` (nnz,); valid until `at` is called
        for another state.

        redundant: whether some rows follow from others. Then, and where K is singular, the multipliers are those of least norm as
        in `unique_multipliers`. give (m,): the compliance of a row in units of `GIVE`: its squared length in unit displacements,
        over the mass of a unit displacement."""
        begun = [not redundant and self._factored(values), False]

        def solve(right: Array) -> Array:
            x = self._solved(values, right) if begun[0] else None
            if x is not None:
                return x
            if not begun[1]:
                self._factor_near(values, give)
                begun[:] = False, True
            return self._nearest(values, right)

        return solve

    def _product(self, values: Array, x: Array) -> Array:
        return np.asarray(np.bincount(self.entries.row_of, values * x[self.entries.column_of], self.n), dtype=float)

    def _factored(self, values: Array) -> bool:
        """Factorise K; returns whether it is regular."""
        self._exact.values[:] = values
        try:
            self._exact.factor()
        except SingularMatrixError:
            return False
        return True

    def _solved(self, values: Array, right: Array) -> Array | None:
        """x with K x = right by the LU factors of K; None where the residual is too large because K is nearly singular."""
        x = self._exact.solve(right)
        left = np.linalg.norm(self._product(values, x) - right)
        return x if left <= CLOSE * (np.linalg.norm(right) + 1e-300) else None

    def _factor_near(self, values: Array, give: Array) -> None:
        self._near.values[:] = values
        self._near.values[self._own] -= GIVE * give
        self._near.factor()

    def _nearest(self, values: Array, right: Array) -> Array:
        """The solution with multipliers of least norm, by the LU factors of K with compliant constraints. Corrections with the
        same factors remove the error that the compliance causes."""
        x = np.zeros(self.n)
        for _ in range(CORRECTIONS):
            x = x + self._near.solve(right - self._product(values, x))
        return x
