"""Joint models x solvers x forms x accuracies on one scene: error, CPU time and evaluations of each run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from types import FunctionType
from typing import Any

import numpy as np

from mbdae.compare.engines import Engines
from mbdae.compare.measures import Reference, quartiles, rivals
from mbdae.compare.page import Comparison
from mbdae.compare.problem import (
    Problem,
    computed_reference,
    given_reference,
    new_problem,
)
from mbdae.compare.rows import Known, Split, as_asked, executed
from mbdae.compare.run import CHOICE, Run, checked_runs, default_runs, is_all, progress_of_runs, shipped_runs
from mbdae.compare.table import Row, TightestRun, asked_for, pairwise, tightest, with_front
from mbdae.engines import engines_of
from mbdae.errors import MbdaeError, OptionError, naming_arguments
from mbdae.integrators.base import Solver
from mbdae.results.quantities import named
from mbdae.results.reads import own_classes, own_of, reads
from mbdae.results.result import Result
from mbdae.results.stored_parts import own_laws
from mbdae.run.checkpoint import environment
from mbdae.scene.record import encode
from mbdae.study.kept import ResumeFile, packed, record, resume_path, told_when_interrupted, unpacked
from mbdae.system.base import Array, System
from mbdae.values import function, number, option, sequence, several, shown

__all__ = ["compare"]


ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)
MAX_WALL = 60.0  #: default of the largest wall time of a run, s
PROBES = 7  #: number of states at which the equations of a System are evaluated to recognise them
ROUNDS = 3  #: runs that compete for an accuracy are timed again in so many turns
#: a run with the accuracy asked of it, None where its solver has a tolerance or step of its own; None: what `simulate` does
Asked_ = tuple[Run | None, float | None]


# -- what a comparison is known by, so that a stored one is continued only where it is the same


def identity(problem: Problem, runs: Sequence[Run], accuracies: Sequence[float], given: list[Any] | None,
             engines: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
    """The identity of a comparison as plain data: scene or equations, end time, measure, runs, accuracies, values of a `given`
    reference, other programs with what they are given, and versions."""
    return {
        "scene": _scene(problem), "t_end": problem.t_end, "measures": [m.name for m in problem.measures],
        "accuracies": list(accuracies),
        "max_wall": problem.max_wall,
        "runs": [{"solver": encode(run.solver), "form": encode(run.form),
                  "model": {name: encode(model) for name, model in run.models.items()} or None, "label": run.label,
                  **({"scene": _stated(run.scene)} if run.scene is not None else {}),
                  "own": own_classes(run.solver, run.form)} for run in runs],
        "reference": "computed" if given is None else f"given, {_digest(given[0])}", "environment": environment(),
        **({"engines": list(engines)} if engines else {}),
        **({"start": problem.start} if problem.start is not None else {}),
        **({"of": {named(key): one if isinstance(one, str) else reads(one) for key, one in problem.wanted.items()}}
           if problem.wanted else {}),
    }


def _scene(problem: Problem) -> dict[str, Any]:
    """The statements of a scene; of a System, whose functions cannot be stored, their values at fixed states."""
    s = problem.scene
    if s is not None:
        return {**_stated(s), "laws": own_laws(problem.stated.prepared.model) if problem.stated.prepared else {}}
    system = problem.system(None)
    out, values = np.empty(system.n), []
    for k in range(PROBES):
        wave = np.sin((1 + k) * (1.0 + np.arange(system.n)))
        t = system.t0 + (problem.t_end - system.t0) * k / PROBES
        system.residual(t, system.y0 + 1e-3 * k * system.scale * wave, system.yp0 + 1e-3 * k * wave[::-1], out)
        values.append(out.copy())
    own = {name: reads(thing) for name, thing in vars(system).items() if isinstance(thing, FunctionType)}
    return {"names": list(system.names), "index": np.asarray(system.index).tolist(), "t0": system.t0, "y0": system.y0.tolist(),
            "yp0": system.yp0.tolist(), "residuals": _digest(np.array(values)), "functions": own}


def _stated(s: Any) -> dict[str, Any]:
    """A scene as it is stated, with what its statements read of the user's own."""
    return {"name": s.name, "gravity": s.gravity.tolist(), "space": s.space, "statements": s.statements, "own": own_of(s)}


