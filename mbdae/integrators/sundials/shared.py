"""What the solvers of SUNDIALS share: their steps, their callbacks, their reports, and what stopped them."""

from __future__ import annotations

import io
import re
import sys
from abc import ABC, abstractmethod
from contextlib import redirect_stdout
from typing import Any, Self

import numpy as np

from mbdae.errors import SolverError
from mbdae.integrators.base import absolute_tolerance
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.watched.watch import SundialsWatch, stop_time
from mbdae.system.base import Array

#: how scikit-sundae begins a report: the function of SUNDIALS and its error code
REPORT = re.compile(r"\s*\[\w+, Error: -?\d+\]")


class SundialsRun(ABC):
    """One run with SUNDIALS: its steps, and the functions that SUNDIALS calls, which count and keep the last point for a
    diagnosis. What they do is done `with self`, which keeps an exception for `steps`.

    method  of scikit-sundae; t, y  the last point; values (n,) what was computed there
    """

    def __init__(self, solver: Any, loop: StepLoop, h0: float | None) -> None:
        system = loop.system
        self.solver, self.loop, self.system, self.stats = solver, loop, system, loop.stats
        self.rtol, self.atol = solver.tolerance, absolute_tolerance(system, solver.tolerance, solver.atol)
        self.error: BaseException | None = None
        self.t = -np.inf
        self.y, self.values = np.array(system.y0, dtype=float), np.zeros(system.n)
        self.watch = SundialsWatch.of(loop, self.tolerance)
        self.method = self.create(rtol=self.rtol, atol=self.atol, first_step=h0 or 0.0, max_num_steps=10**9)

    @abstractmethod
    def create(self, **options: Any) -> Any:
        """The object of scikit-sundae with these options and the solver's own."""

    @abstractmethod
    def begin(self, t: float, y: Array, yp: Array) -> None:
        """Start the method, or start it again."""

    @abstractmethod
    def slope(self, result: Any) -> Array:
        """y' (n,) at the end of a step."""

    @abstractmethod
    def diagnosis(self, message: str) -> SolverError:
        """The failure that names what resists."""

    def piece(self, t: float, y: Array, yp: Array) -> Any:
        """What the solver's `dense` needs of the step that ends with these values, asked for where it is accepted."""
        return None

    def tolerance(self, y: Array) -> Array:
        """Tolerance (n,) of every unknown at y (n,)."""
        return np.asarray(self.rtol * np.abs(y) + self.atol)

    def steps(self) -> None:
        """One internal step at a time, so that no output time interrupts the method."""
        try:
            with redirect_stdout(_WithoutReports(sys.stdout)):
                self.begin(self.loop.t, *self.loop.state)
                self._steps(self.stats.jacobians)
        except Exception:
            if self.error is None:
                raise
        finally:
            del self.method, self.watch  # they refer to this object: it is freed at once, with all it refers to
        if self.error is not None:  # raised in a callback: it comes through as it is
            raise self.error

    def _steps(self, before: int) -> None:
        """Step to the end; before: Jacobians evaluated before this run."""
        loop, watch, going = self.loop, self.watch, True
        while going:
            result = self.method.step(loop.t_end, method="onestep", tstop=stop_time(loop, watch))
            if not result.success or not result.t > loop.t:
                why = "the step fell below the round-off of the time" if result.success else str(result.message).rstrip(".")
                message = why + ("" if watch is None else watch.nearest())
                raise self.error or not_finite(loop, self, message) or self.diagnosis(message)
            restarts = before + (watch.jacobians if watch else 0)
            self.stats.jacobians = self.stats.factorisations = restarts + int(result.njev)
            self.stats.newton_iterations = self.stats.residuals
            t, y, yp = float(result.t), result.y, self.slope(result)
            if watch is not None and watch.refuses(result, yp):
                self.begin(loop.t, *loop.state)
                loop.guard()
                continue
            going = loop.accept(t, y, yp, self.piece(t, y, yp))

    def evaluated(self, t: float) -> None:
        """Count an evaluation at t."""
        if t < self.t:  # an attempt nearer than the last one: that one was rejected
            self.stats.rejected += 1
        self.t = t
        self.stats.residuals += 1

    def probe(self, t: float, y: Array, yp: Array) -> list[Array]:
        """What SUNDIALS sees of the equations at a point, arrays (n,): here F(t, y, y')."""
        out = np.empty(self.system.n)
        self.system.residual(t, y, yp, out)
        return [out]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if error is not None:
            self.error = error


class _WithoutReports(io.TextIOBase):
    """Standard output without the lines scikit-sundae prints there on a failure: the SolverError says the same."""

    def __init__(self, stream: Any) -> None:
        super().__init__()
        self._stream, self._dropped = stream, False

    def write(self, text: str) -> int:
        """Pass text on, except a report and the newline that ends it."""
        report = REPORT.match(text) is not None
        if not report and not (self._dropped and text == "\n"):
            self._stream.write(text)
        self._dropped = report
        return len(text)

    def flush(self) -> None:
        """Flush the stream behind."""
        self._stream.flush()

    def isatty(self) -> bool:
        """Whether the stream behind is a terminal."""
        return bool(self._stream.isatty())


def not_finite(loop: StepLoop, last: SundialsRun, why: str) -> SolverError | None:
    """The failure that names the equation which is not finite at the last point or just after the last step.

    Predicted states are asked first: later iterates are not finite themselves and blame every row.
    """
    y, yp = loop.state
    soon = loop.t + 1e-9 * (loop.t_end - float(last.system.t0))
    predicted = [last.probe(t, y + (t - loop.t) * yp, yp) for t in (last.t, soon)]
    for values in (*predicted[0], *predicted[1], last.values):
        if not np.isfinite(values).all():
            culprit = last.system.equations[int(np.argmax(~np.isfinite(values)))]
            return loop.failure(f"{why}; equation {culprit} is not finite near t = {last.t:.9g}", culprit)
    return None
