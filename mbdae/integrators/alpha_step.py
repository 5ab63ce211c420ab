"""One step of the generalised-alpha method for equations of motion F(t, y, y') = 0 with y = (q, u, s, z, lambda, mu).

Arnold, Bruels, Cardona, Error analysis of generalized-alpha Lie group time integration methods, Numer. Math. 129 (2015). The
equations hold at the end of the step. With the algorithmic accelerations a, the displacements psi during the step and, in the GGL
form, the multipliers eta (the unknowns mu), by which positions and velocities both satisfy their constraints:

    (1 - alpha_m) a1 + alpha_m a0 = (1 - alpha_f) u1' + alpha_f u0'
    u1 = u0 + h ((1 - gamma) a0 + gamma a1)
    psi = h u0 + h^2 ((1/2 - beta) a0 + beta a1) + h G^T(q0) eta,   q1 = q0 moved by psi

Unknowns are u1', s1', z1, lambda1 and eta. States of first order follow the method of Jansen, Whiting and Hulbert (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.integrators import radau_table
from mbdae.integrators.constant import SINGULAR, StepFailedError, not_finite
from mbdae.integrators.dense import cubic
from mbdae.integrators.matrices import as_csc, inverse_or_one, searches
from mbdae.integrators.solution import Stats
from mbdae.integrators.watched_arguments import cubic_of_step
from mbdae.native import Entries, Orders, Searches
from mbdae.native.sparse import Factors, SingularMatrixError
from mbdae.system.base import Array, System
from mbdae.values import largest

CUBIC = 3  #: number of stages of Radau IIA whose polynomial is of degree 3
ORDER = ("q", "v", "s", "z", "lambda", "mu")
#: Newton's method stops where the error expected to remain is at most TARGET units; a unit is ROUND times the scale of the
#: unknown, for velocities and internal states of its scale plus its magnitude
ROUND, TARGET = 1e-10, 3e-2
NOISY = 1.0  #: largest correction, in the units of TARGET, that is accepted as round-off where corrections hardly shrink any more
#: contraction factor of Newton's method above which the next step gets a new Jacobian, unless the last correction is below NOISY
#: / 1000 units
SLOW = 0.02
LIMIT = 12


@dataclass(frozen=True)
class Alphas:
    """Coefficients alpha_m, alpha_f, gamma and beta of the method, for accelerations or for the rates of internal states."""

    m: float
    f: float
    gamma: float
    beta: float

    @property
    def kappa(self) -> float:
        """da1/du1', by the equation of the algorithmic accelerations."""
        return (1 - self.f) / (1 - self.m)

    @property
    def lead(self) -> float:
        """The algorithmic acceleration a0 approximates the acceleration at the time t0 + lead h."""
        return self.m - self.f

    @classmethod
    def of(cls, m: float, f: float) -> Alphas:
        """Coefficients of order 2 with the most damping of high frequencies for given alpha_m and alpha_f."""
        gamma = 0.5 + f - m
        return cls(m, f, gamma, (gamma + 0.5) ** 2 / 4)


