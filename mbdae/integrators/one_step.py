"""One-step methods of your own for ordinary differential equations; generalised-alpha, HHT and Newmark with constant steps."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from dataclasses import dataclass, field
from math import ceil, inf
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError
from mbdae.integrators import radau_table
from mbdae.integrators.alpha_step import CUBIC, ORDER, Alphas, AlphaStep
from mbdae.integrators.collocation_step import CollocationStep, Demand
from mbdae.integrators.constant import StepFailedError, check_rates, constant_steps, not_finite, rate_jacobian
from mbdae.integrators.dense import Collocation, hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant, Stats
from mbdae.integrators.stepped import Stepped
from mbdae.integrators.watched_arguments import cubic_of_step
from mbdae.system.base import Array, System
from mbdae.values import largest, number, option, set_option, whole

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



SECOND = (2, 2, 2)  #: order of positions, of velocities and of multipliers
#: from this spectral radius at high frequencies on a warning says that long steps gain energy or, for Newmark's method with
#: mb.Index3(), that constraint forces do not converge
GAINS = 0.9


class _Alpha(Stepped):
    """Base of the generalised-alpha methods; `rho_infinity`: spectral radius at high frequencies."""

    order: ClassVar[int] = 2
    highest_index: ClassVar[int] = 3
    restarts: ClassVar[bool] = False
    orders: ClassVar[dict[str, dict[str, tuple[int, int, int]]]] = {
        label: dict.fromkeys(("GGL", "Index3", "Index1"), SECOND) for label in ("GeneralizedAlpha", "HHT")
    }
    tightest: ClassVar[dict[str, float]] = {"": 1e-10}

    @property
    def rho_infinity(self) -> float:
        """Spectral radius of a step at high frequencies: factor by which such vibrations are damped per step, 0 to 1."""
        raise NotImplementedError

    @property
    def coefficients(self) -> Alphas:
        """Coefficients (alpha_m, alpha_f, gamma, beta) of the method for accelerations."""
        raise NotImplementedError

    def check(self, system: System) -> None:
        """Raise OptionError for systems that are not equations of motion, or whose multipliers enter by their derivatives (as GGL
        for IDA has them)."""
        kinds = [ORDER.index(k) if k in ORDER else -1 for k in system.kinds]
        if "v" not in system.kinds or -1 in kinds or kinds != sorted(kinds):
            raise OptionError(
                f"{self.label} needs equations of motion M u' + G^T lambda = f, g = 0, but this system ({system.label}) has no "
                "partition into them: use mb.RadauIIA(3) or mb.IDA() or, for equations of motion stated by mb.DAE, give it "
                "partition=(M, f, g, G)"
            )
        forces = np.array([kind == "lambda" for kind in system.kinds])
        columns = forces if not system.sparse else forces[np.repeat(np.arange(system.n), np.diff(system.sparsity.indptr))]
        if forces.any() and not np.any(system.jacobian_parts(system.t0, system.y0, system.yp0)[0][..., columns]):
            raise OptionError(f"{self.label} needs the multipliers (constraint forces) themselves as unknowns, this system "
                              f"({system.label}) contains only their derivatives: for a scene use mb.GGL(algebraic=True), for "
                              "mb.DAE let the residual contain the multipliers")

    def doubts(self, system: System) -> list[str]:
        """Warnings about known weaknesses of the method with the present options."""
        if self.rho_infinity < GAINS:
            return []
        more_damped = "mb.GeneralizedAlpha(rho=0.7) or mb.HHT(alpha=0.1), which damp more"
        if self.coefficients == Alphas.of(0.0, 0.0) and "lambda" in system.kinds and "mu" not in system.kinds:
            return [f"{self.label} without damping (Newmark's method, alpha = 0): with form mb.Index3() constraint forces do not "
                    f"converge with shorter steps; use form=mb.GGL(), or {more_damped}"]
        return [f"{self.label} damps high frequencies so little (spectral radius {self.rho_infinity:.2g}) that long steps gain "
                f"energy, and with form mb.Index3() may grow without bound; look at r.energy.balance, or use {more_damped}"]

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Integrate with constant steps."""
        assert self.step is not None
        for doubt in self.doubts(system):
            warnings.warn(doubt, AccuracyWarning, stacklevel=4)
        rho, h = self.rho_infinity, self.step
        step = AlphaStep(system, self.coefficients, Alphas.of((3 * rho - 1) / (2 * (rho + 1)), rho / (rho + 1)), loop.stats)
        bound = inf if system.longest_step is None else system.longest_step(step.t)
        _begin(step, min(h, bound, loop.t_end - step.t), loop.stats)
        constant_steps(loop, h, step, step.solve)

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Cubic through y and y' at both ends of a step; algebraic unknowns on straight lines."""
        return Collocation.of(CUBIC, t, y, pieces)


