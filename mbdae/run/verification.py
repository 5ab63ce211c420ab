"""The known errors of a run: its estimate, with verify=True differences from another method and a finer mesh of beams, and a
closer run for those who read a quantity that the estimate does not cover."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, MbdaeError, SolverError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.checkpoints.keeper import keeping_runs
from mbdae.integrators.distance import check_times
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.integrators.sundials.ida import IDA
from mbdae.results.accuracy import NO_RUN_BESIDE, NOT_REPEATED, WORDS, Accuracy
from mbdae.results.errors import Errors
from mbdae.results.reactions import OtherRun, some_of
from mbdae.run.control import Controlled, closer, measure_of, other_run, run_controlled
from mbdae.run.growth.amplification import Amplified
from mbdae.run.mesh import mesh_error
from mbdae.system.prepare import Prepared
from mbdae.threads import one_thread

CLOSER = 0.03  #: tolerance of a closer run over that of the run
#: with vibrations of beams that the run leaves out, its tolerance over that which delivers the accuracy in positions
RESOLVED = 0.1
#: it may take so many evaluations of the residual: MORE times those of the run, and SPARE over the number of unknowns (a fraction
#: of a second for all sizes)
MORE, SPARE = 4.0, 1.5e6
SHARE = 1.1  #: ratio of the error of the run to its difference from one with a CLOSER tolerance, at most
REACHED = 0.02  #: where its work ended before it had this fraction of the time, it shows nothing
CONTINUED = "not measured: the run continues another one on the same mesh, whose discretisation error it has too"


@dataclass(frozen=True)
class Verified:
    """What verify=True found. motion: largest difference from a run of another method; mesh: from a run on a finer mesh of the
    beams; reactions, finer: states of these two runs, by which reactions are compared; unknown: {error: why it is not known};
    runs: number of runs made."""

    motion: float | None = None
    reactions: tuple[OtherRun, ...] = ()
    mesh: float | None = None
    finer: tuple[OtherRun, ...] = ()
    unknown: dict[str, str] = field(default_factory=dict)
    runs: int = 0


def verified(prepared: Prepared, form: Form, run: Controlled, accuracy: float, asked: Asked,
             continued: bool) -> Verified:  # fmt: skip
    """Compare a run with another method at a tenth of the accuracy and, where it has beams, with a finer mesh."""
    found = _by_another_method(prepared, run, accuracy, asked)
    if not prepared.model.lines:
        return found
    if continued:
        return replace(found, unknown=found.unknown | {"mesh": CONTINUED})
    same = replace(form, waves=True) if run.waves else form  # type: ignore[type-var]
    try:
        mesh, finer = mesh_error(prepared, same, run.solver, run.solution, asked)
        return replace(found, mesh=mesh, finer=(finer,), runs=found.runs + 1)
    except MbdaeError as error:
        return replace(found, unknown=found.unknown | {"mesh": f"not measured: the run on a finer mesh failed: {error}"})


def _by_another_method(prepared: Prepared, run: Controlled, accuracy: float, asked: Asked) -> Verified:
    """Differences from a run of another method at a tenth of the accuracy."""
    radau, form = isinstance(run.solver, RadauIIA), default_form(prepared)
    other: Solver = IDA() if radau else RadauIIA(3)
    if prepared.model.lines:  # with beams not IDA, whose steps would have to resolve the fastest vibrations
        other = next(method for method in (RadauIIA(3), RadauIIA(2)) if method.label != run.solver.label)
        form = replace(form, waves=True)  # type: ignore[type-var]
    system = system_for(prepared, form, other.highest_index)
    controlled = run_controlled(system, prepared, other, max(accuracy / 10, 1e-10), asked, np.array([asked.t_end]))
    again = controlled.solution
    times = np.linspace(again.t[0], again.t[-1], 2001)
    motion = float(np.max(measure_of(system, prepared)(times, run.solution(times), again(times))))
    return Verified(motion, other_run(system, prepared, again, times, 1.0), runs=controlled.runs)


def accuracy_of(prepared: Prepared, accuracy: float, run: Controlled, found: Verified | None) -> Accuracy:
    """The known errors of a run, and why others are not known; found: errors that verify=True has shown, or None."""
    estimate = None if math.isnan(run.estimate) else run.estimate
    if estimate is None and found is None:
        return Accuracy(None, None, has_mesh=bool(prepared.model.lines), found_amplification=Amplified(run.solution))
    found = found or Verified()
    in_time = found.reactions or run.others
    forces = Errors(prepared, run.solution, (*in_time, *found.finer)) if in_time else None
    asked = accuracy if any(error is not None for error in (estimate, found.motion, found.mesh)) else None
    if forces is not None:
        forces.asked = asked
    unknown = {"reactions": NO_RUN_BESIDE, "mesh": NOT_REPEATED} | found.unknown
    return Accuracy(asked, estimate, found.motion, found.mesh, bool(prepared.model.lines), unknown, forces,
                    Amplified(run.solution))


def nothing_known(prepared: Prepared, why: str) -> Accuracy:
    """The accuracy of a run that did not reach its end, for the reason `why`."""
    return Accuracy(None, None, has_mesh=bool(prepared.model.lines), unknown=dict.fromkeys(WORDS, f"not estimated: {why}"))


@dataclass(frozen=True, eq=False)
class CloserRun:
    """Makes, when it is called, a run far more accurate than the one returned. It is made when a quantity is read whose error,
    estimated from companions, is above the accuracy: such an estimate is a bound, and says so of many numbers that are right.

    waves: whether it is to resolve vibrations of beams that the run leaves out; accuracy: that was asked for."""

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
            with warnings.catch_warnings(), keeping_runs(None), one_thread():
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
        if found.t[-1] < begin + REACHED * (end - begin):
            return None
        times = some_of(check_times(found), system.n, bool(self.prepared.contacts))
        return OtherRun.beside(found, times, SHARE, kind="closer")

    def _tighter(self, label: str) -> Solver | None:
        """The solver with the smaller tolerance; None where round-off allows none."""
        limit = self.solver.tightest.get(label, self.solver.tightest[""])
        wanted = CLOSER * self.solver.tolerance
        if self.waves:
            wanted = min(wanted, RESOLVED * self.solver.at_accuracy(self.accuracy, label).tolerance)
        wanted = max(wanted, limit)
        return replace(self.solver, rtol=wanted) if wanted < self.solver.tolerance / 3 else None  # type: ignore[type-var]
