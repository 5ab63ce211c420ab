"""What distinguishes two trees of joints apart from numbers; the motion of a body relative to the one before it in a tree,
elementary motion by elementary motion, with its rates."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import symengine as se

from mbdae.symbolic.derived import Derived
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import Step, Triad, turned
from mbdae.symbolic.program import Program
from mbdae.symbolic.stated import motion_key
from mbdae.symbolic.vectors import ZERO, Expr, Vec

NONE = se.Integer(0)
Numbers = tuple[tuple[str, int | None], ...]  #: parameter -> its value where that is 0, 1 or -1, None: a symbol
FRAMES = ("k_", "l_")  #: beginnings of the names of numbers that place a law on its sides


class Open(Enum):
    """Which parameters of laws are inputs of kernels, besides those that vary within a run, which always are."""

    FEWEST = "none: what does not vary in a run is evaluated once, and 0, 1 and -1 are written into the kernels of trees"
    LAWS = "the numbers of laws; of joints in trees, places and axes that are 0, 1 or -1 stay written into the kernels"
    ALL = "every one"

    def inputs(self, numbers: Numbers) -> Numbers:
        """These numbers of a law in a tree, without the values of those that become inputs."""
        return tuple((name, value if self is Open.FEWEST or (self is Open.LAWS and name[:2] in FRAMES) else None)
                     for name, value in numbers)


@dataclass(frozen=True)
class Link:
    """The joint that carries node `j` (its place in the tree, from 1) from node `parent` (0: the root)."""

    law: type[Joint]
    structure: Structure
    parent: int
    side: str  #: side of the joint on which the parent is, "k" or "l"
    kind: NodeKind  #: kind of the node carried
    axes: tuple[Axes, Axes]  #: which entries of the joint's axes vanish, on its parent and on the node carried
    numbers: Numbers
    moves: bool  #: False for a joint that leaves its mass point no motion relative to the parent
    coordinates: tuple[str, ...]
    prescribed: tuple[bool, ...]  #: whether each coordinate is prescribed
    first: int  #: number of its first coordinate among those of the tree, from 1
    motion: object = None  #: what stands for the motion that the joint states, see `motion_key`; None: it is asked now

    def __post_init__(self) -> None:
        if self.motion is None:
            object.__setattr__(self, "motion", motion_key(self.law, self.structure))


@dataclass(frozen=True)
class Member:
    """A law between nodes of the tree (None: the ground) that is part of the tree's program."""

    law: Derived
    nodes: tuple[int | None, ...]
    numbers: Numbers


@dataclass(frozen=True)
class TreeStructure:
    """What distinguishes two trees apart from numbers. loaded: nodes on which laws outside the program act."""

    root: NodeKind
    links: tuple[Link, ...]
    members: tuple[Member, ...]
    loaded: tuple[int, ...] = ()


@dataclass
class NodeMotion:
    """Motion of a node: R by columns, heading and quaternion where its kind has them, spins and their rates inertial."""

    kind: NodeKind
    r: Vec
    R: tuple[Vec, Vec, Vec]
    heading: Expr
    v: Vec
    w: Vec
    a: Vec
    al: Vec
    P: list[Expr] = field(default_factory=list)

    def of_body(self, columns: list[list[Expr]]) -> tuple[Vec, ...]:
        """Inertial vectors of body components."""
        return tuple(self.R[0] * c[0] + self.R[1] * c[1] + self.R[2] * c[2] for c in columns)

    def to_body(self, a: Vec) -> Vec:
        """Body components of an inertial vector."""
        return Vec(*(column @ a for column in self.R))


class Coordinate(NamedTuple):
    """An angle or displacement of a joint: value, rate, second rate, and its number in the tree; None where it is prescribed."""

    value: Expr
    rate: Expr
    second: Expr
    number: int | None


@dataclass
class Moved:
    """An elementary motion in a program: first and second rate of its amount, and derivatives of the amount (`slopes`) by the
    free coordinates, by their numbers.

    Of a free rotation: its number among the coordinates, its angular velocity (spin) and the rate of that (change), in components
    along the axes it leads to."""

    step: Step
    rate: Expr = NONE
    second: Expr = NONE
    slopes: dict[int, Expr] = field(default_factory=dict)
    number: int = 0
    spin: Vec = ZERO
    change: Vec = ZERO


