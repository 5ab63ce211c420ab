"""CVODE of SUNDIALS (variable-order Adams or BDF) through scikit-sundae, for systems with a right-hand side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import SolverError
from mbdae.integrators.base import Solver, set_tolerances
from mbdae.integrators.dense import Collocation, Hermite, cubic, sampled
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.rates import check_rates, rate_jacobian
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.sundials.shared import SundialsRun
from mbdae.integrators.watched.watch import SundialsWatch
from mbdae.system.base import Array, System
from mbdae.ties import largest
from mbdae.values import set_option, whole, word

#: order a method may reach
HIGHEST = {"Adams": 12, "BDF": 5}
#: CVODE's own interpolant is sampled at the nodes of Radau IIA with this many stages. Hermite polynomials through
#: neighbouring steps lose all digits where the step grows a thousandfold (the start), cubic ones a factor of 30 at
#: rtol 1e-11; 4 stages lose 30 % at 1e-12, 5 nothing
NODES = 5
#: a step longer than the one before it by more than this is not interpolated by the polynomial of degree 5 with y and y' at
#: both its ends and at the start of the step before, which is as good as CVODE's own elsewhere and costs no calls of it
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
    error_fall: ClassVar[float] = 0.4  # over a factor of 30 in rtol; over 10 the error of Adams was seen to rise
    companion: ClassVar[float] = 30.0
    tightest: ClassVar[dict[str, float]] = {"": 1e-14}
    highest_index: ClassVar[int] = 0

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "method", word, "give 'Adams' (not stiff) or 'BDF' (stiff)", words=HIGHEST)
        highest = HIGHEST[self.method]
        set_option(self, "max_order", whole, f"{self.method} has orders 1 to {highest}; None is the highest",
                   least=1, most=highest)  # fmt: skip

    @classmethod
    def variants(cls) -> list[CVODE]:
        """Adams and BDF."""
        return [cls(method=method) for method in HIGHEST]

    @property
    def label(self) -> str:
        """Name with the method."""
        return f"CVODE ({self.method})"

    def check(self, system: System) -> None:
        """Refuse a system without a right-hand side."""
        check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        _Run(self, loop, h0).steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Polynomials of degree 5: of CVODE's own interpolant, or through y and y' where they are as good."""
        inner = np.empty((len(pieces), NODES - 1, y.shape[1]))
        tame = np.array([i for i, piece in enumerate(pieces) if piece is None], dtype=np.intp)
        inner[tame] = sampled(Hermite(t, y, yp, 3), tame, NODES)
        for i, piece in enumerate(pieces):
            if piece is not None:
                inner[i] = piece
        return Collocation(radau_table(NODES), t, y, inner)


class _Run(SundialsRun):
    """A run with CVODE, which calls the right-hand side and its Jacobian."""

    def __init__(self, solver: CVODE, loop: StepLoop, h0: float | None) -> None:
        super().__init__(solver, loop, h0)
        self.smooth = solver.method == "Adams" and self.watch is None  # with BDF slopes magnify the tolerance of stiff unknowns
        self._choosing = True
        self.renew, self._renewing = False, False
        self._newest: tuple[float, Array] | None = None  # where the newest Jacobian was evaluated

    def create(self, **options: Any) -> Any:
        import sksundae.cvode  # 0.4 s: only when it is used

        method, highest = self.solver.method, self.solver.max_order or HIGHEST[self.solver.method]
        return sksundae.cvode.CVODE(self.rate, jacfn=self.jacobian, method=method, max_order=highest, **options)

    def begin(self, t: float, y: Array, yp: Array) -> None:
        """Start the method, which then chooses its first step."""
        self.method.init_step(t, y)
        self._choosing = True

    def slope(self, result: Any) -> Array:
        """f at the last iterate: the slope of CVODE's own polynomial, and within the Newton tolerance f(t, y)."""
        return self.values.copy()

    def piece(self, t: float, y: Array, yp: Array) -> Array | None:
        """Increments (NODES - 1, n) since the last accepted step, at the inner nodes: of the cubic with y and y' at both ends
        where CVODE's own interpolant agrees with it, else of the latter. While the order is low the slopes of the cubic are
        better than those of that interpolant, which is linear in the first step. None where `dense` needs no piece."""
        self.renew = self.watch is not None and self._stiffness_changed(self.watch)
        if self.smooth and t - self.loop.t <= TAME * self.loop.last_step:
            return None
        own, ends = self._own(t), cubic(NODES, t - self.loop.t, self.loop.state, (y, yp))
        return ends if (np.abs(own - ends) <= self.tolerance(y)).all() else own

    def _own(self, t: float) -> Array:
        """The same of CVODE's own interpolant.

        In normal mode CVODE interpolates inside its last step. It then has to be brought back to t, or the next internal
        step would only return to it.
        """
        start, y, step = self.loop.t, self.loop.state[0], self.method.step
        inner = np.array([step(start + c * (t - start), method="normal").y - y for c in radau_table(NODES).c[:-1]])
        step(t, method="normal")
        return inner

    def evaluated(self, t: float) -> None:
        """Count an evaluation at t; those that choose the first step are no attempts, so none of them is rejected."""
        self.t = min(self.t, t) if self._choosing else self.t
        super().evaluated(t)

    def _stiffness_changed(self, watch: SundialsWatch) -> bool:
        """Whether the Jacobian in use is of other contacts than there are now; CVODE evaluates it at predicted states."""
        if self._newest is not None:
            watch.jacobian_at(*self._newest)
            self._newest = None
        return watch.stiffness_changed()

    def probe(self, t: float, y: Array, yp: Array) -> list[Array]:
        """F(t, y, y'), whose rows tell more, then f(t, y)."""
        out = np.empty(self.system.n)
        self.system.rhs(t, y, out)
        return [*super().probe(t, y, yp), out]

    def rate(self, t: float, y: Array, out: Array) -> None:
        """y' for CVODE.

        With `renew` it is not a number once, and wherever CVODE then asks for it at what is not a number: the only way to
        make CVODE ask for a new Jacobian before its Newton iteration fails (it then repeats the same step).
        """
        with self:
            if self.renew or (self._renewing and np.isnan(y[0])):
                self.renew, self._renewing = False, True
                out[:] = np.nan
                return
            self._renewing = False
            self.evaluated(t)
            self.system.rhs(t, y, out)
            self.y[:], self.values[:] = y, out

    def jacobian(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """df/dy for CVODE; asked for first in the first attempt."""
        with self:
            self._choosing = False
            self._newest = t, y.copy()
            out[...] = rate_jacobian(self.system, t, y, yp)

    def diagnosis(self, message: str) -> SolverError:
        dt, (y, yp) = self.t - self.loop.t, self.loop.state
        missed = np.abs(self.y - y - dt * yp) + np.abs(dt * (self.values - yp))
        worst = largest(missed / self.tolerance(self.y))
        other = "mb.CVODE(method='BDF') or mb.RadauIIA(3)" if self.solver.method == "Adams" else "mb.RadauIIA(3)"
        return self.loop.failure(f"{message}; where the motion is stiff, use {other}", self.system.names[worst])
