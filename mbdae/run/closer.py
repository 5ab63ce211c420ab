"""A run far more accurate than the one returned, made when a quantity is read whose estimated error is above the accuracy.

The estimate from companions is a bound, and says "above" of many numbers that are right. Before a reader is told so, the run is
made once more: with a CLOSER tolerance, and with all vibrations of beams, which no companion has. What it costs is bounded.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

from mbdae.errors import AccuracyWarning, MbdaeError, SolverError
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.checkpoints.keeper import keeping_runs
from mbdae.integrators.distance import check_times
from mbdae.integrators.solution import Solution
from mbdae.results.reactions import OtherRun, some_of
from mbdae.run.control import closer
from mbdae.system.prepare import Prepared

CLOSER = 0.03  #: its tolerance over that of the run
#: with vibrations of beams that the run leaves out, its tolerance over that which delivers the accuracy in positions
RESOLVED = 0.1
#: it may take so many evaluations of the residual: MORE times those of the run, and SPARE over the number of unknowns (a fraction
#: of a second for all sizes)
MORE, SPARE = 4.0, 1.5e6
SHARE = 1.1  #: ratio of the error of the run to its difference from one with a CLOSER tolerance, at most
REACHED = 0.02  #: where its work ended before it had this fraction of the time, it shows nothing


@dataclass(frozen=True, eq=False)
class CloserRun:
    """What is needed to make it: the scene, the form, solver and steps of the run; waves: whether it is to resolve vibrations of
    beams that the run leaves out; accuracy: that was asked for."""

    prepared: Prepared
    form: Form
    solver: Solver
    run: Solution
    accuracy: float
    asked: Asked
    waves: bool

    def __call__(self) -> OtherRun | None:
        """The run beside the one returned, up to the time at which its work ended; None where there is none."""
        form: Any = replace(self.form, waves=True) if self.waves else self.form  # type: ignore[type-var]
        try:
            with warnings.catch_warnings(), keeping_runs(None):
                warnings.simplefilter("ignore", AccuracyWarning)
                system = system_for(self.prepared, form, self.solver.highest_index)
                solver = self._tighter(system.label)
                if solver is None:
                    return None
                most = MORE * self.run.stats.residuals + SPARE / system.n
                asked = closer(replace(self.asked, max_residuals=most, progress=None, max_wall=None, begin=None), solver, 4, 1)
                found = solver.run(system, asked)
        except SolverError as error:
            partial = error.solution
            if not isinstance(partial, Solution) or len(partial.t) < 3:
                return None
            found = partial
        except MbdaeError:
            return None
        begin, end = float(self.run.t[0]), float(self.run.t[-1])
        whole = found.t[-1] >= end
        if not whole and found.t[-1] - begin < REACHED * (end - begin):
            return None
        times = some_of(check_times(found), system.n)
        return OtherRun.beside(found, times, SHARE, kind="closer" if whole else "window")

    def _tighter(self, label: str) -> Solver | None:
        """The solver with the smaller tolerance; None where round-off allows none."""
        limit = self.solver.tightest.get(label, self.solver.tightest[""])
        wanted = CLOSER * self.solver.tolerance
        if self.waves:
            wanted = min(wanted, RESOLVED * self.solver.at_accuracy(self.accuracy, label).tolerance)
        wanted = max(wanted, limit)
        return replace(self.solver, rtol=wanted) if wanted < self.solver.tolerance / 3 else None  # type: ignore[type-var]
