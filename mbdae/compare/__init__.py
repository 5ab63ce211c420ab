"""Joint models x solvers x forms x accuracies on one scene: error, CPU time and evaluations of each run.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from types import FunctionType
from typing import Any

import numpy as np

from mbdae.compare.page import Comparison
from mbdae.compare.problem import (
    Problem,
    Reference,
    computed_reference,
    given_reference,
    new_problem,
    refuse_no_reference,
    with_models,
)
from mbdae.compare.run import Equations, Run, checked_runs, default_runs, progress_of_runs, warm
from mbdae.compare.table import Row, TightestRun, asked_for, pairwise, tightest, with_front
from mbdae.errors import MbdaeError, OptionError, SolverError, naming_arguments
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.solution import Solution, Stats
from mbdae.process import cold, measured
from mbdae.results.reads import own_classes, own_of, reads
from mbdae.results.stored_parts import own_laws
from mbdae.run.checkpoint import environment
from mbdae.run.control import Controlled, companions_of
from mbdae.run.job import Job
from mbdae.scene.record import encode
from mbdae.study.kept import ResumeFile, packed, record, resume_path, told_when_interrupted, unpacked
from mbdae.system.base import Array
from mbdae.system.prepare import prepare
from mbdae.system.scene_system import SceneSystem
from mbdae.values import number, option, sequence, several, shown

__all__ = ["compare"]


ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)
MAX_WALL = 60.0  #: default of the largest wall time of a run, s
PROBES = 7  #: number of states at which the equations of a System are evaluated to recognise them
OUTPUTS = 201  #: number of output times of a result, the default of `simulate`
COUNTS = ("steps", "rejected", "residuals", "jacobians", "factorisations", "newton_iterations")


# -- what a comparison is known by, so that a stored one is continued only where it is the same


def identity(problem: Problem, runs: Sequence[Run], accuracies: Sequence[float], given: Array | None) -> dict[str, Any]:
    """The identity of a comparison as plain data: scene or equations, end time, measure, runs, accuracies, values of a `given`
    reference, and versions."""
    return {
        "scene": _scene(problem), "t_end": problem.t_end, "measure": problem.measure, "accuracies": list(accuracies),
        "max_wall": problem.max_wall,
        "runs": [{"solver": encode(run.solver), "form": encode(run.form),
                  "model": {name: encode(model) for name, model in run.models.items()} or None, "label": run.label,
                  "own": own_classes(run.solver, run.form)} for run in runs],
        "reference": "computed" if given is None else f"given, {_digest(given)}", "environment": environment(),
    }


def _scene(problem: Problem) -> dict[str, Any]:
    """The statements of a scene; of a System, whose functions cannot be stored, their values at fixed states."""
    s = problem.scene
    if s is not None:
        return {"name": s.name, "gravity": s.gravity.tolist(), "space": s.space, "statements": s.statements,
                "laws": own_laws(problem.stated.prepared.model) if problem.stated.prepared else {}, "own": own_of(s)}
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


def _digest(values: Array) -> str:
    return sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()


@dataclass
class Checkpoint(ResumeFile):
    """A comparison in progress: finished rows, the reference with the values that runs are compared with, and the data needed to
    continue. They are in one JSON file, which is written after every run."""

    reference: Reference | None = None
    reference_values: Array | None = None
    rows: list[Row] = field(default_factory=list)
    tightest_runs: dict[str, TightestRun] = field(default_factory=dict)
    cpu_s: float = 0.0  #: CPU time in solver calls, s
    total_cpu_s: float = 0.0  #: CPU time of the whole comparison, s

    kind, file_format, in_order = "comparison", "mbdae comparison in progress 2", True

    def row_name(self, row: Any) -> str:
        return f"the run {shown(row.get('label'))} at accuracy {shown(row.get('accuracy'))}" if isinstance(row, dict) else "a run"

    def load(self) -> None:
        """Take over what is stored in the file, where there is one."""
        with self.stored() as data:
            if data is not None:
                self.reference = record(Reference, data["reference"]) if data["reference"] else None
                self.tightest_runs = {f["label"]: record(TightestRun, f, values=unpacked(f["values"])) for f in data["finals"]}
                self.reference_values = unpacked(data["truth"]) if data["truth"] else None
                self.rows = [record(Row, row) for row in data["rows"]]
                self.cpu_s, self.total_cpu_s = (number(data[key], least=0.0) for key in ("cpu_s", "total_cpu_s"))

    def save(self, cpu_s: float, total_cpu_s: float) -> None:
        """Write the file anew, with the CPU times until now, s."""
        self.cpu_s, self.total_cpu_s = cpu_s, total_cpu_s
        if self.path is not None:
            self.store({
                "rows": [asdict(row) for row in self.rows], "reference": asdict(self.reference) if self.reference else None,
                "cpu_s": self.cpu_s, "total_cpu_s": self.total_cpu_s,
                "finals": [vars(run) | {"values": packed(run.values)} for run in self.tightest_runs.values()],
                "truth": None if self.reference_values is None else packed(self.reference_values),
            })


@dataclass
class Split:
    """Measures CPU times of what runs need besides the call of the solver: deriving, compiling, start, companion runs, checks.
    Those of making the equations are measured once for all runs with equal equations."""

    problem: Problem
    _known: dict[tuple[str, str, int], dict[str, float]] = field(default_factory=dict)

    def of(self, run: Run, solver: Solver, solution: Solution, equations: Equations) -> dict[str, float | None]:
        """CPU times (s) of a run, by the names of the entries of Row; empty for a System, whose equations are given."""
        if equations.prepared is None or self.problem.scene is None:
            return {}
        asked = run.form if run.form is not None else default_form(equations.prepared, solver.highest_index)
        form = asked.for_index(solver.highest_index)
        key = repr(sorted(run.models.items(), key=lambda item: item[0])), repr(form), solver.highest_index
        if key not in self._known:
            self._known[key] = self._made(run, form, solver)
        companions, judgement = self._after(form, solver, solution, equations)
        return {**self._known[key], "companions_s": companions, "judgement_s": judgement}

    def _made(self, run: Run, form: Form, solver: Solver) -> dict[str, float]:
        """CPU time from the scene to finished equations with empty caches, s."""
        with cold(), measured() as spent:
            scene = with_models(self.problem.scene, run)
            warm(system_for(prepare(scene, t_end=self.problem.t_end), form))
        return {"derive_s": spent.get("derive", 0.0), "compile_s": spent.get("compile", 0.0), "start_s": spent["other"]}

    def _after(self, form: Form, solver: Solver, solution: Solution, equations: Equations) -> tuple[float | None, float | None]:
        """CPU times (s) of the companion runs of `simulate`, and of its checks after the run; None where one fails."""
        prepared, end = equations.prepared, self.problem.t_end
        assert prepared is not None
        asked = Asked(end, max_wall=self.problem.max_wall)
        companions = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not solver.fixed and not solver.by_steps and solver.rtol is not None:
                try:
                    companions = companions_of(equations.for_solver(form, solver), solver, asked)[0].cpu_s
                except MbdaeError:
                    companions = None
            system = equations.for_solver(form, solver)
            assert isinstance(system, SceneSystem)
            times = np.linspace(float(solution.t[0]), end, OUTPUTS)
            job = Job(prepared, form, 1e-6, asked, times, continued=False, _systems={(form, solver.highest_index): system})
            begin = time.process_time()
            try:
                job.result(Controlled(solution, solver, math.nan, 1, 0.0))
            except MbdaeError:
                return companions, None
            return companions, time.process_time() - begin


def _execute(problem: Problem, queue: Sequence[tuple[Run, float | None]], smallest: float, kept: Checkpoint, begin: float,
             tell: Callable[[int, int, str], None]) -> None:
    """Compute the reference and the missing rows, one after another, each stored as soon as it is done. queue: every run with an
    accuracy (None: the solver has a tolerance or step of its own); smallest: smallest of the accuracies asked; begin: process
    time (s) at which the comparison began; tell: called as tell(done, total, label) before every run."""
    total, split = len(queue) + 1, Split(problem)
    before = kept.cpu_s, kept.total_cpu_s
    if kept.reference is None:
        tell(0, total, "reference")
        kept.reference, kept.reference_values = computed_reference(problem, smallest)
        kept.save(before[0] + problem.spent, before[1] + time.process_time() - begin)
    for i in range(len(kept.rows), len(queue)):
        run, accuracy = queue[i]
        tell(i + 1, total, f"{run.name('')} {asked_for(accuracy)}")
        row, values = executed(problem, run, accuracy, kept.reference_values, split)
        if values is not None:
            tightest(kept.tightest_runs, row, values)
        kept.rows.append(row)
        kept.save(before[0] + problem.spent, before[1] + time.process_time() - begin)


def executed(problem: Problem, run: Run, accuracy: float | None, reference: Any, split: Split) -> tuple[Row, Array | None]:
    """Execute one run; returns its row, and its values that are compared (None where it failed). reference: values of the
    reference."""
    facts: dict[str, Any] = {**_labels(problem, run, None), "solver": run.solver.label, "accuracy": accuracy}
    spent = problem.spent
    try:
        equations = problem.equations(run)
        facts |= _labels(problem, run, equations)
        solver = run.solver if accuracy is None else run.solver.at_accuracy(accuracy, equations.label_of(run.form, run.solver))
        facts["rtol"] = None if solver.fixed else solver.rtol
        done = problem.solve(solver, run.form, equations)
        values = problem.values(done.solution, equations)
    except SolverError as error:
        return Row(**facts, cpu_s=problem.spent - spent, **counts(error.solution), failure=str(error)), None
    except (MbdaeError, np.linalg.LinAlgError) as error:
        return Row(**facts, failure=str(error)), None
    except Exception as error:  # error in a user's own solver or law: recorded in its row, and the other runs continue
        return Row(**facts, cpu_s=problem.spent - spent, failure=f"{type(error).__name__}: {error}"), None
    error_now = problem.error(values, reference)
    if not np.isfinite(error_now):
        return Row(**facts, cpu_s=done.cpu_s, **counts(done.solution), failure="the solution is not finite everywhere"), None
    cost: dict[str, Any] = {"cpu_s": done.cpu_s, "cpu_spread_s": done.spread_s, "peak_bytes": done.peak_bytes}
    cost |= split.of(run, solver, done.solution, equations)
    return Row(**facts, error=error_now, **cost, **counts(done.solution)), values


def _labels(problem: Problem, run: Run, equations: Equations | None) -> dict[str, Any]:
    """Label, form and joint model of a run, as entries of a Row; before its `equations` are made (None) as the user stated
    them."""
    form = run.form.label if run.form is not None else (equations or problem.stated).label_of(None, run.solver)
    now, asked = equations.recursive if equations is not None else (0, 0)
    part = f" ({now} of {asked} joints, the rest kinematic)" if run.models and now < asked else ""
    model = None if run.model_label is None else run.model_label + part
    return {"label": run.name(form) + (part if run.label is None else ""), "form": form, "model": model}


def counts(solution: Solution | None) -> dict[str, Any]:
    """Numbers of evaluations, and bytes of the stored steps, of a run, as entries of a Row."""
    stats = solution.stats if solution is not None else Stats()
    size = None if solution is None else int(solution.t.nbytes + solution.y.nbytes + solution.yp.nbytes)
    return {name: int(getattr(stats, name)) for name in COUNTS} | {"stored_bytes": size}


@naming_arguments
def compare(scene: Any, t_end: float, runs: Sequence[Run | Solver | type[Solver] | str] | None = None,
            accuracies: Sequence[float] = ACCURACIES, measure: str | None = None, reference: Any = None,
            max_wall: float | None = MAX_WALL,
            progress: Callable[[int, int, str], None] | None = None, resume: Any = None) -> Comparison:
    """Run a scene (or a System) to t_end (s) with every run at every accuracy; returns a `Comparison`.

    runs: list of mb.Run, or of solvers (objects, classes, names); default IDA and Radau. measure: a sensor such as "C.angle";
    default the motion of the bodies. reference: a Result, or a function of the times (nt,) that returns the measure; default a
    tight Radau run that a second method confirms. max_wall: largest wall time of a run, s. progress(done, total, label): called
    before every run.
    resume: a JSON file that stores every finished run; runs that it holds already are not repeated.
    """
    begin = time.process_time()
    asked = _checked_accuracies(accuracies)
    own, tell = checked_runs(runs) if runs is not None else None, progress_of_runs(progress)
    resume = resume_path(resume)
    refuse_no_reference(reference)
    problem = new_problem(scene, t_end, measure, max_wall)
    chosen = own or default_runs(problem.constrained, problem.stated.given, problem.other_models, problem.resolving)
    given = given_reference(problem, reference) if reference is not None else None
    kept = Checkpoint(resume, identity(problem, chosen, asked, given[1] if given else None))
    kept.load()
    if given is not None:
        kept.reference, kept.reference_values = given
    queue = [(run, a) for run in chosen for a in ([None] if run.as_it_is else asked)]
    smallest = min([*asked, *(a for run in chosen if (a := run.own_accuracy(problem.system(None).label)) is not None)])
    with told_when_interrupted(kept.path, "runs", lambda: (len(kept.rows), len(queue))):
        _execute(problem, queue, smallest, kept, begin, tell)
    assert kept.reference is not None
    differences = pairwise(list(kept.tightest_runs.values()), problem.error)
    rows = with_front(kept.rows, kept.reference.difference or 0.0)
    return Comparison(problem.name, problem.t_end, measure, problem.what, kept.reference, asked, rows,
                      differences, kept.cpu_s, kept.total_cpu_s, environment())


def _checked_accuracies(accuracies: Any) -> tuple[float, ...]:
    given = accuracies if several(accuracies) else [accuracies]
    remedy = "give numbers from 1e-12 to 0.1, such as [1e-3, 1e-6]"
    values = option("accuracies", given, sequence, remedy, each=number, least=1e-12, most=1e-1)
    if not values:
        raise OptionError(f"accuracies = {shown(accuracies)} is empty: give one number or more, from 1e-12 to 0.1")
    return tuple(sorted(set(values), reverse=True))
