"""Newton's method on the stages of one collocation step."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, sqrt

import numpy as np

from mbdae.integrators.matrices.iteration import IterationMatrix, coupled_correction
from mbdae.integrators.runge_kutta.tables import CollocationTable
from mbdae.integrators.solution import Stats
from mbdae.native.equations import equations_of
from mbdae.native.radau import STAGNATION, Stages
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System


@dataclass
class Outcome:
    """Result of Newton's method. theta: last contraction factor; norm: last correction in units of the tolerance."""

    converged: bool
    iterations: int
    theta: float
    norm: float


class StageNewton(Stages):
    """The stages of a step (`native.collocation.Stages`), to which Newton's method with a Jacobian for every stage is added."""

    def __init__(self, system: System, table: CollocationTable, matrix: IterationMatrix, stats: Stats) -> None:
        super().__init__(equations_of(system), table, matrix)
        self.system, self.coefficients, self.stats = system, table, stats

    def solve_full(self, t0: float, y0: Array, h: float, weights: Array, target: float, limit: int) -> Outcome:
        """Newton's method on all stages of a step of h (s) together, with a new Jacobian of every stage for every correction,
        where the iteration with one Jacobian fails. weights (n,): of unknowns in the norm; target: norm of a correction at which
        it ends; limit: largest number of corrections."""
        times = t0 + self.coefficients.c * h
        norm, previous, theta = inf, inf, 0.0
        for k in range(1, limit + 1):
            self.slopes(h)
            np.add(self.Z, y0, out=self.Y)
            self.system.residual_stages(times, self.Y, self.Yp, self.R)
            self.stats.newton_iterations += 1
            self.stats.residuals += self.s
            self.stats.jacobians += self.s
            self.stats.factorisations += 1
            try:
                self.correction[:] = coupled_correction(
                    self.system, self.coefficients.A_inv, h, times, self.Y, self.Yp, self.R
                )
            except SingularMatrixError:
                return Outcome(False, 0, inf, inf)
            self.Z += self.correction
            norm = sqrt(float(np.mean((self.correction * weights) ** 2)))
            if not isfinite(norm):
                return Outcome(False, k, inf, inf)
            theta = norm / previous if previous else 0.0
            if norm <= target or (theta > 0.5 and norm <= STAGNATION):
                return self._finished(True, k, theta, norm, h)
            if k > 4 and theta > 2.0:
                break
            previous = norm
        noisy = theta > 0.3 and norm <= self.noise(weights)
        return self._finished(noisy, limit, theta, norm, h)

    def _finished(self, converged: bool, iterations: int, theta: float, norm: float, h: float) -> Outcome:
        if converged:
            self.slopes(h)
        return Outcome(converged, iterations, theta, norm)
