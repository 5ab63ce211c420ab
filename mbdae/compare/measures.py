"""What runs are compared by: the motion of the bodies, the forces of the joints, the energy, sensors, unknowns.

What follows from a comparison, in sentences: which method for which accuracy at what cost, which runs tie, what the joint
models change, and which methods lose digits of some quantity. Rows and comparisons are those of `table`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError, meant
from mbdae.integrators.solution import Solution, scaled_distance
from mbdae.results.quantities import Quantity, magnitudes, moves, value
from mbdae.results.stored_parts import started
from mbdae.scene.sensed import measured, of_motion
from mbdae.system.base import Array, System
from mbdae.system.sampling import motion_distance
from mbdae.values import option, several, shown, text

SPARSE = 4  #: forces and energies are compared at every fourth of the times of the motion


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

    def of_motion(self, problem: Any) -> bool:
        """Whether it follows from the motion of the bodies, which is all that other programs give."""
        return False

    def apart(self, problem: Any, a: Any, b: Any) -> float:
        """Largest difference over time of the values of two runs, in the unit of the error."""
        return float(np.max(np.abs(a - b), initial=0.0))


class BodiesMotion(Measure):
    """Positions and velocities of the bodies, in the unknowns of the scene with kinematic joints."""

    name = "motion"
    what = "motion of the bodies: positions over the scene's length, angles in rad, velocities over the largest typical speed"

    def of_motion(self, problem: Any) -> bool:
        return True

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

    def of_motion(self, problem: Any) -> bool:
        return of_motion(problem.scene, self.name)

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        found: Array = equations.result(solution, t).read(self.name)
        return found


@dataclass(frozen=True)
class AskedFor(Measure):
    """A quantity that runs are asked for, over its largest value in the second run, as `simulate(of=...)` estimates its error."""

    name: str
    quantity: Quantity

    @property
    def what(self) -> str:
        return f"largest difference of {self.name} over its largest value"

    def of_motion(self, problem: Any) -> bool:
        return isinstance(self.quantity, str) and moves(started(problem.stated.prepared), self.quantity)

    def read(self, problem: Any, equations: Any, solution: Solution, t: Array) -> Array:
        return value(equations.result(solution, t), self.quantity)

    def apart(self, problem: Any, a: Any, b: Any) -> float:
        size = float(np.max(magnitudes(b), initial=0.0))
        return float(np.max(magnitudes(a - b), initial=0.0)) / size if size > 0 else super().apart(problem, a, b)


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

    def of_motion(self, problem: Any) -> bool:
        return True

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



NEAR = 2.0  #: runs compete for an accuracy where their CPU times are within this factor of the least
LOST = 10.0  #: a method loses digits of a quantity where its error is this times that of the middle one, asked for the same


def rivals(rows: Sequence[Any], accuracy: float) -> list[int]:
    """Indices of the runs that reach an accuracy in a CPU time within `NEAR` times the least."""
    known = [(row.cpu_s or 0.0, i) for i, row in enumerate(rows) if reaches(row, accuracy)]
    return [i for cpu, i in known if cpu <= NEAR * min(known)[0]]


def reaches(row: Any, accuracy: float) -> bool:
    """Whether a run that models what the scene states has at most this error."""
    return row.measured is not None and not row.loose and row.measured[0] <= accuracy


def tied(row: Any, best: Any) -> bool:
    """Whether the clock does not tell the CPU times of two runs apart."""
    return (row.cpu_s or 0.0) - (best.cpu_s or 0.0) <= (row.cpu_spread_s or 0.0) + (best.cpu_spread_s or 0.0)


def quartiles(times: Sequence[float]) -> tuple[float, float]:
    """The median of some times and the distance of their quartiles, s."""
    low, middle, high = np.quantile(times, (0.25, 0.5, 0.75))
    return float(middle), float(high - low)


def seconds(value: float | None) -> str:
    """A time in the unit in which it is read: us, ms or s."""
    if value is None:
        return "-"
    for unit, size in (("us", 1e-6), ("ms", 1e-3)):
        if value < 999.5 * size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} s"


def decision(w: Any) -> str:
    """The decision as a paragraph of a few sentences."""
    return " ".join([*_choices(w), *_of_simulate(w), *_models(w), *_digits(w),
                     *(f"{one.text}." for one in w.converged)])


def _choices(w: Any) -> Iterable[str]:
    """For each accuracy the cheapest run; accuracies with the same answer are named together."""
    found: list[tuple[list[float], Any, list[str]]] = []
    for wanted in w.accuracies:
        best = w.cheapest(wanted)
        ties = [] if best is None else list(dict.fromkeys(
            row.label for row in w.runs if reaches(row, wanted) and row.label != best.label and not row.chosen
            and tied(row, best)))
        if found and (found[-1][1] is best if best is None or found[-1][1] is None else found[-1][1].label == best.label):
            found[-1] = ([*found[-1][0], wanted], best, ties)
        else:
            found.append(([wanted], best, ties))
    for many, best, ties in found:
        span = f"{many[0]:.0e}" + (f" to {many[-1]:.0e}" if len(many) > 1 else "")
        if best is None:
            yield f"{span} was reached by no run."
            continue
        cost = f"{seconds(best.cpu_s)} in the solver"
        cost += f", {seconds(best.call_s)} a call" if best.call_s is not None else ""
        last = f" for {many[-1]:.0e}" if len(many) > 1 else ""
        last += f" (asked for {best.accuracy:.0e})" if best.accuracy not in (None, many[-1]) else ""
        yield f"For {span} take {best.label}: {cost}{last}."
        if ties:
            named = ", ".join(ties[:3]) + (f" and {len(ties) - 3} more" if len(ties) > 3 else "")
            clock = f" (it ticks in {seconds(w.tick)})" if w.tick > 1e-4 else ""
            yield f"The clock{clock} does not tell {'it' if len(ties) == 1 else 'them'} from {named}."


def _of_simulate(w: Any) -> Iterable[str]:
    own = [row for row in w.runs if row.chosen and row.measured is not None]
    if own:
        last = own[-1]
        yield f"`simulate` takes {last.solver} {last.form}, {seconds(last.call_s)} a call for {last.accuracy:.0e}."


def _models(w: Any) -> Iterable[str]:
    """What the joint models change, by measure in its unit."""
    others = {row.loose for row in w.runs if row.loose}
    alike = {name: w.models[name] for name in w.models if name not in others}
    if alike:
        worst = {m: max(found.get(m, 0.0) for found in alike.values()) for m in w.units}
        yield f"{_listed(list(alike))} joints agree with the scene as stated to {_amounts(w, worst)}."
    for name in sorted(others & w.models.keys()):
        yield f"{name} changes {_amounts(w, w.models[name], 'the ')}." if w.models[name] else f"What {name} changes is not known."


def _digits(w: Any) -> Iterable[str]:
    """Methods that lose digits of a measure beside the others that were asked for the same, smallest, accuracy."""
    for name in w.units:
        rows = [row for row in w.runs if row.accuracy == min(w.accuracies) and row.errors.get(name) and not row.loose]
        known = w.reference.differences.get(name, 0.0)
        if len(rows) < 3:
            continue
        middle = float(np.median([row.errors[name] for row in rows]))
        lost = [row for row in rows if row.errors[name] > LOST * max(middle, known)]
        for row in sorted(lost, key=lambda row: -row.errors[name])[:1]:
            yield (f"{row.label} loses digits of {name}: {amount(row.errors[name], w.units[name])}, where others have "
                   f"{amount(middle, w.units[name])}.")


def amount(value: float, unit: str) -> str:
    """An error with its unit."""
    return f"{value:.1e}" + (f" {unit}" if unit else "")


def _amounts(w: Any, errors: dict[str, float], article: str = "") -> str:
    by = " by " if article else " in "
    return _listed([f"{article * ('.' not in name)}{name}{by}{amount(errors[name], w.units[name])}" if article else
                    f"{amount(errors[name], w.units[name])}{by}{name}" for name in w.units if name in errors])


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
