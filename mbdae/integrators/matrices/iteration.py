"""The iteration matrix dF/dy + (lambda/h) dF/dy' of a system, scaled and factorised.

Unknowns of index k are divided by h^-(k-1) times their scale, and every row by its largest entry. Otherwise the condition
number would grow like h^-4 for short steps (index 3), and round-off would stop Newton's method.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import bmat, csc_matrix, splu
from mbdae.integrators.matrices.ordering import searches
from mbdae.native.elimination import Entries, Order
from mbdae.native.sparse import Matrix, SingularMatrixError
from mbdae.system.base import Array, Kept, System

EARLY = 1e-2  #: an order of elimination is sought for a step of this fraction of the motion's characteristic time


class IterationMatrix(Matrix):
    """The iteration matrix for given real and complex lambda (eigenvalues of A^-1 of a collocation method): `refresh` evaluates
    the Jacobian at a point, `factor` sets the step and factorises."""

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128]) -> None:
        pattern = system.sparsity if system.pattern is None else system.pattern
        entries = Entries.full(system.n) if pattern is None else _entries(system, pattern)
        super().__init__(entries, system.scale, np.asarray(system.index) - 1.0, real, pairs,
                         () if pattern is None else searches(system.kinds))  # fmt: skip
        self.system = system
        if system.kept is not None and self.orders.searches:
            self.orders.present = self._first_order(system.kept)

    def _first_order(self, kept: Kept) -> Order | None:
        """An order of elimination, found for the matrix at the start and stored in `kept` for all runs of the system, because the
        search takes as long as 100 factorisations. Where its pivots become too small later, another order is sought."""
        if "order" not in kept:
            system = self.system
            self.refresh(system.t0, system.y0, system.yp0)
            try:
                self.factor(EARLY * system.time)
                kept["order"] = self.orders.present
            except SingularMatrixError:
                kept["order"] = None
            self.table.ready = False
        found: Order | None = kept["order"]
        return found

    def refresh(self, t: float, y: Array, yp: Array) -> None:
        """Evaluate dF/dy and dF/dy' at (t, y, y')."""
        values = self.system.jacobian_parts if self.system.pattern is None else self.system.jacobian_values
        self.fy[:], self.fyp[:] = (part.ravel(order="F") for part in values(t, y, yp))


def kept_order(system: System) -> list[NDArray[np.int64]] | None:
    """Rows and columns of the pivots of the order stored with `system`; None where none is stored."""
    order = None if system.kept is None else system.kept.get("order")
    return None if order is None else [order.rows, order.columns]


def keep_order(system: System, pivots: list[NDArray[np.int64]] | None) -> None:
    """Store an order with a system, unless it has one already."""
    pattern = system.sparsity if system.pattern is None else system.pattern
    if pivots is not None and system.kept is not None and "order" not in system.kept:
        system.kept["order"] = Order(_entries(system, pattern), *pivots)


def _entries(system: System, pattern: Any) -> Entries:
    kept = Kept() if system.kept is None else system.kept
    if "entries" not in kept:
        kept["entries"] = Entries(system.n, pattern.indptr, pattern.indices)
    found: Entries = kept["entries"]
    return found


def inverse_or_one(largest: Array) -> Array:
    """1 / largest, and 1 where a row is empty or not finite (the factorisation then reports it)."""
    usable = (largest > 0) & np.isfinite(largest)
    return np.divide(1.0, largest, out=np.ones_like(largest), where=usable)


def as_csc(system: System, data: Array) -> csc_matrix:
    """The sparse matrix (n, n) with `data` (nnz,), the entries of a Jacobian, in the sparsity pattern of the system."""
    return csc_matrix((data, system.sparsity.indices, system.sparsity.indptr), shape=(system.n, system.n))


def coupled_correction(system: System, A_inv: Array, h: float, times: Array, Y: Array, Yp: Array, R: Array) -> Array:
    """Newton correction (s, n) of all s stages of a step of h, by one system of s n equations with the Jacobian of every stage:
    without the approximation by one Jacobian, but expensive.

    times (s,), Y, Yp, R (s, n): times, y, y' and residual of the stages; A_inv (s, s): inverse of the Runge-Kutta matrix.
    """
    s, n = R.shape
    parts = [system.jacobian_parts(times[i], Y[i], Yp[i]) for i in range(s)]
    blocks = [[A_inv[i, j] / h * fyp + (fy if i == j else 0.0) for j in range(s)] for i, (fy, fyp) in enumerate(parts)]
    column = np.tile(np.asarray(system.scale, dtype=float) * h ** (1.0 - np.asarray(system.index)), s)
    try:
        if not system.sparse:
            matrix = np.block(blocks) * column
            row = inverse_or_one(np.abs(matrix).max(axis=1))
            x = np.linalg.solve(matrix * row[:, None], R.ravel() * row)
        else:
            sparse = bmat([[as_csc(system, data) for data in line] for line in blocks], format="csc")
            sparse.data *= column[np.repeat(np.arange(s * n), np.diff(sparse.indptr))]
            row = inverse_or_one(abs(sparse).max(axis=1).toarray().ravel())
            sparse.data *= row[sparse.indices]
            x = splu(sparse, permc_spec="COLAMD").solve(R.ravel() * row)
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise SingularMatrixError from error
    return np.asarray(-(x * column).reshape(s, n))
