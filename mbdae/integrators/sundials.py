"""IDA (variable-order BDF, for systems of index at most 1) and CVODE (variable-order Adams or BDF, for systems with a right-hand
side) of SUNDIALS, with their steps and errors.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError, SolverError
from mbdae.integrators import radau_table
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.constant import SINGULAR, check_rates, rate_jacobian
from mbdae.integrators.constant import not_finite as not_finite_text
from mbdae.integrators.dense import Collocation, Hermite, sampled
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.matrices import as_csc
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.watch import SundialsWatch
from mbdae.native import sundials as native
from mbdae.native.equations import equations_of, rates_of
from mbdae.native.sundials_library import MOST_ROWS, Settings, Steps
from mbdae.system.base import Array, System
from mbdae.values import largest, set_option, whole, word


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
                if self.system.longest_step is not None:
                    self.last.bound(*self.system.longest_step)
                self._steps()
        finally:
            self.__dict__.pop("last", None)
            del self.watch  # the watch refers to this object: such a circle would keep memory until the next garbage collection

    def _steps(self) -> None:
        """Step to the end: many steps per call where nothing is checked between steps, else one per call. Steps do not end at
        output times."""
        loop, watch, last = self.loop, self.watch, self.last
        together = watch is None and not loop.system.looks_at_steps
        rows, going = MOST_ROWS if together else 1, True
        while going:
            made = last.advance((loop.t, *loop.state), loop.last_step, loop.t_end if watch is None else watch.stop(), loop.t_end,
                                min(rows, loop.room), loop.evaluations_left)
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


#: number of neighbouring ends of steps that a polynomial of the interpolant goes through. With 4 it has no correct digit where
#: the length of the step jumps (at the start, in the last step); 2 have no advantage
POINTS = 3
#: IDA with an order above 2 and rtol of LOOSE or more is refused where the fastest vibration of a beam passes through more than
#: FAST (rad) in the motion's characteristic time, which orders above 2 excite and do not resolve. Measured without the refusal:
#: errors of 0.1 to 0.5 without a warning at rtol 1e-3; of 2e-3, or a run that does not end, at 1e-4; none that ends at 1e-5
FAST, LOOSE = 2000.0, 1e-5


@dataclass(frozen=True)
class IDA(Solver):
    """Variable-order, variable-step BDF; every step is stored, outputs come from the interpolant.

    rtol       tolerance of the local error relative to each unknown (and to its scale, unless atol is given);
               the global error is typically 5 to 400 times larger
    atol       None, one number, or (n,)
    max_order  1 to 5; orders above 2 feed energy into lightly damped modes
    """

    rtol: float | None = None
    atol: Any = None
    max_order: int = 5

    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = dict.fromkeys(("bdf", "dassl", "daspk", "ddaspk", "ode15i"), "ida")
    factors: ClassVar[dict[str, dict[str, float]]] = {"IDA": {"GGL": 2e-3, "ODE": 5e-3, "DAE": 2e-3}}
    error_fall: ClassVar[float] = 0.4  # small, since errors of variable-order runs at similar rtol differ by a factor of 5
    companion: ClassVar[float] = 30.0
    starts_low: ClassVar[bool] = True
    tightest: ClassVar[dict[str, float]] = {"": 1e-13}

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "max_order", whole, "BDF has orders 1 to 5", least=1, most=5)

    @property
    def bdf_order(self) -> int:
        """Highest order of its formulas."""
        return self.max_order

    def check(self, system: System) -> None:
        """Raise OptionError for an index above 1, and for loose tolerances with stiff beams."""
        highest = int(np.max(system.index))
        if highest > 1:
            worst = system.names[int(np.argmax(system.index))]
            raise OptionError(f"unknown {worst} has index {highest}: IDA takes index 1, above it its error test fails, or "
                              "passes silently with a wrong answer; use mb.RadauIIA(3) or, for a scene, "
                              "form=mb.GGL(algebraic=False)")
        if self.max_order > 2 and self.tolerance >= LOOSE and system.vibration is not None:
            name, angle = system.vibration()
            if angle > FAST:
                raise OptionError(f"beam '{name}' vibrates by {angle:.1e} rad of phase in the characteristic time of the motion, "
                                  f"too fast for IDA with rtol = {self.tolerance:g} and max_order = {self.max_order}, which ends "
                                  "silently with a wrong answer; use mb.RadauIIA(3), or max_order=2 and compare with a smaller "
                                  "rtol")

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        _IdaRun(self, loop, h0).steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Dense output: Hermite interpolation over neighbouring steps."""
        return Hermite(t, y, yp, POINTS)


