"""Error control of collocation methods: a filtered embedded error estimate chooses the step.

Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., IV.8 and VII.6-7, written for implicit F.

Collocation methods: base class of methods that are given by their table of coefficients.

A stiffly accurate method (the last node is 1) solves F(t, y, y') = 0 of index up to 3. Any other takes ordinary differential
equations alone: the equations hold at its stages, not at the end of the step.

Radau IIA for F(t, y, y') = 0 of index up to 3: adaptive with a filtered embedded estimate, or constant step.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.integrators import CollocationTable, radau_table
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.collocation_step import CollocationStep, Demand
from mbdae.integrators.constant import ROWS, Blocks, StepFailedError, check_rates, constant_steps
from mbdae.integrators.dense import Collocation, hermite, increments_of, inside_of
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.watch import StepWatch
from mbdae.native.collocation import AGAIN, DIVERGED, DONE, LOOK, NO_RATES, NO_WIDTH, ORDER, VANISHED, AcceptedSteps
from mbdae.system.base import Array, System
from mbdae.values import number, set_option, whole

#: from this number of consecutive steps on in which Newton's method fails, each half as long as the one before, Newton's method
#: uses a Jacobian for every stage: SOON with up to FEW_UNKNOWNS unknowns, else RESIST. Such a step costs as much as 40 others
#: (measured with the clearance rotor at rtol 1e-3: 1.4 s with RESIST = 3, 2.1 s with 2)
RESIST, SOON, FEW_UNKNOWNS = 3, 2, 100
REMEDY = "see whether a force jumps or grows without bound there, or the position is singular; else take another rtol"


class Adaptive:
    """Error control of a run: Hairer and Wanner's error estimate with Gustafsson's step controller."""

    def __init__(self, solver: Solver, table: CollocationTable, atol: Any, system: System, loop: StepLoop) -> None:
        rtol, stages = solver.tolerance, len(table.c)
        atol = absolute_tolerance(system, rtol, atol)
        target = max(10 * np.finfo(float).eps / rtol, min(1e-3, 0.3 * rtol**0.5))
        demand = Demand(rtol, atol, target, 7 + 2 * (stages - 2))
        before = loop.method  # of the part of the run before this one
        fits = isinstance(before, CollocationStep) and before.fits(system, demand)
        self.step = before.anew(system) if fits else CollocationStep(system, table, loop.stats, demand, estimate=True)
        loop.method = self.step
        self.system, self.loop, self.rtol, self.control = system, loop, rtol, self.step.run.table
        self.solved = False  # whether the stages of the next step are solved already
        self.warned, self.failures, self.resist = False, 0, SOON if system.n <= FEW_UNKNOWNS else RESIST
        self.watch = StepWatch.of(loop, lambda y: rtol * np.abs(y) + atol)
        if system.longest_step is not None:
            self.step.run.bound(*system.longest_step[:3])
        one_by_one = system.one_by_one
        if self.watch is not None:
            one_by_one |= self.watch.one_by_one or not table.stiffly_accurate
        self.blocks = Blocks(1 if one_by_one else ROWS, self.watch is not None)

    def run(self, h0: float | None) -> None:
        """Step to `loop.t_end`, or until the loop ends the run; h0: first step (s), None: chosen here."""
        self.control.h = self.first_step() if h0 is None else h0
        self.control.smallest = 1e-12 * self.control.h
        self.loop.goes_on(self)
        with self.step.run:
            while (ended := self._advance(self.solved)) is not None:
                self.solved = self._solved(ended)
                self.loop.keep(self)

    def _advance(self, solved: bool) -> int | None:
        """Make steps and store those that hide no contact or switch. Returns the reason (code of `native.collocation`) for which
        the native method stopped, None where the run ends. solved: whether the stages of the first step are solved already."""
        step, loop, watch, control, closely = self.step, self.loop, self.watch, self.control, self.blocks.rows == 1
        if watch is not None:
            control.bound = watch.bound() if closely else watch.bound_of_switches()
            step.run.watch(None if closely or watch.contacts is None else watch.contacts.given())
        before = None if watch is None else step.run.control()
        made = self._made(solved)
        # warn, once per run, where the error estimate consists of round-off: the tolerance is then not met
        noise, h = self.control.noise, self.control.noise_h
        if noise and not self.warned:
            self.warned = True
            warnings.warn(
                f"round-off exceeds the tolerance at t = {self.control.noise_t:.6g} s (step {h:.1e} s, rtol = {self.rtol:g}), so "
                f"that is not met: loosen rtol to {10 * noise * self.rtol:.0e}, or, in a scene, draw the bodies nearer to "
                "the origin of coordinates",
                AccuracyWarning,
                stacklevel=6,
            )
        count = len(made.t)
        kept = self._kept(watch, made, before) if watch is not None and before is not None and count else count
        if kept:
            step.t, self.failures = float(made.t[kept - 1]), 0
        going = True
        if kept == 1:
            piece = made.inner[0] if step.table.stiffly_accurate else None
            going = loop.accept(float(made.t[0]), made.y[0], made.yp[0], piece)
        elif kept:
            going = loop.accept_many(made.t[:kept], made.y[:kept], made.yp[:kept], list(made.inner[:kept]))
        else:
            loop.guard()
        step.run.raise_error()
        if not going:
            return None
        return made.code if kept == count else DONE

    def _made(self, solved: bool) -> AcceptedSteps:
        """Make a block of steps. A native call may return earlier, after some time. Where contacts or switches are watched it is
        then repeated until all are made: bounds of the step are renewed between blocks, and must not depend on the clock."""
        step, loop, rows = self.step, self.loop, self.blocks.rows
        if self.watch is None:  # the run may end early at the next look at it
            rows = max(int(min(rows, loop.next_look - loop.stats.steps)), 1)
        made = step.run.steps(step.t, loop.t_end, solved, loop.evaluations_left, rows)
        step.count()
        while self.watch is not None and made.code == DONE and 0 < len(made.t) < rows and made.t[-1] < loop.t_end \
                and loop.evaluations_left >= 0:
            loop.guard()
            more = step.run.steps(float(made.t[-1]), loop.t_end, False, loop.evaluations_left, rows - len(made.t))
            step.count()
            made = made.then(more)
        return made

    def _kept(self, watch: StepWatch, made: AcceptedSteps, before: Any) -> int:
        """Number of the steps `made` that can be stored; the method goes back to the end of the last of these. before: state of
        the step control before these steps."""
        loop, closely = self.loop, self.blocks.rows == 1
        count, calm = len(made.t), len(made.t) - (made.code == LOOK)
        times, states = np.concatenate([[loop.t], made.t]), np.concatenate([loop.state[0][None], made.y])
        table, run = self.step.table, self.step.run
        increments = increments_of(states, made.inner) if table.stiffly_accurate else run.last[None]
        kept, landing = 0, inf
        if calm:
            inside = inside_of(table, states[:calm], increments[:calm])
            kept, landing = watch.kept(times[: calm + 1], made.y[:calm], inside, closely)
            if not closely and kept and watch.contacts is not None:
                watch.contacts.take(times[kept - 1 : kept + 1], states[kept - 1 : kept + 1], calm - kept)
        if kept == calm < count:
            closely, last = True, slice(calm, count)
            one, landing = watch.kept(times[calm:], made.y[last], inside_of(table, states[last], increments[last]), closely)
            kept += one
        self.blocks.made(count, kept)
        if kept < count:
            self._go_back(made, times, increments, kept, closely, before)
            self.control.landing = landing
        elif closely and watch.stiffness_changed():
            self.step.renew()
            watch.jacobian_at(float(times[-1]), states[-1])
        return kept

    def _go_back(self, made: AcceptedSteps, times: Array, increments: Array, kept: int, closely: bool, before: Any) -> None:
        """Return to the last stored step. times, increments: of all `made` steps, of which the first `kept` are stored; closely:
        whether the next one was examined by itself; before: state of the step control before the block."""
        control, loop = self.control, self.loop
        if closely:
            control.h, control.rejected = control.tried, control.careful
        else:
            control.h, control.rejected = float(times[kept + 1] - times[kept]), False
        if kept:
            width = times[kept] - times[kept - 1]
            before = increments[kept - 1], width, width, made.errors[kept - 1]
        y, yp = (made.y[kept - 1], made.yp[kept - 1]) if kept else loop.state
        self.step.run.back(y, yp, before)
        loop.stats.rejected += closely

    def first_step(self) -> float:
        """A small first step (s) from the rates at the start; the step control then enlarges the steps."""
        system, span = self.system, self.loop.t_end - self.step.t
        slow = np.asarray(system.index) < 3
        size = np.asarray(system.scale, dtype=float) + np.abs(system.y0)
        rate = float(np.max(np.abs(system.yp0)[slow] / size[slow], initial=0.0))
        share = 0.1 * float(self.rtol**self.control.exponent)
        return min(share / rate if rate > 0 else inf, 0.01 * span, share * span)

    def _solved(self, ended: int) -> bool:
        """Prepare the next call of the native method, which stopped for the reason `ended`; returns whether the stages of the
        next step are solved already. Raises SolverError where the run cannot go on."""
        step, h = self.step, self.control.width
        if ended in (ORDER, DIVERGED):
            try:
                step.find_order() if ended == ORDER else step.resist(full=self.failures + 1 >= self.resist)
            except StepFailedError as failure:
                self._shorten(h, failure)
                return False
            return ended == DIVERGED
        if ended == NO_WIDTH:
            text = f"the step became smaller than the round-off of the time t (h = {h:.2e} s){self._nearest_contact()}; {REMEDY}"
            raise self.loop.failure(text, step.fastest())
        if ended == VANISHED:
            text = f"the error test fails ({self.control.error:.1e} times the tolerance)"
            raise self._too_small(h, text, step.largest_error())
        if ended == NO_RATES:
            step.no_rates(step.t + h)
        return False

    def _shorten(self, h: float, failure: StepFailedError) -> None:
        """Halve the step h (s), which could not be solved; SolverError where it becomes too small."""
        self.loop.stats.rejected += 1
        if h < max(self.control.smallest, 10 * np.finfo(float).eps * abs(self.step.t)):
            raise self._too_small(h, str(failure), failure.culprit)
        self.control.h, self.control.rejected, self.failures = 0.5 * h, AGAIN, self.failures + 1

    def _too_small(self, h: float, failure: str, culprit: str) -> SolverError:
        text = f"the step became too small (h = {h:.2e} s): {failure}{self._nearest_contact()}; {REMEDY}"
        return self.loop.failure(text, culprit)

    def _nearest_contact(self) -> str:
        return "" if self.watch is None else self.watch.nearest()


#: with a constant step, and no tolerance of its own for Newton's method, that method ends where the error expected to remain is
#: below TARGET times ROUND times the unknown's magnitude plus scale, or where corrections no longer fall and are round-off
ROUND, TARGET = 1e-10, 1e-5


class CollocationMethod(Solver):
    """Base of implicit Runge-Kutta methods by collocation. A frozen dataclass that derives from it defines `table` and has as
    fields those of the options `rtol`, `atol`, `step` and `newton` (see `RadauIIA`) that users may set.

    `highest_index` is 0 (ordinary differential equations) where it is not stated; 3 is for stiffly accurate tables.
    """

    highest_index = 0
    restarts = False
    rtol: float | None = None
    atol: Any = None
    step: float | None = None
    newton: float | None = None

    @property
    @abstractmethod
    def table(self) -> CollocationTable:
        """The method's coefficients, from `collocation_table(nodes, order)`."""

    @property
    def fixed(self) -> bool:
        """Whether the step is constant."""
        return self.step is not None

    def check(self, system: System) -> None:
        """Raise OptionError for an index above 3; for a method without a stage at the end of the step, for all systems but
        ordinary differential equations."""
        highest = int(np.max(system.index))
        if highest > 3:
            raise OptionError(f"index = {highest}: {self.label} solves index 1 to 3; reduce the index of the equations")
        if not self.table.stiffly_accurate:
            check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        if self.step is None:
            Adaptive(self, self.table, self.atol, system, loop).run(h0)
        else:
            tolerance, target = (ROUND, TARGET) if self.newton is None else (self.newton, 1.0)
            demand = Demand(tolerance, tolerance * np.asarray(system.scale, dtype=float), target, limit=15)
            step = CollocationStep(system, self.table, loop.stats, demand, estimate=False)
            with step.run:
                constant_steps(loop, self.step, step, step.solve_surely, self.table.c[self.table.c < 1])

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """The collocation polynomials, or polynomials through y and y' at ends of steps where these have a higher order."""
        if self.table.stiffly_accurate:
            return Collocation.of(len(self.table.c), t, y, pieces)
        return hermite(self.table.order, t, y, yp)


