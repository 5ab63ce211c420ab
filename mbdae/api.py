"""The Scene as users see it: its data, and check, simulate, system on top of it."""

from __future__ import annotations

import math
import warnings as python_warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.formulations import GGL, ODE, Form
from mbdae.integrators.base import Solver, output_times
from mbdae.results.checks import Check, check_scene
from mbdae.results.control import Controlled, measure_of, plausible, run_controlled
from mbdae.results.result import Accuracy, Result, RunInfo
from mbdae.scene.scene import SceneData
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, make_system, prepare
from mbdae.system.start import Start

DEFAULT_OUTPUTS = 201


class Scene(SceneData):
    """A mechanism: bodies, joints and forces. See `SceneData` for the statements."""

    def check(self) -> Check:
        """Everything that can be said before solving; raises SceneError with all problems at once."""
        return check_scene(self)

    def system(self, form: Form | None = None, start: Start | None = None) -> SceneSystem:
        """The equations F(t, y, y') = 0 of the scene in a form, with a consistent start."""
        prepared = prepare(self, start)
        return _system(prepared, form if form is not None else default_form(prepared))

    def simulate(self, t_end: float, accuracy: float = 1e-6, solver: Solver | None = None, form: Form | None = None,
                 outputs: int | Sequence[float] | Array | None = None, start: Result | None = None, verify: bool = False,
                 max_wall: float | None = None, progress: Callable[..., None] | bool | None = None) -> Result:  # fmt: skip
        """Run to t_end (s).

        accuracy: bound asked for the error over the run (positions relative to the scene's length, angles in rad,
        velocities relative to length / characteristic time); the run estimates its error and repeats itself tighter
        where needed. A solver with a tolerance or step of its own is run once, as it is.
        outputs: a number of equally spaced times, or the times. start: a Result to continue. verify: measure the
        error by a repeat at a tenth with another method. max_wall: s of wall time. progress: True shows a bar.
        """
        plausible(accuracy)
        begin = _last_state(start) if start is not None else None
        prepared = prepare(self, begin, t_end=float(t_end) if isinstance(t_end, int | float) and math.isfinite(t_end) else None)
        if not (isinstance(t_end, int | float) and math.isfinite(t_end) and t_end > prepared.start.t):
            raise OptionError(f"t_end = {t_end}: give a time after the start t = {prepared.start.t:g} s")
        form = form if form is not None else default_form(prepared)
        solver = solver if solver is not None else default_solver()
        system = _system(prepared, form)
        times = output_times(system.t0, float(t_end), outputs if outputs is not None else DEFAULT_OUTPUTS)
        assert times is not None
        options: dict[str, Any] = {"max_wall": max_wall, "progress": progress_of(progress)}
        try:
            run = _run(system, prepared, solver, accuracy, float(t_end), times, options)
        except SolverError as error:
            _attach(error, prepared, solver, form, times)
            raise
        verified = _verify(prepared, run, form, accuracy, float(t_end), options) if verify else None
        return _result(prepared, run, form, accuracy, verified, times)


def default_form(prepared: Prepared) -> Form:
    """Stabilised index 2; the plain ODE where nothing is constrained."""
    return GGL() if prepared.mechanics.m else ODE()


def default_solver() -> Solver:
    """IDA for rigid scenes."""
    from mbdae.integrators.ida import IDA

    return IDA()


def progress_of(progress: Any) -> Any:
    """The callback of a progress option: a bar for True."""
    if progress is True:
        from mbdae.results.progress import bar

        return bar()
    return progress or None


def _system(prepared: Prepared, form: Form) -> SceneSystem:
    refusal = form.refusal(prepared.model, prepared.mechanics.rows)
    if refusal:
        raise OptionError(f"scene '{prepared.model.scene.name}': {refusal}")
    return make_system(prepared, form.spec())


def _run(system: SceneSystem, prepared: Prepared, solver: Solver, accuracy: float, t_end: float, times: Array,
         options: dict[str, Any]) -> Controlled:  # fmt: skip
    if solver.fixed or solver.rtol is not None:
        solution = solver.solve(system, t_end, **options)
        return Controlled(solution, solver, float("nan"), 1, solution.stats.cpu_s)
    return run_controlled(system, prepared, solver, accuracy, t_end, times, **options)


def _verify(prepared: Prepared, run: Controlled, form: Form, accuracy: float, t_end: float, options: dict[str, Any]) -> float | None:
    """Largest difference to a run of another method at a tenth of the accuracy."""
    from mbdae.integrators.ida import IDA
    from mbdae.integrators.radau import RadauIIA

    other: Solver = IDA() if isinstance(run.solver, RadauIIA) else RadauIIA(3)
    system = _system(prepared, GGL() if prepared.mechanics.m else ODE())
    again = run_controlled(system, prepared, other, max(accuracy / 10, 1e-11), t_end, np.array([t_end]), **options).solution
    if not (again.complete and run.solution.complete):
        return None
    times = np.linspace(again.t[0], again.t[-1], 2001)
    n = prepared.mechanics.nq + prepared.mechanics.nu
    return float(np.max(measure_of(system, prepared)(run.solution(times)[:, :n], again(times)[:, :n])))


def _result(prepared: Prepared, run: Controlled, form: Form, accuracy: float, verified: float | None, times: Array) -> Result:
    controlled = math.isfinite(run.estimate)
    known = Accuracy(accuracy if controlled or verified is not None else None, run.estimate if controlled else None, verified)
    notes = _warnings(prepared, run, known)
    info = RunInfo(run.solver, form.label, known, run.solution.stats, run.runs, run.cpu_s, tuple(notes))
    for note in notes:
        python_warnings.warn(f"scene '{prepared.model.scene.name}': {note}", AccuracyWarning, stacklevel=3)
    return Result(prepared, run.solution, info, times[times <= run.solution.t[-1]])


def _warnings(prepared: Prepared, run: Controlled, known: Accuracy) -> list[str]:
    notes = []
    if known.met is False:
        worst = known.verified if known.verified is not None else known.estimated
        notes.append(f"accuracy {known.asked:g} was asked, the error is about {worst:.1e}: allow a smaller accuracy with RadauIIA(3), "
                     f"or a shorter run if the motion is chaotic")  # fmt: skip
    if not run.solution.complete:
        notes.append(f"the run was stopped at t = {run.solution.t[-1]:.6g} s")
    for row, novelty in prepared.rank.doubtful:
        notes.append(f"constraint row {row.name} is nearly redundant at the start ({novelty:.1e}); its reaction is uncertain")
    return notes


def _attach(error: SolverError, prepared: Prepared, solver: Solver, form: Form, times: Array) -> None:
    """Give a failed run's solution the shape of a Result: nothing computed is lost."""
    solution = error.solution
    if solution is not None and len(solution.t):
        info = RunInfo(solver, form.label, Accuracy(None, None), solution.stats, 1, solution.stats.cpu_s, (str(error),))
        error.solution = Result(prepared, solution, info, times[times <= solution.t[-1]])


def _last_state(result: Result) -> Start:
    """The end of a result as the start of the next."""
    t = result.solution.t[-1:]
    q, u, s = result.states(t)
    return Start(float(t[0]), q[0], u[0], s[0], np.zeros_like(u[0]), np.zeros(0))
