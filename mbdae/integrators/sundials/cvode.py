"""CVODE of SUNDIALS (variable-order Adams or BDF) for systems with a right-hand side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import SolverError
from mbdae.integrators.base import Solver, set_tolerances
from mbdae.integrators.dense import Collocation, Hermite, sampled
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.rates import check_rates, rate_jacobian
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.sundials.shared import SundialsRun
from mbdae.integrators.watched.watch import SundialsWatch
from mbdae.native import sundials as native
from mbdae.native.equations import rates_of
from mbdae.system.base import Array, System
from mbdae.ties import largest
from mbdae.values import set_option, whole, word

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
    tightest: ClassVar[dict[str, float]] = {"": 1e-14}
    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = {
        **dict.fromkeys(("lsoda", "vode", "zvode", "odeint"), "cvode"), **dict.fromkeys(("adams", "ode113"), "cvodeadams"),
        **dict.fromkeys(("bdf", "ode15s"), "cvodebdf")}  # fmt: skip
    highest_index: ClassVar[int] = 0

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "method", word, "give 'Adams' (not stiff) or 'BDF' (stiff)", words=HIGHEST)
        highest = HIGHEST[self.method]
        set_option(self, "max_order", whole, f"{self.method} has orders 1 to {highest}; None is the highest",
                   least=1, most=highest)  # fmt: skip

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
        _Run(self, loop, h0).steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Polynomials of degree 5: sampled from CVODE's interpolant, or through y and y' where these are as accurate."""
        inner = np.empty((len(pieces), NODES - 1, y.shape[1]))
        own = np.array([piece is not None for piece in pieces], dtype=bool)
        tame = np.flatnonzero(~own)
        inner[tame] = sampled(Hermite(t, y, yp, 3), tame, NODES)
        if own.any():
            inner[own] = np.array([piece for piece in pieces if piece is not None])
        return Collocation(radau_table(NODES), t, y, inner)


class _Run(SundialsRun):
    """A run with CVODE, which calls the right-hand side and its Jacobian."""

    def create(self) -> native.Method:
        solver, system, start = self.solver, self.system, (self.loop.t, *self.loop.state)
        smooth = solver.method == "Adams" and self.watch is None  # in stiff equations (BDF) y' magnifies errors of y
        settings, nodes = self.settings(solver.max_order or HIGHEST[solver.method]), radau_table(NODES).c[:-1]
        multistep = native.ADAMS if solver.method == "Adams" else native.BDF
        return native.Cvode(rates_of(system, rate_jacobian), settings, start, multistep=multistep, nodes=nodes,
                            tame=TAME if smooth else 0.0)  # fmt: skip

    def accepted(self, watch: SundialsWatch) -> None:
        """Request a new Jacobian where the present one was evaluated with other contacts closed: CVODE evaluates it at predicted
        states."""
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
