"""Data common to all runs of a comparison: equations by joint model, time grid, measure, and CPU time spent."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.compare.equations import Equations
from mbdae.compare.memory import peak_bytes, reset_peak
from mbdae.compare.run import Run
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SceneError
from mbdae.formulations import Form, default_form
from mbdae.integrators.base import Solver, end_after
from mbdae.integrators.distance import scaled_distance
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.started import started
from mbdae.scene.components import Classical, JointModel, Kinematic, Recursive
from mbdae.scene.scene import SceneData
from mbdae.scene.sensor_names import measured
from mbdae.show.plots import numbers
from mbdae.system.base import Array, System
from mbdae.system.distance import motion_distance
from mbdae.system.prepare import Prepared, prepare
from mbdae.values import number, optional, shown, text

GRID = 1001  #: number of times at which trajectories are compared
#: a compared run is timed a second time where the first took less CPU time (s) than this; runs for a reference are made once
SHORT = 0.5
FEW = 10  #: largest number of joints for which the classical model is among the default runs
WHOLE_SCENE = "motion of the bodies: positions over the scene's length, angles in rad, velocities over the largest typical speed"
WHOLE_SYSTEM = "every unknown but multipliers, over its scale"


@dataclass(frozen=True)
class Timed:
    """A finished run: the least CPU time of its repeats (s), largest minus least CPU time (s), and peak memory of the process
    (bytes)."""

    solution: Solution
    cpu_s: float
    spread_s: float | None
    peak_bytes: int | None


@dataclass
class Problem:
    """A scene (or a System) that many solvers run to t_end (s). stated: its equations with the joint models that the scene
    states."""

    scene: SceneData | None
    stated: Equations
    t_end: float
    measure: str | None
    max_wall: float | None
    variants: dict[str, Equations | MbdaeError] = field(default_factory=dict)
    spent: float = 0.0  #: CPU time in solver calls, s, repeats included

    @property
    def name(self) -> str:
        """Name of the scene, or of the system's form."""
        return self.scene.name if self.scene is not None else f"system ({self.system(None).label})"

    @property
    def what(self) -> str:
        """Definition of the error in words, with its unit."""
        if self.measure is None:
            return WHOLE_SCENE if self.scene is not None else WHOLE_SYSTEM
        unit = measured(self.scene, self.measure)[1]
        return f"largest difference of {self.measure}" + (f" [{unit}]" if unit else "")

    @property
    def times(self) -> Array:
        """Times (nt,), s, at which trajectories are compared."""
        return np.linspace(self.system(None).t0, self.t_end, GRID)

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
                variant = self._found(Run(RadauIIA(3), model=model))
                if isinstance(variant, Equations) and (not isinstance(model, Recursive) or variant.recursive[0]):
                    found[model] = variant.prepared is not None and not variant.prepared.rows
        return found

    def system(self, form: Form | None) -> System:
        """The equations with the joint models of the scene, in a form."""
        return self.stated.system(form)

    def equations(self, run: Run) -> Equations:
        """The equations with the joint models of a run, prepared once. Where the preparation failed, its error is raised at every
        call, so that each run with these models gets it."""
        found = self._found(run)
        if isinstance(found, MbdaeError):
            raise found
        return found

    def _found(self, run: Run) -> Equations | MbdaeError:
        if not run.models:
            return self.stated
        key = repr(sorted(run.models.items(), key=lambda item: item[0]))
        if key not in self.variants:
            try:
                self.variants[key] = self._with_models(run)
            except MbdaeError as error:
                self.variants[key] = error
        return self.variants[key]

    def _with_models(self, run: Run) -> Equations:
        if self.scene is None:
            raise OptionError(f"model {run.model_label}: a System has no joints; compare it by runs without a model, such as "
                              f"mb.Run(mb.IDA())")
        if not any(c.has_models for c in self.scene.joints):
            raise OptionError(f"model {run.model_label}: scene '{self.name}' has no joint with coordinates, which alone have "
                              f"joint models")  # fmt: skip
        return Equations(prepare(with_models(self.scene, run), t_end=self.t_end))

    @cached_property
    def yardstick(self) -> Equations:
        """The equations in whose unknowns all runs are compared: positions and velocities of the bodies, which follow from the
        unknowns of every joint model."""
        joints = self.scene.joints if self.scene is not None else []
        own = [c.name for c in joints if c.kept and not isinstance(c.model, Kinematic)]
        if self.scene is None or not own:
            return self.stated
        return Equations(prepare(self.scene.replace(*own, model=Kinematic()), t_end=self.t_end))

    def solve(self, solver: Solver, form: Form | None, equations: Equations | None = None, repeat: bool = True) -> Timed:
        """Execute a run; a short one twice, to take the smaller CPU time."""
        system, seconds = (equations or self.stated).for_solver(form, solver), []
        told = reset_peak()
        for _ in range(2 if repeat else 1):
            begin = time.process_time()
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)  # the error is measured against the reference instead
                    solution = solver.solve(system, self.t_end, max_wall=self.max_wall)
            finally:
                seconds.append(time.process_time() - begin)
                self.spent += seconds[-1]
            if seconds[0] >= SHORT:
                break
        spread = max(seconds) - min(seconds) if len(seconds) > 1 else None
        return Timed(solution, min(seconds), spread, peak_bytes() if told else None)

    def values(self, solution: Solution, equations: Equations | None = None, times: Array | None = None) -> Array:
        """Values (nt, ...) of a run that are compared, at times (nt,), by default `self.times`: those of the sensor `measure`,
        else positions and velocities of the bodies (of a System all unknowns)."""
        own, t = equations or self.stated, self.times if times is None else times
        if self.scene is None:
            return solution(t)
        if self.measure is not None:
            return own.sensor(solution, self.measure, t)
        return own.motion_as_in(self.yardstick, t, solution(t))

    def error(self, values: Any, reference: Any) -> float:
        """Largest difference over time between `values` and `reference` (nt, ...), in the unit of `what`."""
        if self.measure is None:
            prepared = self.yardstick.prepared
            if prepared is None:
                return float(np.max(scaled_distance(self.yardstick.system(None), values, reference)))
            a, b = (np.split(v, [prepared.mechanics.nq], axis=1) for v in (values, reference))
            return float(np.max(motion_distance(prepared, (a[0], a[1]), (b[0], b[1]))))
        return float(np.max(np.abs(values - reference)))


