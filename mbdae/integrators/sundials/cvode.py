"""CVODE of SUNDIALS (variable-order Adams or BDF) through scikit-sundae, for systems with a right-hand side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.sparse.linalg import splu

from mbdae.errors import OptionError
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.dense import Collocation, Hermite, cubic
from mbdae.integrators.loop import BLOCK, StepLoop
from mbdae.integrators.runge_kutta.radau_tables import radau_table
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.sundials.shared import Callbacks, as_csc, not_finite, reason, watched
from mbdae.integrators.watched.watch import StepWatch, SundialsWatch, stop_time
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
        if system.rhs is not None:
            return
        if any(kind in ("lambda", "mu") for kind in system.kinds):
            raise OptionError(
                f"{self.label} needs y' = f(t, y), but this system has constraints ({system.label} form), so no right-hand "
                "side: use form=mb.Index1(), which solves for the multipliers at every state, mb.IDA() or mb.RadauIIA(3), or "
                "make the joints recursive with s.recursive()"
            )
        raise OptionError(
            f"{self.label} needs y' = f(t, y), but this system ({system.label}) gives only F(t, y, y') = 0, no right-hand side: "
            "use mb.IDA() or mb.RadauIIA(3), or give the DAE its rhs=, a function (t, y, out) that fills out with y'"
        )

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """One internal step at a time, so that no output time interrupts the method."""
        atol = absolute_tolerance(system, self.tolerance, self.atol)
        callbacks = _Callbacks(system, loop)
        method = _create(self, callbacks, atol, h0)
        with watched(callbacks):
            method.init_step(system.t0, system.y0)
            going, watch, before = True, SundialsWatch.of(loop, lambda y: self.tolerance * np.abs(y) + atol), loop.stats.jacobians
            smooth = self.method == "Adams" and watch is None  # with BDF slopes magnify the tolerance of stiff unknowns
            while going:
                result = method.step(loop.t_end, method="onestep", tstop=stop_time(loop, watch))
                if not result.success or not result.t > loop.t:
                    raise _failure(loop, callbacks, result, self, atol, "" if watch is None else watch.nearest())
                restarts = before + (watch.jacobians if watch else 0)
                loop.stats.jacobians = loop.stats.factorisations = restarts + int(result.njev)
                loop.stats.newton_iterations = loop.stats.residuals
                if watch is not None and watch.refuses(result, callbacks.values):
                    method.init_step(loop.t, loop.state[0])
                    callbacks.restart()
                    loop.guard()
                    continue
                callbacks.renew = watch is not None and callbacks.stiffness_changed(watch)
                # f at the last iterate is the slope of CVODE's own polynomial, and within the Newton tolerance f(t, y)
                t, y, yp = float(result.t), result.y, callbacks.values.copy()
                tame = smooth and t - loop.t <= TAME * loop.last_step
                going = loop.accept(t, y, yp, None if tame else _inner(self, method, loop, t, y, yp, atol))

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Polynomials of degree 5: of CVODE's own interpolant, or through y and y' where they are as good."""
        c = radau_table(NODES).c[:-1]
        inner = np.empty((len(pieces), NODES - 1, y.shape[1]))
        tame = np.array([i for i, piece in enumerate(pieces) if piece is None], dtype=np.intp)
        widths, hermite = np.diff(t), Hermite(t, y, yp, 3)
        for some in np.split(tame, range(BLOCK, len(tame), BLOCK)):  # not all at once: that takes several times their memory
            times = t[some, None] + widths[some, None] * c
            inner[some] = hermite.value(times.ravel()).reshape(len(some), NODES - 1, y.shape[1]) - y[some, None]
        for i, piece in enumerate(pieces):
            if piece is not None:
                inner[i] = piece
        return Collocation(radau_table(NODES), t, y, inner)


