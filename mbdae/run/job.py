"""One call of `Scene.simulate`: from a prepared scene and an accuracy to a judged run.

The way of a run through this folder, from top to bottom:

1. `choice`      joints, form and solver, where the user names none (`checks` says it before the run);
2. `control`     runs of the solver until the estimated error is below the accuracy (`resolution`: what contact and friction ask);
3. `waves`       what long steps leave out of stiff beams;
4. `judgement`   what is to be said of the run that is kept: `reliability`, `passages`, `norms`, `balance`, `drift`;
5. `recheck`     steps whose `defect` contradicts the equations, where something can hide between their points (`hiding`).
"""

from __future__ import annotations

import math
import time
import warnings as python_warnings
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SolverError, WallClockError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.results.result import Accuracy, Result, RunInfo
from mbdae.run.choice import Choice, alternatives
from mbdae.run.control import Controlled, measure_of, run_controlled
from mbdae.run.drift import drifted
from mbdae.run.judgement import judgement_of
from mbdae.run.recheck import unseen
from mbdae.run.resolution import refuse_unresolved
from mbdae.run.waves import lost_amplitude, with_amplitude
from mbdae.system.assembly import SceneSystem
from mbdae.system.eliminated import Eliminated
from mbdae.system.prepare import Prepared

UNRESOLVED = ("of it, part are elastic vibrations that the steps leave out; form=mb.GGL(waves=True) with solver=mb.RadauIIA(3) "
              "follows them")  # fmt: skip
NEARLY = 10.0  #: estimate over the accuracy up to which a tighter run is tried before vibrations are followed


