"""What runs are compared by: the motion of the bodies, the forces of the joints, the energy, sensors, unknowns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError, meant
from mbdae.integrators.solution import Solution, scaled_distance
from mbdae.scene.sensed import measured
from mbdae.system.base import Array, System
from mbdae.system.sampling import motion_distance
from mbdae.values import option, several, shown, text

SPARSE = 5  #: forces and energies are compared at every fifth of the times of the motion


class Measure(ABC):
    """A quantity of a run, and how far apart two runs are in it."""

    name: str
    unit: str = ""  #: of the error, "" where it is a ratio
    every: ClassVar[int] = 1  #: it is compared at every so many of the times of the comparison

    @property
    @abstractmethod
    def what(self) -> str:
        """Definition of the error in words, with its unit."""

    @abstractmethod
    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        """Values (nt, ...) of a run at times t (nt,). problem: `problem.Problem`; equations: `run.Equations` of the run."""

    def apart(self, problem: Any, a: Any, b: Any) -> float:
        """Largest difference over time of the values of two runs, in the unit of the error."""
        return float(np.max(np.abs(a - b), initial=0.0))


class BodiesMotion(Measure):
    """Positions and velocities of the bodies, in the unknowns of the scene with kinematic joints."""

    name = "motion"
    what = "motion of the bodies: positions over the scene's length, angles in rad, velocities over the largest typical speed"

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        found: Array = equations.motion_as_in(problem.yardstick, t, solution(t))
        return found

    def apart(self, problem: Any, a: Any, b: Any) -> float:
        prepared = problem.yardstick.prepared
        assert prepared is not None
        first, second = (np.split(v, [prepared.mechanics.nq], axis=1) for v in (a, b))
        return float(np.max(motion_distance(prepared, (first[0], first[1]), (second[0], second[1]))))


class Unknowns(Measure):
    """All unknowns of a System but its multipliers."""

    name = "unknowns"
    what = "every unknown but multipliers, over its scale"

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        return solution(t)

    def apart(self, problem: Any, a: Any, b: Any) -> float:
        return float(np.max(scaled_distance(problem.system(None), a, b)))


@dataclass(frozen=True)
class Unknown(Measure):
    """One unknown of a System, by its name."""

    name: str
    index: int

    @property
    def what(self) -> str:
        return f"largest difference of {self.name}"

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        return np.asarray(solution(t)[:, self.index])


@dataclass(frozen=True)
class Sensor(Measure):
    """A sensor of a scene."""

    name: str
    unit: str

    @classmethod
    def of(cls, scene: Any, name: str) -> Sensor:
        """The sensor of a scene, with its unit."""
        return cls(name, measured(scene, name)[1])

    @property
    def what(self) -> str:
        return f"largest difference of {self.name}" + (f" [{self.unit}]" if self.unit else "")

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        found: Array = equations.result(solution, t).read(self.name)
        return found


class JointForces(Measure):
    """Forces and torques of all joints."""

    name, unit = "joint forces", "N"
    what = "largest difference of a joint's force, or of its torque over the scene's length [N]"
    every = SPARSE

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        assert problem.scene is not None
        assert equations.prepared is not None
        r, length = equations.result(solution, t), equations.prepared.model.length
        read = [r.read(f"{c.name}.{what}") / scale for c in problem.scene.joints for what, scale in
                (("force", 1.0), ("torque", length))]
        return np.hstack([np.reshape(v, (len(t), -1)) for v in read])


class Energies(Measure):
    """Kinetic and potential energy together."""

    name, unit = "energy", "J"
    what = "largest difference of the kinetic and potential energy [J]"
    every = SPARSE

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        e = equations.result(solution, t).energy
        return np.asarray(e.kinetic + e.potential)


@dataclass(frozen=True)
class Reference:
    """The run against which errors are measured. difference: largest difference of the second method's run from it, in the unit
    of the measure; None without a second method."""

    label: str
    accuracy: float | None
    confirmed_by: str | None
    difference: float | None
    steps: int | None = None
    cpu_s: float | None = None
    note: str | None = None
    differences: dict[str, float] = field(default_factory=dict)  #: as `difference`, by the name of every measure

    @property
    def trusted(self) -> bool:
        """Whether the user gave the reference, or a second method differs from it by at most a third of the smallest accuracy."""
        return self.note is None

    def __str__(self) -> str:
        second = f"; {self.confirmed_by} differs by {self.difference:.1e}" if self.difference is not None else ""
        return self.label + second + (f"; {self.note}" if self.note else "")


def named_measures(measure: Any) -> tuple[str, ...]:
    """The names of measures; OptionError where `measure` is neither a name nor several, each given once."""
    if measure is None:
        return ()
    remedy = "name a sensor such as 'C.angle', or several in a list, or None for the motion of the bodies"
    if isinstance(measure, str) or not several(measure):
        return (option("measure", measure, text, remedy),)
    found = tuple(measure) if isinstance(measure, list | tuple) else ()
    if not found or not all(isinstance(one, str) and one.strip() for one in found) or len(set(found)) < len(found):
        raise OptionError(f"measure = {shown(measure)}: give one name or more, each once; {remedy}")
    return found


def unknowns_of(system: System, named: Sequence[str]) -> tuple[Measure, ...]:
    """The measures of a System: unknowns by name, or all."""
    for name in named:
        if name not in system.names:
            raise OptionError(f"measure = {shown(name)}: there is no such unknown: {meant(name, system.names)}the System has "
                              f"{', '.join(system.names)}")
    return tuple(Unknown(name, system.names.index(name)) for name in named) or (Unknowns(),)
