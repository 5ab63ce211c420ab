"""CPU time of what a run needs besides the call of the solver: deriving, compiling, start, companion runs, checks."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass, field

import numpy as np

from mbdae.compare.equations import Equations, warm
from mbdae.compare.problem import Problem, with_models
from mbdae.compare.run import Run
from mbdae.costs import cold, measured
from mbdae.errors import MbdaeError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.solution import Solution
from mbdae.run.control import Controlled, companions_of
from mbdae.run.job import Job
from mbdae.system.prepare import prepare
from mbdae.system.scene_system import SceneSystem

OUTPUTS = 201  #: number of output times of a result, the default of `simulate`


@dataclass
class Split:
    """Measures these CPU times for the runs of a problem; those of making the equations once for all runs with equal
    equations."""

    problem: Problem
    _known: dict[tuple[str, str, int], dict[str, float]] = field(default_factory=dict)

    def of(self, run: Run, solver: Solver, solution: Solution, equations: Equations) -> dict[str, float | None]:
        """These CPU times (s) of a run, by the names of the entries of Row; empty for a System, whose equations are given."""
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
