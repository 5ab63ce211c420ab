"""One call of `Scene.simulate`: from a prepared scene and an accuracy to a run with its error and its warnings.

Modules of this folder in the order in which a run uses them:

1. `choice`           joints, form and solver where the user names none (`checks` shows them before the run);
2. `control`          runs of the solver until the estimated error (`estimate`) is below the accuracy;
3. `verification`     vibrations of elastic bodies that long steps damp away; with verify=True: a run of another method, and one
                      on a finer mesh; a closer run when a quantity is read that the estimate does not cover;
4. `assessment`, `conditions`  warnings; steps with a large `defect`, where something may have acted unseen, are integrated again.
"""

from __future__ import annotations

import math
import time
import warnings as python_warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

from mbdae.errors import (
    ENDS,
    FINAL,
    AccuracyWarning,
    ChatteringError,
    MbdaeError,
    OptionError,
    SolverError,
    WallClockError,
    interrupted,
    keeping,
    warn,
)
from mbdae.formulations import Form, shared_system
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.integrators.stored_runs import keeping_runs
from mbdae.results.accuracy import RunInfo
from mbdae.results.result import Result
from mbdae.results.stored_parts import AskedToo, told
from mbdae.run.assessment import assessed, singular_stop
from mbdae.run.checkpoint import kept_value
from mbdae.run.choice import Choice, alternatives
from mbdae.run.conditions import Rechecked, rechecked
from mbdae.run.contacts import hidden_contacts, refuse_unresolved
from mbdae.run.control import CLOSER, FOLLOWING, SHALLOW, Besides, following, run_controlled
from mbdae.run.defect import with_stiff_forces
from mbdae.run.drift import Assessment, joint_drift
from mbdae.run.estimate import UNTESTED, Controlled, cpu_of, measure_of, with_vibrations
from mbdae.run.growing import growing, unfollowed
from mbdae.run.verification import SPARE, CloserRun, accuracy_of, nothing_known, verified, with_forces, with_lost_vibrations
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.without_multipliers import WithoutMultipliers
from mbdae.threads import furthest

UNJUDGED = "the run attached (attribute `solution`) is complete with its error; its warnings were not found to the end"
UNRESOLVED = ("part of the error are elastic vibrations that the steps leave out; form=mb.GGL(waves=True) with "
              "solver=mb.RadauIIA(3) follows them")
#: the time of an event is found by a run LOOSER times less accurate than the run that will end there, but never less accurate
#: than MOST
LOOSER, MOST = 10.0, 1e-3
#: ratio of the first to the last estimate of a search above which the runs count as convergent
CONVERGED = 10.0


