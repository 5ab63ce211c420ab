"""Adds plots and animations as methods of `Result`, so that the results package need not import the drawing code.

The drawing code is imported by the first picture, so that a run without pictures does not wait for it.

The Scene as users see it, and `load`. Importing this module gives Result its pictures and files (`mbdae.api`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mbdae.deferred import later
from mbdae.errors import SceneError, naming_arguments, with_text_when_interrupted
from mbdae.formulations import Form, default_form, form_of, system_for
from mbdae.integrators.base import Asked, Solver, end_after, output_times
from mbdae.integrators.named import solver_of
from mbdae.notation import picture, rows, titled
from mbdae.results.accuracy import plausible
from mbdae.results.result import ATTACHED, Result
from mbdae.results.storage import load as load
from mbdae.results.stored_parts import wanted_of
from mbdae.run.checkpoint import give_back, keeper_of, kept, progress_of, statement_of, taken
from mbdae.run.checks import Check, check_scene
from mbdae.run.choice import choose, prepared_from
from mbdae.run.conditions import conditions, ends_of_curves
from mbdae.run.estimate import Controlled
from mbdae.run.events import Watched
from mbdae.run.job import Job
from mbdae.scene.contacts import READERS
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import RELAXED, SceneSystem
from mbdae.system.start import Start
from mbdae.threads import limited, single_threaded
from mbdae.values import flag, number, of_class, option, optional, sequence, shown, text, whole, word

if TYPE_CHECKING:
    from mbdae.analysis import Branch, Equilibrium, Floquet, Linearization, Periodic
    from mbdae.robots.joint_space import Tree
    from mbdae.run.stepper import Stepper
else:
    (Stepper,) = later("mbdae.run.stepper", "Stepper")


def _by(module: str, name: str) -> Callable[..., Any]:
    """A function that imports its module of this package at the first call."""
    return lambda *args, **options: getattr(import_module(f"mbdae.show.{module}"), name)(*args, **options)


def _derivatives(name: str) -> Callable[..., Any]:
    """A function of derivatives, which are imported at the first call."""
    return lambda *args, **options: getattr(import_module("mbdae.derivatives"), name)(*args, **options)


ATTACHED.update(plot=_by("plots", "plot_results"), phase=_by("plots", "plot_phase"), orbit=_by("plots", "plot_orbit"),
                animate=_by("animation", "animate"), gradient=_derivatives("gradient"), sensitivity=_derivatives("sensitivity"))
READERS["color"] = _by("plots", "hexadecimal")


DEFAULT_OUTPUTS = 201
MOST_STATES = 1_000_000  #: largest number of states that a stepper takes together
START = (f"give a Result of this scene (mb.load reads one), an equilibrium, '{RELAXED}' (elastic bodies strained by the loads of "
         "the start), or None for the start of the scene")


def begun_by(start: Any) -> Result | str | None:
    """The option `start` of a run, checked."""
    if isinstance(start, str):
        return option("start", start, word, START, words=(RELAXED,))
    return optional("start", start, of_class, START, base=Result)


@naming_arguments
def read_urdf(path: Any, floating: bool = False, gravity: Sequence[float] = (0, 0, -9.81), packages: Any = None,
              keep_inertias: bool = False, limits: bool = True, stop: Any = None, meshes: bool = True) -> Scene:
    """The robot of a URDF file as a scene, every joint recursive; see docs/robots.md. Needs the extra `robots`.

    floating: True lets the root link float, False holds it on the ground. gravity (3,), m/s^2. packages: folders of packages
    in `package://name/...` are, a list, or a mapping by name; by default the folders above the file. keep_inertias: True keeps
    inertias that no body has. limits: False leaves them out; stop: mb.Stop(stiffness, damping) of all of them. meshes: whether
    they are read, for pictures, as the boxes about them. `scene.told` lists what the scene says otherwise than the file, or not.
    Raises OptionError where the file cannot be read, SceneError with what it cannot mean."""
    from mbdae.robots.urdf import options, read

    field = option("gravity", gravity, sequence, "give three numbers, m/s^2", each=number)
    given = {"floating": floating, "keep_inertias": keep_inertias, "limits": limits, "meshes": meshes}
    floats, keeps, limited_, boxes = (option(name, value, flag, "give True or False") for name, value in given.items())
    return read(Scene, path, floats, field, packages, keeps, limited_, options(stop), boxes)  # type: ignore[no-any-return]


@naming_arguments
def read_mjcf(path: Any, keep_inertias: bool = False, limits: bool = True, stop: Any = None, key: str | None = None) -> Scene:
    """The model of an MJCF file as a scene, every joint recursive, as MuJoCo's compiler resolves it; see docs/robots.md. Needs
    the extra `robots`. key: the key frame that is the start. Other options and errors as of `read_urdf`; gravity is that of the
    file."""
    from mbdae.robots.mjcf import read
    from mbdae.robots.urdf import options

    keeps, limited_ = (option(name, value, flag, "give True or False")
                       for name, value in {"keep_inertias": keep_inertias, "limits": limits}.items())
    return read(Scene, path, keeps, limited_, options(stop), key)  # type: ignore[no-any-return]


class Scene(SceneData):
    """A mechanism: bodies, joints and forces. See `SceneData` for the statements."""

    def check(self, accuracy: float = 1e-6) -> Check:
        """Count degrees of freedom, unknowns and redundant constraints before anything is solved, and name the solver and form
        that `simulate` would choose for this accuracy. Raises SceneError with all problems of the scene at once."""
        return check_scene(self, plausible(accuracy))

    def system(self, form: Form | type[Form] | str | None = None, start: Start | Result | None = None) -> SceneSystem:
        """The equations F(t, y, y') = 0 of the scene, y (n,), in a form (an object, a class or a name such as "ggl"), with a
        consistent start: that of the scene, the end of a Result, or a Start. Raises SceneError and OptionError."""
        chosen = form_of(form) if form is not None else None
        begin = start if start is None or isinstance(start, Start) else option("start", start, of_class, START, base=Result)
        return system_for(prepare(self, begin.state_for(self) if isinstance(begin, Result) else begin), chosen)

    def draw(self, path: Any = None, hide: Sequence[str] = (), ax: Any = None) -> Any:
        """The scene as it starts: bodies, joints, forces, ground and names, in the plane or in space; a matplotlib figure.

        path: .png, .svg or .pdf to write. hide: names of items that are left out, one or a list. ax: axes of matplotlib to draw
        in, with projection="3d" for a scene in space. Raises SceneError with every problem found."""
        from mbdae.show.drawing import draw
        from mbdae.show.plots import checked, given_axes, names_of

        prepared, file = prepare(self), checked(path, what="draw") if path is not None else None
        axes = given_axes(ax, 1, spatial=not prepared.model.planar)[0] if ax is not None else None
        return draw(prepared, file, names_of("hide", hide), axes)

    def __repr__(self) -> str:
        forces = len(self._items) - len(self.bodies) - len(self.joints)
        return f"<Scene '{self.name}': bodies {len(self.bodies)}, joints {len(self.joints)}, forces {forces}>"

    def _repr_html_(self) -> str:
        table = rows([(item.name, getattr(item, "kind", "body")) for item in self._items], ("item", "kind"))
        try:
            return titled(f"scene '{self.name}'", picture(self.draw()._repr_png_()), table)
        except SceneError as error:
            return titled(f"scene '{self.name}'", rows([("problem", text) for text in error.problems]), table)

    def equilibrium(self, frame: Any = None, progress: Callable[[float, int], None] | None = None,
                    out_of_plane: bool = True) -> Equilibrium:
        """A state at rest in a frame: s.ground (default), or a body that turns steadily; see `mbdae.analysis.equilibrium`. Raises
        EquilibriumError where none is found. progress: a function, called as progress(load_factor, iterations)."""
        from mbdae.analysis import equilibrium

        return equilibrium(self, frame, progress, out_of_plane)

    def linearize(self, at: Any = None, frame: Any = None, count: int | None = None,
                  out_of_plane: bool = True) -> Linearization:
        """Modes, frequencies, damping and growth of small departures from a steady motion; see `mbdae.analysis.linearize`."""
        from mbdae.analysis import linearize

        return linearize(self, at, frame, count, out_of_plane)

    def floquet(self, period: float, at: Any = None, count: int | None = None, accuracy: float = 1e-8) -> Floquet:
        """Floquet multipliers, growth and modes of small departures from a periodic motion; see `mbdae.analysis.floquet`."""
        from mbdae.analysis import floquet

        return floquet(self, period, at, count, accuracy)

    def periodic(self, period: Any = None, accuracy: float = 1e-6, start: Any = None, of: Any = None) -> Periodic:
        """A motion that returns to its start after `period` (s), found by shooting, as a Result over one period with its
        `multipliers` and `stable`; period=None: found, for scenes without drives. See `mbdae.analysis.periodic`."""
        from mbdae.analysis import periodic

        return periodic(self, period, accuracy, start, of)

    def continuation(self, name: str, over: Sequence[float], of: Any = None, steps: int = 400) -> Branch:
        """The branch of periodic motions, or states at rest, along a number of the scene, with folds, period doublings and places
        where oscillations begin to grow; see `mbdae.analysis.continuation`."""
        from mbdae.analysis import continuation

        return continuation(self, name, over, of, steps)

    def tree(self) -> Tree:
        """Joint-space dynamics of the scene: mass matrix, bias, gravity, inverse and forward dynamics, Jacobians at given states;
        see `mbdae.robots.joint_space.Tree`. Raises SceneError."""
        from mbdae.robots.joint_space import Tree

        return Tree(self)

    def write_mjcf(self, path: Any) -> tuple[str, ...]:
        """Write the scene as an MJCF file, by MuJoCo (extra `robots`): bodies, hinges, slides, balls, free joints, springs,
        dampers, friction, limits, rotors, loops, couplings, frames as sites. The file is read back, and its mass matrix and bias
        compared with those of the scene. Returns what the file says otherwise. Raises SceneError with the names of all that MJCF
        cannot say, and writes nothing then; OptionError where it cannot be written."""
        from mbdae.robots.writing import write

        return write(self, path, partial(read_mjcf, keep_inertias=True))

    def stepper(self, dt: float, accuracy: float = 1e-6, solver: Solver | type[Solver] | str | None = None,
                form: Form | type[Form] | str | None = None, inputs: Sequence[str] | None = None, reads: Sequence[str] = (),
                batch: int | None = None, start: Result | None = None) -> Stepper:
        """Steps of a loop of one's own: step.set(u=1.0), step.advance(), step["J.angle"], step.state, step.reset(state).

        dt: length of a step, s, over which inputs are held: exactly, as by s.controller(every=dt). inputs: names of the inputs,
        by default every s.signal(name, number); also outputs of a controller, which is then not called, and numbers of items that
        may be driven, such as "J.torque" of s.revolute("J", ..., torque=0.0). reads: names of sensors that the loop reads, as a
        controller names them: whole turns of these angles are counted, in space too. batch: number of states stepped together.
        accuracy, solver, form, start: as in `simulate`; the tolerance is that of its first run, and steps are not repeated:
        `error` of the stepper estimates what came of it. Raises SceneError and OptionError as `simulate` does."""
        accuracy = plausible(accuracy)
        length = option("dt", dt, number, "give the length of a step, a positive number of seconds", above=0)
        method, own = solver_of(solver) if solver is not None else None, form_of(form) if form is not None else None
        optional("start", start, of_class, START, base=Result)
        named = optional("inputs", inputs, sequence, "give a list of names of inputs, such as ['u', 'J.torque']", each=text)
        count = optional("batch", batch, whole, "give a number of states from 1, or None for one", least=1, most=MOST_STATES)
        seen = option("reads", reads, sequence, "give a list of sensors, such as ['J.angle']", each=text)
        return Stepper(self, length, accuracy, method, own, named, seen, count, start)

    @with_text_when_interrupted
    @single_threaded
    def simulate(self, t_end: float, accuracy: float = 1e-6, solver: Solver | type[Solver] | str | None = None,
                 form: Form | type[Form] | str | None = None, outputs: int | Sequence[float] | Array | None = None,
                 start: Result | str | None = None, verify: bool = False, max_wall: float | None = None,
                 progress: Callable[..., None] | bool | None = None, checkpoint: Any = None, every: int | None = None,
                 until: Any = None, record: Any = None, derivatives: bool = False, of: Any = None) -> Result:
        """Integrate the equations of motion to t_end (s), or to the event `until`.

        accuracy: bound asked for the error over the run (positions relative to the scene's length, angles in rad,
        velocities relative to length / characteristic time). With beams only positions and angles count, because their
        velocities contain fast vibrations; likewise while a joint with clearance touches, because a small shift in the time of
        an impact changes velocities a lot. The run estimates its error and is repeated with a tighter tolerance where needed;
        `accuracy.covers` of the result says whether the accuracy also covers reactions and the mesh of beams. A solver with its
        own tolerance or step runs once.
        solver, form: an object, a class or a name, such as mb.RadauIIA(3), mb.IDA, "radau3", "ggl"; by default chosen.
        outputs: a number of equally spaced times, or the times (s). start: a Result to continue, or "relaxed": beams and reduced
        bodies begin strained by the loads of the start as in a steady motion at the driven rates, instead of ringing; prescribed
        motions are kept, and those that are left if elastic bodies were rigid. verify: measure the error by a
        second run with another method at a tenth of the accuracy, and that of the mesh of beams by a finer mesh. max_wall: limit
        of wall-clock time (s), after which WallClockError is raised.
        progress: True shows a bar; a function is called as progress(t, t_end, stats), ten times per second at most.
        checkpoint: a folder in which the call keeps its runs: after it was killed, at whatever time, the same call with the same
        folder goes on and returns the same bits; SIGTERM ends it after the step under way with StoppedError. every: accepted
        steps between two checkpoints (default 1000). IDA and CVODE begin anew at each. Sampled controllers are refused.
        until: a condition on sensors that ends the run where it begins to hold, "J.angle > 1.0"; record: conditions whose
        instants are kept, "J.angle == 0" or a list; both as text or symbols (`sensor`), results in `events`.
        derivatives: refuse a run that has none at once, with the reason (DerivativeError), for `r.gradient` and `r.sensitivity`.
        of: quantities that have to be as accurate as asked too, each over its largest value in the run (at least 1e-6 of the
        scene's largest force or torque): a list of sensors, components and expressions, ["A.drive", "B.force[1]"], or a mapping
        of names to them; the tolerance is chosen for them, `accuracy.of` of the result has their errors.
        An option that cannot be used raises OptionError before anything is solved, a mistake in the scene SceneError, a start
        that does not satisfy the joints StartError, a solver that cannot go on SolverError.

        Ctrl-C raises KeyboardInterrupt; its attribute `solution`, like that of a SolverError, is the Result until then.
        """
        accuracy = plausible(accuracy)
        method, own = solver_of(solver) if solver is not None else None, form_of(form) if form is not None else None
        begin = float(start.solution.t[-1]) if isinstance(start := begun_by(start), Result) else 0.0
        end = end_after(begin, t_end)
        times = output_times(begin, end, outputs if outputs is not None else DEFAULT_OUTPUTS)
        verify = option("verify", verify, flag, "give True to have the error measured by a second method, or False")
        wall = optional("max_wall", max_wall, number, "give a positive number of seconds, or None", above=0)
        asked = Asked(end, max_wall=wall, progress=progress_of(progress))
        watched = Watched(conditions(self, "until", until), conditions(self, "record", record), ends_of_curves(self))
        keeper = keeper_of(checkpoint, every)
        said = partial(statement_of, self, keeper.every if keeper else 0, method, own, start, t_end=end, accuracy=accuracy,
                       outputs=times, verify=verify, until=[c.name for c in watched.until],
                       record=[c.name for c in watched.record], of=shown(of))
        wanted = option("derivatives", derivatives, flag, "give True for a run whose derivatives are wanted, or False")
        with limited(wall), kept(keeper, said):
            return self._simulated(end, accuracy, method, own, times, start, verify, asked, watched,
                                   DEFAULT_OUTPUTS if outputs is None else outputs, wanted, of)

    def _simulated(self, end: float, accuracy: float, method: Solver | None, own: Form | None, times: Array,
                   start: Result | str | None, verify: bool, asked: Asked, watched: Watched, outputs: Any,
                   derivatives: bool, of: Any) -> Result:
        """`simulate` after its options have been checked."""
        default = method is None and own is None
        taken_, key = taken(self, (end, default, start) if not isinstance(start, Result) and asked.progress is None else None,
                            partial(prepared_from, start=start, t_end=end, default=default))
        prepared = watched.with_turns(taken_, lambda scene: prepared_from(scene, start, end))
        if derivatives:
            _derivatives("refuse_scene")(prepared, start, bool(watched.until))
        asked = replace(asked, wanted=wanted_of(of, prepared))
        found = self._solved(prepared, end, accuracy, method, own, times, isinstance(start, Result), verify, asked, watched,
                             outputs)
        give_back(taken_, key)
        return found

    def _continued(self, prepared: Prepared, end: float, accuracy: float, wanted: Any) -> Result:
        """A default run to `end` (s) of the scene as it was prepared at a state that another run came to; wanted: as of `of`."""
        times, watched = output_times(prepared.start.t, end, DEFAULT_OUTPUTS), Watched([], [], ends_of_curves(self))
        prepared.model.conditions.end = end
        return self._solved(prepared, end, accuracy, None, None, times, True, False, Asked(end, wanted=wanted), watched,
                            DEFAULT_OUTPUTS)

    def _solved(self, prepared: Prepared, end: float, accuracy: float, method: Solver | None, own: Form | None, times: Array,
                continued: bool, verify: bool, asked: Asked, watched: Watched, outputs: Any) -> Result:
        """`simulate` after the scene has been prepared."""
        if method is not None:
            own = own if own is not None else default_form(prepared, method.highest_index)
            job, taken = Job(prepared, own, accuracy, asked, times, continued), method

            def made(job: Job) -> tuple[Controlled, Job]:
                return job.run(method), job
        else:
            choice = choose(prepared, self, accuracy, own)
            job, taken = Job(prepared, choice.form, accuracy, asked, times, continued), choice.solver

            def made(job: Job) -> tuple[Controlled, Job]:
                return job.run_default(choice, own)

        with job.attaching(taken):
            if not watched:
                run, job = made(job)
                return job.result(run, verify)
            return watched.result(job, taken, made, outputs, verify)
