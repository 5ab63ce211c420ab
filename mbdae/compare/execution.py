"""Execution of the runs of a comparison, one after another, each stored as soon as it is done."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.compare.checkpoint import Checkpoint, State
from mbdae.compare.equations import Equations
from mbdae.compare.pairwise import tightest
from mbdae.compare.problem import Problem
from mbdae.compare.reference import computed_reference
from mbdae.compare.rows import Row, asked_for
from mbdae.compare.run import Run
from mbdae.compare.split import Split
from mbdae.errors import ENDS, MbdaeError, SolverError, interrupted
from mbdae.integrators.solution import Solution, Stats
from mbdae.sweep.resume import interruption
from mbdae.system.base import Array

Progress = Callable[[int, int, str], None]
COUNTS = ("steps", "rejected", "residuals", "jacobians", "factorisations", "newton_iterations")


@dataclass
class Execution:
    """Executes the runs of a comparison that have no row in `state` yet. queue: every run with an accuracy (None: the solver has
    a tolerance or step of its own); kept: the file in which every finished run is stored."""

    problem: Problem
    split: Split
    queue: Sequence[tuple[Run, float | None]]
    smallest: float  #: smallest of the accuracies asked
    state: State
    kept: Checkpoint
    begin: float  #: process time at which the comparison began, s

    def do(self, tell: Progress) -> None:
        """Compute the reference and the missing rows. tell: called as tell(done, total, label) before every run. A
        KeyboardInterrupt gets the number of finished rows as its message."""
        before = self.state.cpu_s, self.state.total_cpu_s
        try:
            self._do(tell, before)
        except ENDS as error:
            done = interruption(self.kept.path, len(self.state.rows), len(self.queue), "runs")
            interrupted(error, done, None)
            raise

    def _do(self, tell: Progress, before: tuple[float, float]) -> None:
        total = len(self.queue) + 1
        if self.state.reference is None:
            tell(0, total, "reference")
            self.state.reference, self.state.reference_values = computed_reference(self.problem, self.smallest)
            self._keep(before)
        for i in range(len(self.state.rows), len(self.queue)):
            run, accuracy = self.queue[i]
            tell(i + 1, total, f"{run.name('')} {asked_for(accuracy)}")
            row, values = measured(self.problem, run, accuracy, self.state.reference_values, self.split)
            if values is not None:
                tightest(self.state.tightest_runs, row, values)
            self.state.rows.append(row)
            self._keep(before)

    def _keep(self, before: tuple[float, float]) -> None:
        self.state.cpu_s = before[0] + self.problem.spent
        self.state.total_cpu_s = before[1] + time.process_time() - self.begin
        self.kept.save(self.state)


def measured(problem: Problem, run: Run, accuracy: float | None, reference: Any, split: Split) -> tuple[Row, Array | None]:
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
