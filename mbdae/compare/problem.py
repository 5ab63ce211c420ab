"""Data common to all runs of a comparison: equations by joint model, time grid, measure, CPU time spent, and the reference."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.compare.measures import (
    AskedFor,
    BodiesMotion,
    Energies,
    JointForces,
    Measure,
    Reference,
    Sensor,
    Unknown,
    named_measures,
    unknowns_of,
)
from mbdae.compare.run import Equations, Run, Timed, peak_bytes, reset_peak, resolution, timed
from mbdae.engines import INTERVALS
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SceneError
from mbdae.formulations import Form, default_form
from mbdae.integrators.base import Solver, end_after
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.quantities import named as name_of
from mbdae.results.result import Result
from mbdae.results.stored_parts import Wanted, started, wanted_of
from mbdae.run.choice import prepared_from
from mbdae.scene.components import Classical, JointModel, Kinematic, Recursive
from mbdae.scene.scene import SceneData
from mbdae.show.plots import numbers
from mbdae.system.base import Array, System
from mbdae.system.scene_system import begun
from mbdae.values import array, number, option, optional, shown

FEW = 10  #: largest number of joints for which the classical model is among the default runs
MANY = 100  #: largest number of joints whose forces are compared where no measure is named


@dataclass
class Problem:
    """A scene (or a System) that many solvers run to t_end (s). stated: its equations with the joint models that the scene
    states."""

    scene: SceneData | None
    stated: Equations
    t_end: float
    measures: tuple[Measure, ...]  #: the first is that by which runs are ranked
    max_wall: float | None
    variants: dict[str, Equations | MbdaeError] = field(default_factory=dict)
    spent: float = 0.0  #: CPU time in solver calls, s, repeats included
    elsewhere: float = 0.0  #: of it, in processes of other programs, s
    wanted: Wanted = field(default_factory=dict)  #: quantities that runs are asked for
    start: str | None = None  #: RELAXED, or None: runs begin at the start of the scene

    @property
    def name(self) -> str:
        """Name of the scene, or of the system's form."""
        return self.scene.name if self.scene is not None else f"system ({self.system(None).label})"

    @property
    def what(self) -> str:
        """Definition of the error in words, with its unit."""
        return self.measures[0].what

    @property
    def measure(self) -> str | None:
        """Name of the sensor or unknown by which runs are ranked; None for the whole motion."""
        first = self.measures[0]
        return first.name if isinstance(first, Sensor | Unknown | AskedFor) else None

    @property
    def times(self) -> Array:
        """Times (nt,), s, at which trajectories are compared."""
        return np.linspace(self.system(None).t0, self.t_end, INTERVALS + 1)

    @property
    def constrained(self) -> bool:
        """Whether a scene has constraint rows, so that there is an index-3 form."""
        return self.stated.prepared is not None and bool(self.stated.prepared.rows)

    @property
    def resolving(self) -> Form | None:
        """For a scene with beams the form that resolves their vibrations, used for the reference; else None."""
        prepared = self.stated.prepared
        if prepared is None or not prepared.model.lines:
            return None
        return replace(default_form(prepared), waves=True)  # type: ignore[type-var]

    @property
    def other_models(self) -> dict[JointModel, bool]:
        """Further joint models to compare, each with whether its equations are an ODE. The classical model only for few joints,
        where it is cheap."""
        joints = [c for c in self.scene.joints if c.has_models] if self.scene is not None else []
        stated = {c.model for c in joints}
        found: dict[JointModel, bool] = {}
        for model in (Kinematic(), Classical(), Recursive()) if joints else ():
            if {model} != stated and not (isinstance(model, Classical) and len(joints) > FEW):
                try:
                    variant = self.equations(Run(RadauIIA(3), model=model))
                except MbdaeError:
                    continue
                if not isinstance(model, Recursive) or variant.recursive[0]:
                    found[model] = variant.prepared is not None and not variant.prepared.rows
        return found

    def system(self, form: Form | None) -> System:
        """The equations with the joint models of the scene, in a form."""
        return self.stated.system(form)

    def equations(self, run: Run) -> Equations:
        """The equations with the joint models of a run, prepared once. Where the preparation failed, its error is raised at every
        call, so that each run with these models gets it."""
        if not run.models and run.scene is None:
            return self.stated
        key = repr(sorted(run.models.items(), key=lambda item: item[0])) if run.scene is None else f"scene {id(run.scene)}"
        if key not in self.variants:
            try:
                self.variants[key] = self._with_models(run)
            except MbdaeError as error:
                self.variants[key] = error
        found = self.variants[key]
        if isinstance(found, MbdaeError):
            raise found
        return found

    def _with_models(self, run: Run) -> Equations:
        if run.scene is not None and self.scene is not None:
            return Equations(prepared_from(run.scene, self.start, self.t_end))
        if self.scene is None:
            raise OptionError(f"model {run.model_label}: a System has no joints; compare it by runs without a model, such as "
                              f"mb.Run(mb.IDA())")
        if not any(c.has_models for c in self.scene.joints):
            raise OptionError(f"model {run.model_label}: scene '{self.name}' has no joint with coordinates, which alone have "
                              f"joint models: give runs without a model, such as mb.Run(mb.IDA())")
        return Equations(prepared_from(with_models(self.scene, run), self.start, self.t_end))

    @cached_property
    def yardstick(self) -> Equations:
        """The equations in whose unknowns all runs are compared: positions and velocities of the bodies, which follow from the
        unknowns of every joint model."""
        joints = self.scene.joints if self.scene is not None else []
        own = [c.name for c in joints if c.kept and not isinstance(c.model, Kinematic)]
        if self.scene is None or not own:
            return self.stated
        return Equations(prepared_from(self.scene.replace(*own, model=Kinematic()), self.start, self.t_end))

    def solve(self, solver: Solver, form: Form | None, equations: Equations | None = None, repeat: bool = True) -> Timed:
        """Execute a run; a short one until its CPU time and the spread of that are known."""
        system, told = (equations or self.stated).for_solver(form, solver), reset_peak()

        def solve() -> Solution:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)  # the error is measured against the reference instead
                return solver.solve(system, self.t_end, max_wall=self.max_wall)

        made = timed(solve, self.tick if repeat else None, self.spend)
        return replace(made, peak_bytes=peak_bytes() if told else None)

    def spend(self, seconds: float) -> None:
        """Count CPU time in solver calls, s."""
        self.spent += seconds

    def loose(self, run: Run | None) -> str:
        """The joint models of a run in words where, unlike those of the scene as stated, some are not ideal or all are: what it
        models is then something else. Else ""."""
        if run is None or self.scene is None or not (run.models or run.scene):
            return ""
        if run.scene is not None:
            return str(run.label)
        try:
            changed = with_models(self.scene, run)
        except MbdaeError:  # said where its equations are made
            return ""
        stated, own = ({c.name: repr(c.model) for c in s.joints if not getattr(c.model, "ideal", True)}
                       for s in (self.scene, changed))
        return "" if own == stated else run.model_label or ""

    @cached_property
    def tick(self) -> float:
        """Resolution of the clock of CPU time in this process, s."""
        return resolution()

    def values(self, solution: Solution, equations: Equations | None = None, times: Array | None = None) -> Array:
        """Values (nt, ...) of the first measure of a run at times (nt,), by default `self.times`."""
        t = self.times if times is None else times
        return self.measures[0].read(self, equations or self.stated, solution, t)

    def all_values(self, solution: Solution, equations: Equations | None = None) -> list[Array | None]:
        """Values of every measure of a run; None where one of those behind the first cannot be read."""
        found: list[Array | None] = [self.values(solution, equations)]
        for measure in self.measures[1:]:
            try:
                found.append(measure.read(self, equations or self.stated, solution, self.times[:: measure.every]))
            except MbdaeError:
                found.append(None)
        return found

    def error(self, values: Any, reference: Any) -> float:
        """Largest difference over time of the first measure between `values` and `reference` (nt, ...), in the unit of `what`."""
        return self.measures[0].apart(self, values, reference)

    def errors(self, values: Sequence[Any], reference: Sequence[Any]) -> dict[str, float]:
        """Largest differences over time by the names of measures; without those that are not known of both."""
        return {m.name: m.apart(self, a, b) for m, a, b in zip(self.measures, values, reference, strict=True)
                if a is not None and b is not None}