#: numbers of stages for which `orders` and `factors` were measured
STAGES = (2, 3, 5)


@dataclass(frozen=True)
class RadauIIA(CollocationMethod):
    """Radau IIA with 2, 3 or 5 stages: order 3, 5 or 9, stiffly accurate, index up to 3.

    stages  2, 3 or 5
    rtol    tolerance of the local error relative to each unknown (and to its scale, unless atol is given)
    atol    None, one number, or (n,)
    step    constant step in s: no error control; the last step is cut to end at t_end
    newton  with a constant step: tolerance of the stage equations, relative to each unknown and its scale; None: as small as
            round-off allows
    """

    stages: int = 3
    rtol: float | None = None
    atol: Any = None
    step: float | None = None
    newton: float | None = None

    factors: ClassVar[dict[str, dict[str, float]]] = {
        "RadauIIA(5)": {"GGL": 0.3, "Index3": 0.01, "Index1": 0.5, "ODE": 0.3, "DAE": 0.1},
        "RadauIIA(3)": {"GGL": 0.2, "Index3": 3e-3, "Index1": 0.2, "ODE": 0.2, "DAE": 0.03},
        "RadauIIA(2)": {"GGL": 0.01, "Index3": 3e-3, "Index1": 0.01, "ODE": 0.01, "DAE": 0.01},
    }
    orders: ClassVar[dict[str, dict[str, tuple[int, int, int]]]] = {
        "RadauIIA(5)": {"GGL": (9, 9, 5), "Index3": (9, 5, 4), "Index1": (9, 9, 9)},
        "RadauIIA(3)": {"GGL": (5, 5, 3), "Index3": (5, 3, 2), "Index1": (5, 5, 5)},
        "RadauIIA(2)": {"GGL": (3, 3, 2), "Index3": (3, 2, 1), "Index1": (3, 3, 3)},
    }
    highest_index: ClassVar[int] = 3
    word: ClassVar[str] = "radau"
    penetration_share: ClassVar[float] = 0.1
    tightest: ClassVar[dict[str, float]] = {"": 1e-11, "Index3": 1e-10, "DAE": 1e-11}

    def __post_init__(self) -> None:
        stages_offered = "Radau IIA is offered with 2 (order 3), 3 (order 5) or 5 (order 9) stages"
        set_option(self, "stages", whole, stages_offered, least=STAGES[0], most=STAGES[-1])
        if self.stages not in STAGES:
            raise OptionError(f"stages = {self.stages}: {stages_offered}")
        set_tolerances(self)
        set_option(self, "step", number, "give a positive number of seconds, or None for error control", above=0)
        newton = "give a value from 1e-15 to 1e-2 with a constant step, or rtol for an adaptive one"
        set_option(self, "newton", number, newton, least=1e-15, most=1e-2)
        if self.newton is not None and self.step is None:
            raise OptionError(f"newton = {self.newton:g} (the tolerance of Newton's iteration for constant steps) without a "
                              "step: give step= too, or rtol instead of newton for steps that adapt")

    @classmethod
    def variants(cls) -> list[RadauIIA]:
        """The method with 2, 3 and 5 stages."""
        return [cls(stages) for stages in STAGES]

    @classmethod
    def mapped(cls) -> list[RadauIIA]:
        """The method with 2 and 3 stages."""
        return [cls(2), cls(3)]

    @property
    def label(self) -> str:
        """Name with the number of stages."""
        return f"RadauIIA({self.stages})"

    @property
    def table(self) -> CollocationTable:
        """Coefficients on the right Radau points."""
        return radau_table(self.stages)
