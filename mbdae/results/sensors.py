"""Sensors: motions of bodies and of places on them, coordinates and forces of joints and force elements, at the result's
times."""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np

from mbdae.errors import ListsAttributes, OptionError
from mbdae.laws.on_coordinates import OnCoordinate
from mbdae.notation import UNITS, quantity
from mbdae.process import unchanging
from mbdae.results.contacts import Contacts, contacts_at
from mbdae.results.quantities import differences
from mbdae.results.states import RunStates, States
from mbdae.scene.components import Body, Connection
from mbdae.scene.sensed import drives_of, has_length, rates_of
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element, Force
from mbdae.symbolic.outputs import Target, power, reaction
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.nodes import rotation_matrices
from mbdae.system.prepare import Prepared


class judged(property):  # noqa: N801, used as `property` is
    """A property of a sensor, computed once, with whose value the reader is told where its error is above the accuracy asked."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, sensor: Any, owner: type | None = None) -> Any:
        if sensor is None:
            return self
        known = vars(sensor)
        if (kept := f"_{self._name}_read") not in known:
            with sensor._result._silently():
                known[kept] = unchanging(super().__get__(sensor, owner))
        sensor._result._judge(f"{sensor._path}.{self._name}")
        return known[kept]


def reaction_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Force and torque on l at the joint."""
    return [] if isinstance(d.law, Element) else reaction(d)


def wrenches(prepared: Prepared, at: States, names: list[str] | None = None, multipliers: Array | None = None) -> Array:
    """(nt, names, 6) force (N) and torque (N m) of joints and force elements, by names (None: all), on their bodies l.
    multipliers: where they are known."""
    m, items = prepared.with_all_rows, names if names is not None else [c.name for c in prepared.model.scene.connections]
    known = m.accelerations(at.t, at.q, at.u, at.s, at.z)[1] if multipliers is None else multipliers
    total = np.zeros((len(at.t), len(items), 6))
    for g, _, values in m.evaluate(reaction_outputs, at.t, at.q, at.u, at.s, known):
        for i, instance in enumerate(prepared.model.groups[g].instances):
            if instance.item in items:
                total[:, items.index(instance.item)] += values[:, i]
    return total


def forces_apart(own: RunStates, other: RunStates, names: list[str], asked: float | None, ratio: float) -> tuple[float, float]:
    """Largest force, N (torques over the length of the scene), of the named items in one run, and the largest difference from it
    in another, whose tolerance is `ratio` times as large, where no jump comes earlier or later (see `differences`)."""
    per_force = np.repeat([1.0, 1 / own.prepared.length], 3)

    def forces(run: RunStates, some: Any = slice(None)) -> Any:
        return wrenches(run.prepared, States(run.t, *run._states, None), names, run._dynamics[1])[:, some] * per_force

    first, second = forces(own), forces(other)
    size, apart = (np.max(np.linalg.norm(w.reshape(*w.shape[:2], 2, 3), axis=3), axis=2) for w in (first, second - first))
    largest = float(np.max(size, initial=0.0))
    for i in np.flatnonzero(np.max(apart, axis=0, initial=0.0) > asked * largest) if asked else ():
        jumping = differences(own, other, partial(forces, some=i), "", asked or 0.0, ratio, (asked or 0.0) * largest)
        apart[:, i] = np.minimum(apart[:, i], jumping)
    return largest, float(np.max(apart, initial=0.0))