def with_models(scene: Any, run: Run) -> Any:
    """The scene with the joint models that a run names."""
    for name, model in run.models.items():
        spanning = not name and isinstance(model, Recursive)
        scene = scene.recursive() if spanning else scene.replace(*([name] if name else []), model=model)
    return scene


SECONDS = "give a positive number of seconds of wall time, or None"


def new_problem(scene: Any, t_end: Any, measure: Any, max_wall: Any, alone: bool = True, of: Any = None,
                start: Any = None) -> Problem:
    """The problem of a scene or a System, with its options checked; OptionError for wrong ones. measure: a name, or several;
    alone: whether without a name nothing but the motion is compared; of: quantities that runs are asked for; start: RELAXED."""
    given = scene if isinstance(scene, System) else None
    if given is None and not isinstance(scene, SceneData):
        raise OptionError(f"scene = {shown(scene)}: give a mb.Scene or a System such as mb.DAE")
    named = named_measures(measure)
    end = end_after(given.t0 if given is not None else 0.0, t_end)
    wall = optional("max_wall", max_wall, number, SECONDS, above=0)
    if given is not None and of is not None:
        raise OptionError(f"of = {shown(of)}: a System has no sensors; name unknowns as measure=, and leave of out")
    if given is not None:
        return Problem(None, Equations(None, given), end, unknowns_of(given, named), wall)
    stated = Equations(prepared_from(scene, begun(start), end))
    assert stated.prepared is not None
    for sensor in named:
        try:
            numbers(started(stated.prepared), sensor)  # before anything is solved: is it a sensor with numeric values?
        except (SceneError, OptionError) as error:
            sensor_problem = "; ".join(error.problems) if isinstance(error, SceneError) else str(error)
            raise OptionError(f"measure = {shown(measure)}: {sensor_problem}") from error
    wanted = wanted_of(of, stated.prepared)
    asked = [AskedFor(name_of(key), quantity) for key, quantity in wanted.items()]
    if named or asked:
        found = [*(Sensor.of(scene, name) for name in named), *asked, *(() if named else (BodiesMotion(),))]
        return Problem(scene, stated, end, tuple(found), wall, wanted=wanted, start=start)
    forces = () if alone or not 0 < len(scene.joints) <= MANY else (JointForces(),)
    return Problem(scene, stated, end, (BodiesMotion(), *forces, *(() if alone else (Energies(),))), wall, start=start)


