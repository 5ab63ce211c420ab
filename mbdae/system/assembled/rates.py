"""y' and multipliers of equations in which they occur linearly or nearly so, at any state."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.errors import SolverError
from mbdae.system.assembled.acceleration_kernel import row_shares
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Array

ITERATIONS = 30
SETTLED = 1e-10  #: change of rates and multipliers, over the largest of them, at which Newton's method stops


class Rates:
    """y' and multipliers of F(t, (y, lambda), (y', 0)) = 0, where y' and lambda occur linearly or nearly so.

    full: equations whose first unknowns are y, the others algebraic multipliers. linear: whether y' and lambda occur linearly."""

    def __init__(self, full: Assembly, differential: int, linear: bool) -> None:
        self.full, self.n, self.linear = full, differential, linear
        self.multipliers = np.zeros(full.n - differential)
        self._columns = np.repeat(np.arange(full.n), np.diff(full.pattern.indptr))
        self._rate = self._columns < differential
        self._Y, self._Yp, self._R = np.zeros((3, full.n))

    def point(self, y: Array, yp: Array) -> None:
        """Set the unknowns of the full equations to y, y' and the present multipliers."""
        self._Y[: self.n], self._Y[self.n :], self._Yp[: self.n] = y, self.multipliers, yp

    def matrices(self, t: float, y: Array, yp: Array) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Derivatives of F by (y', lambda) and by y, at the present multipliers."""
        self.point(y, yp)
        fy, fyp = self.full.jacobian_values(t, self._Y, self._Yp)
        self._last = by_rates = self._matrix(np.where(self._rate, fyp, fy))
        return by_rates, self._matrix(fy)[:, : self.n]

    def shares(self) -> Array:
        """(m,) squared independent part of every constraint row, at the last matrices."""
        nb = self.full.numbering
        return row_shares(self._last[self.n :, nb.nq : nb.nq + nb.nu].toarray())

    def _matrix(self, data: Array) -> sp.csc_matrix:
        pattern = self.full.pattern
        return sp.csc_matrix((data, pattern.indices, pattern.indptr), shape=pattern.shape)

    def solve(self, t: float, y: Array, out: Array) -> None:
        """out[:] = y'; the multipliers are kept."""
        out[:] = 0.0
        for _ in range(1 if self.linear else ITERATIONS):
            matrix, _ = self.matrices(t, y, out)
            self.full.residual(t, self._Y, self._Yp, self._R)
            step = solved(matrix, self._R, self.full, t)
            out -= step[: self.n]
            self.multipliers -= step[self.n :]
            if self.linear or np.max(np.abs(step)) <= SETTLED * max(np.max(np.abs(out)), np.max(np.abs(self.multipliers))):
                return
        raise SolverError(f"friction and reactions find no balance at t = {t:.9g} s: self-locking; take a smaller friction "
                          f"coefficient", t)  # fmt: skip

    def jacobian(self, t: float, y: Array, yp: Array) -> Array:
        """dy'/dy (n, n) at y' and the multipliers of the same point, by the theorem on implicit functions."""
        by_rates, by_state = self.matrices(t, y, yp)
        return -solved(by_rates, by_state.toarray(), self.full, t)[: self.n]


def solved(matrix: sp.csc_matrix, right: Array, full: Assembly, t: float) -> Array:
    """matrix^-1 right; raises a SolverError that names the unknown where the matrix is singular."""
    try:
        x = np.linalg.solve(matrix.toarray(), right) if full.sparsity is None else splu(matrix).solve(right)
        if np.isfinite(x).all():
            return np.asarray(x)
    except (np.linalg.LinAlgError, RuntimeError):
        pass
    raise singular(t, "")


def singular(t: float, row: str) -> SolverError:
    """The refusal where constraints depend on each other, or a motion has no inertia."""
    where = f": {row} depends on the other constraints there" if row else ""
    return SolverError(f"accelerations and reactions are not determined at t = {t:.9g} s (singular position){where}; the GGL "
                       f"form with mb.RadauIIA(3) may pass it", t, row)  # fmt: skip