class AlphaStep:
    """The state (t, y, y') of a run, with the algorithmic accelerations a and the algorithmic rates w of internal states, and the
    arrays and factors that a step needs. second, first: coefficients for accelerations, and for rates of internal states."""

    def __init__(self, system: System, second: Alphas, first: Alphas, stats: Stats) -> None:
        self.system, self.stats, self.A, self.B = system, stats, second, first
        self.size = [system.kinds.count(kind) for kind in ORDER]
        ends = np.cumsum(self.size)
        self.nq = int(ends[0])
        self.q, self.u, self.s = slice(0, ends[0]), slice(ends[0], ends[1]), slice(ends[1], ends[2])
        self.algebraic, self.mu = slice(ends[2], ends[4]), slice(ends[4], ends[5])
        nu, ns, m = self.size[1], self.size[2], self.size[5]
        self.stabilised = m > 0
        # where u', s', (z, lambda) and eta are in the vector x of the unknowns of a step
        self.xu, self.xs, self.xz, self.xe = (slice(s.start - self.nq, s.stop - self.nq)
                                              for s in (self.u, self.s, self.algebraic, self.mu))
        self.t, self.y, self.yp = float(system.t0), system.y0.copy(), system.yp0.copy()
        self.a, self.w = self.yp[self.u].copy(), self.yp[self.s].copy()
        scale = np.asarray(system.scale, dtype=float)
        units = getattr(system.displaced, "units", None)
        self._unit = scale[self.q] if units is None else units(scale[self.q])
        self._speed, self._columns = scale[self.u], scale[self.nq :].copy()
        self._G, self._alone = np.zeros((m, nu)), np.zeros(m)
        self._velocity_rows: Any = None
        self._Y, self._Yp, self._F = np.zeros((3, system.n))
        self._x = np.zeros(system.n - self.nq)
        self._factors: Any = None
        self._row, self._column = np.ones(len(self._x)), np.ones(len(self._x))
        self._factored, self._by_s, self._correction = 0.0, 0.0, np.zeros(len(self._x))
        self._old: tuple[float, Array] | None = None
        self._states, self._straight = ns > 0, np.arange(system.n) >= ends[2]

    def revive(self, kept: dict[str, Any]) -> None:
        """Create an object for the LU factors where the stored state `kept` has factors; `checkpoints.snapshot.go_back` then
        fills it."""
        if kept["_factors"] is not None:
            self._factors = Factors(Orders(*self._pattern()), float)

    # -- the equations of a step

    def _begin(self, h: float) -> None:
        """Compute the terms of the equations of a step of h (s) that do not depend on its unknowns."""
        A, B, y, yp, self._h = self.A, self.B, self.y, self.yp, h
        part = (A.f * yp[self.u] - A.m * self.a) / (1 - A.m)
        self._part = part
        self._u0 = y[self.u] + h * ((1 - A.gamma) * self.a + A.gamma * part)
        self._psi0 = h * (y[self.u] + h * ((0.5 - A.beta) * self.a + A.beta * part))
        self._by_u, self._by_psi = h * A.gamma * A.kappa, h * h * A.beta * A.kappa
        if self._states:
            self._w0 = (B.f * yp[self.s] - B.m * self.w) / (1 - B.m)
            self._s0 = y[self.s] + h * ((1 - B.gamma) * self.w + B.gamma * self._w0)
            self._by_s = h * B.gamma * B.kappa

    def _compose(self, h: float, x: Array) -> None:
        """Set y and y' at the end of the step from its unknowns."""
        Y, Yp, rate = self._Y, self._Yp, x[self.xu]
        psi = self._psi0 + self._by_psi * rate
        if self.stabilised:
            psi += h * (x[self.xe] @ self._G)
            Y[self.mu] = self._alone * x[self.xe]
        moved = self.system.displaced
        Y[self.q] = self.y[self.q] + psi if moved is None else moved(self.y[self.q], psi)
        Y[self.u] = self._u0 + self._by_u * rate
        Yp[self.u] = rate
        if self._states:
            Y[self.s], Yp[self.s] = self._s0 + self._by_s * x[self.xs], x[self.xs]
        Y[self.algebraic] = x[self.xz]

    def _predict(self, h: float) -> Array:
        """Starting values of Newton's method: the unknowns extrapolated from the last two steps; eta as in the last step."""
        last = np.concatenate([self.yp[self.u], self.yp[self.s], self.y[self.algebraic], self.y[self.mu]])
        self._last, x = last, last.copy()
        if self._old is not None:
            width, before = self._old
            x += (h / width) * (last - before)
        if self.stabilised:
            x[self.xe] = last[self.xe]
        return x

    # -- iteration matrix

    def _jacobian(self, t: float, y: Array, yp: Array) -> None:
        self._fy, self._fyp = (as_csc(self.system, part) if self.system.sparse else part
                               for part in self.system.jacobian_parts(t, y, yp))
        self.stats.jacobians += 1

    def _directions(self) -> None:
        """Set `_G`, the constraint Jacobian (m, nu) at the start of the step, along whose rows eta displaces the bodies."""
        if self._velocity_rows is None:
            filled = np.asarray(abs(self._fy[self.algebraic.start :, self.u]).sum(axis=1)).ravel() > 0
            self._velocity_rows = self.algebraic.start + np.flatnonzero(filled)[-self.size[5] :]
        G = self._fy[self._velocity_rows][:, self.u]
        self._G = G if isinstance(G, np.ndarray) else G.toarray()
        # mu of rows that restrict velocities alone, which their own equations set to 0
        self._alone = (self._fy[self.mu.start :, self.mu].diagonal() != 0).astype(float)

    def _factor(self, h: float) -> None:
        """Scale and factorise dF/dx, x the unknowns of a step, for a step of h (s)."""
        column = self._columns.copy()
        column[self.xe] /= h
        self._column = column
        parts = self._blocks(self._fy, self._fyp, self._G, (self._by_u, self._by_psi, self._by_s, h))
        if self._factors is None:
            self._factors = Factors(Orders(*self._pattern()), float)
        entries = self._factors.orders.entries
        if not self.system.sparse:
            values = np.hstack(parts)[entries.row_of, entries.column_of]
        else:  # SciPy leaves out entries of products that are zero; they are put where the fixed pattern has them
            A = sp.hstack([sp.coo_matrix(part) for part in parts], format="coo")
            at = np.searchsorted(entries.column_of * entries.n + entries.row_of, A.col.astype(np.int64) * entries.n + A.row)
            values = np.bincount(at, A.data, entries.nnz)
        values *= column[entries.column_of]
        largest = np.zeros(entries.n)
        with np.errstate(invalid="ignore"):  # the factorisation reports values that are not finite
            np.maximum.at(largest, entries.row_of, np.abs(values))
        self._row = inverse_or_one(largest)
        np.multiply(values, self._row[entries.row_of], out=self._factors.values)
        self._factors.factor()
        self._factored = h
        self.stats.factorisations += 1

    def _blocks(self, fy: Any, fyp: Any, G: Any, factors: tuple[float, ...]) -> list[Any]:
        """The blocks of columns of dF/dx, not scaled: for u', for s', for z with lambda, and for eta. factors: the derivatives
        du1/du1', dpsi/du1' and ds1/ds1', and h."""
        n, (by_u, by_psi, by_s, h) = self.nq, factors
        D = fy[n:, self.q] @ -fy[: self.nq, self.u]  # dF/dpsi = dF/dq H, because a displacement psi changes q by H psi
        blocks = [fyp[n:, self.u] + by_u * fy[n:, self.u] + by_psi * D]
        if self._states:
            blocks.append(fyp[n:, self.s] + by_s * fy[n:, self.s])
        blocks.append(fy[n:, self.algebraic])
        if self.stabilised:
            blocks.append(h * (D @ G.T) + fy[n:, self.mu])
        return blocks

    def _pattern(self) -> tuple[Entries, Searches]:
        """Sparsity pattern of dF/dx, and the functions that seek an order of elimination."""
        m, pattern = len(self._x), self.system.sparsity if self.system.pattern is None else self.system.pattern
        if pattern is None:
            return Entries.full(m), ()
        ones = sp.csc_matrix((np.ones(pattern.nnz), pattern.indices, pattern.indptr), shape=pattern.shape)
        G = ones[self._velocity_rows][:, self.u] if self.stabilised else None
        blocks = self._blocks(-ones, -ones, G, (1.0, 1.0, 1.0, 1.0))  # all terms of a sum have equal signs, so that none cancel
        found = sp.hstack(blocks, format="csc")
        found.sort_indices()
        return Entries(m, found.indptr, found.indices), searches(self.system.kinds[self.nq :])

    # -- Newton's method

    def solve(self, h: float) -> None:
        """Solve a step of h (s): with the present factors, with a new Jacobian, then with one for every correction; raises
        StepFailedError."""
        fresh = self._factored == 0.0
        if self.stabilised or fresh:
            self._jacobian(self.t, self.y, self.yp)
        if self.stabilised:
            self._directions()
        self._begin(h)
        for attempt in range(3):
            x = self._predict(h)
            try:
                if attempt or fresh or self._factored != h:
                    if attempt:
                        self._compose(h, x)
                        self._jacobian(self.t + h, self._Y, self._Yp)
                    self._factor(h)
                if self._iterate(h, x, renewing=attempt == 2):
                    self._x = x
                    return
            except SingularMatrixError as error:
                if attempt == 2:
                    raise self._failed(h, error.unknown) from error
        self.stats.newton_failures += 1
        raise self._failed(h, -1)

    def _iterate(self, h: float, x: Array, renewing: bool) -> bool:
        """Newton's method from x, which is changed in place; returns whether it converged. renewing: a new Jacobian for every
        correction."""
        previous, theta = inf, 0.0
        speed, unit = ROUND * (np.abs(self.y[self.u]) + self._speed), ROUND * self._unit
        for k in range(LIMIT * (1 + renewing)):
            self._compose(h, x)
            if renewing and k:
                self._jacobian(self.t + h, self._Y, self._Yp)
                self._factor(h)
            self.system.residual(self.t + h, self._Y, self._Yp, self._F)
            self.stats.residuals += 1
            self.stats.newton_iterations += 1
            dx = self._factors.solve(self._F[self.nq :] * self._row)
            dx *= self._column
            x -= dx
            self._correction = dx
            norm = self._norm(dx, h, speed, unit)
            if not isfinite(norm):
                return False
            theta = norm / previous if k else 0.5
            if norm == 0.0 or (k and theta < 1 and norm * theta / (1 - theta) <= TARGET) or norm <= 0.1 * TARGET:
                break
            if k > 1 and theta > 0.5 and norm <= NOISY:
                break
            if k > 1 and theta > (2.0 if renewing else 0.9):
                return False
            previous = norm
        else:
            return False
        if theta > SLOW and norm > NOISY * 1e-3:
            self._factored = 0.0
        self._compose(h, x)
        return True

    def _norm(self, dx: Array, h: float, speed: Array, unit: Array) -> float:
        """Largest change of a velocity (in units `speed`), a displacement (in units `unit`) or an internal state by a correction
        dx."""
        rate = dx[self.xu]
        psi = self._by_psi * rate
        if self.stabilised:
            psi += h * (dx[self.xe] @ self._G)
        worst = max(float(np.max(np.abs(self._by_u * rate) / speed)), float(np.max(np.abs(psi) / unit)))
        if self._states:
            size = ROUND * (np.abs(self.y[self.s]) + self.system.scale[self.s])
            worst = max(worst, float(np.max(np.abs(self._by_s * dx[self.xs]) / size)))
        return worst

    def _failed(self, h: float, unknown: int) -> StepFailedError:
        names = self.system.names
        bad = ~np.isfinite(self._F)
        if bad.any():
            equation = self.system.equations[int(np.argmax(bad))]
            return StepFailedError(not_finite(equation, self.t + h), equation)
        if unknown >= 0:
            return StepFailedError(SINGULAR, names[self.nq + unknown])
        share = np.abs(self._correction) / (np.abs(self._x) + self._columns)
        worst = self.nq + largest(np.where(np.isfinite(share), share, inf))
        return StepFailedError("Newton's iteration diverges (take shorter steps), or round-off keeps it above its "
                               "tolerance (take longer ones)", names[worst])

    # -- going on

    def reached(self) -> Array:
        """y (n,) at the end of the step just solved."""
        return self._Y

    def _rates(self) -> Array:
        """y' (n,) at the end of the step, without algebraic unknowns."""
        yp = self._Yp.copy()
        yp[self.q] = -self._F[self.q]  # F is evaluated at q' = 0, so that its rows of q are -H u
        return yp

    def inside(self, part: Array) -> Array:
        """y (k, n) on the cubic polynomial of the step just solved, at fractions (k,) of the step."""
        return cubic_of_step(self._h, (self.y, self.yp), (self._Y, self._rates()))(part)

    def advance(self, h: float, t1: float) -> tuple[float, Array, Array, Array]:
        """Move to t1 = t + h; returns (t1, y, y', increments (CUBIC - 1, n) of y from the start of the step to its inner nodes),
        with algebraic unknowns interpolated linearly."""
        x, y = self._x, self._Y.copy()
        y[self.mu] = x[self.xe]
        yp = self._rates()
        yp[self.algebraic] = (y[self.algebraic] - self.y[self.algebraic]) / h
        self._old = h, self._last
        self.a = self._part + self.A.kappa * yp[self.u]
        if self._states:
            self.w = self._w0 + self.B.kappa * yp[self.s]
        line = radau_table(CUBIC).c[:-1, None] * (y - self.y)
        inner = np.where(self._straight, line, cubic(CUBIC, h, (self.y, self.yp), (y, yp)))
        self.t, self.y, self.yp = t1, y, yp
        return t1, y, yp, inner