@dataclass
class Job:
    """One call of `Scene.simulate`."""

    prepared: Prepared
    form: Form
    accuracy: float
    asked: Asked  #: end time, wall time and progress
    times: Array  #: output times of the result, s
    continued: bool  #: whether the run starts where another run ended
    choice: str = ""
    begin: float = field(default_factory=time.perf_counter)

    def run(self, solver: Solver, strict: bool = False) -> Controlled:
        """A run of one solver to the accuracy, or with the tolerance or step that the user set. strict: with eliminated
        multipliers, stop at singular positions, where another branch of the motion may begin."""
        refuse_unresolved(self.prepared, solver)
        system = self._system(solver)
        if isinstance(system, WithoutMultipliers):
            system = system.strictly(strict)
        with self.attaching(solver):
            if not solver.fixed and solver.rtol is None and getattr(solver, "atol", None) is not None:
                solver = solver.at_accuracy(self.accuracy, system.label)  # atol is the user's: one run, with the usual rtol
            if solver.fixed or solver.rtol is not None:
                return run_once(system, solver, self.asked, self.accuracy, self.prepared.length)
            if not system.assembly.passes:
                return self._with_vibrations(self._controlled(system, solver), system)
            if self.asked.wanted and not self.prepared.contacts:
                return self._for_forces(solver, system)
            run = self._controlled(system, solver, None if self.prepared.contacts else self._lost(solver, system))
            with keeping(run.solution, UNTESTED):
                return self._with_waves(run, solver, system)

    def _with_vibrations(self, run: Controlled, system: SceneSystem) -> Controlled:
        """The run, judged with the vibrations of stiff springs that its steps leave out. Where it misses the accuracy, one that
        follows them, if that takes at most about half a second longer."""
        with keeping(run.solution, UNTESTED):
            measure = measure_of(system, self.prepared, self.asked.wanted, self.accuracy)
            found = with_vibrations(run, system, self.prepared, self.accuracy, measure)
            asked, met = replace(self.asked, begin=self.begin), found.estimate <= self.accuracy
            if met and self.choice and not asked.wanted:
                return with_stiff_forces(found, system, self.prepared, self.accuracy, asked, self.times)
            if met or not found.vibrations or self.prepared.contacts:
                return found
            asked = replace(asked, max_residuals=run.solution.stats.residuals + SPARE / system.n / 3)
            return _better(found, lambda: following(found, system, self.prepared, self.accuracy, asked, self.times))

    def _for_forces(self, solver: Solver, system: SceneSystem) -> Controlled:
        """A run with what was asked for. Where that is missed although the motion is not, one that resolves all vibrations comes
        first, since these carry forces: tightening a run that leaves them out comes to their steps in the end."""
        lost = self._lost(solver, system)
        run = replace(self, asked=replace(self.asked, motion_alone=True))._controlled(system, solver, lost)
        with keeping(run.solution, UNTESTED):
            if run.estimate <= self.accuracy:
                return self._with_waves(run, solver, system)
            resolving = self._resolving(solver)
            run = _better(run, lambda: replace(self._controlled(resolving, solver), waves=True))
            if run.estimate <= self.accuracy:
                return run
            return _better(run, lambda: lost(self._controlled(system, solver)))

    def _system(self, solver: Solver) -> SceneSystem:
        """The equations with the index that a solver takes, assembled once."""
        return shared_system(self.prepared, self.form, solver.highest_index)

    def _resolving(self, solver: Solver) -> SceneSystem:
        """The equations that resolve all elastic vibrations."""
        return shared_system(self.prepared, replace(self.form, waves=True), solver.highest_index)  # type: ignore[type-var]

    def _lost(self, solver: Solver, system: SceneSystem) -> Callable[[Controlled], Controlled]:
        """What gives a run the estimate with the elastic vibrations that its steps damp away."""
        measure = measure_of(system, self.prepared, self.asked.wanted, self.accuracy)
        return partial(with_lost_vibrations, self.prepared, self._resolving(solver), measure)

    def _controlled(self, system: SceneSystem, solver: Solver, besides: Besides = None) -> Controlled:
        asked = replace(self.asked, begin=self.begin)
        return run_controlled(system, self.prepared, solver, self.accuracy, asked, self.times, besides)

    def _with_waves(self, run: Controlled, solver: Solver, system: SceneSystem) -> Controlled:
        """The run itself where the elastic vibrations that it damps away are below the accuracy, else one of all vibrations."""
        resolving, run = self._resolving(solver), self._lost(solver, system)(run)
        if run.estimate <= self.accuracy:
            if not self.choice or self.prepared.contacts or self.asked.wanted:
                return run
            return with_forces(run, resolving, self.prepared, self.accuracy, replace(self.asked, begin=self.begin), self.times)
        # every impact excites such vibrations anew, and resolving them all takes 10 to 40 times as many steps
        if self.prepared.contacts:
            return replace(run, notes=(*run.notes, UNRESOLVED))
        return _better(run, lambda: replace(self._controlled(resolving, solver), waves=True))

    def until(self, solver: Solver, ends: Callable[[Prepared, Solution], Any]) -> float | None:
        """Time (s) of the event that ends a run, found by a run at a larger tolerance that stops soon after it; None without
        event. ends: function of a scene and a solution that returns the first event, or None."""
        looser = min(LOOSER * self.accuracy, MOST)
        if not solver.fixed and solver.rtol is None:
            solver = solver.at_accuracy(looser, self._system(solver).label)
        asked = replace(self.asked, stop=lambda solution: ends(self.prepared, solution) is not None, begin=self.begin)
        found: float | None = kept_value(lambda: self._found(solver, asked, ends), lambda kept: kept, lambda kept: kept)
        return found

    def _found(self, solver: Solver, asked: Asked, ends: Callable[[Prepared, Solution], Any]) -> float | None:
        """Time (s) of the event in one run of the solver; the run is not stored in a checkpoint, because it is short."""
        try:
            with python_warnings.catch_warnings(), keeping_runs(None):
                python_warnings.simplefilter("ignore", AccuracyWarning)
                found = solver.run(self._system(solver), asked)
        except WallClockError:
            raise
        except SolverError as error:  # the motion may break down soon after the event, which is then on the solution so far
            if not isinstance(error.solution, Solution):
                return None
            found = error.solution
        event = ends(self.prepared, found)
        return None if event is None else float(event.time)

    def run_default(self, choice: Choice, form: Form | None) -> tuple[Controlled, Job]:
        """The run of the chosen solver; of Radau IIA where it misses the accuracy or stops; of IDA where Radau IIA stops too; and
        the job with the form of that run.

        form: the one that the user asked for; with None the other solvers take the default form."""
        best: tuple[Controlled, Job] | None = None
        failure: MbdaeError | None = None
        why, runs, cpu, stopped = "", 0, 0.0, dict[Any, str]()
        for solver, own in alternatives(choice, form):
            job = replace(self, form=own, choice=f"{solver.label}, {own.label}: {why}" if why else str(choice))
            call = solver, own, self.accuracy, self.asked.t_end
            if self.asked.stop is None and call in self.prepared.kept:  # the same call stopped here before
                why = self.prepared.kept[call]
                continue
            try:
                run = job.run(solver, strict=True)
            except FINAL:
                raise
            except (SolverError, OptionError) as error:
                said = str(error)
                runs, cpu = runs + 1, cpu + (cpu_of(error) if isinstance(error, SolverError) else 0.0)
                failure = error if failure is None or isinstance(solver, RadauIIA) else failure  # Radau IIA fails least often
                why = said if solver.label in said else f"{solver.label} stopped: {said}"
                stopped[call] = why
                continue
            runs, cpu = runs + run.runs, cpu + run.cpu_s
            if best is None or run.estimate < best[0].estimate:
                best = run, job
            missed = job._missed(run)
            if not missed or isinstance(solver, RadauIIA) or _at_round_off(run):
                break
            why = f"{solver.label} {missed}"
        if best is None:
            assert failure is not None
            raise failure
        self.prepared.kept.update(stopped if self.asked.stop is None else {})
        return replace(best[0], runs=runs, cpu_s=cpu), best[1]

    def _missed(self, run: Controlled) -> str:
        """Why another method should be tried: the accuracy is missed, or joints drift because constraints are imposed on
        accelerations only; "" where none need be tried."""
        if not run.estimate <= self.accuracy:
            return f"came to {run.estimate:.1e}"
        doubts = [*run.notes, *joint_drift(self.prepared, run, self.accuracy)] if self.form.spec().drifts else []
        return f"warned: {doubts[0]}" if doubts else ""

    def result(self, run: Controlled, verify: bool = False) -> Result:
        """The Result with its warnings, each also issued as an AccuracyWarning; verify: compare with another method at a tenth of
        the accuracy, and beams with a finer mesh."""
        with self.attaching(run.solver), keeping(run.solution, UNTESTED):
            other = None
            if verify:
                begin = time.process_time()
                other = verified(self.prepared, self.form, run, self.accuracy, self.asked, self.continued)
                run = run.after(other.runs, time.process_time() - begin)
            wanted = self.asked.wanted
            if isinstance(measure := measure_of(self._system(run.solver), self.prepared, wanted, self.accuracy), AskedToo):
                run = replace(run, estimate=measure.of_motion(run.solution, run.others, run.estimate))
            known = accuracy_of(self.prepared, self.accuracy, run, other)
            info = RunInfo(run.solver, self.form.label, known, run.solution.stats, run.runs, run.cpu_s, (), self.choice)
            times = self.times[self.times <= run.solution.t[-1]]
            made = Result(self.prepared, run.solution, info, times)
        with self.attaching(run.solver), handing_over(made):
            with made._silently():
                found = kept_value(lambda: assessed(made, run, self.form.spec().drifts), tuple, lambda kept: Assessment(*kept))
            known = found.within(known)
            if found.reliable and not found.singular:  # else a warning already says that the run is not to be relied on
                missed = kept_value(lambda: rechecked(self.prepared, self.form, self._system(run.solver), run, known.asked),
                                    asdict, Rechecked.again)
                info, known = replace(info, cpu_s=info.cpu_s + missed.cpu_s), missed.within(known)
                found = found._replace(notes=(*found.notes, *missed.notes))
            followed = not (run.solver.fixed or run.solver.rtol is None)
            if (errors := known.errors) is not None and followed and found.reliable:
                waves = self._system(run.solver).assembly.passes and not run.waves
                asked = replace(self.asked, bounds=(*self.asked.bounds, *run.vibrations))
                errors.closer = CloserRun(self.prepared, self.form, run.solver, run.solution, self.accuracy, asked, waves)
            if wanted:
                known, notes = told(made, known, wanted)
                found = found._replace(notes=(*found.notes, *notes))
            made.info = replace(info, accuracy=known, warnings=found.notes, reliable=found.reliable)
        for note in found.notes:
            warn(f"scene '{self.prepared.model.scene.name}': {note}")
        return made

    @contextmanager
    def attaching(self, solver: Solver) -> Iterator[None]:
        """Context in which a run is made: where it fails or is interrupted, what was computed is attached to the error as a
        Result."""
        try:
            yield
        except (SolverError, *ENDS) as error:
            solution, singular = getattr(error, "solution", None), self.prepared.rank.singular_here
            if solution is None and (solution := furthest()) is not None and not isinstance(error, SolverError):
                interrupted(error, f"interrupted: {UNTESTED}", solution)
            stopped = isinstance(error, SolverError) and not isinstance(error, FINAL)
            if isinstance(error, SolverError) and stopped and singular and error.time <= self.prepared.start.t:
                error.args = (f"{error}; the scene starts in a singular position, where constraint {singular[0].name} depends on "
                              "the others: start it slightly away from that position",)
            if isinstance(solution, Solution):
                why = "the run failed before its end" if isinstance(error, MbdaeError) else "the run was interrupted"
                why = why if solution.t[-1] < self.asked.t_end else "the call was ended before the error was judged"
                known, stats = nothing_known(self.prepared, why), solution.stats
                info = RunInfo(solver, self.form.label, known, stats, 1, stats.cpu_s, (str(error),))
                made = Result(self.prepared, solution, info, self.times[self.times <= solution.t[-1]])
                error.solution = made  # type: ignore[union-attr]
                if stopped and (place := singular_stop(made, self.form.spec().drifts)):
                    stop, _, message = str(error).partition(": ")
                    error.args = (f"{stop}: {place} (solver: {message})",)
            raise


