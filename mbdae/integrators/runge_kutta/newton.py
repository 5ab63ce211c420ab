"""Simplified Newton iteration on the stages of one collocation step."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, sqrt

import numpy as np

from mbdae.integrators.matrices.factors import coupled_correction
from mbdae.integrators.matrices.iteration import IterationMatrix, SingularMatrixError
from mbdae.integrators.runge_kutta.tables import CollocationTable
from mbdae.integrators.solution import Stats
from mbdae.system.base import Array, System

#: after one correction no contraction is known but that of an earlier step: it is trusted only where the correction is below this
#: part of the tolerance, because what remains adds up over steps (9e-6 instead of 3e-7 after 100 steps asked for 1e-7)
UNSEEN = 0.1
#: corrections that stopped shrinking are round-off; below this part of the tolerance they do no harm
STAGNATION = 0.03
#: a correction within this many times the measured round-off is round-off
NOISE_MARGIN = 30.0


@dataclass
class Outcome:
    """converged; iterations; theta: last contraction factor; norm: last correction in units of the tolerance."""

    converged: bool
    iterations: int
    theta: float
    norm: float


class StageNewton:
    """Solves F(t0 + c_i h, y0 + Z_i, sum_j A_inv[i, j] Z_j / h) = 0 for the increments Z (s, n).

    Z and Yp (s, n) are its results and belong to it; Z holds the starting values on entry to `solve`.
    """

    def __init__(self, system: System, table: CollocationTable, matrix: IterationMatrix, stats: Stats) -> None:
        s, n = len(table.c), system.n
        self.system, self.table, self.matrix, self.stats = system, table, matrix, stats
        self.Z, self.Y, self.Yp, self.R, self.D = (np.zeros((s, n)) for _ in range(5))
        self.correction = np.zeros((s, n))
        self._weighted = np.zeros((s, n))
        self._flat = self._weighted.reshape(-1)
        self._row, self._column = np.ones((s, n)), np.ones((s, n))
        self._complex = np.zeros(n, dtype=complex)
        self._parts = self._complex.real, self._complex.imag
        self._slope_h, self._slope_weights = 0.0, table.A_inv
        self._rate = inf

    def matrix_changed(self) -> None:
        """Ask for two iterations at least, and take over the scaling of rows and columns."""
        self._rate = inf
        self._row[:] = self.matrix.row
        np.negative(self.matrix.column, out=self._column[0])
        self._column[1:] = self._column[0]

    def solve(self, t0: float, y0: Array, h: float, weights: Array, target: float, limit: int) -> Outcome:
        """Iterate with the present factors until the expected remaining correction is below target.

        weights (n,): one unit of the norm is one tolerance; limit: most iterations.
        """
        times = t0 + self.table.c * h
        previous, theta, smooth = inf, 0.0, 0.0
        factor = max(self._rate, 1e-10) ** 0.8 if isfinite(self._rate) else inf
        for k in range(1, limit + 1):
            self._evaluate(times, y0, h)
            self._solve_transformed()
            norm = self._norm(weights)
            if not isfinite(norm):
                return Outcome(False, k, inf, inf)
            if k > 1:
                theta = norm / previous if previous else 0.0
                smooth = theta if k == 2 else sqrt(theta * smooth)
                factor = smooth / (1 - smooth) if smooth < 1 else inf
            if norm == 0.0 or factor * norm <= (target if k > 1 else min(target, UNSEEN)):
                self._rate = factor
                return self._finish(True, k, smooth, norm, h)
            if k > 1 and norm > STAGNATION and self._hopeless(theta, smooth, norm, target, limit - k):
                noisy = theta > 0.3 and norm <= self.noise_floor(weights)
                return self._finish(noisy, k, smooth, norm, h)
            if theta > 0.9 and norm <= STAGNATION:
                return self._finish(True, k, smooth, norm, h)
            previous = norm
        return self._finish(norm <= STAGNATION, limit, smooth, norm, h)

    @staticmethod
    def _hopeless(theta: float, smooth: float, norm: float, target: float, left: int) -> bool:
        """Diverging, or too slow for the iterations left."""
        if theta >= 0.99 or smooth >= 0.99:
            return True
        return bool(smooth**left / (1 - smooth) * norm > max(target, STAGNATION))

    def _finish(self, converged: bool, iterations: int, theta: float, norm: float, h: float) -> Outcome:
        if converged:
            self._slopes(h)
        return Outcome(converged, iterations, theta, norm)

    def noise_floor(self, weights: Array) -> float:
        """Norm a correction can have from round-off alone."""
        noise = self.matrix.noise(self.Y[-1], self.Yp[-1]) * weights
        return NOISE_MARGIN * sqrt(float(noise @ noise) / len(noise))

    def _slopes(self, h: float) -> None:
        if h != self._slope_h:
            self._slope_h, self._slope_weights = h, self.table.A_inv / h
        np.matmul(self._slope_weights, self.Z, out=self.Yp)

    def predicted(self, i: int, y0: Array, h: float) -> tuple[Array, Array]:
        """y and y' (n,) of stage i at the starting values."""
        self._slopes(h)
        return y0 + self.Z[i], self.Yp[i]

    def _evaluate(self, times: Array, y0: Array, h: float) -> None:
        self._slopes(h)
        np.add(self.Z, y0, out=self.Y)
        self.system.residual_stages(times, self.Y, self.Yp, self.R)
        self.stats.residuals += len(times)
        self.stats.newton_iterations += 1

    def _norm(self, weights: Array) -> float:
        """Weighted root mean square of the correction."""
        np.multiply(self.correction, weights, out=self._weighted)
        return sqrt(float(self._flat.dot(self._flat)) / self._flat.size)

    def _solve_transformed(self) -> None:
        """correction = -(iteration matrix)^-1 R by one real and complex solves; Z += correction."""
        matrix, table, D, b = self.matrix, self.table, self.D, self._complex
        self.R *= self._row
        np.matmul(table.T_inv, self.R, out=D)
        r = len(table.real)
        for j in range(r):
            D[j] = matrix.solve_real(j, D[j])
        for j in range(len(table.pairs)):
            k = r + 2 * j
            self._parts[0][:], self._parts[1][:] = D[k], D[k + 1]
            x = matrix.solve_pair(j, b)
            D[k], D[k + 1] = x.real, x.imag
        np.matmul(table.T, D, out=self.correction)
        self.correction *= self._column
        self.Z += self.correction

    def solve_full(self, t0: float, y0: Array, h: float, weights: Array, target: float, limit: int) -> Outcome:
        """Newton's method on all stages together: a Jacobian per stage and correction, for hard starts."""
        times = t0 + self.table.c * h
        norm, previous, theta = inf, inf, 0.0
        for k in range(1, limit + 1):
            self._evaluate(times, y0, h)
            self.stats.jacobians += len(times)
            self.stats.factorisations += 1
            try:
                self.correction[:] = coupled_correction(
                    self.system, self.table.A_inv, h, times, self.Y, self.Yp, self.R
                )
            except SingularMatrixError:
                return Outcome(False, 0, inf, inf)
            self.Z += self.correction
            norm = self._norm(weights)
            if not isfinite(norm):
                return Outcome(False, k, inf, inf)
            theta = norm / previous if previous else 0.0
            if norm <= target or (theta > 0.5 and norm <= STAGNATION):
                return self._finish(True, k, theta, norm, h)
            if k > 4 and theta > 2.0:
                break
            previous = norm
        noisy = theta > 0.3 and norm <= self.noise_floor(weights)
        return self._finish(noisy, limit, theta, norm, h)
