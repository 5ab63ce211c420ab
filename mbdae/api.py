"""The Scene as users see it: its data, and check, simulate, system on top of it."""

from __future__ import annotations

import math
import time
import warnings as python_warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SolverError, WallClockError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver, output_times
from mbdae.integrators.solution import Solution
from mbdae.results.balance import drift_of_energy
from mbdae.results.checks import Check, check_scene, doubts
from mbdae.results.choice import Choice, alternatives, choose, prepared_by_default
from mbdae.results.control import Controlled, measure_of, plausible, run_controlled
from mbdae.results.drift import drifted
from mbdae.results.norms import unequal_norms
from mbdae.results.passages import passages
from mbdae.results.reliability import doubts_of_steps, judged
from mbdae.results.resolution import refuse_unresolved
from mbdae.results.result import Accuracy, Result, RunInfo
from mbdae.results.waves import lost_amplitude, with_amplitude
from mbdae.scene.scene import SceneData
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.eliminated import Eliminated
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start import Start

if TYPE_CHECKING:
    from mbdae.analysis import Equilibrium, Floquet, Linearization

DEFAULT_OUTPUTS = 201
UNRESOLVED = ("of it, part are elastic vibrations that the steps leave out; form=mb.GGL(waves=True) with solver=mb.RadauIIA(3) "
              "follows them")  # fmt: skip
NEARLY = 10.0  #: estimate over the accuracy up to which a tighter run is tried before vibrations are followed
JUDGED = 1000  #: outputs at which a run with contact is judged


class Scene(SceneData):
    """A mechanism: bodies, joints and forces. See `SceneData` for the statements."""

    def check(self, accuracy: float = 1e-6) -> Check:
        """Everything that can be said before solving, and what `simulate` to this accuracy will choose; raises SceneError with
        all problems at once."""
        plausible(accuracy)
        return check_scene(self, accuracy)

    def system(self, form: Form | None = None, start: Start | None = None) -> SceneSystem:
        """The equations F(t, y, y') = 0 of the scene in a form, with a consistent start."""
        prepared = prepare(self, start)
        return system_for(prepared, form)

    def draw(self, path: Any = None) -> Any:
        """The scene as it starts: bodies, joints, forces, ground and names, in the plane or in space; a matplotlib figure.

        path: .png, .svg or .pdf to write. Raises SceneError with every problem found."""
        from mbdae.results.drawing import draw

        return draw(prepare(self), path)

    def equilibrium(self, frame: Any = None, progress: Callable[[float, int], None] | None = None) -> Equilibrium:
        """A state at rest in a frame: s.ground (default), or a body that turns steadily; see `mbdae.analysis.equilibrium`."""
        from mbdae.analysis import equilibrium

        return equilibrium(self, frame, progress)

    def linearize(self, at: Any = None, frame: Any = None, count: int | None = None) -> Linearization:
        """Modes, frequencies, damping and growth of small departures from a steady motion; see `mbdae.analysis.linearize`."""
        from mbdae.analysis import linearize

        return linearize(self, at, frame, count)

    def floquet(self, period: float, at: Any = None, count: int | None = None, accuracy: float = 1e-8) -> Floquet:
        """Floquet multipliers, growth and modes of small departures from a periodic motion; see `mbdae.analysis.floquet`."""
        from mbdae.analysis import floquet

        return floquet(self, period, at, count, accuracy)

    def simulate(self, t_end: float, accuracy: float = 1e-6, solver: Solver | None = None, form: Form | None = None,
                 outputs: int | Sequence[float] | Array | None = None, start: Result | None = None, verify: bool = False,
                 max_wall: float | None = None, progress: Callable[..., None] | bool | None = None) -> Result:  # fmt: skip
        """Run to t_end (s).

        accuracy: bound asked for the error over the run (positions relative to the scene's length, angles in rad,
        velocities relative to length / characteristic time; with beams positions and angles alone, because their
        velocities ring, and the same while a joint with clearance touches, because an impact a moment later is no error);
        the run estimates its error and repeats itself tighter where needed. A solver with a tolerance or step of its own is
        run once, as it is.
        outputs: a number of equally spaced times, or the times. start: a Result to continue. verify: measure the
        error by a repeat at a tenth with another method. max_wall: s of wall time. progress: True shows a bar.
        """
        plausible(accuracy)
        end = float(t_end) if isinstance(t_end, int | float) and math.isfinite(t_end) else None

        def prepared_as(scene: SceneData, largest_tree: int | None = None) -> Prepared:
            begin = start.state_for(scene) if start is not None else None
            return prepare(scene, begin, t_end=end, largest_tree=largest_tree)

        chosen = solver is None and form is None
        prepared = prepared_by_default(self, prepared_as) if chosen else prepared_as(self)
        if not (isinstance(t_end, int | float) and math.isfinite(t_end) and t_end > prepared.start.t):
            raise OptionError(f"t_end = {t_end}: give a time after the start t = {prepared.start.t:g} s")
        times = output_times(prepared.start.t, float(t_end), outputs if outputs is not None else DEFAULT_OUTPUTS)
        options = {"max_wall": max_wall, "progress": progress_of(progress)}
        if solver is not None:
            form = form if form is not None else default_form(prepared, solver.highest_index)
            job = _Job(prepared, form, accuracy, float(t_end), times, options)
            run = job.run(solver)
        else:
            choice = choose(prepared, self, accuracy, form)
            job = _Job(prepared, choice.form, accuracy, float(t_end), times, options)
            run = job.run_default(choice, form)
        return job.result(run, job.verify(run) if verify else None)


