"""One step of a collocation method: starting values, stage equations, what is tried where they resist, error estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbdae.integrators.constant import StepFailedError
from mbdae.integrators.matrices.iteration import IterationMatrix
from mbdae.integrators.runge_kutta.newton import Outcome, StageNewton
from mbdae.integrators.runge_kutta.tables import CollocationTable
from mbdae.integrators.solution import Stats
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System
from mbdae.ties import largest

#: a contraction better than this lets the Jacobian serve the next step too
REUSE = 1e-2
#: number of the stage, the first is 0, at which a new Jacobian is evaluated
AMID = 1
#: steps longer than the last one by more than FAR do not continue its polynomial; a step grows by 8 at most, but a landing
#: on a contact may be short
FAR = 50.0
#: halvings that may be used to find starting values for a constant step
DEPTH = 6


@dataclass(frozen=True)
class Demand:
    """What a step has to deliver.

    rtol, atol (n,): one unit of every norm is rtol |y| + atol; target: part of it left by Newton's method;
    limit: most iterations.
    """

    rtol: float
    atol: Array
    target: float
    limit: int


class CollocationStep:
    """The state (t, y, yp) of an integration by collocation and what it takes to go one step further.

    estimate: whether `error` will be asked for; factored_h: step (s) of the present factors, 0 without.
    """

    def __init__(self, system: System, table: CollocationTable, stats: Stats, demand: Demand, estimate: bool) -> None:
        self.system, self.table, self.stats, self.demand = system, table, stats, demand
        self.t, self.y, self.yp = float(system.t0), np.array(system.y0, float), np.array(system.yp0, float)
        self.iterations = 0
        real = np.array([1 / table.gamma0]) if estimate and not len(table.real) else table.real
        self.matrix = IterationMatrix(system, real, table.pairs)
        self.newton = StageNewton(system, table, self.matrix, stats)
        self._order = np.asarray(system.index) - 1.0
        self.factored_h = self._power_h = 0.0
        self._power: Array = np.ones(system.n)
        self._stale, self._fresh, self._at_start = True, False, False
        self._previous: tuple[float, Array] | None = None
        self._singular = -1

    def weights(self, h: float, y: Array) -> Array:
        """(n,) (h/T)^(k-1) / tolerance for unknowns of index k, T the typical time of the motion."""
        if h != self._power_h:
            self._power_h, self._power = h, np.asarray((h / self.system.time) ** self._order)
        return np.asarray(self._power / self._tolerance(y))

    def _tolerance(self, y: Array) -> Array:
        return self.demand.rtol * np.abs(y) + self.demand.atol

    def solve(self, h: float, full: bool = True) -> None:
        """Solve the stage equations: with the present factors, then a fresh Jacobian, then full Newton if allowed."""
        weights = self.weights(h, self.y)
        outcome = self._simplified(h, weights)
        if not outcome.converged and not self._fresh:
            self._stale = self._at_start = True
            outcome = self._simplified(h, weights)
        singular = outcome.iterations == 0  # a coupled matrix would be singular too, and the error has no factors
        if full and not outcome.converged and not singular:
            self._predict(h)
            outcome = self.newton.solve_full(self.t, self.y, h, weights, self.demand.target, self.demand.limit)
        if not outcome.converged:
            self.stats.newton_failures += 1
            raise self._failed(h, weights, outcome)
        self.iterations = outcome.iterations
        if outcome.theta > REUSE:
            self._stale = True

    def _simplified(self, h: float, weights: Array) -> Outcome:
        try:
            self._prepare(h)
        except SingularMatrixError as error:
            self._singular = error.unknown
            return Outcome(False, 0, np.inf, np.inf)
        self._predict(h)
        return self.newton.simplified(self.t, self.y, h, weights, self.demand.target, self.demand.limit)

    def _prepare(self, h: float) -> None:
        """Jacobian and factors for this step, reused as long as they serve."""
        if self._stale:
            self._refresh(h)
            self.stats.jacobians += 1
            self._stale, self.factored_h = False, 0.0
        if h != self.factored_h:
            self.factored_h = 0.0
            self.matrix.factor(h)
            self.stats.factorisations += 1
            self.factored_h = h
            self.newton.forget_rate()

    def _refresh(self, h: float) -> None:
        """Jacobian at a predicted stage: amid the steps it serves it serves more of them (a quarter to a half fewer were
        counted). At the start where nothing is predicted, the prediction did not serve, or may lie in another contact."""
        self._fresh = self._previous is None or self._at_start or self.system.guards is not None
        if self._fresh:
            self.matrix.refresh(self.t, self.y, self.yp)
        else:
            self._predict(h)
            i = min(AMID, len(self.table.c) - 1)
            self.matrix.refresh(self.t + self.table.c[i] * h, *self.newton.predicted(i, self.y, h))
        self._at_start = False

    def _predict(self, h: float) -> None:
        """Starting increments: the last collocation polynomial continued; a straight line at the start, and after a step that
        was much shorter, whose polynomial is useless so far away."""
        last_h, last = self._previous if self._previous is not None else (0.0, None)
        self.newton.predict(self.yp, h, last_h if h <= FAR * last_h else 0.0, last)

    def advance(self, h: float, t1: float) -> tuple[float, Array, Array, Array | None]:
        """Move to t1 = t + h; returns (t1, y, yp, inner increments (s-1, n)); none where the last stage is not the end."""
        Z = self.newton.Z.copy()
        self._previous, self._fresh = (h, Z), False
        if self.table.stiffly_accurate:
            self.t, self.y, self.yp = t1, self.y + Z[-1], self.newton.Yp[-1].copy()
            return t1, self.y, self.yp, Z[:-1]
        self.t, self.y, self.yp = t1, self.reached(), np.empty_like(self.y)
        self.system.rhs(t1, self.y, self.yp)
        self.stats.residuals += 1
        return t1, self.y, self.yp, None

    def renew(self) -> None:
        """Evaluate the Jacobian anew for the next step."""
        self._stale = True

    def reached(self) -> Array:
        """y (n,) at the end of the step just solved."""
        Z = self.newton.Z
        return np.asarray(self.y + (Z[-1] if self.table.stiffly_accurate else self.table.end @ Z))

    def inside(self, part: float | Array) -> Array:
        """y (n,) or (k, n) on the polynomial of the step just solved, after a part of it or parts (k,)."""
        return np.asarray(self.y + self.table.values(np.asarray(part)) @ self.newton.Z)

    def error(self, h: float, careful: bool) -> float:
        """Filtered embedded error in units of the tolerance; filtered once more where it matters."""
        weights = self.weights(h, np.maximum(np.abs(self.y), np.abs(self.reached())))
        found = self.newton.estimate(self.t, self.y, self.yp, h, weights, careful)
        self.stats.residuals += self.newton.table.residuals
        return found

    def noise(self, h: float) -> float:
        """Largest norm that round-off alone can give to the error, in units of the tolerance."""
        return self.newton.noise(self.weights(h, self.y))

    def largest_error(self) -> str:
        """Name of the unknown that fails the error test most."""
        return self.system.names[largest(np.abs(self.newton.scaled))]

    def fastest(self) -> str:
        """Name of the unknown that changes most."""
        return self.system.names[largest(np.abs(self.yp) / self._tolerance(self.y))]

    def solve_surely(self, h: float, depth: int = DEPTH) -> None:
        """Solve the stages of a constant step, if need be from starting values found with smaller steps, halved up to `depth`
        times."""
        try:
            self.solve(h)
        except StepFailedError:
            if depth == 0:
                raise
            self._restart(h, self._substeps(h, depth))

    def _restart(self, h: float, start: Array) -> None:
        """Full Newton from given increments (s, n)."""
        weights = self.weights(h, self.y)
        self.newton.Z[:] = start
        self._stale, self.factored_h = True, 0.0
        outcome = self.newton.solve_full(self.t, self.y, h, weights, self.demand.target, self.demand.limit)
        self.iterations = outcome.iterations
        if not outcome.converged:
            raise self._failed(h, weights, outcome)

    def _substeps(self, h: float, depth: int) -> Array:
        """Increments (s, n) at the stages of the step h from two steps of half the size; the state stays."""
        saved = self.t, self.y, self.yp, self._previous
        theta = 2 * self.table.c
        start = np.empty_like(self.newton.Z)
        try:
            for half in range(2):
                self.solve_surely(h / 2, depth - 1)
                base = self.y - saved[1]
                mine = theta <= 1 if half == 0 else theta > 1
                start[mine] = base + self.table.values(theta[mine] - half) @ self.newton.Z
                self.advance(h / 2, self.t + h / 2)
                self._stale = True
        finally:
            self.t, self.y, self.yp, self._previous = saved
            self._stale, self.factored_h = True, 0.0
        return start

    def _failed(self, h: float, weights: Array, outcome: Outcome) -> StepFailedError:
        """What resisted: an equation that is not finite, else the unknown with the largest weighted correction."""
        names = self.system.names
        bad = ~np.isfinite(self.newton.R).all(axis=0)
        if bad.any():
            equation = self.system.equations[int(np.argmax(bad))]
            return StepFailedError(f"equation {equation} is not finite near t = {self.t + h:.9g}", equation)
        if outcome.iterations == 0 or not np.isfinite(self.newton.correction).all():
            culprit = names[self._singular] if 0 <= self._singular < len(names) else ""
            return StepFailedError("the iteration matrix is singular", culprit)
        worst = largest(np.abs(self.newton.correction * weights).max(axis=0))
        text = f"Newton's method diverges (last correction {outcome.norm:.1e} tolerances)"
        return StepFailedError(text, names[worst])