def _create(solver: CVODE, callbacks: _Callbacks, atol: Array, h0: float | None) -> Any:
    import sksundae.cvode  # 0.4 s: only when it is used

    return sksundae.cvode.CVODE(
        callbacks.rate,
        jacfn=callbacks.jacobian,
        method=solver.method,
        rtol=solver.tolerance,
        atol=atol,
        max_order=solver.max_order or HIGHEST[solver.method],
        first_step=h0 or 0.0,
        max_num_steps=10**9,
    )


def _inner(solver: CVODE, method: Any, loop: StepLoop, t: float, y: Array, yp: Array, atol: Array) -> Array:
    """Increments (NODES - 1, n) since the last accepted step, at the inner nodes: of the cubic with y and y' at both ends where
    CVODE's own interpolant agrees with it, else of the latter. While the order is low the slopes of the cubic are better than
    those of that interpolant, which is linear in the first step."""
    own, ends = _own(method, loop, t), cubic(NODES, t - loop.t, loop.state, (y, yp))
    return ends if (np.abs(own - ends) <= solver.tolerance * np.abs(y) + atol).all() else own


def _own(method: Any, loop: StepLoop, t: float) -> Array:
    """The same of CVODE's own interpolant.

    In normal mode CVODE interpolates inside its last step. It then has to be brought back to t, or the next internal
    step would only return to it.
    """
    start, y = loop.t, loop.state[0]
    inner = np.array([method.step(start + c * (t - start), method="normal").y - y for c in radau_table(NODES).c[:-1]])
    method.step(t, method="normal")
    return inner


class _Callbacks(Callbacks):
    """The right-hand side and its Jacobian for CVODE."""

    def __init__(self, system: System, loop: StepLoop) -> None:
        super().__init__(system, loop)
        self._choosing = True
        self.renew, self._renewing = False, False
        self._newest: tuple[float, Array] | None = None  # where the newest Jacobian was evaluated

    def evaluated(self, t: float) -> None:
        """Count an evaluation at t; those that choose the first step are no attempts, so none of them is rejected."""
        self.t = min(self.t, t) if self._choosing else self.t
        super().evaluated(t)

    def stiffness_changed(self, watch: StepWatch) -> bool:
        """Whether the Jacobian in use is of other contacts than there are now; CVODE evaluates it at predicted states."""
        if self._newest is not None:
            watch.jacobian_at(*self._newest)
            self._newest = None
        return watch.stiffness_changed()

    def restart(self) -> None:
        """The method begins anew: it chooses its first step again."""
        self._choosing = True

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


def rate_jacobian(system: System, t: float, y: Array, yp: Array) -> Array:
    """df/dy (n, n) of y' = f(t, y) at yp = f(t, y): -(dF/dy')^-1 dF/dy of F(t, y, y') = 0, unless the system knows it."""
    if system.rate_jacobian is not None:
        return np.asarray(system.rate_jacobian(t, y))
    fy, fyp = system.jacobian_parts(t, y, yp)
    try:
        if system.sparsity is None:
            return np.asarray(-np.linalg.solve(fyp, fy))
        return np.asarray(-splu(as_csc(system, fyp)).solve(as_csc(system, fy).toarray()))
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise OptionError(
            f"dF/dy' is singular at t = {t:.9g}: an equation lacks its derivative (a massless motion?), so there is no "
            "y' = f(t, y); use mb.IDA() or mb.RadauIIA(3)"
        ) from error


def _failure(loop: StepLoop, last: _Callbacks, result: Any, solver: CVODE, atol: Array, where: str) -> BaseException:
    """The exception raised inside a callback, or a SolverError that names what resists."""
    if last.error is not None:
        return last.error
    message = reason(result) + where
    undefined = not_finite(loop, last, message)
    if undefined is not None:
        return undefined
    dt, (y, yp) = last.t - loop.t, loop.state
    missed = np.abs(last.y - y - dt * yp) + np.abs(dt * (last.values - yp))
    worst = largest(missed / (solver.tolerance * np.abs(last.y) + atol))
    other = "mb.CVODE(method='BDF') or mb.RadauIIA(3)" if solver.method == "Adams" else "mb.RadauIIA(3)"
    return loop.failure(f"{message}; where the motion is stiff, use {other}", last.system.names[worst])
