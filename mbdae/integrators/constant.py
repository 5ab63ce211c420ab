"""Steps of constant length, for all methods that take them; the right-hand side f of y' = f(t, y), for methods that take ordinary
differential equations; and one-step methods of a user's own for these."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from math import ceil
from typing import Any, ClassVar, Protocol

import numpy as np

from mbdae.deferred import splu
from mbdae.errors import OptionError
from mbdae.integrators.dense import hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.matrices import as_csc
from mbdae.integrators.solution import Interpolant, Stats
from mbdae.integrators.stepped import Stepped
from mbdae.integrators.watch import StepWatch
from mbdae.integrators.watched_arguments import cubic_of_step
from mbdae.system.base import Array, System
from mbdae.values import largest, option, whole


def check_rates(label: str, system: System) -> None:
    """Raise OptionError for a system without a right-hand side; label: of the solver."""
    if system.rhs is not None:
        return
    needs = f"{label} needs y' = f(t, y), but this system"
    if any(kind in ("lambda", "mu") for kind in system.kinds):
        raise OptionError(f"{needs} ({system.label}) has multipliers of constraints, or other algebraic unknowns: use "
                          "mb.RadauIIA(3); or, for a scene, form=mb.Index1(multipliers='eliminated'), which solves for the "
                          "multipliers at every state, or s.recursive() if its joints form a tree")
    raise OptionError(f"{needs} ({system.label}) gives only F(t, y, y') = 0, no right-hand side: use mb.IDA() or mb.RadauIIA(3), "
                      f"or give the DAE its rhs=, a function (t, y, out) that fills out with y'")


def rate_jacobian(system: System, t: float, y: Array, yp: Array) -> Array:
    """df/dy (n, n) of y' = f(t, y) at yp = f(t, y), from the system, or as -(dF/dy')^-1 dF/dy from F(t, y, y') = 0."""
    if system.rate_jacobian is not None:
        return np.asarray(system.rate_jacobian(t, y))
    fy, fyp = system.jacobian_parts(t, y, yp)
    try:
        if not system.sparse:
            return np.asarray(-np.linalg.solve(fyp, fy))
        return np.asarray(-splu(as_csc(system, fyp)).solve(as_csc(system, fy).toarray()))
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise OptionError(
            f"dF/dy' is singular at t = {t:.9g} s: an equation contains no derivative (such as a motion without mass), or the "
            "derivatives of several depend on each other, so there is no y' = f(t, y); use mb.IDA() or mb.RadauIIA(3)"
        ) from error


#: tolerance of unknowns, relative to their magnitude plus their scale, that the watch for kinks assumes, since constant steps
#: have no tolerance
FOLLOWED = 1e-9
#: fractions of a step: lengths that differ by less than SAME count as equal; a step whose end is nearer than CLOSE to a kink of
#: an input ends at the kink, except for the last step of a run
SAME, CLOSE = 1e-6, 1e-3


#: why a step could not be solved
SINGULAR = "the iteration matrix is singular: the position is singular, or the equations do not determine an unknown"


def not_finite(equation: str, t: float) -> str:
    """What a message says of an equation that has no finite value at t, s."""
    return (f"equation {equation} is not finite near t = {t:.9g} s: look in it for a division by 0, a root or logarithm of a "
            "negative number, or values that grow beyond bounds, as with too long steps")


class StepFailedError(Exception):
    """A step could not be solved; culprit: name of the unknown or equation that prevented it."""

    def __init__(self, message: str = "a step cannot be solved", culprit: str = "") -> None:
        super().__init__(message)
        self.culprit = culprit


class Stepping(Protocol):
    """The state of a run with constant steps: the time, and the unknowns at the end of the step just solved."""

    t: float

    def reached(self) -> Array:
        """y (n,) at the end of the step."""

    def inside(self, part: Array) -> Array:
        """y (k, n) on the polynomial of the step at fractions (k,) of it, or (n,) at one fraction."""

    def advance(self, h: float, t1: float) -> tuple[Any, ...]:
        """Accept the step; returns the arguments of `loop.accept`."""


@dataclass
class Going:
    """The state of a run with constant steps that checkpoints store: the step, and the watch for contacts and kinks."""

    step: Stepping
    watch: StepWatch | None


def constant_steps(loop: StepLoop, h: float, step: Stepping, solve: Callable[[float], Any], parts: Iterable[float] = ()) -> None:
    """Make steps of h (s) to the end; the last one is shorter where h does not divide the run. A step that is too long for an
    input of time is divided.

    solve(h): solve a step; parts: fractions of a step at which contacts are sought that close and open inside it.
    """
    watch = StepWatch.of(loop, lambda y: FOLLOWED * (np.abs(y) + loop.system.scale))
    t0, going = step.t, Going(step, watch)
    loop.goes_on(going)

    def inner(width: float) -> list[tuple[float, Array]]:
        return [(step.t + part * width, step.inside(np.asarray(part))) for part in parts]

    for t1, width, full in _steps(loop, h, step, t0):
        try:
            solve(width)
        except StepFailedError as error:
            raise loop.failure(f"a step of {width:g} s fails, try another step: {error}", error.culprit) from error
        loop.stats.shortened += not full
        if watch is not None:
            watch.look(t1, step.reached(), step.inside)
            watch.count_hidden(partial(inner, width))
            watch.keep()
        if not loop.accept(*step.advance(width, t1)):
            return
        loop.keep(going)


def _steps(loop: StepLoop, h: float, step: Stepping, t0: float) -> Iterator[tuple[float, float, bool]]:
    """(end, length, whether the length is h) of every remaining step; t0: time from which multiples of h are counted. Steps that
    are too long for an input of time are divided, and steps end at kinks of tables."""
    longest = loop.system.longest_step
    count = max(1, ceil((loop.t_end - t0) / h - SAME))
    for k in range(1, count + 1):
        goal, least = (loop.t_end, 0.0) if k == count else (t0 + k * h, CLOSE * h)
        while goal - step.t > least:
            end, parts = goal, 1
            if longest is not None:
                kink = longest.kink_after(step.t, SAME * h)
                end = kink if kink < goal + (least or -SAME * h) else goal
                parts = max(1, ceil((end - step.t) / longest.of_stretches(step.t) - SAME))
            width = (end - step.t) / parts
            full = abs(width - h) <= SAME * h
            yield end if parts == 1 else step.t + width, h if full else width, full


# -- One-step methods of a user's own


#: an unknown larger than this many times its scale plus its magnitude at the start is reported as the cause of a rate that is not
#: finite
GROWN = 1e12


@dataclass(frozen=True)
class OneStep(Stepped):
    """Base of a one-step method y1 = y(t + h) of your own for y' = f(t, y): state `order` and write `advance`.

        class Heun(mb.OneStep):
            order = 2

            def advance(self, f, t, y, h):
                k = f(t, y)
                return y + h / 2 * (k + f(t + h, y + h * k))

    step      constant step in s, run as it is; the steps of a run are equal, so they are a little shorter where its length is no
              multiple of it
    accuracy  without a step: the whole run is repeated with shorter equal steps until its error is below it; `Scene.simulate`
              sets it

    Implicit methods find df/dy in f.jacobian(t, y).

    It takes scenes without constraints (`s.recursive()` makes such of trees) and, by eliminated multipliers, those with
    constraints (`mb.Index1()`). `order` is that of the error of a whole run. Inside a step y is interpolated by the cubic with y
    and y' at both ends (order 4), for higher orders by a polynomial through up to four ends of steps (order 8). Options of your
    own are fields: decorate the class by @dataclass(frozen=True). `mb.measure_order` measures the order.
    """

    step: float | None = None
    accuracy: float | None = None
    rtol: float | None = field(default=None, init=False, repr=False)

    order: ClassVar[int] = 0
    highest_index: ClassVar[int] = 0
    restarts: ClassVar[bool] = False
    #: error to be raised in `advance`, with the reason, where a step cannot be solved; the run then ends with a SolverError that
    #: names the time
    Failed: ClassVar[type[StepFailedError]] = StepFailedError

    def __post_init__(self) -> None:
        option("order", self.order, whole, f"state the order of {self.label} in its class, such as order = 4", least=1, most=20)
        self._set_step()

    @abstractmethod
    def advance(self, f: RightHandSide, t: float, y: Array, h: float) -> Array:
        """y (n,) at t + h from y (n,) at t, which may not be changed. f(t, y) returns y' (n,), f.jacobian(t, y) df/dy (n, n)."""

    def check(self, system: System) -> None:
        """Raise OptionError for a system without a right-hand side."""
        check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Integrate with equal steps."""
        assert self.step is not None
        span, step = loop.t_end - float(system.t0), RightHandSide(self, system, loop.stats)
        constant_steps(loop, span / max(1, ceil(span / self.step - 1e-6)), step, step.solve)

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Polynomials through y and y' at the steps."""
        return hermite(self.order, t, y, yp)


class RightHandSide:
    """f of y' = f(t, y) as passed to `advance`, with the state (t, y, y') of the run and the end of the step just made."""

    def __init__(self, solver: OneStep, system: System, stats: Stats) -> None:
        self._solver, self._system, self._stats = solver, system, stats
        self.t, self.y, self.yp = float(system.t0), np.array(system.y0, dtype=float), np.array(system.yp0, dtype=float)
        self.y.setflags(write=False)

    def __call__(self, t: float, y: Array) -> Array:
        """y' (n,); at the start of the step the stored value is returned."""
        if y is self.y and t == self.t:
            return self.yp.copy()
        if np.shape(y) != self.y.shape or np.ndim(t) or np.iscomplexobj(y):
            raise OptionError(f"{self._solver.label}.advance called f(t, y) with t of shape {np.shape(t)} and {_kind(y)}: give a "
                              f"time and real numbers of shape {self.y.shape}")
        out = np.empty(self._system.n)
        self._system.rhs(t, y, out)
        self._stats.residuals += 1
        if not np.isfinite(out).all():
            raise self._not_finite(t, y, out)
        return out

    def jacobian(self, t: float, y: Array) -> Array:
        """df/dy (n, n)."""
        self._stats.jacobians += 1
        return rate_jacobian(self._system, t, y, self(t, y))

    def _not_finite(self, t: float, y: Array, rate: Array) -> StepFailedError:
        """The failure that names an unknown which has diverged, or else the equation that is not finite."""
        system, rows = self._system, np.empty(self._system.n)
        size = np.abs(y) / (np.asarray(system.scale) + np.abs(system.y0))
        if not np.max(size) < GROWN:
            return StepFailedError(f"the motion grows beyond all bounds near t = {t:.9g} s: take shorter steps, or see "
                                   "whether a force adds energy without end", system.names[largest(size)])
        system.residual(t, y, self.yp, rows)
        bad = ~np.isfinite(rows if not np.isfinite(rows).all() else rate)
        equation = system.equations[int(np.argmax(bad))]
        return StepFailedError(not_finite(equation, t), equation)

    def solve(self, h: float) -> None:
        """Make a step of h (s)."""
        with np.errstate(over="ignore", invalid="ignore"):  # values that overflow are reported below
            made = self._solver.advance(self, self.t, self.y, h)
            if made is None or np.shape(made) != self.y.shape or np.iscomplexobj(made):
                raise OptionError(f"{self._solver.label}.advance returned {_kind(made)}: return y at t + h, real numbers "
                                  f"of shape {self.y.shape}")
            end: Array = np.array(made, dtype=float)
            if not np.isfinite(end).all():
                worst = self._system.names[int(np.argmax(~np.isfinite(end)))]
                raise StepFailedError(f"{self._solver.label}.advance returned a value that is not finite near t = "
                                      f"{self.t + h:.9g} s: check its formulas, or take shorter steps", worst)
            self._h, self._end, self._rate = h, end, self(self.t + h, end)
        end.setflags(write=False)

    def reached(self) -> Array:
        """y (n,) at the end of the step."""
        return self._end

    def inside(self, part: Array) -> Array:
        """y (k, n) on the cubic polynomial of the step just made, at fractions (k,) of the step."""
        return cubic_of_step(self._h, (self.y, self.yp), (self._end, self._rate))(part)

    def advance(self, h: float, t1: float) -> tuple[float, Array, Array]:
        """Move to t1 = t + h; returns (t1, y, y')."""
        self.t, self.y, self.yp = t1, self._end, self._rate
        return t1, self.y, self.yp


def _kind(value: Any) -> str:
    """Type and shape of a value, for messages."""
    kind = "complex numbers" if np.iscomplexobj(value) else "an array"
    return "None" if value is None else f"{kind} of shape {np.shape(value)}"
