"""One cell of a map of extremes: a run at the accuracy asked, its error against a reference of two
methods that agree, and the verdict."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.compare.problem import Problem, with_models
from mbdae.compare.run import Equations
from mbdae.errors import AccuracyWarning, MbdaeError
from mbdae.extremes.ways import Way
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.sundials import IDA
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.run.control import run_controlled
from mbdae.run.estimate import Controlled
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import SceneSystem

# -- The reference of the runs at one value: two methods that agree, each with an error far below the accuracy asked


SURE = 1 / 3  #: a reference is certain where two methods differ by at most this fraction of the accuracy
#: methods of a reference in the order in which they are tried, each with the ratio of the accuracy asked for to the one it is run
#: at, which is FLOOR at least; IDA (BDF) is left out for scenes with beams, whose vibrations a reference resolves
#: (`Problem.resolving`)
METHODS: tuple[tuple[Solver, float], ...] = (
    (RadauIIA(3), 100.0), (IDA(), 10.0), (RadauIIA(2), 10.0), (RadauIIA(3), 1000.0), (IDA(), 100.0),
)
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


MET, NEAR, TOLD = "met", "within 3 times", "missed and said so"
SILENT, FAILED, UNKNOWN = "missed silently", "failed loudly", "not judged"
#: verdict -> its meaning, in the order of the legend
VERDICTS = {
    MET: "the error is at most what was asked",
    NEAR: "the error is 1 to 3 times what was asked, and the run did not say so",
    TOLD: "the error is above what was asked, and the run said so",
    SILENT: "the error is more than 3 times what was asked, without warning or error",
    FAILED: "the run stopped, or was refused, with its reason",
    UNKNOWN: "no trustworthy reference: the error of this run is not known",
}
#: ratio of error to accuracy above which a run without warning counts as missed silently; where the reference is uncertain,
#: MARGIN times its uncertainty is subtracted from the error first
SILENCE = 3.0
#: factor on the uncertainty of an uncertain reference, which is subtracted from the error before the comparison with SILENCE; a
#: run that this leaves open is not judged, unless error and uncertainty together are within the accuracy
MARGIN = 10.0


@dataclass(frozen=True)
class Cell:
    """A run at one value of the parameter. error: difference from the reference, in the unit of the measure; estimated: the run's
    own error estimate; cpu_s: CPU time of the run, with the runs that estimate its error, s."""

    value: float
    label: str
    solver: str
    form: str
    model: str | None
    accuracy: float
    t_end: float
    verdict: str
    error: float | None = None
    estimated: float | None = None
    cpu_s: float | None = None
    steps: int = 0
    residuals: int = 0
    warnings: tuple[str, ...] = ()
    failure: str | None = None

    @property
    def told(self) -> bool:
        """Whether the run gave a warning."""
        return bool(self.warnings)


def verdict(error: float, accuracy: float, told: bool, uncertainty: float | None) -> str:
    """The verdict on an error of a run that is known to within `uncertainty` (None: not known); UNKNOWN where it depends on this
    uncertainty. told: whether the run gave a warning."""
    if not math.isfinite(error):
        return TOLD if told else SILENT
    doubt = math.inf if uncertainty is None else uncertainty if uncertainty > SURE * accuracy else 0.0
    if error + doubt <= accuracy:
        return MET
    if error - MARGIN * doubt > SILENCE * accuracy:
        return TOLD if told else SILENT
    if doubt:
        return UNKNOWN
    return TOLD if told else NEAR


def cell(problem: Problem, way: Way, value: float, accuracy: float, reference: Reference) -> Cell:
    """Execute a run at a value and judge it. A run with its own tolerance or step has no error estimate, so it is verified by
    another method."""
    run, models, scene = way.run, way.run or way.models, problem.scene
    assert scene is not None
    facts: dict[str, Any] = {
        "value": value, "label": way.label, "solver": run.solver.label if run else "", "form": run.form.label if run and run.form
        else "", "model": models.model_label if models else None, "accuracy": accuracy,
        "t_end": problem.t_end,
    }
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            variant: Any = with_models(scene, models) if models is not None else scene
            r: Result = variant.simulate(problem.t_end, accuracy, solver=run.solver if run else None,
                                         form=run.form if run else None, max_wall=problem.max_wall,
                                         verify=run is not None and run.as_it_is)
    except (MbdaeError, np.linalg.LinAlgError, ArithmeticError) as stop:
        name = "" if isinstance(stop, MbdaeError) else f"{type(stop).__name__}: "
        return Cell(**facts, verdict=FAILED, cpu_s=time.process_time() - begin, failure=name + " ".join(str(stop).split()))
    cpu = time.process_time() - begin
    facts |= {"solver": r.info.solver.label, "form": r.info.form, "cpu_s": cpu}
    values = problem.values(r.solution, Equations(r.prepared))
    if reference.values is None:
        error, found = math.nan, UNKNOWN
    else:
        error = problem.error(values, reference.values)
        found = verdict(error, accuracy, bool(r.warnings), reference.uncertainty)
    best = r.accuracy.verified if r.accuracy.verified is not None else r.accuracy.estimated
    known = best if best is not None and math.isfinite(best) else None
    return Cell(**facts, verdict=found, error=error if math.isfinite(error) else None, estimated=known, steps=r.stats.steps,
                residuals=r.stats.residuals, warnings=tuple(" ".join(w.split()) for w in r.warnings))
