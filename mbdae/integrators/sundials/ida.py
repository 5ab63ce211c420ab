"""IDA of SUNDIALS (variable-order BDF) through scikit-sundae, for systems of index at most 1."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.dense import Hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.matrices.iteration import as_csc
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.sundials.shared import Callbacks, not_finite, reason, watched
from mbdae.integrators.watched.watch import SundialsWatch, stop_time
from mbdae.system.base import Array, System
from mbdae.ties import largest
from mbdae.values import set_option, whole

#: neighbouring steps in the interpolant; 4 loses all digits where the step jumps (start, last step), 2 gains nothing
POINTS = 3
#: beams that vibrate by more than FAST rad in the characteristic time of the motion: orders above 2 feed the vibrations they
#: do not resolve. Measured there: errors of 0.1 to 0.5 without a sign of it at 1e-3, of 2e-3 or no end at 1e-4, no end at 1e-5
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

    factors: ClassVar[dict[str, dict[str, float]]] = {"IDA": {"GGL": 2e-3, "ODE": 5e-3, "DAE": 2e-3}}
    error_fall: ClassVar[float] = 0.4  # the error of a variable-order run scatters by a factor of 5 over nearby rtol
    companion: ClassVar[float] = 30.0
    tightest: ClassVar[dict[str, float]] = {"": 1e-13}
    alternative: ClassVar[str] = ", or use RadauIIA(3)"

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "max_order", whole, "BDF has orders 1 to 5", least=1, most=5)

    def check(self, system: System) -> None:
        """Refuse an index above 1, and loose tolerances on stiff beams."""
        highest = int(np.max(system.index))
        if highest > 1:
            worst = system.names[int(np.argmax(system.index))]
            raise OptionError(
                f"{worst} has index {highest}: with multipliers of index 2 or 3 the error test of IDA fails, or passes "
                "silently with a wrong answer; use the GGL form with multipliers as derivatives, or RadauIIA"
            )
        if self.max_order > 2 and self.tolerance >= LOOSE and system.vibration is not None:
            name, angle = system.vibration()
            if angle > FAST:
                raise OptionError(
                    f"beam '{name}' vibrates by {angle:.1e} rad in the characteristic time of the motion: there IDA with "
                    f"rtol = {self.tolerance:g} and max_order = {self.max_order} ends silently with a wrong answer; use "
                    "RadauIIA(3), or max_order=2 and compare with a smaller rtol"
                )

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """One internal step at a time, so that no output time interrupts the method."""
        atol = absolute_tolerance(system, self.tolerance, self.atol)
        callbacks = _Callbacks(system, loop)
        method = _create(self, system, callbacks, atol, h0)
        with watched(callbacks):
            method.init_step(system.t0, system.y0, system.yp0)
            self._run(method, loop, callbacks, atol)

    def _run(self, method: Any, loop: StepLoop, callbacks: _Callbacks, atol: Array) -> None:
        going, watch, before = True, SundialsWatch.of(loop, lambda y: self.tolerance * np.abs(y) + atol), loop.stats.jacobians
        while going:
            result = method.step(loop.t_end, method="onestep", tstop=stop_time(loop, watch))
            if not result.success or not result.t > loop.t:
                where = "" if watch is None else watch.nearest()
                raise _failure(loop, callbacks, result, self.tolerance, atol, where)
            restarts = before + (watch.jacobians if watch else 0)
            loop.stats.jacobians = loop.stats.factorisations = restarts + int(result.njev)
            loop.stats.newton_iterations = loop.stats.residuals
            if watch is not None and watch.refuses(result, result.yp):
                method.init_step(loop.t, *loop.state)
                loop.guard()
                continue
            going = loop.accept(float(result.t), result.y, result.yp)

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Local Hermite interpolation over the stored steps."""
        return Hermite(t, y, yp, POINTS)


def _create(solver: IDA, system: System, callbacks: _Callbacks, atol: Array, h0: float | None) -> Any:
    import sksundae.ida  # 0.4 s: only when it is used

    options: dict[str, Any] = {"linsolver": "dense"}
    if system.sparsity is not None:
        options = {"linsolver": "sparse", "sparsity": system.sparsity}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # sparse warns that the given Jacobian replaces its own
        return sksundae.ida.IDA(
            callbacks.residual,
            jacfn=callbacks.jacobian,
            rtol=solver.tolerance,
            atol=atol,
            max_order=solver.max_order,
            first_step=h0 or 0.0,
            max_num_steps=10**9,
            **options,
        )


class _Callbacks(Callbacks):
    """The residual and its Jacobian for IDA."""

    def __init__(self, system: System, loop: StepLoop) -> None:
        super().__init__(system, loop)
        self.cj, self.yp = 1.0, np.array(system.yp0)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Residual for IDA."""
        with self:
            self.evaluated(t)
            self.system.residual(t, y, yp, out)
            self.y[:], self.yp[:], self.values[:] = y, yp, out

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, cj: float, out: Array) -> None:
        """Jacobian for IDA."""
        with self:
            self.cj = cj
            self.system.jacobian(t, y, yp, cj, out)


def _failure(loop: StepLoop, last: _Callbacks, result: Any, rtol: float, atol: Array, where: str) -> BaseException:
    """The exception raised inside a callback, or a SolverError that names what resists."""
    if last.error is not None:
        return last.error
    message, names = reason(result) + where, last.system.names
    undefined = not_finite(loop, last, message)
    if undefined is not None:
        return undefined
    weights = 1 / (rtol * np.abs(last.y) + atol)
    correction = _newton_correction(last)
    if correction is None:
        worst = largest(np.abs(last.values))
        return loop.failure(f"{message}; the iteration matrix is singular", last.system.equations[worst])
    if np.max(np.abs(correction) * weights) < 1.0:  # Newton is not what fails: the error test is
        dt = last.t - loop.t
        y, yp = loop.state
        correction = last.y - y - dt * yp
    return loop.failure(message, names[largest(np.abs(correction) * weights)])


def _newton_correction(last: _Callbacks) -> Array | None:
    """Correction (n,) of one more Newton iteration at the last point, None where the matrix is singular."""
    system = last.system
    data = np.zeros((system.n, system.n) if system.sparsity is None else (system.sparsity.nnz,))
    system.jacobian(last.t, last.y, last.yp, last.cj, data)
    matrix = data if system.sparsity is None else as_csc(system, data).toarray()
    if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < system.n:
        return None
    return np.asarray(np.linalg.solve(matrix, last.values))
