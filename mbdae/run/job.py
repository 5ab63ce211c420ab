"""One call of `Scene.simulate`: from a prepared scene and an accuracy to a judged run.

The way of a run through this folder, from top to bottom:

1. `choice`      joints, form and solver, where the user names none (`checks` says it before the run);
2. `control`     runs of the solver until the estimated error is below the accuracy (`resolution`: what contact and friction ask);
3. `waves`       what long steps leave out of stiff beams;
   `verification` with verify=True: another method, and a finer `mesh` of the beams;
4. `judgement`   what is to be said of the run that is kept: `reliability`, `passages`, `norms`, `balance`, `drift`;
5. `recheck`     steps whose `defect` contradicts the equations, where something can hide between their points (`hiding`).
"""

from __future__ import annotations

import math
import time
import warnings as python_warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SolverError, WallClockError, keeping
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.results.result import Result, RunInfo
from mbdae.run.choice import Choice, alternatives
from mbdae.run.control import UNTESTED, Controlled, cpu_of, run_controlled
from mbdae.run.drift import drifted
from mbdae.run.judgement import judgement_of
from mbdae.run.recheck import unseen
from mbdae.run.resolution import refuse_unresolved
from mbdae.run.verification import accuracy_of, nothing_known, verified
from mbdae.run.waves import with_lost_waves
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.without_multipliers import WithoutMultipliers

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
    continued: bool = False  #: it begins where another run ended
    begin: float = field(default_factory=time.perf_counter)
    _systems: dict[tuple[Form, int], SceneSystem] = field(default_factory=dict)

    def run(self, solver: Solver, strict: bool = False) -> Controlled:
        """One solver: to the accuracy, or as its own tolerance or step says. strict: eliminated multipliers stop at singular
        positions, where another branch may begin."""
        refuse_unresolved(self.prepared, solver)
        system = self._system(solver)
        if isinstance(system, WithoutMultipliers):
            system = system.strictly(strict)
        with self._attaching(solver):
            if not solver.fixed and solver.rtol is None and getattr(solver, "atol", None) is not None:
                solver = solver.at_accuracy(self.accuracy, system.label)  # a tolerance of the user's own: run as it is
            if solver.fixed or solver.rtol is not None:
                with python_warnings.catch_warnings(record=True) as caught:
                    python_warnings.simplefilter("always", AccuracyWarning)
                    solution = solver.solve(system, self.t_end, **self.options)
                notes = tuple(dict.fromkeys(str(w.message) for w in caught))
                return Controlled(solution, solver, math.nan, 1, solution.stats.cpu_s, notes)
            run = self._controlled(system, solver)
            if not system.numbering.stresses or self.form.waves:
                return run
            with keeping(run.solution, UNTESTED):
                return self._with_waves(run, solver, system)

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
        resolving = system_for(self.prepared, replace(self.form, waves=True), solver.highest_index)  # type: ignore[type-var]
        run = with_lost_waves(self.prepared, resolving, run)
        if self.accuracy < run.estimate < NEARLY * self.accuracy and not self.prepared.contacts:
            run = self._tighter(run, solver, system, resolving)
        if run.estimate <= self.accuracy:
            return run
        if self.prepared.contacts:  # every impact excites such vibrations anew: following all costs 10 to 40 times the steps
            return replace(run, notes=(*run.notes, UNRESOLVED))
        try:
            again = replace(self._controlled(resolving, solver), waves=True)
        except WallClockError:
            raise
        except SolverError as error:
            return run.after(1, cpu_of(error))
        if again.estimate < run.estimate:
            return again.after(run.runs, run.cpu_s)
        return run.after(again.runs, again.cpu_s)

    def _tighter(self, run: Controlled, solver: Solver, system: SceneSystem, resolving: SceneSystem) -> Controlled:
        """A run to a tenth of the accuracy if that is better."""
        try:
            again = self._controlled(system, solver, self.accuracy / 10)
        except WallClockError:
            raise
        except OptionError:
            return run
        except SolverError as error:
            return run.after(1, cpu_of(error))
        again = with_lost_waves(self.prepared, resolving, again)
        return again.after(run.runs, run.cpu_s) if again.estimate < run.estimate else run.after(again.runs, again.cpu_s)

    def run_default(self, choice: Choice, form: Form | None) -> Controlled:
        """What was chosen; Radau IIA where it cannot reach the accuracy or stops; IDA where Radau IIA stops too.

        form: what the user asked for; with None the others take the default form."""
        from mbdae.integrators.runge_kutta.radau import RadauIIA

        best: tuple[Controlled, Form, str] | None = None
        failure: MbdaeError | None = None
        why, runs, cpu = "", 0, 0.0
        for solver, own in alternatives(choice, form):
            self.form = own
            told = f"{solver.label}, {self.form.label}: {why}" if why else str(choice)
            try:
                run = self.run(solver, strict=True)
            except WallClockError:
                raise
            except (SolverError, OptionError) as error:
                said = str(error)
                runs, cpu = runs + 1, cpu + (cpu_of(error) if isinstance(error, SolverError) else 0.0)
                failure, why = failure or error, said if solver.label in said else f"{solver.label} stopped: {said}"
                continue
            runs, cpu = runs + run.runs, cpu + run.cpu_s
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
        return replace(run, runs=runs, cpu_s=cpu)

    def _missed(self, run: Controlled) -> str:
        """Why another method should try: the accuracy, or joints held on the level of accelerations alone that did not stay."""
        if not run.estimate <= self.accuracy:
            return f"came to {run.estimate:.1e}"
        doubts = [*run.notes, *drifted(self.prepared, run, self.accuracy)] if self.form.label == "Index1" else []
        return f"warned: {doubts[0]}" if doubts else ""

    def result(self, run: Controlled, verify: bool = False) -> Result:
        """The Result with its warnings, each also issued as an AccuracyWarning; verify: measured against another method at a
        tenth of the accuracy, and beams against a finer mesh."""
        with self._attaching(run.solver), keeping(run.solution, UNTESTED):
            found = None
            if verify:
                begin = time.process_time()
                found = verified(self.prepared, self.form, run, self.accuracy, self.t_end, self.continued, self.options)
                run = run.after(found.runs, time.process_time() - begin)
            known = accuracy_of(self.prepared, self.accuracy, run, found)
            info = RunInfo(run.solver, self.form.label, known, run.solution.stats, run.runs, run.cpu_s, (), self.choice)
            times = self.times[self.times <= run.solution.t[-1]]
            made = Result(self.prepared, run.solution, info, times)
            judgement = judgement_of(made, run, self.form.label == "Index1")
            known = judgement.within(known)
            if judgement.reliable and not judgement.singular:  # else it is told already
                missed = unseen(self.prepared, self.form, self._system(run.solver), run, known.asked)
                info, known = replace(info, cpu_s=info.cpu_s + missed.cpu_s), missed.within(known)
                judgement = judgement._replace(notes=(*judgement.notes, *missed.notes))
            made.info = replace(info, accuracy=known, warnings=judgement.notes, reliable=judgement.reliable)
        for note in judgement.notes:
            python_warnings.warn(f"scene '{self.prepared.model.scene.name}': {note}", AccuracyWarning, stacklevel=4)
        return made

    @contextmanager
    def _attaching(self, solver: Solver) -> Iterator[None]:
        """Give the solution of a run that fails or is interrupted the shape of a Result: nothing computed is lost."""
        try:
            yield
        except (SolverError, KeyboardInterrupt, SystemExit) as error:
            solution, singular = getattr(error, "solution", None), self.prepared.rank.singular_here
            if isinstance(error, SolverError) and singular and error.time <= self.prepared.start.t:
                error.args = (f"{error}; the scene starts in a singular position, where {singular[0].name} depends on the other "
                              f"rows: start it a little beside that",)  # fmt: skip
            if isinstance(solution, Solution):
                why = "the run failed before its end" if isinstance(error, SolverError) else "the run was interrupted"
                known, stats = nothing_known(self.prepared, why), solution.stats
                info = RunInfo(solver, self.form.label, known, stats, 1, stats.cpu_s, (str(error),))
                made = Result(self.prepared, solution, info, self.times[self.times <= solution.t[-1]])
                error.solution = made  # type: ignore[union-attr]
            raise