def _digest(values: Array) -> str:
    return sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()


@dataclass
class Checkpoint(ResumeFile):
    """A comparison in progress: finished rows, the reference with the values that runs are compared with, and the data needed to
    continue. They are in one JSON file, which is written after every run."""

    references: dict[str, Known] = field(default_factory=dict)  #: by the loose joints of what is run, "" where none is
    rows: list[Row] = field(default_factory=list)
    tightest_runs: dict[str, TightestRun] = field(default_factory=dict)
    settled: bool = False  #: whether competing runs have been timed again
    tick: float = 0.0  #: resolution of the clock of CPU time, s
    cpu_s: float = 0.0  #: CPU time in solver calls, s
    total_cpu_s: float = 0.0  #: CPU time of the whole comparison, s

    kind, file_format, in_order = "comparison", "mbdae comparison in progress 3", True

    def row_name(self, row: Any) -> str:
        return f"the run {shown(row.get('label'))} at accuracy {shown(row.get('accuracy'))}" if isinstance(row, dict) else "a run"

    def load(self) -> None:
        """Take over what is stored in the file, where there is one."""
        with self.stored() as data:
            if data is not None:
                self.references = {key: (record(Reference, one["reference"]), [v and unpacked(v) for v in one["values"]])
                                   for key, one in data["references"].items()}
                self.tightest_runs = {f["label"]: record(TightestRun, f, values=unpacked(f["values"])) for f in data["finals"]}
                self.rows = [record(Row, row) for row in data["rows"]]
                self.settled, self.tick = bool(data["settled"]), number(data["tick"], least=0.0)
                self.cpu_s, self.total_cpu_s = (number(data[key], least=0.0) for key in ("cpu_s", "total_cpu_s"))

    def save(self, cpu_s: float, total_cpu_s: float) -> None:
        """Write the file anew, with the CPU times until now, s."""
        self.cpu_s, self.total_cpu_s = cpu_s, total_cpu_s
        if self.path is not None:
            self.store({
                "rows": [asdict(row) for row in self.rows], "cpu_s": self.cpu_s, "total_cpu_s": self.total_cpu_s,
                "settled": self.settled, "tick": self.tick,
                "references": {key: {"reference": asdict(one), "values": [None if v is None else packed(v) for v in values]}
                               for key, (one, values) in self.references.items()},
                "finals": [vars(run) | {"values": packed(run.values)} for run in self.tightest_runs.values()],
            })


def _execute(problem: Problem, queue: Sequence[Asked_], smallest: float, kept: Checkpoint, begin: float,
             tell: Callable[[int, int, str], None], engines: Engines) -> None:
    """Compute the references and the missing rows, one after another, each stored as soon as it is done. queue: every run with an
    accuracy (None: the solver has a tolerance or step of its own); smallest: smallest of the accuracies asked; begin: process
    time (s) at which the comparison began; tell: called as tell(done, total, label) before every run; engines: other programs,
    whose runs follow."""
    steps = engines.queue
    total, split = len(queue) + len(steps) + 1, Split(problem)
    before = kept.cpu_s, kept.total_cpu_s
    kept.tick = kept.tick or problem.tick

    def save() -> None:
        kept.save(before[0] + problem.spent, before[1] + time.process_time() - begin + problem.elsewhere)

    for i in range(-1, len(queue)):
        if 0 <= i < len(kept.rows):
            continue
        run, accuracy = queue[i] if i >= 0 else (None, None)
        loose = problem.loose(run)
        if loose not in kept.references:
            tell(i + 1, total, "reference")
            kept.references[loose] = own_reference(problem, run, smallest)
            save()
        if i < 0:
            continue
        tell(i + 1, total, f"{run.name('') if run is not None else CHOICE} {asked_for(accuracy)}")
        row, values = executed(problem, run, accuracy, kept.references[loose], split)
        if values is not None and not loose:
            tightest(kept.tightest_runs, row, values)
        kept.rows.append(row)
        save()
    for i, step in enumerate(steps, len(queue)):
        if i >= len(kept.rows):
            tell(i + 1, total, step.label)
            ladder = [row for row in kept.rows[len(queue) :] if row.label == step.label]
            kept.rows.append(engines.row(step, kept.references[""], ladder))
            save()
    if not kept.settled:
        kept.rows, kept.settled = _timed_again(problem, queue, kept.rows), True
        save()


