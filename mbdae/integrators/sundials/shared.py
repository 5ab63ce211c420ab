"""What the solvers of SUNDIALS share: their callbacks, their reports, and what stopped them."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any, Self

import numpy as np

from mbdae.errors import SolverError
from mbdae.integrators.loop import StepLoop
from mbdae.system.base import Array, System

#: how scikit-sundae begins a report: the function of SUNDIALS and its error code
REPORT = re.compile(r"\s*\[\w+, Error: -?\d+\]")


class Callbacks:
    """What SUNDIALS calls: counts, and keeps the last point for a diagnosis. What it does is done `with self`, which keeps an
    exception for `watched`.

    t, y  the last point; values (n,) what was computed there
    """

    def __init__(self, system: System, loop: StepLoop) -> None:
        self.system, self.stats = system, loop.stats
        self.error: BaseException | None = None
        self.t = -np.inf
        self.y, self.values = np.array(system.y0, dtype=float), np.zeros(system.n)

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


@contextmanager
def watched(callbacks: Callbacks) -> Iterator[None]:
    """Drop what scikit-sundae prints; an exception raised in a callback comes through as it is."""
    try:
        with redirect_stdout(_WithoutReports(sys.stdout)):
            yield
    except Exception:
        if callbacks.error is None:
            raise
    if callbacks.error is not None:
        raise callbacks.error


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


def reason(result: Any) -> str:
    """Why a step failed, in the words of SUNDIALS."""
    return "the step fell below the round-off of the time" if result.success else str(result.message).rstrip(".")


def not_finite(loop: StepLoop, last: Callbacks, why: str) -> SolverError | None:
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
