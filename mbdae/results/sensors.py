"""Sensors: motions of bodies and of places on them, coordinates and forces of joints and force elements, at the result's
times."""

from __future__ import annotations

import re
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import ListsAttributes, OptionError, SceneError
from mbdae.notation import QUANTITIES
from mbdae.results.contacts import Contacts, contacts_at
from mbdae.results.states import RunStates
from mbdae.scene.components import Body, Connection
from mbdae.scene.sensed import rates_of as rates_of
from mbdae.scene.sensed import split_entry
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, power, reaction
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.rotations import rotation_matrices

_PLACE = re.compile(r"(?P<item>.+)\.at\((?P<where>[^()]*)\)")


def reaction_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Force and torque on l at the joint."""
    return [] if isinstance(d.law, Element) else reaction(d)


def power_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Power that a joint or force delivers."""
    return [] if isinstance(d.law, Element) else power(d)


def split(path: str) -> tuple[str, str]:
    """Item and quantity of "item.quantity"; the item may be a place, "item.at(0.5)"; no quantity where it ends in one."""
    if path.endswith(")"):
        return path, ""
    name, _, quantity = path.rpartition(".")
    return name, quantity


def placed(scene: Any, key: str) -> tuple[Any, Any]:
    """The item of a scene, and where on it: "item", "item.at(s)" with s from 0 to 1, "item.at(x, y)" or "item.at(x, y, z)"."""
    found = None if any(item.name == key for item in scene._items) else _PLACE.fullmatch(key)
    if found is None:
        return scene[key], None
    item = scene[found["item"]]
    try:
        where = [float(x) for x in found["where"].split(",")]
    except ValueError:
        where = []
    if not isinstance(item, Body) or len(where) not in (1, 2, 3):
        raise SceneError([f"there is no place '{key}'; give a body and a number from 0 to 1, or a point of 2 or 3 coordinates"])
    return item, where[0] if len(where) == 1 else where


def measured(scene: Any, sensor: str) -> tuple[str, str]:
    """What a sensor measures in words, and its SI unit ("" where it has none)."""
    if any(signal.name == sensor for signal in scene.signals):
        return sensor, ""
    name, quantity = split(split_entry(sensor)[0])
    item = placed(scene, name)[0]
    if isinstance(item, Connection):
        known = {c: item.unit(c) for c in item.scalars} | {r: f"{item.unit(c)}/s" for r, c in rates_of(item).items()}
        if quantity in known:
            return "speed" if (quantity, known[quantity]) == ("rate", "m/s") else quantity.replace("_", " "), known[quantity]
    return quantity.replace("_", " "), QUANTITIES[quantity].unit if quantity in QUANTITIES else ""


class BodySensor(ListsAttributes):
    """Motion of a body's centre of mass, or of a place on it: arrays over the result's times."""

    def __init__(self, result: RunStates, body: Body, point: Array | None = None) -> None:
        self._result, self._body = result, body
        drawn = body.drawn.position if point is None else point
        self._offset = body.drawn.rotation.T @ (drawn - body.drawn.position)

    @property
    def _called(self) -> str:
        return f"the sensor of body '{self._body.name}'"

    def at(self, point: Any) -> BodySensor:
        """A place of the body, given as drawn (inertial coordinates, m), or 0..1 along a link or beam."""
        return self._place(self._body.at(point).point)

    def _place(self, point: Array) -> BodySensor:
        """The sensor of a place (3,) as drawn, m."""
        return BodySensor(self._result, self._body, point)

    @cached_property
    def _node(self) -> Any:
        return self._result.prepared.model.node(self._body)

    @cached_property
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
    def position(self) -> Array:
        """(nt, 3), m."""
        center = self._body.drawn.position + np.zeros((len(self._result.t), 3))
        if self._node is not None:
            center = self._translation(self._result.q, self._node.q)
        return center + self.rotation @ self._offset

    @cached_property
    def velocity(self) -> Array:
        """(nt, 3), m/s."""
        center = self._translation(self._result.u, self._node.u if self._node is not None else 0)
        return center + np.cross(self.angular_velocity, self.rotation @ self._offset)

    @cached_property
    def angular_velocity(self) -> Array:
        """(nt, 3), rad/s, inertial frame."""
        out = np.zeros((len(self._result.t), 3))
        if self._node is not None and self._node.kind is NodeKind.PLANAR:
            out[:, 2] = self._result.u[:, self._node.u + 2]
        elif self._node is not None and self._node.kind is NodeKind.SPATIAL:
            out = np.einsum("tij,tj->ti", self.rotation, self._result.u[:, self._node.u + 3 : self._node.u + 6])
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
                why = "the bodies it connects do not show it: use model=mb.Classical(), where it is an unknown of its own"
                why = why if point is None else f"the point mass '{point}' has no orientation; use s.rigid_body"
                raise OptionError(f"{item.kind} '{item.name}': its {rates.get(name, name)} is not known: {why}")
            return found[name in rates]
        if name in (*item.coordinates, "angle", "displacement", "rate", "angle_rate", "displacement_rate"):
            has = f"its coordinates: {', '.join(names)}" if names else "it has no angle or displacement: read its bodies instead"
            raise OptionError(f"{item.kind} '{item.name}' has no {name}; {has}")
        return super().__getattr__(name)  # type: ignore[misc,no-any-return]

    def __dir__(self) -> list[str]:
        touches = any(one.item == self._item.name for one in self._result.prepared.contacts)
        known = [name for name in super().__dir__() if touches or name not in ("contacts", "summary")]
        return [*known, *self._item.scalars, *rates_of(self._item)]

    @cached_property
    def _wrench(self) -> Array:
        return self._result.sum_over_laws(reaction_outputs, self._item, 6)

    @property
    def force(self) -> Array:
        """(nt, 3) N on body l, inertial frame."""
        return self._wrench[:, :3]

    @property
    def torque(self) -> Array:
        """(nt, 3) N m on body l about the joint, inertial frame (in a planar model: the z component only)."""
        return self._wrench[:, 3:]

    @property
    def reaction_is_unique(self) -> bool:
        """False where redundant constraints could share the reaction: `force` and `torque` are then one of many possible
        values."""
        prefix = self._item.name + "."
        return not any(row.name.startswith(prefix) for row in self._result.prepared.rank.not_unique)

    @cached_property
    def contacts(self) -> Contacts:
        """Begin, end and peak penetration of every contact of a joint with clearance or limits, found on the steps of the run; of
        several limited coordinates all in order of time, each penetration in the unit of its coordinate."""
        known = [one for one in self._result.prepared.contacts if one.item == self._item.name]
        if not known:
            raise OptionError(f"{self._called[14:]} touches nothing: contacts are those of joints with clearance or with limits")
        return contacts_at(self._result.prepared, self._result.solution, known)

    def summary(self) -> dict[str, float]:
        """The contacts in numbers: see `Result.contacts`."""
        found = self.contacts
        return {"contacts": len(found), "first": found.first, "deepest": found.deepest}

    @cached_property
    def power(self) -> Array:
        """(nt,) W delivered to the bodies."""
        return self._result.sum_over_laws(power_outputs, self._item, 1)[:, 0]