class _IdaRun(SundialsRun):
    """A run with IDA, which calls the residual and its Jacobian."""

    def create(self) -> native.Method:
        system, order, start = self.system, self.solver.max_order, (self.loop.t, *self.loop.state)
        sparse = system.sparse
        return native.Ida(equations_of(system), self.settings(order), start, sparse=sparse,
                          pattern=system.sparsity if sparse else system.pattern, differences=system.differences,
                          raising=self.watch is None and order > 3)

    def diagnosis(self, reason: str) -> SolverError:
        last, correction = self.last, self._newton_correction()
        weights = 1 / self.tolerance(last.y)
        if correction is None:
            return self.loop.failure(f"{reason}; {SINGULAR}", self.system.equations[largest(np.abs(last.values))])
        if np.max(np.abs(correction) * weights) < 1.0:  # Newton's method converges, so the error test failed
            y, yp = self.loop.state
            correction = last.y - y - (last.t - self.loop.t) * yp
        text = f"{reason}; see whether a force jumps or grows without bound there, or use mb.RadauIIA(3)"
        return self.loop.failure(text, self.system.names[largest(np.abs(correction) * weights)])

    def _newton_correction(self) -> Array | None:
        """Correction (n,) of one more Newton iteration at the last point that IDA evaluated; None where the iteration matrix is
        singular."""
        system, last = self.system, self.last
        data = np.zeros(system.jacobian_shape)
        system.jacobian(last.t, last.y, last.yp, last.cj, data)
        matrix = data if not system.sparse else as_csc(system, data).toarray()
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < system.n:
            return None
        return np.asarray(np.linalg.solve(matrix, last.values))


#: highest order of each method
HIGHEST = {"Adams": 12, "BDF": 5}
#: CVODE's own interpolant is sampled at the nodes of Radau IIA with this many stages. Measured errors compared with that
#: interpolant: equal with 5 stages, larger by 30 % with 4 at rtol 1e-12, 30 times as large with cubics over one step at rtol
#: 1e-11. Hermite polynomials through neighbouring steps have no correct digit where the step grows a thousandfold (at the start)
NODES = 5
#: with Adams and where no contact or switch is watched, a step at most this many times as long as the one before is interpolated
#: by the polynomial of degree 5 with y and y' at both its ends and at the start of the step before: it is as accurate there as
#: CVODE's interpolant, which then need not be called
TAME = 2.0