def with_models(scene: Any, run: Run) -> Any:
    """The scene with the joint models that a run names."""
    for name, model in run.models.items():
        spanning = not name and isinstance(model, Recursive)
        scene = scene.recursive() if spanning else scene.replace(*([name] if name else []), model=model)
    return scene


SECONDS = "give a positive number of seconds of wall time, or None"


def new_problem(scene: Any, t_end: Any, measure: Any, max_wall: Any) -> Problem:
    """The problem of a scene or a System, with its options checked; OptionError for wrong ones."""
    given = scene if isinstance(scene, System) else None
    if given is None and not isinstance(scene, SceneData):
        raise OptionError(f"scene = {shown(scene)}: give a mb.Scene or a System such as mb.DAE")
    sensor = optional("measure", measure, text, "name a sensor such as 'C.angle', or None for the motion of the bodies")
    if given is not None and sensor is not None:
        raise OptionError(f"measure = {shown(measure)}: a System has no sensors: leave it out, the error is that of all unknowns")
    end = end_after(given.t0 if given is not None else 0.0, t_end)
    wall = optional("max_wall", max_wall, number, SECONDS, above=0)
    if given is not None:
        return Problem(None, Equations(None, given), end, None, wall)
    stated = Equations(prepare(scene, t_end=end))
    if sensor is not None and stated.prepared is not None:
        refuse_unknown(stated.prepared, sensor)
    return Problem(scene, stated, end, sensor, wall)


def refuse_unknown(prepared: Prepared, sensor: str) -> None:
    """Refuse, before anything is solved, a measure that is no sensor of the scene or has no numeric values."""
    try:
        numbers(started(prepared), sensor)
    except (SceneError, OptionError) as error:
        told = "; ".join(error.problems) if isinstance(error, SceneError) else str(error)
        raise OptionError(f"measure = {shown(sensor)}: {told}") from error
