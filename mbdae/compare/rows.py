"""One run of a comparison: executed, timed and measured, as a row; and where else its CPU time goes."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbdae.compare.measures import Reference, quartiles
from mbdae.compare.problem import Problem, with_models
from mbdae.compare.run import CHOICE, MOST, REPEATED, Equations, Run, warm
from mbdae.compare.table import Row
from mbdae.errors import MbdaeError, SolverError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.solution import Beside, Solution, Stats, check_times
from mbdae.process import cold, measured
from mbdae.results.clearance import OtherRun
from mbdae.results.errors import Errors
from mbdae.results.quantities import named
from mbdae.run.choice import prepared_from
from mbdae.run.control import companions_of
from mbdae.run.estimate import Controlled, RunAt, measure_of, other_run, share_of
from mbdae.run.job import Job
from mbdae.system.base import Array

Known = tuple[Reference, list[Any]]  #: a reference, and its values of every measure, None where they are not known
OUTPUTS = 201  #: number of output times of a result, the default of `simulate`
COUNTS = ("steps", "rejected", "residuals", "jacobians", "factorisations", "newton_iterations")


@dataclass
class Split:
    """Measures CPU times of what runs need besides the call of the solver: deriving, compiling, start, companion runs, checks.
    Those of making the equations are measured once for all runs with equal equations."""

    problem: Problem
    _known: dict[tuple[str, str, int], dict[str, float]] = field(default_factory=dict)

    def of(self, run: Run, solver: Solver, solution: Solution, equations: Equations) -> dict[str, Any]:
        """CPU times (s) of a run and estimates of what was asked for, by the names of the entries of Row; empty for a System,
        whose equations are given."""
        if equations.prepared is None or self.problem.scene is None:
            return {}
        asked = run.form if run.form is not None else default_form(equations.prepared, solver.highest_index)
        form = asked.for_index(solver.highest_index)
        models = sorted(run.models.items(), key=lambda item: item[0])
        key = f"{id(run.scene) if run.scene else 0} {models}", repr(form), solver.highest_index
        if key not in self._known:
            self._known[key] = self._made(run, form, solver)
        return {**self._known[key], **self._after(form, solver, solution, equations)}

    def _made(self, run: Run, form: Form, solver: Solver) -> dict[str, float]:
        """CPU time from the scene to finished equations with empty caches, s."""
        with cold(), measured() as spent:
            problem, scene = self.problem, run.scene or with_models(self.problem.scene, run)
            warm(system_for(prepared_from(scene, problem.start, problem.t_end), form))
        return {"derive_s": spent.get("derive", 0.0), "compile_s": spent.get("compile", 0.0), "start_s": spent["other"]}

    def _after(self, form: Form, solver: Solver, solution: Solution, equations: Equations) -> dict[str, Any]:
        """CPU times (s) of the companion runs of `simulate`, and of its checks after the run, None where one fails; and estimates
        beside those companions."""
        prepared, end = equations.prepared, self.problem.t_end
        assert prepared is not None
        asked = Asked(end, max_wall=self.problem.max_wall)
        found: dict[str, Any] = {"companions_s": None, "judgement_s": None}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not solver.fixed and not solver.by_steps and solver.rtol is not None:
                try:
                    last, made = companions_of(equations.for_solver(form, solver), solver, asked)
                    found |= {"companions_s": last.cpu_s, "estimates": self._estimates(form, solver, made, solution, equations)}
                except MbdaeError:
                    pass
            # the equations of the run, since their assembly is none of the checks
            prepared.kept[form.for_index(solver.highest_index).for_time(prepared.time)] = equations.for_solver(form, solver)
            times = np.linspace(float(solution.t[0]), end, OUTPUTS)
            job = Job(prepared, form, 1e-6, asked, times, continued=False)
            begin = time.process_time()
            try:
                job.result(Controlled(solution, solver, math.nan, 1, 0.0))
            except MbdaeError:
                return found
            return found | {"judgement_s": time.process_time() - begin}

    def _estimates(self, form: Form, solver: Solver, companions: Sequence[RunAt], solution: Solution, equations: Equations
                   ) -> dict[str, float]:
        """The estimated errors of quantities that were asked for, from the run's companions, where they are known."""
        system, prepared, wanted = equations.for_solver(form, solver), equations.prepared, self.problem.wanted
        assert prepared is not None
        others = list[OtherRun]()
        for rtol, run in companions if wanted else ():
            share = share_of(system, solver, solver.tolerance / rtol, forces=True)
            beside = Beside(run, check_times(run), measure_of(system, prepared), share)
            others += other_run(system, prepared, beside, ratio=rtol / solver.tolerance)
        errors = Errors(prepared, solution, tuple(others), wanted=tuple(wanted.values()))
        result = equations.result(solution, solution.t)
        found = {named(key): errors.of(result, quantity) for key, quantity in wanted.items()}
        return {name: one.relative for name, one in found.items() if one is not None}