def shared_reactions(prepared: Prepared) -> set[tuple[str, int]]:
    """(joint, number of an output of `reaction_outputs`) of the components of forces and torques that are not unique, at the
    start or in other positions that the joints allow."""
    m, start, found = prepared.with_all_rows, prepared.start, set[tuple[str, int]]()
    rows = [m.rows.index(row) for row in prepared.rank.not_unique]
    multipliers = np.vstack([np.zeros(m.m), np.eye(m.m)[rows]])
    for q in (start.q, *prepared.rank.elsewhere) if rows else ():
        t, many, u, s = (np.repeat(part[None], len(multipliers), axis=0) for part in (np.array(start.t), q, start.u, start.s))
        for g, p, values in m.evaluate(reaction_outputs, t, many, u, s, multipliers):
            for instance, of in zip(m.model.groups[g].instances, values.swapaxes(0, 1), strict=True):
                acts = np.any(np.abs(of[1:] - of[0]) > 1e-9, axis=0)
                found |= {(instance.item, t[1]) for t, one in zip(p.targets, acts, strict=True) if one}
    return found


def power_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Power that a joint or force delivers."""
    return [] if isinstance(d.law, Element) else power(d)


def drive_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """The force of a law that loads a coordinate of a joint."""
    if not (isinstance(d.law, OnCoordinate) and d.law.loads):
        return []
    v, thrust = d.variation, d.law.thrust(*d.sides)
    return [] if thrust is None else [(("thrust",), v.resolve(v.name(thrust[1])))]


def length_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Distance between the two points of a force, and its rate."""
    if not isinstance(d.law, Force) or len(d.sides) < 2:
        return []
    k, l, v = *d.sides[:2], d.variation
    length = (l.r - k.r).norm()
    return [(("length",), v.resolve(v.name(length))), (("rate",), v.resolve(v.rate(v.name(length))))]


def quantities_of(kind: type) -> tuple[str, ...]:
    """The quantities that sensors of a kind (`BodySensor`, `ConnectionSensor`) have, and those of kinds derived from it."""
    kinds = [kind]
    for one in kinds:
        kinds += one.__subclasses__()
    return tuple(name for name in UNITS if any(name in vars(one) for one in kinds))


class MissingError(OptionError, AttributeError):
    """A quantity was read by a name that its object does not have; `hasattr` and `getattr` with a default know it, too."""


