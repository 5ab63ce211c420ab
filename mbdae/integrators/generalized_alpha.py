"""Generalised-alpha with constant steps for equations of motion, including HHT and Newmark."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from math import inf
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError
from mbdae.integrators.alpha_step import CUBIC, ORDER, Alphas, AlphaStep
from mbdae.integrators.collocation_step import CollocationStep, Demand
from mbdae.integrators.collocation_tables import radau_table
from mbdae.integrators.constant import StepFailedError, constant_steps
from mbdae.integrators.dense import Collocation
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant, Stats
from mbdae.integrators.stepped import Stepped
from mbdae.system.base import Array, System
from mbdae.values import number, set_option

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
