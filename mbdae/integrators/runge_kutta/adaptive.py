"""Error control of collocation methods: a filtered embedded estimate chooses the step.

Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., IV.8 and VII.6-7, written for implicit F.
"""

from __future__ import annotations

import warnings
from math import inf, isfinite
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning
from mbdae.integrators.base import Solver, absolute_tolerance
from mbdae.integrators.constant import StepFailedError
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.runge_kutta.step import CollocationStep, Demand
from mbdae.integrators.runge_kutta.tables import CollocationTable
from mbdae.integrators.watched.watch import StepWatch
from mbdae.system.base import System

#: a change of the step inside this band does not pay for a new factorisation
KEEP = (0.9, 1.2)
SHRINK, GROW = 0.2, 8.0
#: factors of a step this much shorter than what a contact allows are used again
KEEP_FACTORS = 0.6
#: an error estimate above SUSPECT is compared with round-off; if it is round-off, the step grows as after an
#: estimate of ESCAPE, because shorter steps only make it worse (eps |q| / h in velocities)
SUSPECT, ESCAPE = 0.8, 0.05


class Adaptive:
    """Error control around the step: Hairer and Wanner's estimate with Gustafsson's controller."""

    def __init__(self, solver: Solver, table: CollocationTable, atol: Any, system: System, loop: StepLoop) -> None:
        rtol, stages = solver.tolerance, len(table.c)
        atol = absolute_tolerance(system, rtol, atol)
        target = max(10 * np.finfo(float).eps / rtol, min(1e-3, 0.3 * rtol**0.5))
        self.limit = 7 + 2 * (stages - 2)
        demand = Demand(rtol, atol, target, self.limit)
        self.step = CollocationStep(system, table, loop.stats, demand, estimate=True)
        self.system, self.loop, self.rtol = system, loop, rtol
        self.exponent = 1 / (stages + 1)
        self.accepted_h, self.accepted_error = 0.0, 1.0
        self.smallest = 0.0
        self.diverged = self.warned = False
        self.watch = StepWatch.of(loop, lambda y: rtol * np.abs(y) + atol)
        self.landing = inf

    def run(self, h0: float | None) -> None:
        """Step until the end, or until the loop stops the run."""
        h = self.first_step() if h0 is None else h0
        self.smallest = 1e-12 * h
        rejected = True  # the first step is treated with the care of one after a rejection
        while True:
            bounded = h if self.system.longest_step is None else min(h, self.system.longest_step(self.step.t))
            width = self._fit(bounded if self.watch is None else self._watched(bounded))
            if not self.step.t + width > self.step.t:
                raise self.loop.failure(
                    f"the step fell below the round-off of the time (h = {width:.2e} s){self._where()}", self.step.fastest()
                )
            try:
                self.step.solve(width, full=self.diverged)
                error = self.step.error(width, rejected)
            except StepFailedError as failure:
                h, rejected, self.diverged = self._after_failure(width, failure), True, True
                continue
            if error > SUSPECT and self._is_round_off(width, error):
                error = ESCAPE
            if not error < 1.0:  # not a number counts as failed too
                h, rejected = self._after_rejection(width, error), True
                continue
            t1 = self.loop.t_end if self.step.t + width * (1 + 1e-9) >= self.loop.t_end else self.step.t + width
            if self.watch is not None and self._ends_wrong(width, t1):
                continue
            proposed = self._next(width, error, rejected)
            if self.landing < inf:  # that step was shortened to end at a contact or kink, not for its error
                proposed, self.landing = max(proposed, h), inf
            if not self.loop.accept(*self.step.advance(width, t1)):
                return
            h, rejected, self.diverged = proposed, False, False

    def first_step(self) -> float:
        """A small first step from the rates at the start; the controller then grows it by up to GROW per step."""
        system, span = self.system, self.loop.t_end - self.step.t
        slow = np.asarray(system.index) < 3
        size = np.asarray(system.scale, dtype=float) + np.abs(system.y0)
        rate = float(np.max(np.abs(system.yp0)[slow] / size[slow], initial=0.0))
        share = 0.1 * float(self.rtol**self.exponent)
        return min(share / rate if rate > 0 else inf, 0.01 * span, share * span)

    def _watched(self, h: float) -> float:
        """h, no longer than contacts and laws allow; the present factors are used again where that shortens it little."""
        assert self.watch is not None
        bound = self.watch.bound()
        if bound < h:
            factored = self.step.factored_h
            h = factored if KEEP_FACTORS * bound <= factored <= bound else bound
        return min(h, self.landing)

    def _ends_wrong(self, h: float, t1: float) -> bool:
        """Whether the step hides a contact or a peak, or has a kink inside: the next attempt then ends there."""
        assert self.watch is not None
        self.watch.look(t1, self.step.reached(), self.step.inside)
        shorter = self.watch.shorter(h, self.step.inside)
        if shorter is None:
            self.watch.keep()
            if self.watch.stiffness_changed():
                self.step.renew()
                self.watch.jacobian_at(t1, self.step.reached())
            return False
        self.landing = shorter
        self.loop.stats.rejected += 1
        self.loop.guard()
        return True

    def _fit(self, h: float) -> float:
        """h, cut or slightly stretched to end at t_end; two equal steps rather than a long and a tiny one."""
        rest = self.loop.t_end - self.step.t
        if h * 1.01 >= rest:
            return rest
        return rest / 2 if 2 * h > rest and h > 0.6 * rest else h

    def _after_failure(self, h: float, failure: StepFailedError) -> float:
        self.loop.stats.rejected += 1
        self._watch(h, f"the step became too small (h = {h:.2e} s): {failure}", failure.culprit)
        return 0.5 * h

    def _after_rejection(self, h: float, error: float) -> float:
        self.loop.stats.rejected += 1
        text = f"the step became too small (h = {h:.2e} s): the error test fails ({error:.1e} times the tolerance)"
        self._watch(h, text, self.step.largest_error())
        factor = 0.9 * float(error**-self.exponent) if isfinite(error) else 0.0
        return h * max(SHRINK, factor)

    def _is_round_off(self, h: float, error: float) -> bool:
        """Whether the estimate can be round-off alone; warned of once, because the tolerance is then not met."""
        noise = self.step.noise(h)
        if not error <= noise:
            return False
        if not self.warned:
            warnings.warn(
                f"round-off exceeds the tolerance at t = {self.step.t:.6g} (h = {h:.1e} s, rtol = {self.rtol:g}): "
                f"loosen rtol to {10 * noise * self.rtol:.0e}, or move the origin nearer to the bodies",
                AccuracyWarning,
                stacklevel=5,
            )
        self.warned = True
        return True

    def _watch(self, h: float, message: str, culprit: str) -> None:
        """Stop on a vanishing step, or where the wall time is used up."""
        t = self.step.t
        if h < max(self.smallest, 10 * np.finfo(float).eps * abs(t)):
            raise self.loop.failure(message + self._where(), culprit)
        self.loop.guard()

    def _where(self) -> str:
        return "" if self.watch is None else self.watch.nearest()

    def _next(self, h: float, error: float, rejected: bool) -> float:
        """Step proposed after an accepted one, kept where the change would not pay."""
        newton = self.step.iterations
        safety = 0.9 * (2 * self.limit + 1) / (2 * self.limit + newton)
        error = max(error, 1e-10)
        factor = safety * error**-self.exponent
        if self.accepted_h:
            predictive = safety * (h / self.accepted_h) * (self.accepted_error / error**2) ** self.exponent
            factor = min(factor, predictive)
        self.accepted_h, self.accepted_error = h, max(error, 1e-2)
        factor = min(max(factor, SHRINK), 1.0 if rejected and self.loop.stats.rejected else GROW)
        return h if KEEP[0] <= factor <= KEEP[1] else h * factor