class BodySensor(ListsAttributes):
    """Motion of a body's centre of mass, or of a place on it: arrays over the result's times."""

    def __init__(self, result: RunStates, body: Body, point: Array | None = None) -> None:
        self._result, self._body, self._where = result, body, point
        drawn = body.drawn.position if point is None else point
        self._offset = body.drawn.rotation.T @ (drawn - body.drawn.position)

    @property
    def _called(self) -> str:
        return f"the sensor of body '{self._body.name}'"

    @property
    def _path(self) -> str:
        """The text by which `Result.read` finds the sensor."""
        where = "" if self._where is None else f".at({', '.join(f'{x:.12g}' for x in self._where)})"
        return f"{self._body.name}{where}"

    def at(self, point: Any) -> BodySensor:
        """A place of the body, given as drawn (inertial coordinates, m), or 0..1 along a link or beam."""
        made = self._place(self._body.at(point).point)
        made._where = np.atleast_1d(np.asarray(point, dtype=float))
        return made

    def _place(self, point: Array) -> BodySensor:
        """The sensor of a place (3,) as drawn, m."""
        return BodySensor(self._result, self._body, point)

    @cached_property
    def _node(self) -> Any:
        return self._result.prepared.model.node(self._body)

    @cached_property
    @quantity("")
    def rotation(self) -> Array:
        """R (nt, 3, 3), body to inertial frame."""
        nt = len(self._result.t)
        if self._node is None or not self._node.kind.turns:
            return np.broadcast_to(np.eye(3), (nt, 3, 3)).copy()
        q = self._result.q[:, self._node.q :]
        if self._node.kind is NodeKind.SPATIAL:
            return rotation_matrices(q[:, 3:7])
        return turned_about_z(q[:, 2])

    def _translation(self, table: Array, start: int) -> Array:
        out = np.zeros((len(self._result.t), 3))
        if self._node is not None:
            n = self._node.kind.translations
            out[:, :n] = table[:, start : start + n]
        return out

    @cached_property
    @quantity("m")
    def position(self) -> Array:
        """Position (nt, 3), m, inertial frame."""
        center = self._body.drawn.position + np.zeros((len(self._result.t), 3))
        if self._node is not None:
            center = self._translation(self._result.q, self._node.q)
        return center + self.rotation @ self._offset

    @cached_property
    @quantity("m/s")
    def velocity(self) -> Array:
        """Velocity (nt, 3), m/s, inertial frame."""
        center = self._translation(self._result.u, self._node.u if self._node is not None else 0)
        return center + np.cross(self.angular_velocity, self.rotation @ self._offset)

    @judged
    @quantity("m/s^2", loop=True)
    def acceleration(self) -> Array:
        """Acceleration (nt, 3), m/s^2, inertial frame, from the equations of motion: 0 at rest (an accelerometer adds -g)."""
        center = self._translation(self._result.acceleration, self._node.u if self._node is not None else 0)
        arm, w = self.rotation @ self._offset, self.angular_velocity
        return center + np.cross(self.angular_acceleration, arm) + np.cross(w, np.cross(w, arm))

    @judged
    @quantity("rad/s^2", loop=True)
    def angular_acceleration(self) -> Array:
        """Angular acceleration (nt, 3), rad/s^2, inertial frame, from the equations of motion; 0 for a point mass, which has no
        axes that could turn."""
        return self._turning(self._result.acceleration)

    @cached_property
    @quantity("rad/s")
    def angular_velocity(self) -> Array:
        """Angular velocity (nt, 3), rad/s, inertial frame; 0 for a point mass, which has no axes that could turn."""
        return self._turning(self._result.u)

    def _turning(self, values: Array) -> Array:
        """The rotational part (nt, 3) of velocities or accelerations (nt, nu), inertial frame: w x w = 0, so that the rate of the
        body's own components is the rate of the vector."""
        out = np.zeros((len(self._result.t), 3))
        if self._node is not None and self._node.kind is NodeKind.PLANAR:
            out[:, 2] = values[:, self._node.u + 2]
        elif self._node is not None and self._node.kind is NodeKind.SPATIAL:
            out = np.einsum("tij,tj->ti", self.rotation, values[:, self._node.u + 3 : self._node.u + 6])
        return out