TIGHTER = 100.0  #: ratio of the smallest accuracy asked of the runs to that asked of the reference, which is FLOOR at least
#: ratio of the smallest accuracy asked of the runs to that asked of the second method (FLOOR at least); IDA, where it does not
#: confirm the reference, is run again with an accuracy 30 times smaller
CONFIRM = 10.0
FLOOR = 1e-11


def given_reference(problem: Problem, given: Any) -> tuple[Reference, list[Any]]:
    """A reference given by the user: a Result of the same scene, or values of the measure as a function of time; and the values
    of every measure, None where they are not known."""
    if isinstance(given, Result):
        if problem.scene is None:
            raise OptionError("reference is the Result of a scene, but what is compared is a System, not a scene; leave "
                              "reference out")
        if [b.name for b in given.prepared.model.scene.bodies] != [b.name for b in problem.scene.bodies]:
            raise OptionError(f"reference is a Result of a scene with other bodies; give one of this scene to t = "
                              f"{problem.t_end:g} s")
        if (end := given.solution.t[-1]) < problem.t_end:
            raise OptionError(f"reference is a Result that ends at t = {end:g} s; give one to t = {problem.t_end:g} s")
        label = f"given result, {given.solution.solver.label} {given.info.form}"
        return Reference(label, given.accuracy.asked, None, None), problem.all_values(given.solution, Equations(given.prepared))
    if problem.scene is None:
        raise OptionError("reference is a function, which returns values of a sensor, and a System has none; leave reference out")
    if problem.measure is None:
        raise OptionError("reference is a function: name the sensor whose values it returns, such as measure='C.angle'")
    values: Array = option("reference(times)", given(problem.times), array, f"return {problem.measure} at the times given")
    solver = as_tight(RadauIIA(3), 1e-3, problem.system(None).label)
    shape = problem.values(problem.solve(solver, None, repeat=False).solution).shape
    if values.shape != shape:
        raise OptionError(f"reference returns an array of shape {values.shape}; return {problem.measure} at the times given, "
                          f"with shape {shape}")
    return Reference("given function", None, None, None), [values, *(None for _ in problem.measures[1:])]


