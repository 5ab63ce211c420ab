"""The reference of the runs at one value: two methods that agree, each with an error far below the accuracy asked.

Two methods agree too if both step over a short pulse of an input. A reference is therefore computed in pieces that end at the
edges of every pulse (`sweep/pulses.py`) and within it, each started from the last state of the piece before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.compare.equations import Equations
from mbdae.compare.problem import Problem
from mbdae.errors import MbdaeError
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.sundials.ida import IDA
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result
from mbdae.results.run_info import RunInfo
from mbdae.run.control import Controlled, run_controlled
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import SceneSystem

SURE = 1 / 3  #: a reference is certain where two methods differ by at most this fraction of the accuracy
#: methods of a reference in the order in which they are tried, each with the ratio of the accuracy asked for to the one it is run
#: at, which is FLOOR at least; IDA (BDF) is left out for scenes with beams, whose vibrations a reference resolves
#: (`Problem.resolving`)
METHODS: tuple[tuple[Solver, float], ...] = (
    (RadauIIA(3), 100.0), (IDA(), 10.0), (RadauIIA(2), 10.0), (RadauIIA(3), 1000.0), (IDA(), 100.0),
)  # fmt: skip
FLOOR = 1e-10
PATIENCE = 3.0  #: ratio of the wall time allowed for a run of a reference to that of a judged run
#: distance of the ends of a piece of the reference from a time at which an input may jump, in round-offs of the end time
BESIDE = 16


@dataclass(frozen=True)
class Reference:
    """Values of the better of two methods; uncertainty: their difference, None where fewer than two finished."""

    label: str
    values: Any
    uncertainty: float | None


def reference_at(problem: Problem, accuracy: float, stops: Sequence[float] = ()) -> Reference:
    """The first run on which two different methods agree, else the pair of runs with the smallest difference. Two runs of one
    method prove nothing: they may agree on a wrong branch, or to round-off. stops: times at which runs restart, s."""
    found: list[tuple[str, str, Any]] = []
    best = Reference("no method finished", None, None)
    reasons: list[str] = []
    for solver, below in METHODS:
        if problem.resolving is not None and isinstance(solver, IDA):
            continue
        asked = max(accuracy / below, FLOOR)
        try:
            rtol, values = _in_pieces(problem, solver, asked, stops)
        except MbdaeError as error:
            reasons.append(f"{solver.label}: " + " ".join(str(error).split()))
            continue
        label = f"{solver.label}, rtol {rtol:.1e}"
        for method, other, seen in found:
            gap = problem.error(values, seen)
            if method != solver.label and (best.uncertainty is None or gap < best.uncertainty):
                best = Reference(f"{other}; {label} differs by {gap:.1e}", seen, gap if math.isfinite(gap) else None)
        found.append((solver.label, label, values))
        if best.uncertainty is not None and best.uncertainty <= SURE * accuracy:
            return best
    if best.uncertainty is None and found:
        best = Reference(f"{found[0][1]}, not confirmed", found[0][2], None)
    return Reference("; ".join([best.label, *reasons]), best.values, best.uncertainty)


def _in_pieces(problem: Problem, solver: Solver, accuracy: float, stops: Sequence[float]) -> tuple[float, Any]:
    """Runs from stop to stop: smallest tolerance used, and compared values."""
    edges, own, rtol, values = list(_pieces(problem, stops)), problem.stated, math.inf, []
    for i, (begin, end) in enumerate(edges):
        run = _controlled(problem, own, solver, accuracy, end)
        rtol = min(rtol, run.solver.tolerance)
        last = i == len(edges) - 1
        inside = problem.times[(problem.times >= begin) & ((problem.times < edges[i + 1][0]) if not last else True)]
        values.append(problem.values(run.solution, own, np.minimum(inside, end)))
        if not last:
            own = Equations(_continued(problem, own, run, edges[i + 1]))
    return rtol, np.concatenate(values)


def _pieces(problem: Problem, stops: Sequence[float]) -> Iterator[tuple[float, float]]:
    """Begin and end (s) of the pieces of a reference. They leave out instants at which an input may jump, so that no piece has
    values from both sides of a jump."""
    begin, beside = float(problem.times[0]), BESIDE * float(np.spacing(problem.t_end))
    for stop in stops:
        if begin + 2 * beside < stop < problem.t_end - 2 * beside:
            yield begin, stop - beside
            begin = stop + beside
    yield begin, problem.t_end


def _continued(problem: Problem, own: Equations, run: Controlled, piece: tuple[float, float]) -> Prepared:
    """The scene prepared at the begin of a piece, in the last state of the run before."""
    assert own.prepared is not None
    assert problem.scene is not None
    info = RunInfo(run.solver, "", Accuracy(None, None), run.solution.stats)
    start = Result(own.prepared, run.solution, info, run.solution.t).state_for(problem.scene)
    return prepare(problem.scene, replace(start, t=piece[0]), t_end=piece[1])


def _controlled(problem: Problem, own: Equations, solver: Solver, accuracy: float, end: float) -> Controlled:
    """A run to `end` whose estimated error is below the accuracy, or as small as the method can make it."""
    system = own.for_solver(problem.resolving, solver)
    assert isinstance(system, SceneSystem)
    wall = None if problem.max_wall is None else PATIENCE * problem.max_wall
    try:
        return run_controlled(system, own.prepared, solver, accuracy, Asked(end, max_wall=wall), problem.times[:0])
    except MbdaeError as error:
        begun = getattr(error, "solution", None)
        # a complete run whose error could not be estimated is used: its error follows from the comparison with the second method
        if begun is not None and begun.complete and begun.t[-1] >= end:
            return Controlled(begun, begun.solver, math.nan, 1, begun.stats.cpu_s)
        raise