@dataclass(frozen=True)
class CVODE(Solver):
    """Variable-order, variable-step Adams or BDF for y' = f(t, y); every step is stored.

    rtol       tolerance of the local error relative to each unknown (and to its scale, unless atol is given)
    atol       None, one number, or (n,)
    method     "Adams" for motions that are not stiff, "BDF" for stiff ones; both solve their step by Newton's method
               with the exact Jacobian, kept over many steps (functional iteration took up to 3 times the evaluations)
    max_order  1 to 12 (Adams) or 1 to 5 (BDF); None: the highest
    """

    rtol: float | None = None
    atol: Any = None
    method: str = "Adams"
    max_order: int | None = None

    factors: ClassVar[dict[str, dict[str, float]]] = {
        "CVODE (Adams)": {"ODE": 1e-3, "Index1": 1e-3, "DAE": 5e-4},
        "CVODE (BDF)": {"ODE": 1e-3, "Index1": 1e-3, "DAE": 5e-4},
    }
    error_fall: ClassVar[float] = 0.4  # measured with rtol 30 times smaller; with 10 times smaller errors of Adams sometimes rose
    companion: ClassVar[float] = 30.0
    starts_low: ClassVar[bool] = True
    tightest: ClassVar[dict[str, float]] = {"": 1e-14}
    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = {
        **dict.fromkeys(("lsoda", "vode", "zvode", "odeint"), "cvode"), **dict.fromkeys(("adams", "ode113"), "cvodeadams"),
        **dict.fromkeys(("bdf", "ode15s"), "cvodebdf")}
    highest_index: ClassVar[int] = 0

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "method", word, "give 'Adams' (not stiff) or 'BDF' (stiff)", words=HIGHEST)
        highest = HIGHEST[self.method]
        set_option(self, "max_order", whole, f"{self.method} has orders 1 to {highest}; None is the highest",
                   least=1, most=highest)

    @classmethod
    def variants(cls) -> list[CVODE]:
        """The method as Adams and as BDF."""
        return [cls(method=method) for method in HIGHEST]

    @property
    def label(self) -> str:
        """Name with the kind of method."""
        return f"CVODE ({self.method})"

    @property
    def bdf_order(self) -> int:
        """Highest order of its formulas; 0 for Adams."""
        return 0 if self.method == "Adams" else self.max_order or HIGHEST[self.method]

    def check(self, system: System) -> None:
        """Raise OptionError for a system without a right-hand side."""
        check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        _CvodeRun(self, loop, h0).steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Polynomials of degree 5: sampled from CVODE's interpolant, or through y and y' where these are as accurate."""
        inner = np.empty((len(pieces), NODES - 1, y.shape[1]))
        own = np.array([piece is not None for piece in pieces], dtype=bool)
        tame = np.flatnonzero(~own)
        inner[tame] = sampled(Hermite(t, y, yp, 3), tame, NODES)
        if own.any():
            inner[own] = np.array([piece for piece in pieces if piece is not None])
        return Collocation(radau_table(NODES), t, y, inner)


class _CvodeRun(SundialsRun):
    """A run with CVODE, which calls the right-hand side and its Jacobian."""

    def create(self) -> native.Method:
        solver, system, start = self.solver, self.system, (self.loop.t, *self.loop.state)
        smooth = solver.method == "Adams" and self.watch is None  # in stiff equations (BDF) y' magnifies errors of y
        settings, nodes = self.settings(solver.max_order or HIGHEST[solver.method]), radau_table(NODES).c[:-1]
        multistep = native.ADAMS if solver.method == "Adams" else native.BDF
        return native.Cvode(rates_of(system, rate_jacobian), settings, start, multistep=multistep, nodes=nodes,
                            tame=TAME if smooth else 0.0)

    def accepted(self, watch: SundialsWatch) -> None:
        """Request a new Jacobian where that of CVODE, evaluated at predicted states, is with other contacts closed."""
        newest = self.last.newest()
        if newest is not None:
            watch.jacobian_at(*newest)
        if watch.stiffness_changed():
            self.last.renew()

    def probe(self, t: float, y: Array, yp: Array) -> list[Array]:
        """F(t, y, y') and f(t, y); F first, because its rows, the equations of motion, have names that say more than those of
        f."""
        out = np.empty(self.system.n)
        self.system.rhs(t, y, out)
        return [*super().probe(t, y, yp), out]

    def diagnosis(self, reason: str) -> SolverError:
        last, (y, yp) = self.last, self.loop.state
        dt = last.t - self.loop.t
        missed = np.abs(last.y - y - dt * yp) + np.abs(dt * (last.values - yp))
        worst = largest(missed / self.tolerance(last.y))
        other = "mb.CVODE(method='BDF') or mb.RadauIIA(3)" if self.solver.method == "Adams" else "mb.RadauIIA(3)"
        return self.loop.failure(f"{reason}; where the motion is stiff, use {other}", self.system.names[worst])
