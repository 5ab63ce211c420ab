"""Steps and errors of the solvers of SUNDIALS, IDA and CVODE of `native.sundials`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from mbdae.errors import SolverError
from mbdae.integrators.base import absolute_tolerance
from mbdae.integrators.constant import not_finite as not_finite_text
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.watched.watch import SundialsWatch, stop_time
from mbdae.native import sundials as native
from mbdae.native.sundials_steps import MOST_ROWS, Settings, Steps
from mbdae.system.base import Array


class SundialsRun(ABC):
    """One run with SUNDIALS. last: IDA or CVODE with its memory, from which the last point evaluated can be read after a
    failure."""

    last: native.Method

    def __init__(self, solver: Any, loop: StepLoop, h0: float | None) -> None:
        system = loop.system
        self.solver, self.loop, self.system, self.stats = solver, loop, system, loop.stats
        self.rtol, self.atol = solver.tolerance, absolute_tolerance(system, solver.tolerance, solver.atol)
        self.watch = SundialsWatch.of(loop, self.tolerance)
        self.first_step = h0 or 0.0
        self._counted = (0, 0, 0)

    @abstractmethod
    def create(self) -> native.Method:
        """Create the method, to begin at the last accepted step."""

    @abstractmethod
    def diagnosis(self, reason: str) -> SolverError:
        """The error that names the unknown or equation which prevented a step."""

    def accepted(self, watch: SundialsWatch) -> None:
        """Called before a step of a run with contacts or switches is stored; here without effect."""
        return

    def settings(self, order: int) -> Settings:
        """Settings of IDA and CVODE."""
        return Settings(self.rtol, self.atol, order, self.first_step)

    def tolerance(self, y: Array) -> Array:
        """Tolerance (n,) of every unknown at y (n,)."""
        return np.asarray(self.rtol * np.abs(y) + self.atol)

    def steps(self) -> None:
        """Step to the end."""
        try:
            with self.create() as self.last:
                self._steps()
        finally:
            self.__dict__.pop("last", None)
            del self.watch  # the watch refers to this object: such a circle would keep memory until the next garbage collection

    def _steps(self) -> None:
        """Step to the end: many steps per call where nothing is checked between steps, else one per call. Steps do not end at
        output times."""
        loop, watch, last = self.loop, self.watch, self.last
        together = watch is None and loop.system.longest_step is None and not loop.system.looks_at_steps
        rows, going = MOST_ROWS if together else 1, True
        while going:
            made = last.advance((loop.t, *loop.state), loop.last_step, stop_time(loop, watch), loop.t_end,
                                min(rows, loop.room), loop.evaluations_left)  # fmt: skip
            self._count()
            if len(made.t):
                going = loop.accept_many(made.t, made.y, made.yp, made.pieces) if together else self._keep(made, watch)
            last.raise_error()
            if made.code and going:
                message = last.reason(made.code) + ("" if watch is None else watch.nearest())
                raise not_finite(loop, self, message) or self.diagnosis(message)

    def _keep(self, made: Steps, watch: SundialsWatch | None) -> bool:
        """Store the step `made`, or restart the method to repeat it; returns whether the run goes on."""
        loop, t, y, yp = self.loop, float(made.t[0]), made.y[0], made.yp[0]
        if watch is not None:
            if watch.refuses(t, y, yp):
                self.last.begin(loop.t, *loop.state)
                loop.guard()
                return True
            self.accepted(watch)
        return loop.accept(t, y, yp, made.pieces[0])

    def _count(self) -> None:
        """Add the work of the last call to the counts of the run."""
        stats, counts = self.stats, self.last.counts
        residuals, rejected, jacobians = (now - before for now, before in zip(counts, self._counted, strict=True))
        self._counted = counts
        stats.residuals += residuals
        stats.rejected += rejected
        stats.jacobians += jacobians
        stats.newton_iterations, stats.factorisations = stats.residuals, stats.jacobians

    def probe(self, t: float, y: Array, yp: Array) -> list[Array]:
        """Values (n,) at a point of the functions that SUNDIALS calls, to find out which equation is not finite; here F(t, y,
        y')."""
        out = np.empty(self.system.n)
        self.system.residual(t, y, yp, out)
        return [out]


def not_finite(loop: StepLoop, run: SundialsRun, why: str) -> SolverError | None:
    """The error that names the equation which is not finite at the last point, or just after the last step.

    States predicted by y and y' at the last accepted step are checked first. The last iterates of SUNDIALS may not be finite
    themselves, and then no row would be.
    """
    y, yp = loop.state
    soon = loop.t + 1e-9 * (loop.t_end - float(run.system.t0))
    predicted = [run.probe(t, y + (t - loop.t) * yp, yp) for t in (run.last.t, soon)]
    for values in (*predicted[0], *predicted[1], run.last.values):
        if not np.isfinite(values).all():
            culprit = run.system.equations[int(np.argmax(~np.isfinite(values)))]
            return loop.failure(f"{why}; {not_finite_text(culprit, run.last.t)}", culprit)
    return None