def turned_about_z(angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about z by angles (...), rad."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, one], -1)]
    found: Array = np.stack(rows, -2)
    return found


class ConnectionSensor(ListsAttributes):
    """A joint or force element: coordinate, force and torque on body l, power; arrays over the result's times."""

    def __init__(self, result: RunStates, item: Connection) -> None:
        self._result, self._item = result, item

    @property
    def _called(self) -> str:
        return f"the sensor of {self._item.kind} '{self._item.name}'"

    @property
    def _path(self) -> str:
        """The text by which `Result.read` finds the sensor."""
        return self._item.name

    def __getattr__(self, name: str) -> Array:
        """A coordinate of the joint by its name, (nt,) rad or m, 0 as drawn, whole turns of angles counted; its rate by
        "<name>_rate", or "rate" where there is one coordinate."""
        item: Connection | None = self.__dict__.get("_item")
        if item is None:
            return super().__getattr__(name)  # type: ignore[misc,no-any-return]
        names, rates = item.scalars, rates_of(item)
        if name in names or name in rates:
            found = self._result.coordinate(item, rates.get(name, name))
            if found is None:
                point = next((b.name for b in (item.k, item.l) if b.is_point), None)
                coordinate = f"{item.kind} '{item.name}': the coordinate '{rates.get(name, name)}'"
                if point is not None:
                    raise OptionError(f"{coordinate} is not known: the point mass '{point}' has no orientation; use s.rigid_body")
                raise OptionError(f"{coordinate} is not known: the positions of its bodies do not determine it; use "
                                  f"model=mb.Classical(), where it is an unknown")
            return found[name in rates]
        if name in drives_of(item):
            found_drive = self._drive(name, drives_of(item)[name])
            self._result._judge(f"{self._path}.{name}")
            return found_drive
        if name in ("length", "rate") and has_length(item):
            return self._length[:, ("length", "rate").index(name)]
        if name == "drive" or name.startswith("drive_"):
            driven = ", ".join(drives_of(item))
            instead = f"it has {driven}" if driven else "none of its coordinates is prescribed or loaded; read force and torque"
            raise MissingError(f"{item.kind} '{item.name}' has no {name}: {instead}")
        if name in (*item.coordinates, "angle", "displacement", "rate", "angle_rate", "displacement_rate"):
            of_bodies = "it has no coordinates; read position and rotation of its bodies"
            instead = f"its coordinates: {', '.join(names)}" if names else of_bodies
            raise MissingError(f"{item.kind} '{item.name}' has no {name}; {instead}")
        return super().__getattr__(name)  # type: ignore[misc,no-any-return]

    def __dir__(self) -> list[str]:
        touches = any(one.item == self._item.name for one in self._result.prepared.contacts)
        known = [name for name in super().__dir__() if touches or name not in ("contacts", "summary")]
        own = [*drives_of(self._item), *(("length", "rate") if has_length(self._item) else ())]
        return [*known, *self._item.scalars, *rates_of(self._item), *own]

    @cached_property
    def _length(self) -> Array:
        found = [values for g, p, values in self._result.over_laws(length_outputs, self._item)]
        return np.asarray(found[0]) if found else np.full((len(self._result.t), 2), np.nan)

    def _drive(self, row: str, coordinate: str) -> Array:
        """Torque or force (nt,), N m or N, on l that acts on a coordinate: the multiplier of `row`, which prescribes it, plus its
        loads; positive in the direction in which the coordinate grows."""
        loads = [values[:, 0] for law, _, values in self._result.over_laws(drive_outputs, self._item)
                 if law.name_of_coordinate == coordinate]
        name = f"{self._item.name}.{row}"
        if name in self._result.multiplier_names:
            loads.append(self._result._dynamics[1][:, self._result.multiplier_names.index(name)])
        return np.sum(loads, axis=0) if loads else np.full(len(self._result.t), np.nan)

    @cached_property
    def _wrench(self) -> Array:
        return self._result.sum_over_laws(reaction_outputs, self._item, 6)

    @judged
    @quantity("N", loop=True)
    def force(self) -> Array:
        """Force on body l (nt, 3), N, inertial frame."""
        return self._wrench[:, :3]

    @judged
    @quantity("N m", loop=True)
    def torque(self) -> Array:
        """Torque on body l about the joint (nt, 3), N m, inertial frame (in a planar model: the z component only)."""
        return self._wrench[:, 3:]

    @property
    def reaction_is_unique(self) -> bool:
        """False where redundant constraints could share the reaction: `force` and `torque` are then one of many possible
        values."""
        return self._item.name not in self._result.prepared.rank.sharing

    @cached_property
    def contacts(self) -> Contacts:
        """Begin, end and peak penetration of every contact of a joint with clearance or limits, found on the steps of the run; of
        several limited coordinates all in order of time, each penetration in the unit of its coordinate."""
        known = [one for one in self._result.prepared.contacts if one.item == self._item.name]
        if not known:
            raise OptionError(f"{self._item.kind} '{self._item.name}' has no contacts: only joints with clearance or with limits "
                              f"have some; leave .contacts and .summary() out")
        return contacts_at(self._result.prepared, self._result.solution, known)

    def summary(self) -> dict[str, float]:
        """The contacts in numbers: see `Result.contacts`."""
        found = self.contacts
        return {"contacts": len(found), "first": found.first, "deepest": found.deepest}

    @judged
    @quantity("W", loop=True)
    def power(self) -> Array:
        """Power that the joint or force delivers to the bodies (nt,), W."""
        return self._result.sum_over_laws(power_outputs, self._item, 1)[:, 0]
