"""From a scene to its model: nodes, and groups of equal laws between them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import symengine as se

from mbdae.deferred import later
from mbdae.errors import LawError, SceneError
from mbdae.laws.bodies import BeamNode, JointCoordinate, PointMass, RigidBody
from mbdae.laws.forces import Gravity
from mbdae.scene.changed import carried_over, drawn_as
from mbdae.scene.components import Beam, Body, Connection, Station
from mbdae.scene.record import apart, models_of
from mbdae.scene.scene import SceneData, refuse_other_laws
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element
from mbdae.system.base import Kept
from mbdae.system.model.feedback import ConditionTime, Renewed, Scenery, entry_of, out_of_plane, scene_length
from mbdae.system.model.nodes import (
    Group,
    Groups,
    Instance,
    JointMotion,
    Key,
    Node,
    Shape,
    out_of_plane_motions,
    shape_of,
)

if TYPE_CHECKING:
    from mbdae.system.model.beams import Line, meshed
else:
    Line, meshed = later("mbdae.system.model.beams", "Line", "meshed")

ALL = 6  #: degrees of freedom of a rigid body in space


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
    def listed(self) -> Any:
        """The numbers of all laws one after the other, group by group."""
        return np.concatenate([np.zeros(0), *(group.numbers.ravel() for group in self.groups)])

    @cached_property
    def nu(self) -> int:
        """Number of velocity unknowns."""
        return sum(n.kind.sizes[1] for n in self.nodes)

    @cached_property
    def elastic(self) -> bool:
        """Whether it has elastic bodies, whose fast vibrations hardly move them: steps may pass over these."""
        return bool(self.lines) or any(group.derived.law.elastic for group in self.groups)

    @cached_property
    def shape(self) -> Shape:
        """What it has in common with models that differ in numbers alone; beams have theirs for themselves."""
        if self.lines:
            return Shape()
        laws = [(g.derived, g.key, *((i.item, *(n and n.name for n in i.nodes), *i.numbers, *i.timed.items(), *i.states)
                                     for i in g.instances)) for g in self.groups]
        return shape_of((self.planar, *((n.name, n.kind, n.q, n.u, n.unit) for n in self.nodes), *laws))

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
    known, key = models_of(scene), (scene.space, *kept.items())
    last = known.get(key)
    found = None
    with suppress(LawError):  # of the plane
        found = _renewed(last, scene, kept) if last is not None and last.scene is not scene else None
    made = known[key] = found or _built(scene, kept)
    made.kept["by_rows"] = kept
    return made


def _built(scene: SceneData, kept: dict[str, str]) -> Model:
    if scene.space != "spatial":
        reason = out_of_plane(scene, scene_length(scene))
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


def _renewed(last: Model, scene: SceneData, kept: dict[str, str]) -> Model | None:
    """The model of a scene that shares items with the scene of another model: the laws of the others alone are read. None where
    its laws have other equations, or for other reasons to build it whole."""
    items, theirs = apart(scene, last.scene), last.scene
    own = not all(name.startswith("mbdae:") for name in scene.own)
    if items is None or last.lines or own or scene.gravity is not theirs.gravity or any(
            getattr(i.law, p) != i.numbers[p] for _, _, i in last.instances() for p in i.law.params if p in i.numbers):
        return None
    bodies, connections = [b for b in scene.bodies if b.name in items], [c for c in scene.connections if c.name in items]
    alike = {b.name for b in bodies if drawn_as(b, theirs[b.name])}
    alike |= (connected := {c.name for c in connections if carried_over(c, theirs[c.name])})
    length = last.length if len(alike) == len(bodies) + len(connections) else scene_length(scene)
    joints = [c for c in connections if c.name not in alike]
    why = out_of_plane(scene, length, items - {c.name for c in connections if c.name in alike} if last.planar else None)
    across = out_of_plane_motions(scene) if last.planar and any(c.recursive for c in joints) else {}
    if (last.planar is (why is not None) and scene.space != "spatial") or (across and kept | across != last.stay_kinematic):
        return None
    kept = last.stay_kinematic
    nodes = [replace(n, body=scene[n.name]) if n.body is not None and n.name in items else n for n in last.nodes]
    by_body = {n.body: n for n in nodes if n.body is not None}
    by_coordinate = {(n.joint, n.coordinate): n for n in nodes if n.body is None}
    scenery = Scenery(scene, last.planar, by_body, by_coordinate, {}, {}, lambda c: laws_of(c, kept)[0])
    at = {item: iter(places) for item, places in last.kept["places"].items() if item in items}
    groups, timed, placed, inertia = [*last.groups], False, False, False
    for law, sides, item in _laws(scene, kept, {}, bodies, connections, ()):
        (g, i), ends = next(at[item], (-1, 0)), tuple(by_body.get(b) for b in sides)
        old, key = groups[g].instances[i], groups[g].key
        if (instance := _carried(law, old, key, ends, item in connected) if item in alike else None) is None:
            key, instance = entry_of(scenery, law, sides, ends, item)
        if g < 0 or key != groups[g].key or (*instance.numbers, *instance.timed) != (*old.numbers, *old.timed):
            return None
        if groups[g] is last.groups[g]:
            groups[g] = groups[g].again()
        groups[g].put(i, instance)
        changed = {n for n, v in instance.numbers.items() if v != old.numbers[n]}
        if isinstance(law, Element) and any(not instance.numbers[n] or not old.numbers[n] for n in changed):
            return None  # what is 0 may be left out
        timed |= instance.timed != old.timed
        placed |= bool(changed) and (bool(groups[g].derived.rows) or not changed <= law.params.keys())
        inertia |= isinstance(law, Element) and bool(changed)
    placed |= any(b.name not in alike for b in bodies) or any(
        (c.hold, c.hold_rate) != (theirs[c.name].hold, theirs[c.name].hold_rate) for c in joints)
    if any(next(left, None) for left in at.values()) or any(
            c.rotor or JointMotion(c).not_as_drawn(length) for c in joints if c.is_joint):
        return None
    made = replace(last, scene=scene, why=last.why if last.planar else why or last.why, nodes=nodes, groups=groups, length=length,
                   scenery=scenery, conditions=ConditionTime())
    last.kept.pop(Renewed, None)  # of the model before
    made.kept.update({"places": last.kept["places"], Renewed: Renewed(last, timed, placed, inertia)})
    if not timed:
        vars(made)["shape"] = last.shape
    return made


def _carried(law: Any, old: Instance, key: Key, ends: tuple[Node | None, ...], same: bool) -> Instance | None:
    """The instance, in place of an old one, of a law whose item is drawn as before; None where it has other equations or reads
    other items. same: whether it states the same, on bodies that may be others; else its parameters may be."""
    stated = {} if same else {p: v for p in law.params if isinstance(v := getattr(law, p), float)}
    if not same and (key != (type(law), law.structure(frozenset(old.timed)), key[2]) or not stated.keys() <= old.numbers.keys()):
        return None
    return Instance(law, (*ends, *old.nodes[len(ends) :]), old.numbers | stated, old.timed, old.item, old.states, old.signals)


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
    places: dict[str, list[tuple[int, int]]] = {}
    given = _laws(scene, kept, attached, [b for b in by_body if b is not None], scene.connections, scene.signals)
    for law, bodies, item in given:
        key, instance = entry_of(scenery, law, bodies, tuple(by_body.get(b) for b in bodies), item)
        try:
            group = groups.of(key)
            group.instances.append(instance)
            derived = group.derived
            places.setdefault(item, []).append((list(groups).index(key), len(group.instances) - 1))
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
    made = Model(scene, planar, why, nodes, list(groups.values()), length, vanished, kept, lines, attached, undefined, scenery)
    made.kept["places"] = places
    return made


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


def _laws(scene: SceneData, kept: Mapping[str, str], attached: Mapping[tuple[str, str], Body], nodes: Collection[Body],
          connections: Collection[Connection], signals: Collection[Any]) -> list[tuple[Any, tuple[Body, ...], str]]:
    """Laws of the model with their bodies and the name of the item: elements and gravity of bodies (nodes), joints and forces,
    controllers."""
    out: list[tuple[Any, tuple[Body, ...], str]] = []
    for b in nodes:
        out.append((element_of(b), (b,), b.name))
        own = scene.gravity if b.gravity is None else b.gravity
        if np.any(own) and b.mass:
            field_ = {n: float(g) for n, g in zip(("gx", "gy", "gz"), own, strict=True) if g}
            gravity = Gravity(b.name, scene.ground, b, b.drawn.position, mass=float(b.mass), **field_)
            out.append((gravity, (scene.ground, b), b.name))
    for c in connections:
        sides = {side: attached.get((c.name, side), body) for side, body in (("k", c.k), ("l", c.l), *c.others.items())}
        out += [(law, tuple(sides[side] for side in law.frames), c.name) for law in laws_of(c, kept)]
    out += [(signal.law, (), signal.name) for signal in signals if signal.law is not None]
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
