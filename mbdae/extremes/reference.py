"""What the runs of one value are measured against: two methods, each controlled far below the accuracy asked, that agree.

Two methods that step over the same pulse of an input agree as well. A reference therefore starts anew at the edges of every
pulse, and within it, from the state reached (`extremes_inputs`), so that none of its runs is longer than what it is to see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.compare.equations import Equations
from mbdae.compare.job import Job
from mbdae.errors import MbdaeError
from mbdae.integrators.base import Solver
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.sundials.ida import IDA
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result, RunInfo
from mbdae.run.control import Controlled, run_controlled
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import SceneSystem

SURE = 1 / 3  #: of the accuracy: methods that differ by less are a reference for every run
#: accuracy of each method of a reference below the one asked; without BDF where it would follow vibrations for ever
METHODS: tuple[tuple[Solver, float], ...] = (
    (RadauIIA(3), 100.0), (IDA(), 10.0), (RadauIIA(2), 10.0), (RadauIIA(3), 1000.0), (IDA(), 100.0),
)  # fmt: skip
FLOOR = 1e-10
PATIENCE = 3.0  #: wall time of a run of a reference, over that of a run that is judged
BESIDE = 16  #: round-offs of the end time before and after the edge of a pulse at which a run ends and the next begins


@dataclass(frozen=True)
class Truth:
    """Values of the better of two methods; known: their difference, None where fewer than two finished."""

    reference: str
    values: Any
    known: float | None


def truth(job: Job, accuracy: float, stops: Sequence[float] = ()) -> Truth:
    """Runs are added until two of different methods agree; what comes nearest where none do. One method agrees with itself at
    the tolerance of round-off, or on a wrong branch: that confirms nothing. stops: times at which they start anew, s."""
    found: list[tuple[str, str, Any]] = []
    best = Truth("no method finished", None, None)
    reasons: list[str] = []
    for solver, below in METHODS:
        if job.resolving is not None and isinstance(solver, IDA):
            continue
        asked = max(accuracy / below, FLOOR)
        try:
            rtol, values = _in_pieces(job, solver, asked, stops)
        except MbdaeError as error:
            reasons.append(f"{solver.label}: " + " ".join(str(error).split()))
            continue
        label = f"{solver.label}, rtol {rtol:.1e}"
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


def _in_pieces(job: Job, solver: Solver, accuracy: float, stops: Sequence[float]) -> tuple[float, Any]:
    """The smallest tolerance taken, and what is compared, of runs from stop to stop."""
    edges, own, rtol, values = list(_pieces(job, stops)), job.stated, math.inf, []
    for i, (begin, end) in enumerate(edges):
        run = _controlled(job, own, solver, accuracy, end)
        rtol = min(rtol, run.solver.tolerance)
        last = i == len(edges) - 1
        inside = job.times[(job.times >= begin) & ((job.times < edges[i + 1][0]) if not last else True)]
        values.append(job.values(run.solution, own, np.minimum(inside, end)))
        if not last:
            own = Equations(_continued(job, own, run, edges[i + 1]))
    return rtol, np.concatenate(values)


def _pieces(job: Job, stops: Sequence[float]) -> Iterator[tuple[float, float]]:
    """Begin and end of the runs of a reference, s. They leave out the instants at which an input may jump, so that no run
    evaluates what is before and what is after such an instant."""
    begin, beside = float(job.times[0]), BESIDE * float(np.spacing(job.t_end))
    for stop in stops:
        if begin + 2 * beside < stop < job.t_end - 2 * beside:
            yield begin, stop - beside
            begin = stop + beside
    yield begin, job.t_end


def _continued(job: Job, own: Equations, run: Controlled, piece: tuple[float, float]) -> Prepared:
    """The scene at the beginning of a piece, in the state a run ended with."""
    assert own.prepared is not None
    assert job.scene is not None
    info = RunInfo(run.solver, "", Accuracy(None, None), run.solution.stats)
    start = Result(own.prepared, run.solution, info, run.solution.t).state_for(job.scene)
    return prepare(job.scene, replace(start, t=piece[0]), t_end=piece[1])


def _controlled(job: Job, own: Equations, solver: Solver, accuracy: float, end: float) -> Controlled:
    """A run to `end` whose own estimate is below the accuracy, or as near as the method comes."""
    system = own.for_solver(job.resolving, solver)
    assert isinstance(system, SceneSystem)
    wall = None if job.max_wall is None else PATIENCE * job.max_wall
    try:
        return run_controlled(system, own.prepared, solver, accuracy, end, job.times[:0], max_wall=wall)
    except MbdaeError as error:
        begun = getattr(error, "solution", None)
        if begun is not None and begun.complete and begun.t[-1] >= end:  # its error is not known: the other method tells
            return Controlled(begun, begun.solver, math.nan, 1, begun.stats.cpu_s)
        raise
