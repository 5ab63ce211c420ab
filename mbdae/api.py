"""The Scene as users see it: its data, and check, simulate, system on top of it."""

from __future__ import annotations

import math
import time
import warnings as python_warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError, SolverError, WallClockError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver, output_times
from mbdae.integrators.solution import Solution
from mbdae.results.balance import drift_of_energy
from mbdae.results.checks import Check, check_scene, doubts
from mbdae.results.choice import chosen_solver
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
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start import Start

if TYPE_CHECKING:
    from mbdae.analysis import Equilibrium, Linearization

DEFAULT_OUTPUTS = 201
UNRESOLVED = ("of it, part are elastic vibrations that the steps leave out; form=mb.GGL(waves=True) with solver=mb.RadauIIA(3) "
              "follows them")  # fmt: skip
JUDGED = 1000  #: outputs at which a run with contact is judged


class Scene(SceneData):
    """A mechanism: bodies, joints and forces. See `SceneData` for the statements."""

    def check(self) -> Check:
        """Everything that can be said before solving; raises SceneError with all problems at once."""
        return check_scene(self)

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
        begin = _last_state(start) if start is not None else None
        prepared = prepare(self, begin, t_end=float(t_end) if isinstance(t_end, int | float) and math.isfinite(t_end) else None)
        if not (isinstance(t_end, int | float) and math.isfinite(t_end) and t_end > prepared.start.t):
            raise OptionError(f"t_end = {t_end}: give a time after the start t = {prepared.start.t:g} s")
        form = form if form is not None else default_form(prepared, solver.highest_index if solver is not None else 1)
        times = output_times(prepared.start.t, float(t_end), outputs if outputs is not None else DEFAULT_OUTPUTS)
        job = _Job(prepared, form, accuracy, float(t_end), times, {"max_wall": max_wall, "progress": progress_of(progress)})
        run = job.run(solver) if solver is not None else job.run_default()
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

    def run(self, solver: Solver) -> Controlled:
        """One solver: to the accuracy, or as its own tolerance or step says."""
        refuse_unresolved(self.prepared, solver)
        system = system_for(self.prepared, self.form, solver.highest_index)
        try:
            if solver.fixed or solver.rtol is not None:
                with python_warnings.catch_warnings(record=True) as caught:
                    python_warnings.simplefilter("always", AccuracyWarning)
                    solution = solver.solve(system, self.t_end, **self.options)
                notes = tuple(dict.fromkeys(str(w.message) for w in caught))
                return Controlled(solution, solver, math.nan, 1, solution.stats.cpu_s, notes)
            run = self._controlled(system, solver)
            return self._with_waves(run, solver) if system.numbering.stresses and not self.form.waves else run
        except SolverError as error:
            self._attach(error, solver)
            raise

    def _controlled(self, system: SceneSystem, solver: Solver) -> Controlled:
        asked = self.accuracy, self.t_end, self.times
        return run_controlled(system, self.prepared, solver, *asked, begin=self.begin, **self.options)

    def _with_waves(self, run: Controlled, solver: Solver) -> Controlled:
        """The run if the elastic vibrations it steps over are small enough, else one that resolves them."""
        if not run.solution.complete:
            return run
        resolving = system_for(self.prepared, replace(self.form, waves=True), solver.highest_index)  # type: ignore[type-var]
        run = with_amplitude(run, lost_amplitude(self.prepared, resolving, run))
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

    def run_default(self) -> Controlled:
        """The solver that suits the equations; Radau IIA where it cannot reach the accuracy or stops."""
        from mbdae.integrators.radau import RadauIIA

        run = None
        if self.form.label == "Index3":
            why = "only Radau takes index 3"
        else:
            solver, self.choice = chosen_solver(system_for(self.prepared, self.form), self.prepared)
            try:
                run = self.run(solver)
                if isinstance(solver, RadauIIA):
                    return run
                if run.estimate <= self.accuracy or not run.solution.complete:
                    return run
                why = f"{solver.label} came to {run.estimate:.1e}"
            except WallClockError:
                raise
            except (SolverError, OptionError) as error:
                why = str(error)
        again = self.run(RadauIIA(3))
        if run is not None and run.estimate <= again.estimate:
            return run
        self.choice = f"RadauIIA(3): {why}"
        return again

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


def _last_state(result: Result) -> Start:
    """The end of a result as the start of the next."""
    t = result.solution.t[-1:]
    q, u, s = result.states(t)
    return Start(float(t[0]), q[0], u[0], s[0], np.zeros_like(u[0]), np.zeros(0))
