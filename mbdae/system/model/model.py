"""From a scene to its model: nodes, and groups of equal laws between them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import symengine as se

from mbdae.deferred import later
from mbdae.errors import LawError, SceneError
from mbdae.laws.bodies import BeamNode, JointCoordinate, PointMass, RigidBody
from mbdae.laws.forces import Gravity
from mbdae.scene.beams import mesh_of
from mbdae.scene.components import Beam, Body, Clearance, Connection, Station
from mbdae.scene.scene import SceneData, refuse_other_laws
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element
from mbdae.system.base import Kept
from mbdae.system.model.feedback import ConditionTime, Scenery, fed_into
from mbdae.system.model.nodes import (
    Group,
    Groups,
    Instance,
    JointMotion,
    Key,
    Node,
    out_of_plane_motions,
    rotation_matrices,
    sides_of,
)

if TYPE_CHECKING:
    from mbdae.system.model.beams import Line, meshed
else:
    Line, meshed = later("mbdae.system.model.beams", "Line", "meshed")

ALL = 6  #: degrees of freedom of a rigid body in space
FLAT = 1e-12  #: distance of a point from the plane z = 0, over the scene's length, up to which it counts as lying in the plane


@dataclass(frozen=True)
class Model:
    """A scene in the plane or in space as nodes (what has unknowns: bodies, nodes of beams, joint coordinates) and laws between
    them in groups."""

    scene: SceneData
    planar: bool
    why: str  #: reason why the scene is planar, or why it is not
    nodes: list[Node]
    groups: list[Group]
    length: float  #: size of the scene, m: its largest extent along an axis
    vanished: list[str]  #: "joint.row" of constraint rows that are identically zero (in the plane), or undefined
    stay_kinematic: dict[str, str] = field(default_factory=dict)  #: recursive or rigid joints treated as kinematic -> why
    lines: list[Line] = field(default_factory=list)  #: flexible beams
    attached: dict[tuple[str, str], Body] = field(default_factory=dict)  #: (item, side) on a beam -> the node it is attached to
    undefined: list[str] = field(default_factory=list)  #: vanished rows that are undefined: a point mass has no axes
    scenery: Any = None  #: nodes by which sensors are found, see `Scenery`
    conditions: ConditionTime = field(default_factory=ConditionTime)
    kept: Kept = field(default_factory=Kept, init=False, repr=False, compare=False)  #: what is made once of rows in force

    @cached_property
    def nq(self) -> int:
        """Number of position unknowns."""
        return sum(n.kind.sizes[0] for n in self.nodes)

    @cached_property
    def nu(self) -> int:
        """Number of velocity unknowns."""
        return sum(n.kind.sizes[1] for n in self.nodes)

    @cached_property
    def elastic(self) -> bool:
        """Whether it has elastic bodies, whose fast vibrations hardly move them: steps may pass over these."""
        return bool(self.lines) or any(group.derived.law.elastic for group in self.groups)

    @property
    def bodies(self) -> list[tuple[Node, Body]]:
        """Every node that is a body or a node of a beam, with its body (the station of a beam)."""
        return [(n, n.body) for n in self.nodes if n.body is not None]

    def ends(self, c: Connection) -> tuple[Body, Body]:
        """The two bodies that an item connects; for a beam the station (node) to which the item is attached."""
        return self.attached.get((c.name, "k"), c.k), self.attached.get((c.name, "l"), c.l)

    def line(self, beam: Body) -> Line | None:
        """The nodes and elements of a beam, None where the body is no beam of the model."""
        return next((line for line in self.lines if line.beam is beam), None)

    @cached_property
    def joint_coordinates(self) -> list[Node]:
        """Nodes of the joint coordinates that are unknowns of their own."""
        return [n for n in self.nodes if n.body is None]

    def coordinate_node(self, joint: str, coordinate: str) -> Node | None:
        """The node of a joint's coordinate; None where it is not an unknown of its own."""
        return self._by_coordinate.get((joint, coordinate))

    @cached_property
    def _by_coordinate(self) -> dict[tuple[str, str], Node]:
        return {(n.joint, n.coordinate): n for n in self.joint_coordinates}

    @property
    def recursive(self) -> list[Connection]:
        """Joints that are recursive in this model: stated so, and not treated as kinematic."""
        return [c for c in self.scene.joints if c.recursive and c.name not in self.stay_kinematic]

    def instances(self) -> Iterator[tuple[int, int, Instance]]:
        """Every law of the model with the numbers of its group and instance."""
        for g, group in enumerate(self.groups):
            for i, instance in enumerate(group.instances):
                yield g, i, instance

    def node(self, body: Body) -> Node | None:
        """The node of a body, None for the ground and for a beam as a whole."""
        return self._by_body.get(body)

    @cached_property
    def _by_body(self) -> dict[Body, Node]:
        return {n.body: n for n in self.nodes if n.body is not None}