def computed_reference(problem: Problem, smallest: float, equations: Equations | None = None) -> tuple[Reference, list[Any]]:
    """The tightest Radau run and its values of every measure; its difference from a second method is its uncertainty. equations:
    by default those of the scene as stated."""
    system = problem.system(None)
    solver = as_tight(RadauIIA(3), max(smallest / TIGHTER, FLOOR), system.label)
    run = problem.solve(solver, problem.resolving, equations, repeat=False)
    values = problem.all_values(run.solution, equations)
    label = f"{solver.label} {system.label}, rtol {solver.tolerance:.1e}{', vibrations resolved' if problem.resolving else ''}"
    found = Reference(label, max(smallest / TIGHTER, FLOOR), None, None, run.solution.stats.steps, run.cpu_s)
    reasons: list[str] = []
    made = [(f"{solver.label} {system.label}, rtol {solver.tolerance:.1e}", found.steps, run.cpu_s, values)]
    for second in _seconds(problem, smallest):
        try:
            other = problem.solve(second, problem.resolving, equations, repeat=False)
        except MbdaeError as error:
            reasons.append(str(error))
            continue
        name = f"{second.label} {system.label}, rtol {second.tolerance:.1e}"
        made.append((name, other.solution.stats.steps, other.cpu_s, problem.all_values(other.solution, equations)))
        gaps = problem.errors(made[-1][-1], values)
        gap = gaps[problem.measures[0].name]
        if gap <= smallest / 3:
            return replace(found, confirmed_by=name, difference=gap, differences=gaps), values
    if len(made) == 1:
        return replace(found, note="not confirmed by a second method: " + "; ".join(reasons)), values
    return _of_the_nearest(problem, found, made)


def _of_the_nearest(problem: Problem, first: Reference, made: Sequence[tuple[str, int | None, float | None, Any]]
                    ) -> tuple[Reference, list[Any]]:
    """The reference where no second run confirms the first: of the two runs with the smallest difference the one that was made
    earlier, with that difference as its uncertainty. made: (name, number of steps, CPU time in s, values) of every run."""
    pairs = [(problem.error(made[j][-1][0], made[i][-1][0]), i, j) for j in range(len(made)) for i in range(j)]
    gap, i, j = min(pairs)
    name, steps, cpu, values = made[i]
    own = first if i == 0 else Reference(name, None, None, None, steps, cpu)
    note, gaps = f"errors below {gap:.0e} are not known", problem.errors(made[j][-1], values)
    return replace(own, confirmed_by=made[j][0], difference=gap, note=note, differences=gaps), values


def _seconds(problem: Problem, smallest: float) -> list[Solver]:
    """Second methods in the order in which they are tried. IDA is tried again with a smaller tolerance, because the difference
    from the reference may be its own error."""
    from mbdae.integrators.sundials import IDA

    label = problem.system(None).label
    tries: list[tuple[Solver, float]] = [(IDA(), CONFIRM), (IDA(), 30 * CONFIRM), (RadauIIA(2), CONFIRM)]
    if np.max(problem.system(None).index) > 1 or problem.resolving is not None:
        tries = tries[2:]
    return [as_tight(method, max(smallest / factor, FLOOR), label) for method, factor in tries]


def as_tight(solver: Solver, accuracy: float, form_label: str) -> Solver:
    """The solver with the tolerance for an accuracy, or with its smallest tolerance where round-off does not allow that
    accuracy."""
    try:
        return solver.at_accuracy(accuracy, form_label)
    except OptionError:
        return replace(solver, rtol=solver.tightest.get(form_label, solver.tightest[""]))  # type: ignore[type-var]