@dataclass
class _Job:
    """One call of `Scene.simulate`."""

    prepared: Prepared
    form: Form
    accuracy: float
    t_end: float
    times: Any
    options: dict[str, Any]
    choice: str = ""
    begin: float = field(default_factory=time.perf_counter)

    def run(self, solver: Solver, strict: bool = False) -> Controlled:
        """One solver: to the accuracy, or as its own tolerance or step says. strict: eliminated multipliers stop at singular
        positions, where another branch may begin."""
        refuse_unresolved(self.prepared, solver)
        system = system_for(self.prepared, self.form, solver.highest_index)
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
        judgement = judged(found if len(times) <= JUDGED else found(times[:: len(times) // JUDGED + 1]), run)
        notes = [*_warnings(self.prepared, run, known, self.form.label == "Index1"), *doubts_of_steps(run), *judgement.notes,
                 *passages(found, asked), *unequal_norms(found), *drift_of_energy(found, run, asked)]  # fmt: skip
        found.info = replace(info, warnings=tuple(notes), reliable=judgement.reliable)
        for note in notes:
            python_warnings.warn(f"scene '{self.prepared.model.scene.name}': {note}", AccuracyWarning, stacklevel=4)
        return found

    def _attach(self, error: SolverError, solver: Solver) -> None:
        """Give a failed run's solution the shape of a Result: nothing computed is lost."""
        solution = error.solution
        if isinstance(solution, Solution) and len(solution.t):
            info = RunInfo(solver, self.form.label, Accuracy(None, None), solution.stats, 1, solution.stats.cpu_s, (str(error),))
            error.solution = Result(self.prepared, solution, info, self.times[self.times <= solution.t[-1]])


def progress_of(progress: Any) -> Any:
    """The callback of a progress option: a bar for True."""
    if progress is True:
        from mbdae.results.progress import bar

        return bar()
    return progress or None


def _warnings(prepared: Prepared, run: Controlled, known: Accuracy, drifts: bool) -> list[str]:
    notes = []
    if known.met is False:
        worst = known.verified if known.verified is not None else known.estimated
        found = f"about {worst:.1e}" if worst is not None and math.isfinite(worst) else "not known: every tighter run failed"
        notes.append(f"accuracy {known.asked:g} was asked, the error is {found}: allow a smaller accuracy with RadauIIA(3), "
                     f"or a shorter run if the motion is chaotic")  # fmt: skip
    if known.met is False or run.solver.fixed or known.asked is None:
        notes += run.notes
    notes += (drifted(prepared, run, known.asked) if drifts else []) or _broken_rows(prepared, run, known.asked)
    if not run.solution.complete:
        notes.append(f"the run was stopped at t = {run.solution.t[-1]:.6g} s")
    return notes + doubts(prepared)


def _broken_rows(prepared: Prepared, run: Controlled, asked: float | None) -> list[str]:
    """Constraint rows, the redundant ones included, that the run does not keep."""
    m, t = prepared.everything, run.solution.t
    if not m.m:
        return []
    t = t[:: len(t) // 200 + 1]
    off = np.max(np.abs(m.position_residual(t, prepared.states(t, run.solution(t))[0])), axis=0) / max(prepared.length, 1.0)
    off[[row.name in {r.name for r, _ in prepared.rank.doubtful} for row in m.rows]] = 0.0  # told by `doubts`
    worst = int(np.argmax(off))
    if off[worst] <= 10 * (asked if asked is not None else 1e-6):
        return []
    return [f"constraint {m.rows[worst].name} is violated by {off[worst]:.1e}: "
            f"prescribed motions may contradict each other later on"]  # fmt: skip
