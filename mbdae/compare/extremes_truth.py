"""What the runs of one value are measured against: two methods, each controlled far below the accuracy asked, that agree."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mbdae.compare.job import Job
from mbdae.errors import MbdaeError
from mbdae.integrators.base import Solver
from mbdae.integrators.ida import IDA
from mbdae.integrators.radau import RadauIIA
from mbdae.run.control import Controlled, run_controlled
from mbdae.system.assembly import SceneSystem

SURE = 1 / 3  #: of the accuracy: methods that differ by less are a reference for every run
#: accuracy of each method of a reference below the one asked; without BDF where it would follow vibrations for ever
METHODS: tuple[tuple[Solver, float], ...] = (
    (RadauIIA(3), 100.0), (IDA(), 10.0), (RadauIIA(2), 10.0), (RadauIIA(3), 1000.0), (IDA(), 100.0),
)  # fmt: skip
FLOOR = 1e-10
PATIENCE = 3.0  #: wall time of a run of a reference, over that of a run that is judged


@dataclass(frozen=True)
class Truth:
    """Values of the better of two methods; known: their difference, None where fewer than two finished."""

    reference: str
    values: Any
    known: float | None


def truth(job: Job, accuracy: float) -> Truth:
    """Runs are added until two of different methods agree; what comes nearest where none do. One method agrees with itself at
    the tolerance of round-off, or on a wrong branch: that confirms nothing."""
    found: list[tuple[str, str, Any]] = []
    best = Truth("no method finished", None, None)
    reasons: list[str] = []
    for solver, below in METHODS:
        if job.resolving is not None and isinstance(solver, IDA):
            continue
        asked = max(accuracy / below, FLOOR)
        try:
            run = _controlled(job, solver, asked)
            values = job.values(run.solution)
        except MbdaeError as error:
            reasons.append(f"{solver.label}: " + " ".join(str(error).split()))
            continue
        label = f"{solver.label}, rtol {run.solver.tolerance:.1e}"
        for method, other, seen in found:
            gap = job.error(values, seen)
            if method != solver.label and (best.known is None or gap < best.known):
                best = Truth(f"{other}; {label} differs by {gap:.1e}", seen, gap if math.isfinite(gap) else None)
        found.append((solver.label, label, values))
        if best.known is not None and best.known <= SURE * accuracy:
            return best
    if best.known is None and found:
        best = Truth(f"{found[0][1]}, not confirmed", found[0][2], None)
    return Truth("; ".join([best.reference, *reasons]), best.values, best.known)


def _controlled(job: Job, solver: Solver, accuracy: float) -> Controlled:
    """A run whose own estimate is below the accuracy, or as near as the method comes."""
    prepared = job.stated.prepared
    assert prepared is not None
    system = job.stated.for_solver(job.resolving, solver)
    assert isinstance(system, SceneSystem)
    wall = None if job.max_wall is None else PATIENCE * job.max_wall
    try:
        return run_controlled(system, prepared, solver, accuracy, job.t_end, job.times, max_wall=wall)
    except MbdaeError as error:
        begun = getattr(error, "solution", None)
        if begun is not None and begun.complete and begun.t[-1] >= job.t_end:  # its error is not known: the other method tells
            return Controlled(begun, begun.solver, math.nan, 1, begun.stats.cpu_s)
        raise