def executed(problem: Problem, run: Run | None, accuracy: float | None, reference: Known, split: Split
             ) -> tuple[Row, Array | None]:
    """Execute one run (None: the call of `simulate`); returns its row, and its values of the first measure, None where it
    failed."""
    if run is None:
        return _of_simulate(problem, accuracy, reference)
    facts: dict[str, Any] = {**_labels(problem, run, None), "solver": run.solver.label, "accuracy": accuracy,
                             "loose": problem.loose(run)}
    spent = problem.spent
    try:
        equations, solver = as_asked(problem, run, accuracy)
        facts |= _labels(problem, run, equations)
        facts["rtol"] = None if solver.fixed else solver.rtol
        done = problem.solve(solver, run.form, equations)
        values = problem.all_values(done.solution, equations)
    except SolverError as error:
        return Row(**facts, cpu_s=problem.spent - spent, **counts(error.solution), failure=str(error)), None
    except (MbdaeError, np.linalg.LinAlgError) as error:
        return Row(**facts, failure=str(error)), None
    except Exception as error:  # error in a user's own solver or law: recorded in its row, and the other runs continue
        return Row(**facts, cpu_s=problem.spent - spent, failure=f"{type(error).__name__}: {error}"), None
    cost: dict[str, Any] = {"cpu_s": done.cpu_s, "cpu_spread_s": done.spread_s, "cpu_first_s": done.first_s,
                            "peak_bytes": done.peak_bytes}
    first = values[0]
    assert first is not None
    if not np.isfinite(first).all():
        return Row(**facts, cpu_s=done.cpu_s, **counts(done.solution), failure="the solution is not finite everywhere"), None
    cost |= split.of(run, solver, done.solution, equations)
    return Row(**facts, **_errors(problem, values, reference), **cost, **counts(done.solution)), values[0]


def _errors(problem: Problem, values: list[Any], reference: Known) -> dict[str, Any]:
    """Errors of a run by measure, and of the first, as entries of a Row."""
    found = problem.errors(values, reference[1])
    return {"error": found.get(problem.measures[0].name), "errors": found}


def as_asked(problem: Problem, run: Run, accuracy: float | None) -> tuple[Equations, Solver]:
    """The equations of a run, and its solver with the tolerance for an accuracy."""
    equations = problem.equations(run)
    solver = run.solver if accuracy is None else run.solver.at_accuracy(accuracy, equations.label_of(run.form, run.solver))
    return equations, solver


def _of_simulate(problem: Problem, accuracy: float | None, reference: Known) -> tuple[Row, Array | None]:
    """What `simulate` does where no solver is named: the CPU time of the whole call, with all runs beside it."""
    facts: dict[str, Any] = {"label": CHOICE, "solver": "", "form": "", "model": None, "accuracy": accuracy, "chosen": True}
    assert problem.scene is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seconds = list[float]()
        try:
            while len(seconds) < 2 or (sum(seconds) < REPEATED and len(seconds) < MOST):
                begin = time.process_time()
                r = problem.scene.simulate(problem.t_end, accuracy, start=problem.start,  # type: ignore[attr-defined]
                                           max_wall=problem.max_wall,
                                           of={named(key): one for key, one in problem.wanted.items()} or None)
                seconds.append(time.process_time() - begin)
        except MbdaeError as error:
            return Row(**facts, failure=str(error)), None
    problem.spend(sum(seconds))
    own = Equations(r.prepared)
    solver, form = r.solution.solver.label, r.info.form
    facts |= {"label": f"{CHOICE}: {solver} {form}", "solver": solver, "form": form,
              "told": "; ".join(r.warnings) or ("not reliable" if r.reliable is False else "")}
    facts["estimates"] = {name: one for name, one in r.accuracy.of.items() if one is not None}
    values = problem.all_values(r.solution, own)
    call, spread = quartiles(seconds[1:])
    cost = {"cpu_s": r.stats.cpu_s, "call_s": call, "cpu_spread_s": spread + problem.tick, "cpu_first_s": seconds[0]}
    return Row(**facts, **_errors(problem, values, reference), **cost, **counts(r.solution)), values[0]


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
