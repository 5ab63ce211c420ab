"""Equations with their multipliers eliminated: y' = f(t, y), y = (q, u, s), of a scene with constraints.

At every state M u' + G^T lambda = f and the constraints on the level of accelerations are solved for u' and lambda. Where the
mass matrix is constant and the forces do not depend on lambda, one kernel call per law gives f, the constraints' right-hand side
and G (`elimination.py`); everywhere else Newton's method solves the full equations, which is exact after one step where they
are linear.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cached_property
from math import inf

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.errors import AccuracyWarning, SolverError
from mbdae.system.assembled.acceleration_kernel import Elimination, elimination, row_shares
from mbdae.system.assembled.scene_system import FormSpec, SceneSystem
from mbdae.system.base import Array
from mbdae.system.model.carried_bodies import Carried
from mbdae.system.model.model import Model
from mbdae.system.model.numbering import Row

ITERATIONS = 30
SETTLED = 1e-10  #: change of a rate or multiplier over its largest value: the next one would be its square
NEAR = 1e-7  #: part of a constraint row that the others do not hold, below which reactions and accelerations are uncertain
#: how near what is found beyond a singular position is to the straight line that goes through it
PASSED = 0.3
SOUND = 0.3  #: smallest singular value of all rows over that at the start, above which a position is not singular


class Rates:
    """y' and multipliers of F(t, (y, lambda), (y', 0)) = 0, where y' and lambda occur linearly or nearly so.

    full: equations whose first unknowns are y, the others algebraic multipliers. linear: whether y' and lambda occur linearly.
    """

    def __init__(self, full: SceneSystem, differential: int, linear: bool) -> None:
        self.full, self.n, self.linear = full, differential, linear
        self.multipliers = np.zeros(full.n - differential)
        self._columns = np.repeat(np.arange(full.n), np.diff(full.pattern.indptr))
        self._rate = self._columns < differential
        self._Y, self._Yp, self._R = np.zeros((3, full.n))

    def point(self, y: Array, yp: Array) -> None:
        """Set the unknowns of the full equations to y, y' and the multipliers at hand."""
        self._Y[: self.n], self._Y[self.n :], self._Yp[: self.n] = y, self.multipliers, yp

    def matrices(self, t: float, y: Array, yp: Array) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Derivatives of F by (y', lambda) and by y, at the multipliers at hand."""
        self.point(y, yp)
        fy, fyp = self.full.jacobian_values(t, self._Y, self._Yp)
        self._last = by_rates = self._matrix(np.where(self._rate, fyp, fy))
        return by_rates, self._matrix(fy)[:, : self.n]

    def shares(self) -> Array:
        """(m,) part of every constraint row that the others do not hold, at the last matrices."""
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


def solved(matrix: sp.csc_matrix, right: Array, full: SceneSystem, t: float) -> Array:
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


class Eliminated(SceneSystem):
    """A scene as y' = f(t, y); `multipliers` (m,) are those of the last evaluation. strict: stop at singular positions."""

    strict = False

    def __init__(self, model: Model, rows: list[Row], spec: FormSpec, sparse: bool | None = None,
                 carried: Carried | None = None) -> None:  # fmt: skip
        self.full = SceneSystem(model, rows, replace(spec, eliminated=False), sparse, carried)
        super().__init__(model, [], replace(spec, blocks=(), eliminated=False), False, carried)
        self.pattern = None  # dy'/dy is full
        linear = not any(group.derived.reactive for group in model.groups)
        self._rates = Rates(self.full, self.n, linear)
        self._rate = np.zeros(self.n)
        self._seen, self._told = ((-inf, 1.0), (-inf, 1.0)), False

    @cached_property
    def _fast(self) -> Elimination | None:
        of_bodies = self.full._constant_mass, self.full._row_of
        return elimination(self.full, *of_bodies, (self.t0, self.y0)) if self._rates.linear else None

    @property
    def multipliers(self) -> Array:
        """lambda (m,) of the last evaluation."""
        return self._fast.multipliers if self._fast is not None else self._rates.multipliers

    def rhs(self, t: float, y: Array, out: Array) -> None:
        """out[:] = y'."""
        if self._fast is None:
            self._rates.solve(t, y, out)
            return
        row = self._fast.rates(t, y, out)
        if row >= 0:
            raise singular(t, self.full.numbering.rows[row].name)

    def rate_jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy (n, n)."""
        self.rhs(t, y, self._rate)
        self._rates.multipliers = self.multipliers
        return self._rates.jacobian(t, y, self._rate)

    def go_on_from(self, other: SceneSystem, t: float, y: Array) -> None:
        super().go_on_from(other, t, y)
        assert isinstance(other, Eliminated)
        self.strict, self._told, self._seen = other.strict, other._told, ((-inf, 1.0), (-inf, 1.0))

    def accept(self, t: float, y: Array) -> None:
        """Warn once where constraints depend on each other, nearly or on the way from one step to the next."""
        shares = self._fast.shares() if self._fast is not None else self._rates.shares()
        here = float(np.sqrt(np.min(shares)))  # falls to 0 and rises again in straight lines where a singular position is passed
        (t0, before), (t1, last) = self._seen
        if t <= t1:  # another run
            self._told, t0, before, last = False, -inf, here, here
        expected = last + (last - before) * (t - t1) / (t1 - t0) if t1 > t0 else last
        self._seen = self._seen[1], (t, here)
        if self._told or (here**2 > NEAR and abs(here + expected) > PASSED * abs(expected)):
            return
        self._rates.matrices(t, y, self._rate)
        weakest = int(np.argmin(self._rates.shares()))  # geometry alone: the masses do not count
        if (expected < 0 or self._rates.shares()[weakest] < NEAR) and not self._determined(t, y):
            if self.strict:
                raise singular(t, self.full.numbering.rows[weakest].name)
            self._told = True
            name = self.full.numbering.rows[weakest].name
            text = (f"a singular position is near or passed at t = {t:.6g} s: {name} depends on the other constraints there; the "
                    f"index-1 form may go on in another branch without a sign: compare with mb.GGL()")  # fmt: skip
            warnings.warn(text, AccuracyWarning, stacklevel=4)

    def _determined(self, t: float, y: Array) -> bool:
        """Whether the rows that were left out determine the motion where those in force are about to fail."""
        if self.determined is None:
            return False
        return self.determined(t, y) > SOUND * self.determined(self.t0, self.y0)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        self.rhs(t, y, out)
        np.subtract(yp, out, out=out)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        for i in range(len(t)):
            self.residual(t[i], y[i], yp[i], out[i])

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        return -self.rate_jacobian(t, y), np.eye(self.n)

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        out[...] = cj * np.eye(self.n) - self.rate_jacobian(t, y)

    def jacobian_values(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        raise NotImplementedError("dy'/dy of eliminated equations is full")