def own_reference(problem: Problem, run: Run | None, smallest: float) -> Known:
    """The reference of what a run models; its label says why, where there is none."""
    try:
        return computed_reference(problem, smallest, problem.equations(run) if run is not None else None)
    except MbdaeError as error:
        if run is None:
            raise
        return Reference(f"none: {error}", None, None, None), [None for _ in problem.measures]


def _timed_again(problem: Problem, queue: Sequence[Asked_], rows: list[Row]) -> list[Row]:
    """The rows, where those that compete for an accuracy have been timed again in turns: what else the machine did while one of
    them was timed does not decide between them."""
    rows = list(rows)
    accuracies = {row.accuracy for row in rows if row.accuracy}
    near = sorted({i for wanted in accuracies for i in rivals(rows, wanted) if not (rows[i].chosen or rows[i].engine)})
    if len(near) < 2:
        return rows
    found: dict[int, list[float]] = {i: [] for i in near}
    work = {i: (*as_asked(problem, run, accuracy), run.form) for i in near for run, accuracy in [queue[i]] if run is not None}
    for _ in range(ROUNDS):
        for i, (equations, solver, form) in work.items():
            found[i].append(problem.solve(solver, form, equations).cpu_s)
    for i, seconds in found.items():
        middle, spread = quartiles(seconds)
        rows[i] = replace(rows[i], cpu_s=middle, cpu_spread_s=max(spread, rows[i].cpu_spread_s or 0.0))
    return rows


