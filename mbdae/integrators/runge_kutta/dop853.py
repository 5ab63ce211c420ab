"""The explicit method of order 8 of Dormand and Prince (DOP853), for smooth systems with a right-hand side."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

import numpy as np

from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.constant import not_finite
from mbdae.integrators.dense import Collocation, increments_of, inside_of
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.rates import check_rates
from mbdae.integrators.runge_kutta.dop853_table import DENSE, FIFTH, STAGES, THIRD
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.watched.watch import StepWatch
from mbdae.native.equations import rates_of
from mbdae.native.explicit import Explicit, Method, Steps
from mbdae.system.base import Array, System
from mbdae.ties import largest

METHOD = Method(STAGES, tuple((0, *entry) for entry in FIFTH) + tuple((1, *entry) for entry in THIRD), DENSE)
#: stages of Radau IIA at whose nodes the interpolant is stored: with the start they determine its polynomial of degree 7
NODES = 7
#: largest number of steps in one call of the native method, and in the first call where switches are watched; where contacts are
#: watched, or every step has to be looked at by itself, it is 1
ROWS, FEW = 256, 8


@dataclass(frozen=True)
class DOP853(Solver):
    """Explicit Runge-Kutta method of order 8 with a dense output of order 7, for y' = f(t, y) that is smooth and not stiff.

    rtol  tolerance of the local error relative to each unknown (and to its scale, unless atol is given)
    atol  None, one number, or (n,)
    """

    rtol: float | None = None
    atol: Any = None

    factors: ClassVar[dict[str, dict[str, float]]] = {"DOP853": {"ODE": 3e-3, "Index1": 3e-3, "DAE": 3e-3}}
    error_fall: ClassVar[float] = 0.6
    #: factor on the longest step during an impact. At the begin of an impact forces grow with the power 1.5 of time. No
    #: polynomial describes that well, and the error estimate does not see it: with longer steps errors would hardly fall with the
    #: tolerance, and runs that are equally wrong would agree
    impacts: ClassVar[float] = 0.25
    tightest: ClassVar[dict[str, float]] = {"": 1e-14}
    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = dict.fromkeys(
        ("rk45", "rk23", "rk4", "dopri5", "dopri853", "ode45", "ode23", "ode78", "ode89", "tsit5", "rungekutta"), "dop853")
    highest_index: ClassVar[int] = 0
    restarts: ClassVar[bool] = False

    def __post_init__(self) -> None:
        set_tolerances(self)

    def check(self, system: System) -> None:
        """Raise OptionError for a system without a right-hand side."""
        check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        run = _Run(self, loop, h0)
        with run.method:
            run.steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Interpolant: polynomials of degree 7."""
        return Collocation.of(NODES, t, y, pieces)


