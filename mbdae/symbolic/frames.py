"""Abstract frames: the quantities of the two bodies from which a law is stated.

A frame is a point with three axes, fixed to a body. Its components are opaque symbols; how they follow
from the unknowns of the body's node is written once per kind of node:

    spatial   r = (r1, r2, r3), quaternion P; u = (v, Omega), v inertial, Omega in body components
    planar    r = (r1, r2, 0), R = Rz(theta);  u = (v1, v2, theta')
    point     r only: a mass point has no orientation, rows that need one are left out
    joint coordinate   one scalar of a joint, without mass, in the first component of r
    joint rotation     free rotation of a joint, without mass: quaternion P from the axes before it, Omega in those after it
    ground    constants only

One rule gives every variation: a vector a fixed to the frame changes by delta a = delta psi x a.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, lru_cache

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec, rotation_columns, rotation_per_component

#: kind of node -> numbers of its position and of its velocity unknowns
SIZES = {"spatial": (7, 6), "planar": (3, 3), "point": (3, 3), "planar point": (2, 2), "ground": (0, 0), "planar ground": (0, 0),
         "joint coordinate": (1, 1), "joint rotation": (4, 3)}


class NodeKind(Enum):
    """Kind of the node a frame is fixed to."""

    SPATIAL = "spatial"
    PLANAR = "planar"
    POINT = "point"
    PLANAR_POINT = "planar point"
    GROUND = "ground"
    PLANAR_GROUND = "planar ground"
    COORDINATE = "joint coordinate"
    ROTATION = "joint rotation"

    @property
    def turns(self) -> bool:
        """Whether the node has rotational unknowns."""
        return self in (NodeKind.SPATIAL, NodeKind.PLANAR, NodeKind.ROTATION)

    @property
    def by_quaternion(self) -> bool:
        """Whether the rotational unknowns are a quaternion, after the translations."""
        return self in (NodeKind.SPATIAL, NodeKind.ROTATION)

    @property
    def of_joint(self) -> bool:
        """Whether the node is a coordinate of a joint."""
        return self in (NodeKind.COORDINATE, NodeKind.ROTATION)

    @property
    def flat(self) -> bool:
        """Whether the node moves in the plane z = 0 only."""
        return self in (NodeKind.PLANAR, NodeKind.PLANAR_POINT, NodeKind.PLANAR_GROUND)

    @property
    def moves(self) -> bool:
        """Whether the node has unknowns at all."""
        return self not in (NodeKind.GROUND, NodeKind.PLANAR_GROUND)

    @property
    def oriented(self) -> bool:
        """Whether the node has axes: all but mass points."""
        return self not in (NodeKind.POINT, NodeKind.PLANAR_POINT)

    @cached_property
    def translations(self) -> int:
        """Number of unknowns before those of rotation (the one unknown of a joint coordinate is counted here)."""
        return {(7, 6): 3, (4, 3): 0, (3, 3): 2 if self is NodeKind.PLANAR else 3}.get(self.sizes, self.sizes[0])

    @cached_property
    def sizes(self) -> tuple[int, int]:
        """Number of position and velocity unknowns."""
        return SIZES[self._value_]


class Axes(Enum):
    """Structure of the constant matrix Q of joint axes in the body (its columns); numbers stay parameters."""

    GENERAL = "general"
    NORMAL = "normal to the plane"  #: [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    REVERSED = "against the normal"  #: [[c, s, 0], [s, -c, 0], [0, 0, -1]]
    IN_PLANE = "in the plane"  #: x = normal, z = (a, b, 0), y = z x x


def _symbols(prefix: str, count: int) -> list[Expr]:
    return [se.Symbol(f"{prefix}{i + 1}") for i in range(count)]


def _vec(prefix: str) -> Vec:
    return Vec(*_symbols(prefix, 3))


@dataclass(frozen=True)
class Frame:
    """One side of a law. A law uses `r`, `v` (of the point), `x`, `y`, `z` (axes), `w` (angular velocity)."""

    side: str
    kind: NodeKind
    axes: Axes
    r: Vec  #: position of the point at which the law acts, m
    v: Vec  #: velocity of the point at which the law acts, m/s
    x: Vec
    y: Vec
    z: Vec
    w: Vec  #: angular velocity, inertial components, rad/s
    center: Vec  #: position of the node, m
    center_velocity: Vec
    arm: Vec  #: from the node to the point at which the law acts, m
    body: tuple[Vec, Vec, Vec]  #: columns of R
    heading: Expr  #: of a planar node: rotation from the attitude as drawn, rad
    spin: Vec  #: angular velocity in body components
    q: list[Expr]
    u: list[Expr]
    parameters: list[Expr]
    structure: dict[Expr, Expr]  #: symbols that are 0 or +-1 for this kind of node
    meaning: dict[Expr, Expr]  #: symbols as functions of q, u and the parameters
    attached: list[Vec] = field(default_factory=list)  #: vectors fixed to the body: they turn with it
    undefined: dict[Expr, str] = field(default_factory=dict)  #: symbols without a value on this kind of node, with their names

    @cached_property
    def symbols(self) -> frozenset[Expr]:
        """Every symbol of the frame: those that laws read, unknowns, parameters, and symbols between these."""
        seen, node = (self.r, self.v, self.x, self.y, self.z, self.w), (self.center, self.center_velocity, self.arm, self.spin)
        scalars = (c for vector in (*seen, *node, *self.body) for c in vector)
        named = {*self.q, *self.u, *self.parameters, *self.structure, *self.meaning}
        return frozenset(named.union(*(se.sympify(e).free_symbols for e in (*scalars, self.heading))))

    def to_body(self, a: Vec) -> Vec:
        """Body components of an inertial vector."""
        return Vec(*(column @ a for column in self.body))


@lru_cache(maxsize=256)
def make_frame(side: str, kind: NodeKind, axes: Axes = Axes.GENERAL) -> Frame:
    """The frame of a law's side ("k", "l" or "b") on a node of the given kind; laws share it."""
    r, s, v, w, spin = (_vec(f"{side}_{n}") for n in ("r", "s", "v", "w", "W"))
    x, y, z = (_vec(f"{side}_{n}") for n in "xyz")
    body = (_vec(f"{side}_bx"), _vec(f"{side}_by"), _vec(f"{side}_bz"))
    heading = se.Symbol(f"{side}_h")
    offset, Q = _symbols(f"{side}_p", 3), [_symbols(f"{side}_Q{j}", 3) for j in "xyz"]
    undefined: dict[Expr, str] = {}
    structure: dict[Expr, Expr] = {}
    meaning: dict[Expr, Expr] = {}
    q: list[Expr] = []
    u: list[Expr] = []
    parameters: list[Expr] = [*offset]
    if not kind.moves:
        r, v, w, s, spin, body = Vec(*offset), ZERO, ZERO, ZERO, ZERO, UNIT
        heading = se.Integer(0) if kind.flat else heading
        undefined = {} if kind.flat else {heading: "heading"}
        parameters += _axes_columns(axes, Q, UNIT, (x, y, z), structure, meaning)
        structure |= {offset[2]: 0} if kind.flat else {}
    elif kind is NodeKind.COORDINATE:
        r, v, s, w, spin, parameters = Vec(r[0], 0, 0), Vec(v[0], 0, 0), ZERO, ZERO, ZERO, []
        q, u = [r[0]], [v[0]]
    elif kind is NodeKind.ROTATION:
        P = _symbols(f"{side}_P", 4)
        q, u, parameters, r, v, s = P, list(spin), [], ZERO, ZERO, ZERO
        _bind(body, rotation_columns(P), structure, meaning)
        _bind((w,), (_combine(body, list(spin)),), structure, meaning)
    elif not kind.turns:
        s, w, spin, parameters = ZERO, ZERO, ZERO, []
        undefined = {c: f"axis {name}" for name, a in zip("xyzxyz", (x, y, z, *body), strict=True) for c in a}
        undefined[heading] = "heading"
        q, u = list(r)[: kind.sizes[0]], list(v)[: kind.sizes[1]]
    elif kind is NodeKind.PLANAR:
        theta, theta0 = se.Symbol(f"{side}_theta"), se.Symbol(f"{side}_theta0")
        q, u = [r[0], r[1], theta], [v[0], v[1], w[2]]
        bx = Vec(se.cos(theta), se.sin(theta), 0)
        _bind(body, (bx, UNIT[2].cross(bx), UNIT[2]), structure, meaning)
        _bind((s,), (body[0] * offset[0] + body[1] * offset[1],), structure, meaning)
        parameters = [offset[0], offset[1], theta0]
        parameters += _axes_columns(axes, Q, body, (x, y, z), structure, meaning)
        spin = w
        structure |= {w[0]: 0, w[1]: 0}
        meaning |= {heading: theta - theta0}
    else:
        P = _symbols(f"{side}_P", 4)
        q, u = [*r, *P], [*v, *spin]
        _bind(body, rotation_columns(P), structure, meaning)
        _bind((s, w), (_combine(body, offset), _combine(body, list(spin))), structure, meaning)
        parameters += _axes_columns(axes, Q, body, (x, y, z), structure, meaning)
        undefined = {heading: "heading"}
    if kind.flat and kind.moves:
        structure |= {r[2]: 0, v[2]: 0}
    own = [] if kind is NodeKind.ROTATION else [s, x, y, z]  # a free rotation has no point and no axes of a joint
    attached = [*own, w, *body] if kind.turns else []
    return Frame(side, kind, axes, r + s, v + w.cross(s), x, y, z, w, r, v, s, body, heading, spin, q, u,
                 parameters, structure, meaning, attached, undefined)


