"""Nodes of a model: bodies, nodes of beams, and coordinates of joints, each with its unknowns.

Rotations in numbers: quaternions (4,) of any length, rotation vectors, matrices.

The frames of a law in a model: kinds of their nodes, axes, and numbers.

The motion of a joint in numbers: where its coordinates put a body, and how fast.

Laws of a model in groups: laws of one class and structure between nodes of the same kinds, evaluated by one kernel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import nan
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.inputs import timed
from mbdae.process import made_once
from mbdae.scene.components import Body, Connection, Station
from mbdae.scene.scene import SceneData
from mbdae.scene.shapes import joint_axes
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Structure
from mbdae.symbolic.motion import Step, real_value, symbolic_motion
from mbdae.symbolic.stated import motion_key
from mbdae.system.base import Array, Kept


@dataclass(frozen=True)
class Node:
    """A node that moves: a body, a node of a beam, or a joint's coordinate that is an unknown. body: None for a coordinate; q, u:
    its first entries among all positions and velocities; unit: that of its translations, or of the coordinate; joint,
    coordinate: name of the joint and of the coordinate in it, for coordinates only."""

    name: str
    body: Body | None
    kind: NodeKind
    q: int
    u: int
    unit: str = "m"
    joint: str = ""
    coordinate: str = ""

    def position(self, q: Array) -> Array:
        """Position (3,) of the node at q (nq,), m."""
        r = np.zeros(3)
        r[: self.kind.translations] = q[self.q : self.q + self.kind.translations]
        return r


def quaternion_product(a: Array, b: Array) -> Array:
    """Quaternion product a o b of arrays (..., 4), scalar part first: the rotation b after a, in the axes that a has turned."""
    if a.ndim == b.ndim == 1:  # the formula below; for single quaternions Python numbers are much faster than arrays
        (s, x, y, z), (t, u, v, w) = a.tolist(), b.tolist()
        return np.array([s * t - (x * u + y * v + z * w), s * u + t * x + (y * w - z * v), s * v + t * y + (z * u - x * w),
                         s * w + t * z + (x * v - y * u)])
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def turned(P: Array, rotation: Array) -> Array:
    """Quaternions P (..., 4) after further rotations by rotation vectors (..., 3) in body axes, rad."""
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    half = np.sinc(angle / (2 * np.pi)) / 2
    return quaternion_product(P, np.concatenate([np.cos(angle / 2), half * rotation], axis=-1))


def rotation_matrices(P: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), which need not have unit length."""
    p = P / np.linalg.norm(P, axis=-1, keepdims=True)
    w, x, y, z = p.tolist() if p.ndim == 1 else np.moveaxis(p, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows) if p.ndim == 1 else np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion(R: Array) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(R, (-2, -1), (0, 1))
    K = np.array([
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, xy + yx, xz + zx],
        [xz - zx, xy + yx, yy - xx - zz, yz + zy],
        [yx - xy, xz + zx, yz + zy, zz - xx - yy],
    ])
    P: Array = np.linalg.eigh(np.moveaxis(K, (0, 1), (-2, -1)))[1][..., -1]
    return np.where(P[..., :1] >= 0, P, -P)


def drawn_quaternion(body: Body | None) -> Array:
    """Quaternion (4,) of a body's axes as drawn (None: the ground). P and -P are the same rotation: for a node of a beam the sign
    is that of its mesh, because quaternions that are interpolated along an element must not change sign between nodes."""
    if isinstance(body, Station):
        return body.quaternion
    return quaternion(body.drawn.rotation) if body is not None else np.eye(4)[0]


def rotation_of(kind: NodeKind, q: Array) -> Array:
    """Rotation matrix (3, 3) of a node of this kind at its positions q."""
    if kind is NodeKind.SPATIAL:
        return rotation_matrices(q[3:])
    if kind is NodeKind.PLANAR:
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.eye(3)


def sides_of(law: Any, bodies: tuple[Body, ...], nodes: tuple[Node | None, ...],
           planar: bool) -> tuple[tuple[Side, ...], dict[str, float]]:
    """Kind of node and structure of axes of every frame of a law, and the numbers of the frames by name: in body axes, the
    joint's point, the joint's axes, and the heading of the body (rad, in the plane)."""
    if isinstance(law, Element):
        assert nodes[0] is not None
        return ((nodes[0].kind, Axes.GENERAL),), {}
    sides: list[Side] = []
    numbers: dict[str, float] = {}
    for side, body, node in zip(law.frames, bodies, nodes, strict=True):
        kind = node.kind if node is not None else (NodeKind.PLANAR_GROUND if planar else NodeKind.GROUND)
        Q = body.drawn.rotation.T @ joint_axes(law, bodies[0], side)
        offset = body.drawn.rotation.T @ (law.point_on(side) - body.drawn.position)
        sides.append((kind, pattern(Q) if planar else Axes.GENERAL))
        numbers |= zip(_names(side), (*offset.tolist(), *Q.T.ravel().tolist(), body.heading), strict=True)
    if law.at_nodes:
        sides = [(kind, Axes.NORMAL if planar else Axes.GENERAL) for kind, _ in sides]
    return tuple(sides), numbers


