"""The time at which conditions of inputs, such as t < 1, are evaluated inside a run.

Feedback in a model: parameters of laws that are expressions of sensors.

Such an expression is brought into a form that equal laws with other numbers share: every sensor that it reads, every signal,
every number and every part that depends on time alone is replaced by a symbol. The frames and nodes that the sensors read are
added to those of the law.

Whether a scene lies in the plane, and its length.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from math import inf, isnan, nan
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import symengine as se

from mbdae.errors import LawError, SceneError
from mbdae.inputs.sensed import path_of, paths
from mbdae.inputs.tables import in_cases, lookup_of
from mbdae.inputs.text import TIME
from mbdae.scene.beams import mesh_of
from mbdae.scene.components import Beam, Body, Clearance, Connection, Signal
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import Sensed, found
from mbdae.symbolic.derive import Side
from mbdae.symbolic.frames import Axes
from mbdae.symbolic.law import Structure
from mbdae.symbolic.rebuild import is_condition, joined
from mbdae.symbolic.statement import Feeds, Reading
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Instance, JointMotion, Key, Node, rotation_matrices, sides_of
from mbdae.values import BadValueError

if TYPE_CHECKING:
    from mbdae.system.model.beams import Meshed


class ConditionTime:
    """The time at which conditions of inputs, such as t < 1, are evaluated. `time`: a fixed one within the present part of a run
    between two breaks, so that a condition does not change at the end of a step; None: just after the time at which the equations
    are evaluated, but before `end`, the end of the run."""

    def __init__(self) -> None:
        self.read = np.array([nan, inf])  #: (time, end), s, an array whose address the native evaluation holds; NaN: time is None

    @property
    def time(self) -> float | None:
        """The time in the present part of a run, s, or None."""
        return None if isnan(self.read[0]) else float(self.read[0])

    @time.setter
    def time(self, value: float | None) -> None:
        """Set the time, s, or None."""
        self.read[0] = nan if value is None else value

    @property
    def end(self) -> float:
        """The end of the run, s."""
        return float(self.read[1])

    @end.setter
    def end(self, value: float) -> None:
        """Set the end of the run, s."""
        self.read[1] = value


AT = 1e-9  #: a sensor on a beam is refused where the nearest node is farther than this part of the beam's length
HALF = se.Rational(1, 2)


@dataclass(frozen=True)
class Scenery:
    """Where sensors are found in a model. by_body, by_coordinate: the node of a body, and of a coordinate (joint, name) that is
    an unknown; meshes: those of beams; attached: the station to which (item, side) is attached on a beam; law_of: the law of a
    joint in this model."""

    scene: Any
    planar: bool
    by_body: Mapping[Any, Node]
    by_coordinate: Mapping[tuple[str, str], Node]
    meshes: Mapping[Beam, Meshed]
    attached: Mapping[tuple[str, str], Body]
    law_of: Callable[[Connection], Any]


@dataclass
class Fed:
    """The parameters of one law that are expressions of sensors. names: parameters and signals with their expressions; readings:
    the sensors in them; sides, nodes, frames: kinds, nodes and numbers of the frames that the sensors read; numbers, timed:
    numbers and functions of time in the expressions, by symbol; signals: of numbers that are values of signals, these signals;
    states: items whose internal state is read."""

    names: list[tuple[str, Expr]] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    sides: list[Side] = field(default_factory=list)
    nodes: list[Node | None] = field(default_factory=list)
    numbers: dict[str, float] = field(default_factory=dict)
    frames: dict[str, float] = field(default_factory=dict)
    timed: dict[str, Expr] = field(default_factory=dict)
    signals: dict[str, str] = field(default_factory=dict)
    states: list[str] = field(default_factory=list)

    @property
    def feeds(self) -> Feeds:
        """The readings and expressions alone, which are part of the structure that laws with one kernel share."""
        return Feeds(tuple(self.readings), tuple(self.names))


def fed_into(scenery: Scenery, values: Mapping[str, Any]) -> Fed:
    """The parameters of a law, among values by name, that are expressions of sensors."""
    made = _Feeding(scenery)
    for name, value in values.items():
        if paths(value):
            made.fed.names.append((name, made.shared(value, name)))
    return made.fed


class _Feeding:
    """Replaces sensors, signals, numbers and functions of time in the expressions of one law by symbols."""

    def __init__(self, scenery: Scenery) -> None:
        self.scenery, self.fed = scenery, Fed()
        self._known: dict[str, Expr] = {}  # path of a sensor -> its symbol
        self._given: dict[tuple[str, Expr], Expr] = {}  # (kind, number or function of time, or the signal it is of) -> its symbol

    def shared(self, e: Any, name: str) -> Expr:
        """The expression with its sensors, numbers and functions of time replaced by symbols, whose names begin with `name`."""
        e = se.sympify(e)
        free = e.free_symbols
        if is_condition(e) and free and free <= {TIME}:
            return se.Gt(self._parameter(name, "t", se.Piecewise((se.Integer(1), e), (se.Integer(0), se.true))), HALF)
        if isinstance(e, se.Symbol) and path_of(e):
            return self._of(path_of(e))
        if free and free <= {TIME}:
            return self._parameter(name, "t", e)
        if isinstance(e, se.RealDouble):
            return self._parameter(name, "n", e)
        if (curve := lookup_of(e)) is not None:
            at = self.shared(e.args[0], name)
            x = se.Symbol(f"{name}_x{len(self.fed.names) + 1}")
            self.fed.names.append((str(x), at))
            return in_cases(curve, x, lambda number: self._parameter(name, "n", se.RealDouble(number)))
        if not e.args:
            return e
        parts = e.args
        if isinstance(e, se.Pow) and parts[1].is_Number:
            return self.shared(parts[0], name) ** parts[1]
        return joined(e, [self.shared(part, name) for part in parts])

    def _parameter(self, name: str, kind: str, e: Expr, signal: str = "") -> Expr:
        """The symbol that replaces a number (kind "n") or a function of time (kind "t"), e; its name begins with `name`. The
        number of a signal shares its symbol with no other number: exports have it as an input."""
        known = (kind, signal or e)
        if known not in self._given:
            symbol = f"{name}_{kind}{len(self._given) + 1}"
            if kind == "n":
                self.fed.numbers[symbol] = float(e)
                self.fed.signals |= {symbol: signal} if signal else {}
            else:
                self.fed.timed[symbol] = e
            self._given[known] = se.Symbol(symbol)
        return self._given[known]

    def _of(self, path: str) -> Expr:
        """The symbol of a sensor or signal, such as "hinge.angle" (path); a new one is added to `fed`."""
        if path not in self._known:
            try:
                sensed = found(self.scenery.scene, path)
            except BadValueError as refused:
                raise SceneError([str(refused)]) from None
            if isinstance(sensed.item, Signal) and sensed.item.kind == "signal":
                e = sensed.item.value
                value = self._parameter("signal", "n", e, path) if isinstance(e, float) else self.shared(e, "signal")
                name = f"signal{len(self.fed.names) + 1}"
                self.fed.names.append((name, value))
            else:
                name = f"reading{len(self.fed.readings) + 1}"
                self.fed.readings.append(self._reading(name, sensed))
            self._known[path] = se.Symbol(name)
        return self._known[path]

    def _reading(self, symbol: str, sensed: Sensed) -> Reading:
        item = sensed.item
        if isinstance(item, Signal):
            self.fed.states.append(item.name)
            return Reading(symbol, "state", 0)
        return self._of_joint(symbol, sensed) if isinstance(item, Connection) else self._of_body(symbol, sensed)

    def _of_joint(self, symbol: str, sensed: Sensed) -> Reading:
        c, near = sensed.item, self.scenery
        node = near.by_coordinate.get((c.name, sensed.quantity))
        if node is not None:
            self.fed.sides.append((node.kind, Axes.GENERAL))
            self.fed.nodes.append(node)
            return Reading(symbol, "coordinate", 1, rated=sensed.rated)
        law = near.law_of(c)
        bodies = tuple(near.attached.get((c.name, side), body) for side, body in (("k", c.k), ("l", c.l)))
        self._frames(law, ("k", "l"), bodies)
        plain = Structure(options=tuple((option, None) for option in law.options))
        return Reading(symbol, "joint", 2, rated=sensed.rated, joint=(type(law), plain, sensed.quantity))

    def _of_body(self, symbol: str, sensed: Sensed) -> Reading:
        body = sensed.item
        point = body.drawn.position if sensed.point is None else sensed.point
        if isinstance(body, Beam):
            body = self._station(body, point)
        place = SimpleNamespace(frames=("b",), axes_of="k", at_nodes=True, point_on=lambda side: point)
        self._frames(place, ("b",), (body,))
        return Reading(symbol, sensed.quantity, 1, sensed.entry)

    def _station(self, beam: Beam, point: Any) -> Body:
        nearest = min(self.scenery.meshes[beam].stations, key=lambda s: float(np.linalg.norm(s.drawn.position - point)))
        length = float(np.linalg.norm(np.ptp(beam.outline, axis=0)))
        if np.linalg.norm(nearest.drawn.position - point) > AT * length:
            at = np.round(nearest.drawn.position, 9).tolist()
            raise SceneError([f"beam '{beam.name}' has no node at {np.round(point, 9).tolist()} m, where a sensor reads it; "
                              f"read the node at {at} m, or attach something at the place"])
        return nearest

    def _frames(self, law: Any, names: tuple[str, ...], bodies: tuple[Body, ...]) -> None:
        """Add the frames `names` of a law on bodies to `fed`, with the numbers (points and axes) of these frames."""
        nodes = tuple(self.scenery.by_body.get(b) for b in bodies)
        sides, numbers = sides_of(law, bodies, nodes, self.scenery.planar)
        for name in names:
            own = f"m{len(self.fed.sides) + names.index(name) + 1}"
            self.fed.frames |= {own + key[len(name) :]: v for key, v in numbers.items() if key.startswith(f"{name}_")}
        self.fed.sides += sides
        self.fed.nodes += nodes


def entry_of(scenery: Scenery, law: Any, bodies: tuple[Body, ...], ends: tuple[Node | None, ...],
             item: str) -> tuple[Key, Instance]:
    """The key of the group that a law belongs to, and its instance in the group. bodies, ends: the bodies of its frames and their
    nodes (None: ground); item: name of its item."""
    try:
        sides, numbers = sides_of(law, bodies, ends, scenery.planar)
    except LawError as error:
        raise LawError(f"'{item}': {error}") from error
    own = tuple(scenery.by_coordinate[key] for key in law.coordinates_in(item))
    values = {p: getattr(law, p) for p in law.params if getattr(law, p) is not None}
    fed = fed_into(scenery, values)
    values = {p: v for p, v in values.items() if p not in dict(fed.names)} | fed.numbers | fed.timed
    timed = {p: v for p, v in values.items() if not isinstance(v, float)}
    numbers |= fed.frames | {p: v for p, v in values.items() if p not in timed}
    structure = replace(law.structure(frozenset(timed)), feeds=fed.feeds)
    nodes, sides = (*ends, *own, *fed.nodes), (*sides, *((n.kind, Axes.GENERAL) for n in own), *fed.sides)
    return (type(law), structure, sides), Instance(law, nodes, numbers, timed, item, tuple(fed.states), fed.signals)


FLAT = 1e-12  #: distance of a point from the plane z = 0, over the scene's length, up to which it counts as lying in the plane


def scene_length(scene: SceneData) -> float:
    """Largest distance between any two points of the scene along an axis, m (1 m for a single point)."""
    points = [p for b in scene.bodies for p in (b.drawn.position, *b.outline)]
    points += [law.point_on(side) for c in scene.connections for law in c.laws for side in "kl"]
    races = [(c.joint, c.model.outer) for c in scene.joints if isinstance(c.model, Clearance)]
    points += [joint.at + side for joint, radius in races for side in (-radius * np.ones(3), radius * np.ones(3))]
    extent = float(np.max(np.ptp(np.array(points), axis=0))) if points else 0.0
    return extent if extent > 0 else 1.0


def out_of_plane(scene: SceneData, length: float, items: Collection[str] | None = None) -> str | None:
    """Reason why the scene is not planar: the first thing that leaves the plane z = 0; None where nothing does. length: that of
    the scene, m; items: names of those that are looked at, None: all."""
    bodies = [b for b in scene.bodies if items is None or b.name in items]
    connections = [c for c in scene.connections if items is None or c.name in items]
    tolerance = FLAT * length
    for b in (None, *bodies):
        g, of = (scene.gravity, "") if b is None else (b.gravity, f" of body '{b.name}'")
        if g is not None and abs(g[2]) > 0:
            return f"gravity{of} has the z component {g[2]:g} m/s^2"
    for b in bodies:
        points = np.array([b.drawn.position, *b.outline])
        if np.max(np.abs(points[:, 2])) > tolerance:
            return f"body '{b.name}' has a point at z = {points[np.argmax(np.abs(points[:, 2])), 2]:g} m"
        if np.max(np.abs(b.drawn.rotation[2] - [0, 0, 1])) > 1e-12:
            return f"body '{b.name}' is rotated out of the plane"
        if abs(b.drawn.velocity[2]) > 0 or np.max(np.abs(b.drawn.angular_velocity[:2])) > 0:
            return f"body '{b.name}' starts with a velocity out of the plane"
        if isinstance(b, Beam) and mesh_of(b).normal_axis is None:
            return f"beam '{b.name}' has no section axis normal to the plane"
        if b.inertia is not None and np.max(np.abs(b.inertia[2, :2])) > 1e-12 * np.abs(b.inertia).max(initial=1e-300):
            return f"body '{b.name}' has products of inertia with z"
    for load in scene.line_loads:
        if load.law.f3 is not None:
            return f"load '{load.name}' has a component 3, out of the plane"
        if load.law.following and not _upright(load.beam):
            return f"load '{load.name}' turns with the sections of beam '{load.beam.name}', whose axis 3 is not z"
    for c in connections:
        for law in c.laws:
            for point in (law.at, law.point_on("l")):
                if abs(point[2]) > tolerance:
                    return f"{c.kind} '{c.name}' has a point at z = {point[2]:g} m"
        if (c.hold or c.hold_rate) and JointMotion(c).leaves_plane(c.hold, c.hold_rate):
            return f"{c.kind} '{c.name}' starts out of the plane"
    return None


def _upright(beam: Beam) -> bool:
    """Whether section axis 3 is parallel to z along the whole beam."""
    mesh = mesh_of(beam)
    sections = rotation_matrices(mesh.quaternions[mesh.elements]) @ rotation_matrices(mesh.turns)
    return bool(np.all(sections[..., 2, 2] > 0.5))


@dataclass(frozen=True)
class Renewed:
    """How a model differs from that of which it was made. last: that model; timed: whether inputs of time may be others; placed:
    whether the places of bodies and joints, or velocities at the start, are; inertia: whether masses are."""

    last: Any
    timed: bool
    placed: bool
    inertia: bool