@dataclass
class Job:
    """One call of `Scene.simulate`."""

    prepared: Prepared
    form: Form
    accuracy: float
    t_end: float
    times: Any
    options: dict[str, Any]
    choice: str = ""
    begin: float = field(default_factory=time.perf_counter)
    _systems: dict[tuple[Form, int], SceneSystem] = field(default_factory=dict)

    def run(self, solver: Solver, strict: bool = False) -> Controlled:
        """One solver: to the accuracy, or as its own tolerance or step says. strict: eliminated multipliers stop at singular
        positions, where another branch may begin."""
        refuse_unresolved(self.prepared, solver)
        system = self._system(solver)
        if isinstance(system, Eliminated):
            system.strict = strict
        try:
            if solver.fixed or solver.rtol is not None:
                with python_warnings.catch_warnings(record=True) as caught:
                    python_warnings.simplefilter("always", AccuracyWarning)
                    solution = solver.solve(system, self.t_end, **self.options)
                notes = tuple(dict.fromkeys(str(w.message) for w in caught))
                return Controlled(solution, solver, math.nan, 1, solution.stats.cpu_s, notes)
            run = self._controlled(system, solver)
            return self._with_waves(run, solver, system) if system.numbering.stresses and not self.form.waves else run
        except SolverError as error:
            self._attach(error, solver)
            raise

    def _system(self, solver: Solver) -> SceneSystem:
        """The equations as a solver takes them, built once."""
        key = self.form, solver.highest_index
        if key not in self._systems:
            self._systems[key] = system_for(self.prepared, *key)
        return self._systems[key]

    def _controlled(self, system: SceneSystem, solver: Solver, accuracy: float | None = None) -> Controlled:
        asked = accuracy if accuracy is not None else self.accuracy, self.t_end, self.times
        return run_controlled(system, self.prepared, solver, *asked, begin=self.begin, **self.options)

    def _with_waves(self, run: Controlled, solver: Solver, system: SceneSystem) -> Controlled:
        """The run if the elastic vibrations it steps over are small enough, else one that resolves them: a tighter one where
        they are nearly small enough (shorter steps leave out less), or one that follows them all."""
        if not run.solution.complete:
            return run
        resolving = system_for(self.prepared, replace(self.form, waves=True), solver.highest_index)  # type: ignore[type-var]
        run = with_amplitude(run, lost_amplitude(self.prepared, resolving, run))
        if self.accuracy < run.estimate < NEARLY * self.accuracy and not self.prepared.contacts:
            run = self._tighter(run, solver, system, resolving)
        if run.estimate <= self.accuracy:
            return run
        if self.prepared.contacts:  # every impact excites such vibrations anew: following all costs 10 to 40 times the steps
            return replace(run, notes=(*run.notes, UNRESOLVED))
        try:
            again = self._controlled(resolving, solver)
        except WallClockError:
            raise
        except SolverError:
            return run
        return again if again.estimate < run.estimate or not again.solution.complete else run

    def _tighter(self, run: Controlled, solver: Solver, system: SceneSystem, resolving: SceneSystem) -> Controlled:
        """A run to a tenth of the accuracy if that is better."""
        try:
            again = self._controlled(system, solver, self.accuracy / 10)
        except WallClockError:
            raise
        except (SolverError, OptionError):
            return run
        if not again.solution.complete:
            return run
        again = replace(again, runs=run.runs + again.runs, cpu_s=run.cpu_s + again.cpu_s)
        again = with_amplitude(again, lost_amplitude(self.prepared, resolving, again))
        return again if again.estimate < run.estimate else run

    def run_default(self, choice: Choice, form: Form | None) -> Controlled:
        """What was chosen; Radau IIA where it cannot reach the accuracy or stops; IDA where Radau IIA stops too.

        form: what the user asked for; with None the others take the default form."""
        from mbdae.integrators.radau import RadauIIA

        best: tuple[Controlled, Form, str] | None = None
        failure: MbdaeError | None = None
        why = ""
        for solver, own in alternatives(choice, form):
            self.form = own
            told = f"{solver.label}, {self.form.label}: {why}" if why else str(choice)
            try:
                run = self.run(solver, strict=True)
            except WallClockError:
                raise
            except (SolverError, OptionError) as error:
                said = str(error)
                failure, why = failure or error, said if solver.label in said else f"{solver.label} stopped: {said}"
                continue
            if best is None or run.estimate < best[0].estimate:
                best = run, self.form, told
            missed = self._missed(run)
            if not missed or isinstance(solver, RadauIIA):
                break
            why = f"{solver.label} {missed}"
        if best is None:
            assert failure is not None
            raise failure
        run, self.form, self.choice = best
        return run

    def _missed(self, run: Controlled) -> str:
        """Why another method should try: the accuracy, or joints held on the level of accelerations alone that did not stay."""
        if not run.solution.complete:
            return ""
        if not run.estimate <= self.accuracy:
            return f"came to {run.estimate:.1e}"
        doubts = [*run.notes, *drifted(self.prepared, run, self.accuracy)] if self.form.label == "Index1" else []
        return f"warned: {doubts[0]}" if doubts else ""

    def verify(self, run: Controlled) -> float | None:
        """Largest difference to a run of another method at a tenth of the accuracy."""
        from mbdae.integrators.ida import IDA
        from mbdae.integrators.radau import RadauIIA

        radau, form = isinstance(run.solver, RadauIIA), default_form(self.prepared)
        other: Solver = IDA() if radau else RadauIIA(3)
        if self.prepared.model.lines:  # IDA follows fast vibrations of beams for ever
            other = RadauIIA(2) if radau and run.solver.label == "RadauIIA(3)" else RadauIIA(3)
            form = replace(form, waves=True)  # type: ignore[type-var]
        system = system_for(self.prepared, form, other.highest_index)
        end = np.array([self.t_end])
        tighter = max(self.accuracy / 10, 1e-10)
        again = run_controlled(system, self.prepared, other, tighter, self.t_end, end, **self.options).solution
        if not (again.complete and run.solution.complete):
            return None
        times = np.linspace(again.t[0], again.t[-1], 2001)
        return float(np.max(measure_of(system, self.prepared)(times, run.solution(times), again(times))))

    def result(self, run: Controlled, verified: float | None) -> Result:
        """The Result with its warnings, each also issued as an AccuracyWarning."""
        controlled = not math.isnan(run.estimate)
        asked = self.accuracy if controlled or verified is not None else None
        known = Accuracy(asked, run.estimate if controlled else None, verified)
        info = RunInfo(run.solver, self.form.label, known, run.solution.stats, run.runs, run.cpu_s, (), self.choice)
        times = self.times[self.times <= run.solution.t[-1]]
        found = Result(self.prepared, run.solution, info, times)
        judgement = judgement_of(found, run, self.form.label == "Index1")
        if judgement.reliable:
            missed = unseen(self.prepared, self.form, self._system(run.solver), run, asked)
            info = replace(info, cpu_s=info.cpu_s + missed.cpu_s)
            judgement = judgement._replace(notes=(*judgement.notes, *missed.notes))
        found.info = replace(info, warnings=judgement.notes, reliable=judgement.reliable)
        for note in judgement.notes:
            python_warnings.warn(f"scene '{self.prepared.model.scene.name}': {note}", AccuracyWarning, stacklevel=4)
        return found

    def _attach(self, error: SolverError, solver: Solver) -> None:
        """Give a failed run's solution the shape of a Result: nothing computed is lost."""
        solution = error.solution
        if isinstance(solution, Solution) and len(solution.t):
            info = RunInfo(solver, self.form.label, Accuracy(None, None), solution.stats, 1, solution.stats.cpu_s, (str(error),))
            error.solution = Result(self.prepared, solution, info, self.times[self.times <= solution.t[-1]])