@lru_cache(maxsize=64)
def _names(side: str) -> tuple[str, ...]:
    """Names of the numbers of a frame, in the order of `sides_of`: its point, its axes column by column, its heading."""
    axes = (f"{side}_Q{a}{i + 1}" for a in "xyz" for i in range(3))
    return *(f"{side}_p{i + 1}" for i in range(3)), *axes, f"{side}_theta0"


def pattern(Q: Array) -> Axes:
    """How the joint axes Q (columns, in body axes) of a planar scene lie, which decides which entries of Q are 0 or 1. Raises
    LawError where z of Q is neither in the plane nor normal to it."""
    if abs(Q[2, 2] - 1) < 1e-12:
        return Axes.NORMAL
    if abs(Q[2, 2] + 1) < 1e-12:
        return Axes.REVERSED
    if abs(Q[2, 2]) < 1e-12 and abs(Q[2, 0] - 1) < 1e-12:
        return Axes.IN_PLANE
    if abs(Q[2, 2]) < 1e-12:
        raise LawError(f"its axis is in the plane, but its x axis ({Q[0, 0]:.6g}, {Q[1, 0]:.6g}, {Q[2, 0]:.6g}) is not (0, 0, "
                       "1); omit axis_x")
    raise LawError(f"its axis ({Q[0, 2]:.6g}, {Q[1, 2]:.6g}, {Q[2, 2]:.6g}) is neither in the plane nor normal to it")


NO_TURN = np.eye(4)[0]


class JointMotion:
    """The motion of a joint as a chain of rotations and translations about and along axes as drawn. t: time (s) at which
    parameters that depend on time are evaluated; the chain is empty where the law states no motion."""

    def __init__(self, item: Connection, t: float = 0.0) -> None:
        law: Any = (item.as_kinematic or item.laws)[0] if item.loose else item.joint
        motion = symbolic_motion(law) if isinstance(law, Joint) else None  # a force states no motion
        self._steps = motion.steps if motion is not None else ()
        self._t, self.at = t, np.asarray(law.at, dtype=float)
        self._axes = joint_axes(law, item.k)

    def _direction(self, step: Step) -> Array:
        """Axis (3,) of a step of the chain as drawn, inertial components."""
        return np.asarray(self._axes @ [float(c) for c in step.axis])

    def _amount(self, e: Any, values: dict[str, float]) -> float:
        if e.is_Symbol and str(e) != "t":  # the most frequent case, without substitution
            return float(values.get(str(e), 0.0))
        numbers = {s: values.get(str(s), 0.0) for s in e.free_symbols if str(s) != "t"}
        found = e.subs(numbers)
        number = timed.value_at(found, self._t) if found.free_symbols else real_value(found)
        return number if math.isfinite(number) else math.nan

    def drawn(self, values: dict[str, float], outwards: bool) -> tuple[Array, Array]:
        """Rigid motion (quaternion, displacement, m) of l from its drawn place, relative to k, at values of the coordinates;
        those not given are 0. outwards: False gives the inverse motion, of k relative to l."""
        P, r = NO_TURN, np.zeros(3)
        for step in self._steps:  # a free rotation is not turned: the amount of its step is 0
            amount = self._amount(step.amount, values)
            if not amount:
                continue
            axis = self._direction(step)
            if step.turns:
                dP = turned(NO_TURN, amount * axis)
                P, r = quaternion_product(P, dP), r + rotation_matrices(P) @ (self.at - rotation_matrices(dP) @ self.at)
            else:
                r = r + rotation_matrices(P) @ (amount * axis)
        if outwards:
            return P, r
        back = P * np.array([1.0, -1.0, -1.0, -1.0])
        return back, -rotation_matrices(back) @ r

    def leaves_plane(self, values: dict[str, float], rates: dict[str, float]) -> bool:
        """Whether a start with these values or rates lies or moves out of the plane z = 0."""
        (_, *p), r = self.drawn(values, True)
        _, v, w = self.rates(values, rates)
        return bool(np.any(np.abs([p[0], p[1], r[2], v[2], w[0], w[1]]) > 1e-12))

    def not_as_drawn(self, length: float) -> str:
        """Error message where the motion moves l from its drawn place although all coordinates are 0; "" where it does not.
        length: that of the scene, m."""
        P, r = self.drawn({}, True)
        if np.max(np.abs(P[1:])) <= 1e-9 and np.max(np.abs(r)) <= 1e-9 * length:
            return ""
        turned = 2 * np.arcsin(np.minimum(1.0, np.linalg.norm(P[1:])))
        return (f"its method `motion` moves the second body (l) by {np.linalg.norm(r):.3g} m and turns it by {turned:.3g} rad "
                "where its coordinates are 0, but there both bodies have to be as drawn; state the motion without this offset, "
                "or draw l there")

    def planar_turn(self, values: dict[str, float]) -> float:
        """Rotation of body l relative to k about z at these values of the coordinates, whole turns included, rad."""
        return sum(self._amount(s.amount, values) * float(self._direction(s)[2]) for s in self._steps if s.turns)

    def rates(self, values: dict[str, float], rates: dict[str, float]) -> tuple[Array, Array, Array]:
        """Relative motion of the bodies k and l: vector from the joint's point on k to that on l, its velocity, and the angular
        velocity of l relative to k, (3,) each, in axes fixed to k that were inertial as drawn."""
        P, way, v, w = NO_TURN, np.zeros(3), np.zeros(3), np.zeros(3)
        for step in self._steps:
            axis = rotation_matrices(P) @ self._direction(step)
            amount = self._amount(step.amount, values)
            rate = sum(self._amount(se.diff(step.amount, se.Symbol(c)), values) * r for c, r in rates.items())
            if step.turns:
                P = quaternion_product(P, turned(NO_TURN, amount * self._direction(step))) if amount else P
                w = w + rate * axis
            else:
                way, v = way + amount * axis, v + rate * axis + np.cross(w, amount * axis)
        return way, v, w