@contextmanager
def handing_over(made: Result) -> Iterator[None]:
    """Context in which a complete run is judged: where that is interrupted, or its time is over, the run goes with the exception,
    with what is known of its error."""
    try:
        yield
    except (WallClockError, *ENDS) as error:
        made.info = replace(made.info, warnings=(f"interrupted: {UNJUDGED}",), reliable=False)
        interrupted(error, f"interrupted: {UNJUDGED}", made)
        raise


def _at_round_off(run: Controlled) -> bool:
    """Whether the tolerance of a run is the smallest that round-off allows, and its estimates fell with the tolerance until then:
    the other methods, whose smallest tolerances are larger, would come no nearer."""
    return len(run.told) > 1 and run.told[-1][0] <= run.limit * (1 + 1e-9) and run.estimate < run.told[0][1] / CONVERGED


def run_once(system: System, solver: Solver, asked: Asked, accuracy: float, length: float = 1.0) -> Controlled:
    """A run with the tolerance or step of the solver, without an estimate of its error. Where its steps are not constant and do
    not follow a disturbance that grows unseen, it is repeated with shorter ones; where the equations have no Jacobian, not for
    growth that only their variation in time causes, which would be sought at 4 to 40 times the cost of the run. Contacts inside
    its steps count from a fraction of its tolerance (of the accuracy, where steps are constant) times the length (m) on."""
    with python_warnings.catch_warnings(record=True) as caught:
        python_warnings.simplefilter("always", AccuracyWarning)
        for repeats in range(FOLLOWING + 1):
            run = solver.run(system, asked)
            growth = growing(system, run, repeats > 0, varying=not system.differences)
            bounds = () if solver.fixed or repeats == FOLLOWING else unfollowed(growth)
            if not bounds:
                break
            asked = replace(asked, bounds=(*asked.bounds, *bounds), share=CLOSER)
    notes = tuple(dict.fromkeys(str(w.message) for w in caught))
    hidden = hidden_contacts(system, run, SHALLOW * (accuracy if solver.rtol is None else solver.rtol) * length)
    return Controlled(run, solver, math.nan, 1 + repeats, run.stats.cpu_s, notes, hidden=tuple(hidden), growth=tuple(growth))


def _better(run: Controlled, attempt: Callable[[], Controlled]) -> Controlled:
    """The run, or that which `attempt` returns if its estimate is smaller; with the cost of both."""
    try:
        again = attempt()
    except ChatteringError as error:  # there is the run
        return run.after(1, cpu_of(error))
    except FINAL:
        raise
    except OptionError:  # round-off does not allow the smaller tolerance
        return run
    except SolverError as error:
        return run.after(1, cpu_of(error))
    return again.after(run.runs, run.cpu_s) if again.estimate < run.estimate else run.after(again.runs, again.cpu_s)