class _Run:
    """A run with DOP853, in blocks of steps; where a block passed over a contact or switch, in single steps."""

    def __init__(self, solver: DOP853, loop: StepLoop, h0: float | None) -> None:
        self.loop, self.system, rtol = loop, loop.system, solver.tolerance
        self.atol = absolute_tolerance(self.system, rtol, solver.atol)
        atol = self.atol
        self.rtol, self.watch = rtol, StepWatch.of(loop, lambda y: rtol * np.abs(y) + atol)
        self.equations = rates_of(self.system)
        self.method = Explicit(self.equations, METHOD, radau_table(NODES).c[:-1], rtol, self.atol)
        self.h0 = h0
        # number of steps in the next call, and their largest length (s) where a step had passed over a contact or switch
        self.rows, self.landing = 1, inf

    def _start(self) -> None:
        loop = self.loop
        code = self.method.start(loop.t, loop.state[0], loop.t_end - loop.t, self.h0)
        loop.stats.residuals += 2
        self.equations.raise_error()
        if code:  # y' does not exist or is not finite at the start: the call of rhs raises the error that says why
            self.system.rhs(loop.t, loop.state[0], np.empty(self.system.n))

    def steps(self) -> None:
        """Step to the end, in blocks of steps. Of a block only the steps before one that may hide a contact or switch are stored;
        the steps after these are made one by one."""
        self._start()
        loop, watch = self.loop, self.watch
        if self.system.longest_step is not None:
            self.method.bound(*self.system.longest_step)
        most = 1 if self.system.looks_at_steps or (watch is not None and watch.contacts is not None) else ROWS
        self.rows, going = most if watch is None else min(most, FEW), True
        loop.goes_on(self)
        while going:
            rows = self.rows
            made = self._made(rows, self.landing if watch is None else min(watch.bound(), self.landing))
            kept = count = len(made.t)
            if watch is not None and count:
                kept, self.landing = self._looked_at(watch, made, closely=rows == 1)
                self.rows = min(max(2 * rows, FEW), most) if kept == count else 1
            if kept == 1:
                going = loop.accept(float(made.t[0]), made.y[0], made.yp[0], made.inner[0])
            elif kept:
                going = loop.accept_many(made.t[:kept], made.y[:kept], made.yp[:kept], list(made.inner[:kept]))
            else:
                loop.guard()
            self.equations.raise_error()
            if made.code and going:
                raise self._failed()
            if kept < count:
                self.method.begin(*loop.state, float(made.t[kept] - loop.t))
            if going:
                loop.keep(self)

    def _made(self, rows: int, longest: float) -> Steps:
        """Make up to `rows` steps of at most `longest` (s). A native call may return earlier, after some time. Where contacts or
        switches are watched it is then repeated until all steps are made: bounds of the step are renewed between blocks, and must
        not depend on the clock."""
        loop = self.loop
        made = self._advanced(loop.t, rows, longest)
        while self.watch is not None and not made.code and len(made.t) < rows and made.t[-1] < loop.t_end \
                and loop.evaluations_left >= 0:  # fmt: skip
            loop.guard()
            more = self._advanced(float(made.t[-1]), rows - len(made.t), longest)
            made = made.then(more)
        return made

    def _advanced(self, t: float, rows: int, longest: float) -> Steps:
        """Make up to `rows` steps, not longer than `longest` (s), in one call of the native method."""
        table, stats = self.method.table, self.loop.stats
        before = table.evaluations, table.rejected
        made = self.method.advance(t, self.loop.t_end, self.loop.evaluations_left, rows, longest)
        stats.residuals += table.evaluations - before[0]
        stats.rejected += table.rejected - before[1]
        return made

    def _looked_at(self, watch: StepWatch, made: Steps, closely: bool) -> tuple[int, float]:
        """Number of steps before the first that may hide a contact or switch, and the largest length (s) of the next step,
        finite only where a single step hides one. closely: whether it is a single step, in which contacts are sought too."""
        times = np.concatenate([[self.loop.t], made.t])
        states = np.concatenate([self.loop.state[0][None], made.y])
        inside = inside_of(radau_table(NODES), states[:-1], increments_of(states, made.inner))
        kept, landing = watch.kept(times, made.y, inside, closely)
        self.loop.stats.rejected += closely and not kept
        return kept, landing

    def _failed(self) -> Exception:
        """The error for a step that became as small as the round-off of the time."""
        loop, (y, yp) = self.loop, self.loop.state
        nearest_contact, F = "" if self.watch is None else self.watch.nearest(), np.empty(self.system.n)
        text = ("the step became smaller than the round-off of the time t: see whether a force jumps or grows without bound "
                f"there, or, where the motion is stiff, use mb.RadauIIA(3){nearest_contact}")  # fmt: skip
        for h in (0.0, 1e-9 * (loop.run_end - float(loop.system.t0))):  # F at the last state, and just after it
            self.system.residual(loop.t + h, y + h * yp, yp, F)  # raises an error where accelerations are not determined
            if not np.isfinite(F).all():
                culprit = self.system.equations[int(np.argmax(~np.isfinite(F)))]
                return loop.failure(f"{text}; {not_finite(culprit, loop.t + h)}", culprit)
        return loop.failure(text, self.system.names[largest(np.abs(yp) / (self.rtol * np.abs(y) + self.atol))])