def out_of_plane_motions(scene: SceneData) -> dict[str, str]:
    """Recursive joints of a planar scene that are treated as kinematic, and why: some of their coordinates would move bodies out
    of the plane, or one is a free rotation. (A joint all of whose coordinates do so makes the scene spatial elsewhere.)"""
    found = {}
    for c in (c for c in scene.joints if c.recursive):
        across = [name for name in c.coordinates if JointMotion(c).leaves_plane({name: 1.0}, {name: 1.0})]
        if "rotation" in map(c.unit, c.coordinates):
            found[c.name] = "in the plane its rotation is an angle: state a revolute joint to make it recursive"
        elif 0 < len(across) < len(c.coordinates):
            found[c.name] = f"in a planar scene its {across[0]} stays 0: as a recursive joint it would move out of the plane"
    return found


Key = tuple[Any, Structure, tuple[Side, ...]]  #: class of a law, its structure, kinds of nodes and axes of its frames


@dataclass
class Instance:
    """One law of the scene with the nodes it acts between (None: the ground). numbers: points and axes of its frames and its
    constant parameters, by name; signals: of these the values of signals, with their names; item: of the joint, force or body."""

    law: Any
    nodes: tuple[Node | None, ...]
    numbers: dict[str, float]
    timed: dict[str, Any]  #: parameter -> expression of time
    item: str
    states: tuple[str, ...] = ()  #: names of other items whose internal state the law reads
    signals: Mapping[str, str] = field(default_factory=dict)


@dataclass
class Group:
    """All laws of one class and structure between nodes of the same kinds: one kernel evaluates them. derived: the expressions
    derived from what the law stated when the model was made, which all instances share."""

    key: Key
    derived: Derived
    instances: list[Instance] = field(default_factory=list)
    constants: dict[int, Any] = field(default_factory=dict, repr=False, compare=False)  #: see `Numbering.constants`

    @cached_property
    def motion(self) -> object:
        """What stands for the motion of a joint, see `motion_key`."""
        return motion_key(*self.key[:2])

    @cached_property
    def side_numbers(self) -> dict[str, int]:
        """Name of a frame -> position of its node in `Instance.nodes`."""
        return {f.side: n for n, f in enumerate(self.derived.frames)}

    @cached_property
    def names_of_numbers(self) -> dict[str, int]:
        """Name of a number of the laws -> its column in `numbers`."""
        return {name: n for n, name in enumerate(dict.fromkeys(name for i in self.instances for name in i.numbers))}

    @cached_property
    def numbers(self) -> Array:
        """(instances, names) numbers of its laws; NaN where a law has none of that name."""
        names = self.names_of_numbers
        rows = [[i.numbers.get(name, nan) for name in names] for i in self.instances]
        return np.array(rows, dtype=float).reshape(len(rows), len(names))

    def again(self) -> Group:
        """A copy in which single laws may be replaced by `put`."""
        made = Group(self.key, self.derived, [*self.instances], self.constants)
        vars(made).update({name: value for name, value in vars(self).items() if name not in vars(made)})
        return made

    def put(self, i: int, instance: Instance) -> None:
        """Replace a law by one whose numbers have the same names."""
        if instance.numbers != self.instances[i].numbers:
            vars(self).update(numbers=self.numbers.copy(), constants={})
            self.numbers[i, [self.names_of_numbers[name] for name in instance.numbers]] = [*instance.numbers.values()]
        self.instances[i] = instance

    def side(self, name: str) -> list[Node]:
        """Of every instance the node of the frame `name`."""
        n = self.side_numbers[name]
        return [i.nodes[n] for i in self.instances]  # type: ignore[misc]


class Groups(dict[Key, Group]):
    """Groups by their keys. A law is derived when the first of its group is added."""

    def of(self, key: Key) -> Group:
        """The group with a key, made where there is none."""
        found = self.get(key)
        if found is None:
            found = self[key] = Group(key, derive(*key))
        return found


class Shape:
    """What models that differ in numbers alone have in common, such as lists of operations: kept by name."""

    def __init__(self) -> None:
        self.kept = Kept()


@made_once("plan", 32)
def shape_of(key: Any) -> Shape:
    """The shape of all models with the same nodes, laws and names of numbers (key)."""
    return Shape()