def moved(step: Step, coordinates: list[Coordinate], program: Program) -> Moved:
    """An elementary motion with the rates of its amount, which follow from those of the coordinates."""
    first = [se.diff(step.amount, c.value) for c in coordinates]
    rate = sum((d * c.rate for d, c in zip(first, coordinates, strict=True)), NONE)
    second = sum((d * c.second for d, c in zip(first, coordinates, strict=True)), NONE)
    for c in coordinates:
        second += sum((se.diff(d, c.value) * c.rate * o.rate for d, o in zip(first, coordinates, strict=True)), NONE)
    slopes = {c.number: program.let(d) for d, c in zip(first, coordinates, strict=True) if c.number is not None and d != 0}
    return Moved(Step(step.turns, step.axis, program.let(step.amount)), program.let(rate), program.let(second), slopes)


class MotionPart(NamedTuple):
    """An elementary motion on the way to a body, inertial components: its direction, its displacement (zero for rotations), and
    of a free rotation the three axes along which its angular velocity has its components."""

    moved: Moved
    direction: Vec
    displacement: Vec
    axes: tuple[Vec, ...]


@dataclass
class LinkWay:
    """The way from a node to the next one in the tree. parts: the elementary motions; total: vector from the node to their end;
    back: vector from the next node to that end. At the end: axes, their angular velocity w and its rate al, velocity v and
    acceleration a less those of the node. Inertial components."""

    axes: Triad
    w: Vec
    al: Vec
    v: Vec = ZERO
    a: Vec = ZERO
    total: Vec = ZERO
    back: Vec = ZERO
    parts: list[MotionPart] = field(default_factory=list)


def way(program: Program, node: NodeMotion, offset: Vec, axes: Triad, motions: list[Moved], turns: bool) -> LinkWay:
    """The way from a node to the next one. offset: vector from the node to the joint's point on it; axes: the joint's axes there;
    motions: the elementary motions of the joint; turns: whether the next node has axes."""
    found, group = LinkWay(axes, node.w, node.al), _Group(offset)
    for m in motions:
        if not m.step.turns:
            group.add(program, found, m)
            continue
        group.end(program, found)
        group = _Group(ZERO)
        if turns:
            _turn(program, found, m)
    group.end(program, found)
    found.total = program.vec(found.total)
    return found


@dataclass
class _Group:
    """The displacements between two rotations, whose axes turn together. arm: their sum; speed, change: its first and second rate
    by the amounts alone, as if the axes did not turn."""

    arm: Vec
    speed: Vec = ZERO
    change: Vec = ZERO

    def add(self, program: Program, found: LinkWay, m: Moved) -> None:
        e = program.vec(m.step.direction(found.axes))
        found.parts.append(MotionPart(m, e, e * m.step.amount, ()))
        self.arm, self.speed = self.arm + e * m.step.amount, self.speed + e * m.rate
        self.change = self.change + e * m.second

    def end(self, program: Program, found: LinkWay) -> None:
        """Add the displacements to the way `found`: vector, velocity and acceleration at their end."""
        arm, w = program.vec(self.arm), found.w
        along = program.vec(w.cross(arm) + self.speed)
        found.v, found.total = found.v + along, found.total + arm
        found.a = found.a + found.al.cross(arm) + w.cross(along) + w.cross(self.speed) + self.change


def _turn(program: Program, found: LinkWay, m: Moved) -> None:
    """Continue the way `found` by a rotation m: its axes, their angular velocity and its rate."""
    vec, before, w = program.vec, found.axes, found.w
    after = program.axes(turned(before, m.step))
    if m.step.rotation is None:
        e = vec(m.step.direction(before))
        found.parts.append(MotionPart(m, e, ZERO, ()))
        spin, change = e * m.rate, e * m.second + w.cross(e) * m.rate
    else:
        own = tuple(-axis for axis in before) if m.step.rotation.inverse else after
        found.parts.append(MotionPart(m, ZERO, ZERO, own))
        spin, change = (vec(sum((axis * c for axis, c in zip(own, part, strict=True)), ZERO)) for part in (m.spin, m.change))
        change = change + w.cross(spin)
    found.axes, found.w, found.al = after, vec(w + spin), vec(found.al + change)
