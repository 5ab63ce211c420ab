"""Newton's method on the stages of one collocation step.

One step of a collocation method: starting values, stage equations, remedies where they fail, error estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import Self

import numpy as np

from mbdae.integrators import CollocationTable
from mbdae.integrators.constant import SINGULAR, StepFailedError, not_finite
from mbdae.integrators.matrices import IterationMatrix, coupled_correction
from mbdae.integrators.solution import Stats
from mbdae.native.collocation import DIVERGED, ORDER, STAGNATION, CollocationRun, Stages
from mbdae.native.equations import equations_of, rates_of
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System
from mbdae.values import largest


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
        return self._finished(theta > 0.3 and norm <= self.noise(weights), limit, theta, norm, h)

    def _finished(self, converged: bool, iterations: int, theta: float, norm: float, h: float) -> Outcome:
        if converged:
            self.slopes(h)
        return Outcome(converged, iterations, theta, norm)


#: contraction factor of Newton's method below which the Jacobian is used in the next step too, as in radau.c
REUSE = 1e-2
#: a constant step that cannot be solved is halved up to this number of times to find starting values for Newton's method
DEPTH = 6


@dataclass(frozen=True)
class Demand:
    """Required accuracy of a step.

    rtol, atol (n,): errors are measured in units of rtol |y| + atol; target: largest error that Newton's method may leave, in
    these units; limit: largest number of its iterations.
    """

    rtol: float
    atol: Array
    target: float
    limit: int


class CollocationStep:
    """The state (t, y, yp) of a run with a collocation method, and the iteration matrix, stages and counts that a step needs.

    estimate: whether error estimates are needed; a method without a real eigenvalue then gets a further real factorisation.
    """

    def __init__(self, system: System, table: CollocationTable, stats: Stats, demand: Demand, estimate: bool) -> None:
        self.table, self.stats, self.demand = table, stats, demand
        real = np.array([1 / table.gamma0]) if estimate and not len(table.real) else table.real
        self.matrix = IterationMatrix(system, real, table.pairs)
        self.newton = StageNewton(system, table, self.matrix, stats)
        order = np.asarray(system.index, dtype=float) - 1.0
        self.run = CollocationRun(self.newton, None if table.stiffly_accurate else rates_of(system), demand.atol, order,
                                  demand.rtol, system.time, demand.target, demand.limit)
        self.y, self.yp = self.run.y, self.run.yp
        self.anew(system)

    def anew(self, system: System) -> Self:
        """The same step at the start of these equations, without anything of an earlier part of a run."""
        self.system = self.newton.system = self.matrix.system = system
        self.t = float(system.t0)
        self.run.anew()
        self.y[:], self.yp[:] = system.y0, system.yp0
        # with contacts the Jacobian is evaluated at the start of a step: at the predicted state other contacts may be closed
        self.run.table.here = system.guards is not None
        return self

    def fits(self, system: System, demand: Demand) -> bool:
        """Whether a step made for these equations and this demand would be the same, its order of elimination too."""
        order = None if system.kept is None else system.kept.get("order")
        return (self.newton.equations is equations_of(system) and self.matrix.orders.present is order
                and self.demand.rtol == demand.rtol and np.array_equal(self.demand.atol, demand.atol))

    def solve(self, h: float, full: bool = True) -> None:
        """Solve the stage equations of a step of h (s): with the present factors, else with a new Jacobian, else, if `full`, by
        Newton's method with a Jacobian for every stage; raises StepFailedError."""
        while (code := self.run.solve(self.t, h)) == ORDER:
            self.find_order()
        self.count()
        if code == DIVERGED:
            self.resist(full)

    def find_order(self) -> None:
        """Factorise the iteration matrix in another order of elimination; where it is singular in all of them, request a Jacobian
        at the start of the step."""
        table = self.run.table
        try:
            self.matrix.factor(table.width)
        except SingularMatrixError as error:
            if table.fresh:
                raise self._failed(error.unknown) from None
            table.stale = table.at_start = True
        else:
            self.run.factored(table.width)

    def resist(self, full: bool) -> None:
        """Where a new Jacobian did not solve the stages: if `full`, Newton's method with a Jacobian for every stage, else
        StepFailedError."""
        if not full:
            raise self._failed()
        self.run.predict(self.run.table.width)
        self._solve_fully(self.run.table.width)

    def _solve_fully(self, h: float) -> None:
        """Solve the stages by Newton's method with a Jacobian for every stage, beginning with the present increments."""
        demand, found = self.demand, self.newton.table
        outcome = self.newton.solve_full(self.t, self.y, h, self.weights(h), demand.target, demand.limit)
        found.iterations, found.norm = outcome.iterations, outcome.norm
        if not outcome.converged:
            raise self._failed()
        if outcome.theta > REUSE:
            self.renew()

    def weights(self, h: float) -> Array:
        """Weights (n,) of unknowns in norms: (h/T)^(k-1) / tolerance for an unknown of index k, T the motion's characteristic
        time."""
        return np.asarray((h / self.system.time) ** (np.asarray(self.system.index) - 1.0) / self._tolerance(self.y))

    def _tolerance(self, y: Array) -> Array:
        return self.demand.rtol * np.abs(y) + self.demand.atol

    def count(self) -> None:
        """Add what the native run counted to the statistics."""
        table, stats = self.run.table, self.stats
        stats.jacobians += table.jacobians
        stats.factorisations += table.factorisations
        stats.newton_iterations += table.iterations
        stats.residuals += table.residuals
        stats.rejected += table.rejections
        table.jacobians = table.factorisations = table.iterations = table.residuals = table.rejections = 0

    def advance(self, h: float, t1: float) -> tuple[float, Array, Array, Array | None]:
        """Move to t1 = t + h; returns (t1, y, yp, increments (s-1, n) of y at inner stages), with None for the increments where
        the last stage is not the end of the step."""
        inner = self.newton.Z[:-1].copy() if self.table.stiffly_accurate else None
        if self.run.advance(self.t, h):
            self.no_rates(t1)
        self.t = t1
        self.count()
        return t1, self.y.copy(), self.yp.copy(), inner

    def no_rates(self, t: float) -> None:
        """Call the right-hand side at the end of a step, where y' could not be computed, so that the system raises its error."""
        self.system.rhs(t, self.y, self.yp)

    def renew(self) -> None:
        """Request a new Jacobian for the next step."""
        self.run.table.stale = True

    def reached(self) -> Array:
        """y (n,) at the end of the step just solved."""
        return np.asarray(self.y + self.table.end @ self.newton.Z)

    def inside(self, part: float | Array) -> Array:
        """y (n,) or (k, n) on the polynomial of the step just solved, at one fraction or fractions (k,) of the step."""
        return np.asarray(self.y + self.table.values(np.asarray(part)) @ self.newton.Z)

    def largest_error(self) -> str:
        """Name of the unknown with the largest local error estimate, relative to the tolerance."""
        return self.system.names[largest(np.abs(self.newton.scaled))]

    def fastest(self) -> str:
        """Name of the unknown with the largest rate, relative to the tolerance."""
        return self.system.names[largest(np.abs(self.yp) / self._tolerance(self.y))]

    def solve_surely(self, h: float, depth: int = DEPTH) -> None:
        """Solve the stages of a constant step h (s). Where that fails, starting values are found by steps of half the length,
        which are halved again if needed, `depth` times at most."""
        try:
            self.solve(h)
        except StepFailedError:
            if depth == 0:
                raise
            self.newton.Z[:] = self._substeps(h, depth)
            self._forget()
            self._solve_fully(h)

    def _forget(self) -> None:
        """Discard the Jacobian and its factors."""
        self.run.table.stale, self.run.table.factored = True, 0.0

    def _substeps(self, h: float, depth: int) -> Array:
        """Increments (s, n) at the stages of a step of h, found by two steps of h/2; t, y, y' and step control are restored."""
        t, y, yp, control = self.t, self.y.copy(), self.yp.copy(), self.run.control()
        theta = 2 * self.table.c
        start = np.empty_like(self.newton.Z)
        try:
            for half in range(2):
                self.solve_surely(h / 2, depth - 1)
                mine = theta <= 1 if half == 0 else theta > 1
                start[mine] = self.y - y + self.table.values(theta[mine] - half) @ self.newton.Z
                self.advance(h / 2, self.t + h / 2)
                self.renew()
        finally:
            self.t = t
            self.run.back(y, yp, control)
            self._forget()
        return start

    def _failed(self, unknown: int | None = None) -> StepFailedError:
        """The failure that names an equation which is not finite, or else the unknown with the largest weighted correction.

        unknown: number of an unknown without a pivot, -1 where it is not known, None where the matrix is regular."""
        self.stats.newton_failures += 1
        names, h, newton = self.system.names, self.run.table.width, self.newton
        bad = ~np.isfinite(newton.R).all(axis=0)
        if bad.any():
            equation = self.system.equations[int(np.argmax(bad))]
            return StepFailedError(not_finite(equation, self.t + h), equation)
        if unknown is not None or not np.isfinite(newton.correction).all():
            culprit = names[unknown] if unknown is not None and 0 <= unknown < len(names) else ""
            return StepFailedError(SINGULAR, culprit)
        worst = largest(np.abs(newton.correction * self.weights(h)).max(axis=0))
        text = f"Newton's iteration diverges (last correction {newton.table.norm:.1e} tolerances)"
        return StepFailedError(text, names[worst])
