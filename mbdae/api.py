"""The Scene as users see it: its data, and check, simulate, system on top of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from mbdae.errors import OptionError, told_when_interrupted
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Solver, output_times
from mbdae.results.result import Result
from mbdae.run.checks import Check, check_scene
from mbdae.run.choice import choose, prepared_by_default
from mbdae.run.control import plausible
from mbdae.run.job import Job
from mbdae.run.progress import progress_of
from mbdae.scene.scene import SceneData
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start import Start

if TYPE_CHECKING:
    from mbdae.analysis import Equilibrium, Floquet, Linearization

DEFAULT_OUTPUTS = 201


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

    @told_when_interrupted
    def simulate(self, t_end: float, accuracy: float = 1e-6, solver: Solver | None = None, form: Form | None = None,
                 outputs: int | Sequence[float] | Array | None = None, start: Result | None = None, verify: bool = False,
                 max_wall: float | None = None, progress: Callable[..., None] | bool | None = None) -> Result:  # fmt: skip
        """Run to t_end (s).

        accuracy: bound asked for the error over the run (positions relative to the scene's length, angles in rad,
        velocities relative to length / characteristic time; with beams positions and angles alone, because their
        velocities ring, and the same while a joint with clearance touches, because an impact a moment later is no error);
        the run estimates its error and repeats itself tighter where needed; `accuracy.covers` of the result says whether that
        holds of reactions and of the mesh of beams too. A solver with a tolerance or step of its own is run once, as it is.
        outputs: a number of equally spaced times, or the times. start: a Result to continue. verify: measure the
        error by a repeat at a tenth with another method, and that of the mesh of beams by a finer mesh. max_wall: s of wall
        time. progress: True shows a bar.

        Ctrl-C comes out as KeyboardInterrupt; its attribute `solution` is the Result until then, as that of a SolverError is.
        """
        plausible(accuracy)
        end = float(t_end) if isinstance(t_end, int | float) and math.isfinite(t_end) else None

        def prepared_as(scene: SceneData) -> Prepared:
            begin = start.state_for(scene) if start is not None else None
            return prepare(scene, begin, t_end=end)

        chosen = solver is None and form is None
        prepared = prepared_by_default(self, prepared_as) if chosen else prepared_as(self)
        if not (isinstance(t_end, int | float) and math.isfinite(t_end) and t_end > prepared.start.t):
            raise OptionError(f"t_end = {t_end}: give a time after the start t = {prepared.start.t:g} s")
        times = output_times(prepared.start.t, float(t_end), outputs if outputs is not None else DEFAULT_OUTPUTS)
        options = {"max_wall": max_wall, "progress": progress_of(progress)}
        if solver is not None:
            form = form if form is not None else default_form(prepared, solver.highest_index)
            job = Job(prepared, form, accuracy, float(t_end), times, options, continued=start is not None)
            run = job.run(solver)
        else:
            choice = choose(prepared, self, accuracy, form)
            job = Job(prepared, choice.form, accuracy, float(t_end), times, options, continued=start is not None)
            run = job.run_default(choice, form)
        return job.result(run, verify)
