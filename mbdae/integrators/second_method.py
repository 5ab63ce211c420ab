"""A second method, Radau IIA, by which runs of a user's own method are checked: a comparison of such runs with each other cannot
show that the method converges to a wrong solution, or has another order than it states."""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import inf

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError, SolverError, WallClockError
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.distance import Measure, check_times
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.system.base import System

TIGHTER = 10.0  #: ratio of the accuracy asked for to that for which the first run of Radau IIA is made
AGAIN = 30.0  #: ratio of the tolerance of a run of Radau IIA to that of the next run
#: two runs of Radau IIA confirm each other where the accuracy asked for is at least this many times their distance
AGREE = 3.0
MOST = 4  #: largest number of runs of Radau IIA
#: a warning says that the estimate is wrong where the distance from Radau IIA is above this many times the estimate, and above
#: the accuracy asked for
CLEARLY = 2.0


class SecondMethod:
    """A run of Radau IIA, made when it is first needed, and the distance of other runs from it. runs, cpu_s: number of runs that
    were made for it, and their CPU time (s)."""

    def __init__(self, solver: Solver, system: System, asked: Asked, accuracy: float, measure: Measure) -> None:
        self._solver, self._system, self._measure = solver, system, measure
        self._asked = replace(asked, times=None, progress=None, h0=None, share=None)
        method = RadauIIA(3)
        self._rtol = min(method.factor(system.label) * accuracy / TIGHTER, 0.1)
        self._tightest = method.tightest.get(system.label, method.tightest[""])
        self._method, self._apart = method, accuracy / AGREE
        self._run: Solution | None = None
        self.runs, self.cpu_s, self._why_not = 0, 0.0, ""

    def distance(self, run: Solution, estimate: float) -> float:
        """Largest distance of a run from the run of the second method; `estimate`, the estimated error of the run by its own
        method, where that is larger or the second method fails."""
        if not self.runs:
            self._solve()
        if self._run is None:
            return estimate
        return max(self._between(run, self._run), estimate)

    def _between(self, a: Solution, b: Solution) -> float:
        times = check_times(a)
        return float(np.max(self._measure(times, a(times), b(times))))

    def tell(self, estimate: float, distance: float, accuracy: float) -> None:
        """Warn where the `distance` of a run from the second method contradicts its `estimate`, and where the second method
        failed."""
        name = self._solver.label
        if self._why_not:
            warnings.warn(f"{name}: its runs agree with each other, but no second method could confirm them ({self._why_not}), "
                          f"so the estimated error stands on {name} alone: compare with a run of another solver yourself",
                          AccuracyWarning, stacklevel=2)  # fmt: skip
        elif distance > max(CLEARLY * estimate, accuracy):
            warnings.warn(f"{name} differs by {distance:.1e} from {self._method.label}, while its own runs with shorter steps or "
                          f"tolerances differ by {estimate:.1e}: measure its order by mb.measure_order, and check its "
                          f"coefficients", AccuracyWarning, stacklevel=2)  # fmt: skip

    def _solve(self) -> None:
        """Make runs of Radau IIA with smaller and smaller tolerances until two of them agree."""
        known, apart, rtol = None, inf, self._rtol
        while self.runs < MOST and apart > self._apart and (known is None or rtol >= self._tightest):
            self.runs += 1
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)
                    found = replace(self._method, rtol=max(rtol, self._tightest)).run(self._system, self._asked)
            except WallClockError:
                raise
            except (SolverError, OptionError) as error:
                self._why_not = str(error)
                return
            self.cpu_s += found.stats.cpu_s
            apart = self._between(found, known) if known is not None else inf
            known, rtol = found, rtol / AGAIN
        if apart <= self._apart:
            self._run = known
        else:
            self._why_not = f"runs of {self._method.label} at two tolerances differ by {apart:.1e}"


def second_method(solver: Solver, system: System, asked: Asked, accuracy: float, measure: Measure) -> SecondMethod | None:
    """The second method for a user-defined method; None for methods that mbdae ships, whose orders are measured."""
    return None if solver.shipped else SecondMethod(solver, system, asked, accuracy, measure)