@naming_arguments
def compare(scene: Any, t_end: float, runs: Sequence[Run | Solver | type[Solver] | str] | str | None = None,
            accuracies: Sequence[float] = ACCURACIES, measure: str | Sequence[str] | None = None, reference: Any = None,
            max_wall: float | None = MAX_WALL,
            progress: Callable[[int, int, str], None] | None = None, resume: Any = None, engines: Any = None,
            of: Any = None, start: Any = None) -> Comparison:
    """Run a scene (or a System) to t_end (s) with every run at every accuracy; returns a `Comparison`.

    runs: list of mb.Run, or of solvers (objects, classes, names), or "all" that admit the scene; default IDA and Radau, and what
    `simulate` chooses. measure: a sensor such as "C.angle", an unknown of a mb.DAE, or several: runs are ranked by the first;
    default the motion of the bodies, with the joint forces and the energy. reference: a Result, or a function of the times (nt,)
    that returns the first measure; default a tight Radau run that a second method confirms. Runs whose joints have clearance
    where the scene's have none, or the reverse, model something else: their errors are those against a reference of their own,
    and `models` says how far that is from the scene's. max_wall: largest wall time of a run, s. progress(done, total, label):
    called before every run. resume: a JSON file that stores every finished run; runs that it holds already are not repeated.
    engines: other programs that run the same scene over a ladder of their own settings, {"exudyn": "/path/to/python", ...} with
    the interpreter of an environment that has the program, or a list of names for the running one: "exudyn", "mujoco", "scipy"
    (the exported equations), or a class derived from `mbdae.engines.Engine`. Their motions are measured against the same
    reference. of: quantities of a scene that the runs are asked for, as those of `Scene.simulate`: sensors, expressions,
    functions, in a list or by name. Their errors, over their largest values, are measured, by the first of them runs are ranked
    unless `measure` names something, and `estimates` of a row has what its run tells of them: `simulate` is called with
    them, and other runs with a tolerance are judged beside companions as `simulate` makes them. start: "relaxed" as in
    `simulate`, found with the joint models of every run; other programs do not take it.
    """
    begin = time.process_time()
    asked = checked_accuracies(accuracies)
    everything, tell = runs is not None and is_all(runs), progress_of_runs(progress)
    own = None if runs is None or everything else checked_runs(runs)
    resume = resume_path(resume)
    if reference is not None and not isinstance(reference, Result):
        option("reference", reference, function, "give a Result, a function of the times (nt,), or None to have one computed",
               takes="times")
    programs = engines_of(engines)
    if start is not None and (programs or isinstance(scene, System)):
        raise OptionError(f"start = {shown(start)}: {'other programs begin' if programs else 'a System begins'} as stated; leave "
                          "start out")
    problem = new_problem(scene, t_end, measure, max_wall, alone=False, of=of, start=start)
    chosen = own or default_runs(problem.constrained, problem.stated.given, problem.other_models, problem.resolving)
    if everything and problem.scene is not None:
        known = {run.name("") for run in chosen}
        chosen = [*chosen, *(run for run in shipped_runs(not problem.constrained) if run.name("") not in known)]
    given = given_reference(problem, reference) if reference is not None else None
    with Engines(problem, programs) as others:
        kept = Checkpoint(resume, identity(problem, chosen, asked, given[1] if given else None, others.identity))
        kept.load()
        if given is not None:
            kept.references[""] = given
        queue: list[Asked_] = [(run, a) for run in chosen for a in ([None] if run.as_it_is else asked)]
        if own is None and hasattr(problem.scene, "simulate"):
            queue += [(None, a) for a in asked]
        smallest = min([*asked, *(a for run in chosen if (a := run.own_accuracy(problem.system(None).label)) is not None)])
        made = partial(_made, problem, asked, kept)
        with told_when_interrupted(kept.path, "runs", lambda: (len(kept.rows), len(queue)), made):
            _execute(problem, queue, smallest, kept, begin, tell, others)
    found = made()
    assert found is not None
    return found


def _made(problem: Problem, asked: tuple[float, ...], kept: Checkpoint) -> Comparison | None:
    """The comparison of the runs that are done; None before the reference is."""
    if "" not in kept.references:
        return None
    reference, values = kept.references[""]
    differences = pairwise(list(kept.tightest_runs.values()), problem.error)
    rows = with_front(kept.rows, reference.difference or 0.0)
    models = {name: problem.errors(other, values) for name, (_, other) in kept.references.items() if name}
    for row in rows:
        if row.model is not None and not row.loose and row.errors:
            best = models.setdefault(row.model, dict(row.errors))
            models[row.model] = {name: min(error, best.get(name, error)) for name, error in row.errors.items()}
    return Comparison(problem.name, problem.t_end, problem.measure, problem.what, reference, asked, rows, differences,
                      {m.name: m.unit for m in problem.measures}, models, kept.tick, kept.cpu_s, kept.total_cpu_s,
                      environment())


def checked_accuracies(accuracies: Any) -> tuple[float, ...]:
    """The accuracies that a user gave, loose to tight, each once."""
    given = accuracies if several(accuracies) else [accuracies]
    remedy = "give numbers from 1e-12 to 0.1, such as [1e-3, 1e-6]"
    values = option("accuracies", given, sequence, remedy, each=number, least=1e-12, most=1e-1)
    if not values:
        raise OptionError(f"accuracies = {shown(accuracies)} is empty: give one number or more, from 1e-12 to 0.1")
    return tuple(sorted(set(values), reverse=True))