def build(scene: SceneData, kept: Mapping[str, str] | None = None) -> Model:
    """The model of a scene; space="auto" tries the plane first and stores the reason where that is not possible.

    kept: joints stated as recursive that are treated as kinematic, and why."""
    refuse_other_laws(scene)
    kept = _changing(scene) | dict(kept or {})
    if scene.space != "spatial":
        reason = out_of_plane(scene)
        if reason is None:
            try:
                flat = "every point, axis, velocity and load lies in the plane z = 0 and no law leaves it"
                return _assemble(scene, True, kept | out_of_plane_motions(scene), flat)
            except LawError as error:
                reason = str(error)
        if scene.space == "planar":
            raise SceneError([f"scene '{scene.name}': space='planar' is not possible: {reason}; use space='auto' or 'spatial'"])
        return _assemble(scene, False, kept, reason)
    return _assemble(scene, False, kept, "space='spatial' was asked for")


def _changing(scene: SceneData) -> dict[str, str]:
    """Recursive joints that are treated as kinematic because a parameter depends on time: programs of trees take constants
    only."""
    found = {}
    for c in (c for c in scene.joints if c.recursive):
        for name in c.joint.params.keys() - c.joint.drives().keys():
            if getattr(se.sympify(getattr(c.joint, name) or 0), "free_symbols", None):
                found[c.name] = f"its parameter {name} depends on time"
    return found


def scene_length(scene: SceneData) -> float:
    """Largest distance between any two points of the scene along an axis, m (1 m for a single point)."""
    points = [p for b in scene.bodies for p in (b.drawn.position, *b.outline)]
    points += [law.point_on(side) for c in scene.connections for law in c.laws for side in "kl"]
    races = [(c.joint, c.model.outer) for c in scene.joints if isinstance(c.model, Clearance)]
    points += [joint.at + side for joint, radius in races for side in (-radius * np.ones(3), radius * np.ones(3))]
    extent = float(np.max(np.ptp(np.array(points), axis=0))) if points else 0.0
    return extent if extent > 0 else 1.0


def out_of_plane(scene: SceneData) -> str | None:
    """Reason why the scene is not planar: the first thing that leaves the plane z = 0; None where nothing does."""
    tolerance = FLAT * scene_length(scene)
    for b in (None, *scene.bodies):
        g, of = (scene.gravity, "") if b is None else (b.gravity, f" of body '{b.name}'")
        if g is not None and abs(g[2]) > 0:
            return f"gravity{of} has the z component {g[2]:g} m/s^2"
    for b in scene.bodies:
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
    for c in scene.connections:
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


