"""The known errors of a run: its estimate, and with verify=True differences from another method and a finer mesh of beams."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mbdae.errors import MbdaeError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.sundials.ida import IDA
from mbdae.results.accuracy import NO_RUN_BESIDE, NOT_REPEATED, WORDS, Accuracy
from mbdae.results.errors import Errors
from mbdae.results.reactions import OtherRun
from mbdae.run.control import Controlled, measure_of, other_run, run_controlled
from mbdae.run.growth.amplification import Amplified
from mbdae.run.mesh import mesh_error
from mbdae.system.prepare import Prepared

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
