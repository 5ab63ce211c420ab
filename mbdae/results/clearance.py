"""Sensors of contacts: gap, forces, slip, contacts, wear; of a joint with clearance also its orbit.

Runs beside a run, with which it is compared, and the forces and torques of all joints and force elements at once.

Stresses at a point of the section of a beam, from its stress resultants.

Normal stress by Bernoulli, shear of shear forces by Jourawski (V Q / (I b)), of a torque in round sections by Saint-Venant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import NamesArguments, OptionError
from mbdae.integrators.solution import Solution
from mbdae.notation import quantity
from mbdae.results.sensors import ConnectionSensor, judged
from mbdae.scene.shapes import Section
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared


def observed_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Quantities that the sensor of a law reads in addition to force, torque and power."""
    if not isinstance(d.law, Force):
        return []
    v = d.variation
    return [((name, i), v.resolve(v.name(e))) for name, parts in d.law.observed(*d.sides).items() for i, e in enumerate(parts)]


class RopeSensor(ConnectionSensor):
    """Sensor of a force that states what it shows: force and torque on l, power, and these; arrays (nt, ...) over the times."""

    @cached_property
    def _columns(self) -> dict[str, Array]:
        """(nt, n) of every observed quantity."""
        ((_, targets, values),) = self._result.over_laws(observed_outputs, self._item)
        names = [name for name, _ in targets]
        return {name: values[:, [n == name for n in names]] for name in names}

    @judged
    @quantity("N", loop=True)
    def tension(self) -> Array:
        """Tension of a rope (nt,), N; 0 where it is slack."""
        return self._columns["tension"][:, 0]

    @property
    @quantity("m")
    def length(self) -> Array:
        """Length of a rope's path (nt,), m; what was wound on drums since the drawing counts."""
        return self._columns["length"][:, 0]

    @property
    @quantity("m")
    def on_pulleys(self) -> Array:
        """Lengths (nt, pulleys) of a rope on its pulleys, m; negative where it has left one."""
        return self._columns.get("on_pulleys", np.zeros((len(self._result.t), 0)))


class ContactSensor(ConnectionSensor):
    """Sensor of two surfaces that touch: force, torque and power as of every force, and the quantities of their contact.

    Arrays (nt,) over the result's times; where they may touch at several places (nt, places).
    """

    def at_times(self, t: Array) -> dict[str, Array]:
        """All quantities of the contact at times t (nt,), by name, (nt, places): a column for each place where it may touch."""
        columns: dict[str, list[Array]] = {}
        prepared = self._result.prepared
        for g, p, values in prepared.mechanics.evaluate(observed_outputs, t, *self._result.states(t)):
            for i, instance in enumerate(prepared.model.groups[g].instances):
                if instance.item == self._item.name:
                    for o, (name, _) in enumerate(p.targets):
                        columns.setdefault(name, []).append(values[:, i, o])
        return {name: np.stack(parts, axis=1) for name, parts in columns.items()}

    @cached_property
    def on_steps(self) -> dict[str, Array]:
        """`at_times` on the steps of the run."""
        return self.at_times(self._result.solution.t)

    @cached_property
    def _seen(self) -> dict[str, Array]:
        return self.at_times(self._result.t)

    def _observed(self, name: str) -> Array:
        values = self._seen[name]
        return values[:, 0] if values.shape[1] == 1 else values

    @judged
    @quantity("m")
    def gap(self) -> Array:
        """Distance of the surfaces, m; negative in contact."""
        return self._observed("gap")

    @judged
    @quantity("m/s")
    def gap_rate(self) -> Array:
        """Rate of the gap, m/s."""
        return self._observed("gap_rate")

    @judged
    @quantity("m")
    def penetration(self) -> Array:
        """Depth by which the surfaces overlap, m; 0 where they are apart."""
        depth: Array = np.maximum(0.0, -self.gap)
        return depth

    @judged
    @quantity("N", loop=True)
    def normal_force(self) -> Array:
        """Normal force, N; 0 where the surfaces are apart."""
        return self._observed("normal_force")

    @judged
    @quantity("N")
    def friction_force(self) -> Array:
        """Magnitude of the friction force, N. For a joint with clearance: the force on the pin along the vector product of the
        joint's axis and the contact normal, with its sign."""
        return self._observed("friction_force")

    @judged
    @quantity("m/s")
    def slip(self) -> Array:
        """Sliding speed, m/s, also where the surfaces are apart. For a joint with clearance: the velocity of the pin's surface on
        that of the race along the vector product of the joint's axis and the contact normal, with its sign."""
        return self._observed("slip")

    @judged
    @quantity("W")
    def friction_power(self) -> Array:
        """Power lost in friction, W; negative where bristles give energy back."""
        return self._observed("friction_power")

    @judged
    @quantity("W")
    def wear_rate(self) -> Array:
        """Normal force times sliding speed, W: wear by Archard's law is proportional to it."""
        return np.asarray(self._observed("normal_force") * np.abs(self.slip))

    @cached_property
    def wear(self) -> float:
        """Normal force times sliding distance over the whole run, J (trapezoidal over its steps)."""
        from scipy.integrate import trapezoid

        seen = self.on_steps
        return float(trapezoid(np.sum(seen["normal_force"] * np.abs(seen["slip"]), axis=1), self._result.solution.t))

    def summary(self) -> dict[str, float]:
        """The contact in numbers: see `Result.contacts`."""
        return super().summary() | {"wear": self.wear}


