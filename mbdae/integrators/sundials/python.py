"""IDA and CVODE by the Python interface of scikit-sundae, one step per call: used where its libraries cannot be opened."""

from __future__ import annotations

import io
import re
import sys
import warnings
from abc import ABC, abstractmethod
from contextlib import redirect_stdout
from typing import Any, Self

import numpy as np

from mbdae.integrators.dense import cubic
from mbdae.integrators.rates import rate_jacobian
from mbdae.native.sundials import STUCK
from mbdae.native.sundials_steps import Settings, Steps
from mbdae.system.base import Array, System

#: beginning of scikit-sundae's reports: the function of SUNDIALS and its error code
REPORT = re.compile(r"\s*\[\w+, Error: -?\d+\]")


class PythonMethod(ABC):
    """Base of IDA and CVODE by scikit-sundae, with the interface of `native.sundials.Method`. Functions that SUNDIALS calls run
    inside `with self`, which stores their exceptions, because they cannot pass through C."""

    def __init__(self, system: System, settings: Settings, start: tuple[float, Array, Array]) -> None:
        self.system, self.settings, self.error = system, settings, None
        self.t, self.cj, self._message, self._newest = -np.inf, 1.0, "", None
        self.y, self.yp, self.values = np.array(start[1]), np.array(start[2]), np.zeros(system.n)
        self._residuals = self._rejected = self._jacobians = 0
        self._method = self.create(rtol=settings.rtol, atol=settings.atol, first_step=settings.first_step,
                                   max_num_steps=10**9, max_order=settings.order)  # fmt: skip
        self.begin(*start)

    error: BaseException | None
    _newest: tuple[float, Array] | None

    @abstractmethod
    def create(self, **options: Any) -> Any:
        """The solver object of scikit-sundae."""

    @abstractmethod
    def begin(self, t: float, y: Array, yp: Array) -> None:
        """Start the method, or restart it, at the time t (s) with y and y' (n,)."""

    @abstractmethod
    def slope(self, result: Any) -> Array:
        """y' (n,) at the end of a step."""

    def piece(self, start: tuple[float, Array, Array], last_step: float, end: tuple[float, Array, Array]) -> Array | None:
        """Increments of y for the interpolant over the step from `start` to `end`, each (t, y, y'); None where y and y' at ends
        of steps suffice. last_step: length of the step before, s."""
        return None

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers so far of evaluations of the equations, of rejected steps, and of evaluations of the Jacobian."""
        return self._residuals, self._rejected, self._jacobians

    def newest(self) -> tuple[float, Array] | None:
        """Point (t, y) of the latest Jacobian since the last call; None where there is no new one."""
        found, self._newest = self._newest, None
        return found

    def renew(self) -> None:
        """Request a new Jacobian for the next step."""
        raise NotImplementedError

    def advance(self, start: tuple[float, Array, Array], last_step: float, stop: float, toward: float, rows: int = 1,
                left: float = np.inf) -> Steps:  # fmt: skip
        """Make one step, not beyond the time `stop`. The arguments are those of `native.sundials.Method.advance`, which makes up
        to `rows` steps with up to `left` evaluations."""
        none = np.empty((0, self.system.n))
        try:
            with redirect_stdout(_WithoutReports(sys.stdout)):
                result = self._method.step(toward, method="onestep", tstop=stop)
        except Exception:
            if self.error is None:
                raise
        if self.error is not None:
            return Steps(np.empty(0), none, none, [], -1)
        self._message = str(result.message).rstrip(".")
        if not result.success or not result.t > start[0]:
            return Steps(np.empty(0), none, none, [], STUCK if result.success else int(result.status))
        end = float(result.t), np.asarray(result.y), self.slope(result)
        return Steps(np.array([end[0]]), end[1][None], end[2][None], [self.piece(start, last_step, end)], 0)

    def reason(self, code: int) -> str:
        """Text for the error code of the last step."""
        return "the step became smaller than the round-off of the time t" if code == STUCK else self._message

    def raise_error(self) -> None:
        """Raise the stored exception of a function called by SUNDIALS."""
        if self.error is not None:
            raise self.error

    def evaluated(self, t: float) -> None:
        """Count an evaluation at the time t; where t is earlier than at the last evaluation, the last attempt of a step was
        rejected."""
        self._rejected += t < self.t
        self.t = t
        self._residuals += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if isinstance(error[1], BaseException):
            self.error = error[1]


class IdaByPython(PythonMethod):
    """IDA for F(t, y, y') = 0."""

    def create(self, **options: Any) -> Any:
        import sksundae.ida  # imported here, because the import takes 0.4 s

        options |= {"linsolver": "dense"}
        if self.system.sparse:
            options |= {"linsolver": "sparse", "sparsity": self.system.sparsity}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # scikit-sundae warns that the given Jacobian replaces its own
            return sksundae.ida.IDA(self.residual, jacfn=self.jacobian, **options)

    def begin(self, t: float, y: Array, yp: Array) -> None:
        self._method.init_step(t, y, yp)

    def slope(self, result: Any) -> Array:
        return np.asarray(result.yp)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """Residual, as called by IDA."""
        with self:
            self.evaluated(t)
            self.system.residual(t, y, yp, out)
            self.y[:], self.yp[:], self.values[:] = y, yp, out

    def jacobian(self, t: float, y: Array, yp: Array, res: Array, cj: float, out: Array) -> None:
        """Jacobian, as called by IDA."""
        with self:
            self.cj = cj
            self._jacobians += 1
            if self.system.differences:
                self._differences(t, y, yp, res, cj, out)
            else:
                self.system.jacobian(t, y, yp, cj, out)

    def _differences(self, t: float, y: Array, yp: Array, res: Array, cj: float, out: Array) -> None:
        """`ida_differences` of native/sundials.c in Python."""
        tolerance = self.settings.rtol * np.abs(y) + self.settings.atol
        size = np.maximum(2.0**-26 * np.maximum(np.abs(y), np.abs(yp / cj)), tolerance)
        step, moved = (y + np.copysign(size, yp / cj)) - y, np.empty(len(y))
        for j in range(len(y)):
            one = np.arange(len(y)) == j
            self.system.residual(t, y + one * step, yp + one * cj * step, moved)
            self._residuals += 1
            out[:, j] = (moved - res) / step[j]


class CvodeByPython(PythonMethod):
    """CVODE for y' = f(t, y). nodes: fractions of a step at which its interpolant is sampled; tame: largest ratio of a step to
    the one before for which that is not needed (TAME in `cvode`), 0 for none."""

    def __init__(self, *args: Any, method: str, nodes: Array, tame: float) -> None:
        self._multistep, self._nodes, self._tame = method, nodes, tame
        self._choosing, self._renew, self._renewing = True, False, False
        super().__init__(*args)

    def create(self, **options: Any) -> Any:
        import sksundae.cvode  # imported here, because the import takes 0.4 s

        return sksundae.cvode.CVODE(self.rate, jacfn=self.jacobian, method=self._multistep, **options)

    def begin(self, t: float, y: Array, yp: Array) -> None:
        self._method.init_step(t, y)
        self._choosing = True

    def slope(self, result: Any) -> Array:
        return self.values.copy()

    def renew(self) -> None:
        self._renew = True

    def piece(self, start: tuple[float, Array, Array], last_step: float, end: tuple[float, Array, Array]) -> Array | None:
        (t0, y0, yp0), (t, y, yp) = start, end
        if self._tame and t - t0 <= self._tame * last_step:
            return None
        # sampling moves the solver's time to the nodes; a last call at t sets it back, else its next step would only return to t
        step = self._method.step
        own = np.array([step(t0 + c * (t - t0), method="normal").y - y0 for c in self._nodes])
        step(t, method="normal")
        ends = cubic(len(self._nodes) + 1, t - t0, (y0, yp0), (y, yp))
        return ends if (np.abs(own - ends) <= self.settings.rtol * np.abs(y) + self.settings.atol).all() else own

    def evaluated(self, t: float) -> None:
        """Count an evaluation. Those by which CVODE chooses its first step do not count as attempts of a step that were
        rejected."""
        self.t = min(self.t, t) if self._choosing else self.t
        super().evaluated(t)

    def rate(self, t: float, y: Array, out: Array) -> None:
        """y', as called by CVODE. Where a new Jacobian was requested it returns NaN, which makes CVODE evaluate one
        (`cvode_rates` of native/sundials.c)."""
        with self:
            if self._renew or (self._renewing and np.isnan(y[0])):
                self._renew, self._renewing = False, True
                out[:] = np.nan
                return
            self._renewing = False
            self.evaluated(t)
            self.system.rhs(t, y, out)
            self.y[:], self.values[:] = y, out

    def jacobian(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """df/dy, as called by CVODE. Its first call shows that the first step is chosen, and that CVODE now attempts it."""
        with self:
            self._choosing = False
            self._jacobians += 1
            self._newest = t, y.copy()
            out[...] = rate_jacobian(self.system, t, y, yp)


class _WithoutReports(io.TextIOBase):
    """Standard output without the lines that scikit-sundae prints there after a failure, because the SolverError repeats them."""

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
        """Flush the underlying stream."""
        self._stream.flush()

    def isatty(self) -> bool:
        """Whether the underlying stream is a terminal."""
        return bool(self._stream.isatty())
