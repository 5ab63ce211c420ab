"""User-defined one-step methods for ordinary differential equations."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from math import ceil
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError
from mbdae.integrators.constant import StepFailedError, check_rates, constant_steps, not_finite, rate_jacobian
from mbdae.integrators.dense import hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant, Stats
from mbdae.integrators.stepped import Stepped
from mbdae.integrators.watched_arguments import cubic_of_step
from mbdae.system.base import Array, System
from mbdae.values import largest, option, whole

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