def _assemble(scene: SceneData, planar: bool, kept: dict[str, str], why: str) -> Model:
    nodes, q, u = [], 0, 0
    point, turning = (NodeKind.PLANAR_POINT, NodeKind.PLANAR) if planar else (NodeKind.POINT, NodeKind.SPATIAL)
    meshes, attached = meshed(scene, planar) if any(isinstance(b, Beam) for b in scene.bodies) else ({}, {})
    for b in [body for given in scene.bodies for body in (meshes[given].stations if isinstance(given, Beam) else [given])]:
        kind = point if b.is_point else turning
        nodes.append(Node(b.name, b, kind, q, u))
        q, u = q + kind.sizes[0], u + kind.sizes[1]
    by_body = {n.body: n for n in nodes}
    lines = [Line(b, m.mesh, [by_body[s] for s in m.stations], turning, scene) for b, m in meshes.items()]
    for c in scene.joints:
        law = laws_of(c, kept)[0]
        for name in law.own_coordinates:
            called = c.name if len(law.coordinates) == 1 else f"{c.name}.{name}"
            unit = law.coordinates[name].unit
            kind = NodeKind.ROTATION if unit == "rotation" else NodeKind.COORDINATE
            nodes.append(Node(called, None, kind, q, u, unit, c.name, name))
            q, u = q + kind.sizes[0], u + kind.sizes[1]
    by_coordinate = {(n.joint, n.coordinate): n for n in nodes if n.body is None}
    scenery = Scenery(scene, planar, by_body, by_coordinate, meshes, attached, lambda c: laws_of(c, kept)[0])
    joints = {c.name: c for c in scene.joints}
    groups = Groups()
    vanished: list[str] = []
    undefined: list[str] = []
    refused: list[str] = []
    for law, bodies, item in _laws(scene, kept, attached, [b for b in by_body if b is not None]):
        key, instance = entry_of(scenery, law, bodies, tuple(by_body.get(b) for b in bodies), item)
        try:
            group = groups.of(key)
            group.instances.append(instance)
            derived = group.derived
            vanished += [f"{item}.{row}" for row in derived.vanished]
            undefined += [f"{item}.{row}" for row in derived.undefined]
            if isinstance(law, Joint) and not joints[item].loose:
                refused += without_rows(item, derived)
            if without := law.drives().keys() & set(derived.vanished):
                refused.append(f"'{item}': prescribed motion has no effect: " + ("its equation always holds; leave it out" if
                    not without & set(derived.undefined) else "a point mass has no orientation; use s.rigid_body"))
        except LawError as error:
            if planar:
                raise LawError(f"'{item}': {error}") from error
            refused.append(f"'{item}': {error}")
    length = scene_length(scene)
    refused += [f"{c.kind} '{c.name}': {off}" for c in scene.joints if (off := JointMotion(c).not_as_drawn(length))]
    if refused:
        raise SceneError(refused)
    for n in by_coordinate.values():
        rotor = joints[n.joint].rotor.get(n.coordinate) or None
        law = JointCoordinate(n.name, rotor=rotor)
        key = (JointCoordinate, law.structure(frozenset()), ((n.kind, Axes.GENERAL),))
        groups.of(key).instances.append(Instance(law, (n,), {} if rotor is None else {"rotor": rotor}, {}, n.name))
    return Model(scene, planar, why, nodes, list(groups.values()), length, vanished, kept, lines, attached, undefined, scenery)


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


def without_rows(item: str, d: Derived) -> list[str]:
    """Error messages for a joint that constrains nothing; rows that are satisfied in the plane are no error."""
    if d.rows or (d.vanished and not d.undefined) or d.law.freedoms() == ALL:
        return []
    if d.undefined:
        return [f"'{item}': no row is left of this joint: {', '.join(d.undefined)} need an orientation, which a point mass does "
                f"not have; use s.rigid_body, or omit the joint"]
    return [f"'{item}': {type(d.law).__name__} states no row, so that it constrains nothing; state rows, or make it an mb.Force"]


def laws_of(c: Connection, kept: Mapping[str, str]) -> list[Any]:
    """The laws of an item in the model; kept: names of recursive joints that are treated as kinematic."""
    return c.as_kinematic or c.laws if c.name in kept else c.laws


def _laws(scene: SceneData, kept: Mapping[str, str], attached: Mapping[tuple[str, str], Body],
          nodes: Collection[Body]) -> list[tuple[Any, tuple[Body, ...], str]]:
    """Every law of the model with its bodies and the name of its item: elements, gravity, joints and forces, controllers."""
    out: list[tuple[Any, tuple[Body, ...], str]] = []
    for b in nodes:
        out.append((element_of(b), (b,), b.name))
        own = scene.gravity if b.gravity is None else b.gravity
        if np.any(own) and b.mass:
            field_ = {n: float(g) for n, g in zip(("gx", "gy", "gz"), own, strict=True) if g}
            gravity = Gravity(b.name, scene.ground, b, b.drawn.position, mass=float(b.mass), **field_)
            out.append((gravity, (scene.ground, b), b.name))
    for c in scene.connections:
        sides = {side: attached.get((c.name, side), body) for side, body in (("k", c.k), ("l", c.l), *c.others.items())}
        out += [(law, tuple(sides[side] for side in law.frames), c.name) for law in laws_of(c, kept)]
    out += [(signal.law, (), signal.name) for signal in scene.signals if signal.law is not None]
    return out


def element_of(b: Body) -> Element:
    """The law of a body's inertia: rigid body, point mass, or node of a beam, whose inertia is that of the beam's elements."""
    if isinstance(b, Station):
        return BeamNode(b.name)
    if b.inertia is None:
        return PointMass(b.name, mass=float(b.mass))
    J = b.inertia.astype(float)
    products = {"Jxy": float(J[0, 1]), "Jxz": float(J[0, 2]), "Jyz": float(J[1, 2])} if np.any(J - np.diag(np.diag(J))) else {}
    return RigidBody(b.name, mass=float(b.mass), Jxx=float(J[0, 0]), Jyy=float(J[1, 1]), Jzz=float(J[2, 2]), **products)