class ClearanceSensor(ContactSensor):
    """Sensor of a revolute joint with clearance: quantities as of every joint, and the contact of its pin with its race.

    Arrays (nt,) over the result's times; for a bearing that touches at both ends (nt, 2), near and far end along the axis.
    """

    @judged
    @quantity("m")
    def orbit(self) -> Array:
        """Centre of the pin relative to that of the race (nt, 2), m, in axes that turn with the race."""
        return self._seen["orbit"]

    def summary(self) -> dict[str, float]:
        """The contact in numbers: see `Result.contacts`."""
        law = self._item.laws[-1]
        return super().summary() | {"play": law.outer - law.inner}


#: largest number of unknowns at all steps of a run beside the one returned that is kept whole (16 MB); larger ones at some times
WHOLE = 2_000_000
#: number of times at which a run is compared; with contacts up to MOST, as far as all unknowns at them are at most NUMBERS:
#: impacts are short, and of 200 times of a run with 5000 steps one companion met them and another did not
FEWEST, MOST, NUMBERS = 200, 2000, 400_000
BEGIN = 12  #: number of times from the begin on that are all kept: forces are farthest off where a motion begins with a jerk
KINDS = ("companion", "window", "mesh", "start", "closer")  #: see `OtherRun`
FURTHER = ("mesh", "start")  #: kinds of which runs of the same scene from the same start show nothing: their errors are added
LATE = 2 / 3  #: fraction of a window from which on its vibrations are taken to go on after it