def _combine(columns: tuple[Vec, Vec, Vec], c: list[Expr]) -> Vec:
    combined: Vec = columns[0] * c[0] + columns[1] * c[1] + columns[2] * c[2]
    return combined


def _bind(symbols: tuple[Vec, ...], values: tuple[Vec, ...], structure: dict[Expr, Expr], meaning: dict[Expr, Expr]) -> None:
    """Enter the values of symbols: plain numbers in `structure`, expressions in `meaning`."""
    for a, b in zip(symbols, values, strict=True):
        for name, value in zip(a, b, strict=True):
            value = se.sympify(value).subs(structure)
            (structure if value.is_Number else meaning)[name] = value


def _axes_columns(axes: Axes, Q: list[list[Expr]], body: tuple[Vec, Vec, Vec], xyz: tuple[Vec, Vec, Vec],
                  structure: dict[Expr, Expr], meaning: dict[Expr, Expr]) -> list[Expr]:
    """Enter the joint axes `xyz` as the columns of R Q, R being `body`; returns the entries of Q that stay parameters."""
    columns, used = axes_pattern(axes, Q)
    _bind(xyz, tuple(_combine(body, column) for column in columns), structure, meaning)
    return used


def axes_pattern(axes: Axes, Q: list[list[Expr]]) -> tuple[list[list[Expr]], list[Expr]]:
    """Columns of Q with the zeros and ones that `axes` implies, and the entries that stay parameters. Q: symbols
    Q[column][row]."""
    (c, s, _), _, (a, b, _) = Q
    match axes:
        case Axes.NORMAL:
            return [[c, s, 0], [-s, c, 0], [0, 0, 1]], [c, s]
        case Axes.REVERSED:
            return [[c, s, 0], [s, -c, 0], [0, 0, -1]], [c, s]
        case Axes.IN_PLANE:
            return [[0, 0, 1], [b, -a, 0], [a, b, 0]], [a, b]
    return Q, [entry for column in Q for entry in column]