@dataclass(frozen=True)
class GeneralizedAlpha(_Alpha):
    """Generalised-alpha of Chung and Hulbert, stabilised as Arnold, Bruels and Cardona do: order 2 in positions, velocities and
    multipliers, in the GGL form, Index3 (for comparison) and ODE.

    rho       spectral radius for high frequencies, 0 (damps them in one step) to 1 (keeps them); from 0.9 on coarse steps gain
              energy
    step      constant step in s, run as it is: no accuracy is asked or estimated. The last one is cut to end at t_end
    accuracy  without a step: steps are halved until the error is below it; `Scene.simulate` sets it
    """

    rho: float = 0.7
    step: float | None = None
    accuracy: float | None = None
    rtol: float | None = field(default=None, init=False, repr=False)
    word: ClassVar[str] = "genalpha"
    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = dict.fromkeys(("newmark", "newmarkbeta", "chunghulbert"), "genalpha")

    def __post_init__(self) -> None:
        set_option(self, "rho", number, "give the spectral radius for high frequencies, 0 to 1 (0.6 to 0.8 serve most)",
                   least=0, most=1)
        self._set_step()

    @property
    def rho_infinity(self) -> float:
        return self.rho

    @property
    def coefficients(self) -> Alphas:
        return Alphas.of((2 * self.rho - 1) / (self.rho + 1), self.rho / (self.rho + 1))


@dataclass(frozen=True)
class HHT(_Alpha):
    """Hilber, Hughes and Taylor: the member of the generalised-alpha family with alpha_m = 0, alpha_f = alpha.

    alpha     0 (Newmark's trapezoidal rule, whose multipliers do not converge in index 3) to 1/3 (most damping); -1/3 to 0 are
              the same values with Hughes's sign.
              Its spectral radius for high frequencies is (1 - alpha) / (1 + alpha): 0.74 for 0.15
    step, accuracy  as in GeneralizedAlpha
    """

    alpha: float = 0.15
    step: float | None = None
    accuracy: float | None = None
    rtol: float | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        set_option(self, "alpha", number, "give 0 (Newmark) to 1/3 (most damping), or the same values below 0, as Hughes counts",
                   least=-1 / 3, most=1 / 3)
        self._set_step()

    @property
    def rho_infinity(self) -> float:
        return (1 - abs(self.alpha)) / (1 + abs(self.alpha))

    @property
    def coefficients(self) -> Alphas:
        return Alphas.of(0.0, abs(self.alpha))


def _begin(step: AlphaStep, h: float, stats: Stats) -> None:
    """Set the algorithmic rates a and w at the start, which belong to times slightly off t0 (`Alphas.lead`), by a short step of
    Radau IIA. With y'(t0) in their place multipliers would oscillate at first and converge with a lower order than 2. Where the
    short step fails, y'(t0) is used all the same."""
    lead = min(step.A.lead, step.B.lead if step.size[2] else 0.0)
    if lead == 0:
        return
    tolerance = 1e-10
    scale = np.asarray(step.system.scale, dtype=float)
    short = CollocationStep(step.system, radau_table(3), stats, Demand(tolerance, tolerance * scale, 1e-3, 15), estimate=False)
    try:
        short.solve(-lead * h)
    except StepFailedError:
        return
    change = (short.newton.Yp[-1] - step.yp) / -lead
    step.a += step.A.lead * change[step.u]
    step.w += step.B.lead * change[step.s]