def some_of(times: Array, unknowns: int, contacts: bool) -> Array:
    """Those of the times of a comparison at which two runs are read: equally many between any two of them, and the first ones.
    contacts: whether their scene has some."""
    count = int(np.clip(NUMBERS // max(unknowns, 1), FEWEST, MOST if contacts else FEWEST))
    return np.asarray(times[distinct(np.r_[: min(BEGIN, len(times)), np.linspace(0, len(times) - 1, count).astype(int)])])


@dataclass(frozen=True, eq=False)
class AtTimes:
    """Dense output of a run of which the unknowns y (k, n) at the times t (k,) alone are kept."""

    t: Array
    y: Array

    def value(self, t: Array) -> Array:
        """y at times among those kept; OptionError for others."""
        i = np.clip(np.searchsorted(self.t, t), 0, len(self.t) - 1)
        if not np.array_equal(self.t[i], t):
            raise OptionError("a run that was kept at some times is not known at others")
        return self.y[i]

    def derivative(self, t: Array) -> Array:
        """y' is not kept: nan."""
        return np.full_like(self.value(t), np.nan)


def sampled(run: Solution, times: Array) -> Solution:
    """A run of which the unknowns at some times (k,) alone are kept."""
    y = run(times)
    return replace(run, t=times, y=y, yp=np.zeros((0, y.shape[1])), outputs=None, interpolant=AtTimes(times, y), systems=())


@dataclass(frozen=True, eq=False)
class OtherRun:
    """A run with which the returned run is compared at some times (k,): the error of the latter is `share` times the difference.

    kind: "companion" (the same method at a larger tolerance, or another method), "window" (a short run that resolves vibrations
    which the run may leave out), "mesh" (the run on a finer mesh of the beams), "start" (a motion from another start, where that
    of the run is not exact) or "closer" (a far more accurate run, made when a quantity was read); prepared: its scene, where
    it has another mesh; ratio: its tolerance over that of the run (0: not known)."""

    run: Solution
    times: Array
    share: float
    prepared: Prepared | None = None
    kind: str = "companion"
    ratio: float = 0.0

    @classmethod
    def beside(cls, run: Solution, times: Array, share: float, prepared: Prepared | None = None, kind: str = "companion",
               ratio: float = 0.0) -> OtherRun:
        """The run, whole where it is small."""
        kept = replace(run, systems=(), outputs=None) if run.y.size <= WHOLE else sampled(run, times)
        return cls(kept, times, share, prepared, kind, ratio)

    def between(self, first: float, last: float) -> slice:
        """The times that count between two times (s): those there; of a window the vibrations from LATE on too, which go on."""
        begin, end = np.clip(np.searchsorted(self.times, [first, last]) + np.array([-1, 1]), 0, len(self.times)).tolist()
        if self.kind == "window":
            a, b = self.times[[0, -1]].tolist()
            return slice(min(begin, int(np.searchsorted(self.times, a + LATE * (b - a)))), None)
        return slice(begin, end) if end - begin > 1 else slice(None)

    def after(self, end: float) -> OtherRun:
        """The same run, compared after a time (s)."""
        return replace(self, times=self.times[self.times > end])

    def until(self, end: float) -> OtherRun:
        """The same run, compared up to a time (s)."""
        return replace(self, times=self.times[self.times <= end])


def at_the_same_times(others: tuple[OtherRun, ...]) -> tuple[OtherRun, ...]:
    """The runs, with the two companions of a run with contacts compared with it at the same times: what one of them shows at an
    impact and the other misses is no sign that errors fall."""
    pair = [other for other in others if other.kind == "companion" and not isinstance(other.run.interpolant, AtTimes)]
    if len(pair) != 2:
        return others
    end = min(other.run.t[-1] for other in pair)
    times = distinct(np.concatenate([other.times[other.times <= end] for other in pair]))
    return tuple(replace(other, times=times) if other in pair else other for other in others)


OUTSIDE = 1e-6  #: distance beyond the boundary of a section, relative to its size, that counts as rounding


@dataclass(frozen=True)
class Fibre(NamesArguments):
    """A point of a section, x2 and x3 in m along its axes 2 and 3 from the centroid; called: name of the beam in messages."""

    section: Section
    x2: float
    x3: float
    called: str

    def normal(self, resultants: Array) -> Array:
        """Normal stress (nt,), Pa, of N1, M2, M3 among the resultants (nt, 6), N and N m."""
        s, E = self.section, self._modulus()
        N1, M2, M3 = resultants[:, 0], resultants[:, 4], resultants[:, 5]
        return np.asarray(E * (N1 / s.EA + M2 * self.x3 / s.EI2 - M3 * self.x2 / s.EI3))

    def shear(self, resultants: Array) -> Array:
        """Shear stress (nt, 2), Pa, along axes 2 and 3; OptionError for a torque on a section that is not round."""
        s, E = self.section, self._modulus()
        N2, N3, M1 = resultants[:, 1], resultants[:, 2], resultants[:, 3]
        along2 = N2 * self._first_over_width(2, abs(self.x2)) * E / s.EI3
        along3 = N3 * self._first_over_width(3, abs(self.x3)) * E / s.EI2
        if np.any(M1) and not self._round:
            raise OptionError(f"{self.called}: the shear stress of a torque is known for circles and tubes alone; read "
                              f"fibre_stress and stress_resultants")
        polar = M1 * E / (s.EI2 + s.EI3) if self._round else 0 * M1
        return np.stack([along2 - polar * self.x3, along3 + polar * self.x2], axis=1)

    def von_mises(self, resultants: Array) -> Array:
        """Von Mises stress (nt,), Pa, of the resultants (nt, 6), N and N m."""
        return np.asarray(np.sqrt(self.normal(resultants) ** 2 + 3 * np.sum(self.shear(resultants) ** 2, axis=1)))

    @property
    def _round(self) -> bool:
        return bool(self.section.shape) and self.section.shape[0] == "tube"

    def _modulus(self) -> float:
        """Young's modulus, Pa; refuses a section without a shape, and a point outside of it."""
        shape: Any = self.section.shape
        if not shape or not self.section.E:
            raise OptionError(f"{self.called}: its section has stiffnesses and no shape, so that stresses are not known: make it "
                              f"by mb.Section.circular, tube or rectangular")
        kind, a, b = shape
        slack = 1 + OUTSIDE
        inside = b / slack <= np.hypot(self.x2, self.x3) <= a * slack if kind == "tube" else (
            abs(self.x3) <= a / 2 * slack and abs(self.x2) <= b / 2 * slack)
        if not inside:
            section = f"a tube of radii {a:g} and {b:g} m" if kind == "tube" else f"a rectangle of {a:g} m by {b:g} m"
            where = f"x2 = {self.x2:g} m, x3 = {self.x3:g} m"
            raise OptionError(f"{self.called}: the point {where} is outside of its section, {section}: "
                              f"name a point of it, such as beam.at((x, y, z))")
        return float(self.section.E)

    def _first_over_width(self, axis: int, x: float) -> float:
        """First moment of the part of the section beyond x along an axis, over the width there, m^2."""
        kind, a, b = self.section.shape
        if kind == "rectangle":
            h = b if axis == 2 else a
            return float(max((h / 2) ** 2 - x**2, 0.0) / 2)
        outer, inner = max(a**2 - x**2, 0.0), max(b**2 - x**2, 0.0)
        return float((outer + np.sqrt(outer * inner) + inner) / 3)