def rotation_columns_of_q(frame: Frame) -> list[list[Expr]]:
    """T with delta psi = T delta q_rotation: (3, 4) for a quaternion, (3, 1) for a heading, (3, 0) otherwise."""
    if frame.kind.by_quaternion:
        return rotation_per_component(frame.q[frame.kind.translations :])
    if frame.kind is NodeKind.PLANAR:
        return [[0], [0], [1]]
    return [[], [], []]


# ---- geometry a law may use ------------------------------------------------------------------------------------


def angle(k: Frame, l: Frame) -> Expr:
    """Rotation of l relative to k about k.z, 0 as drawn: swing-twist angle in (-pi, pi], in the plane without bound.

    phi = atan2(k.y.l.x - k.x.l.y, k.x.l.x + k.y.l.y); its rate is m.(omega_l - omega_k), m = (k.z + l.z)/(1 + k.z.l.z).
    """
    if NodeKind.PLANAR in (k.kind, l.kind):
        reference = k if k.kind.turns else l
        if reference.axes not in (Axes.NORMAL, Axes.REVERSED):
            raise LawError(f"the angle between {k.side} and {l.side} is about an axis that does not point along z, the only "
                           f"direction about which bodies turn in the plane: give axis=(0, 0, 1)")
        return (1 if reference.axes is Axes.NORMAL else -1) * (l.heading - k.heading)
    return se.atan2(k.y @ l.x - k.x @ l.y, k.x @ l.x + k.y @ l.y)
