"""Random trees of rigid bodies as plain data: what Pinocchio and the package are both given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

GROUND = -1
LEAD = 0.4  #: m a turn, of screws
Array = np.ndarray


@dataclass(frozen=True)
class Kind:
    """steps: name of a coordinate, "turn", "slide" or "screw", and the axis of the joint, from k to l; rotates: a free rotation
    follows."""

    steps: tuple[tuple[str, str, int], ...] = ()
    rotates: bool = False


X, Y, Z = 0, 1, 2
ALONG = tuple((name, "slide", axis) for name, axis in zip("xyz", (X, Y, Z), strict=True))
KINDS = {
    "revolute": Kind((("angle", "turn", Z),)), "prismatic": Kind((("displacement", "slide", Z),)),
    "cylindrical": Kind((("displacement", "slide", Z), ("angle", "turn", Z))), "screw": Kind((("angle", "screw", Z),)),
    "universal": Kind((("angle_k", "turn", X), ("angle_l", "turn", Y))), "planar": Kind((*ALONG[:2], ("angle", "turn", Z))),
    "spherical": Kind((), True), "point_on_line": Kind((("displacement", "slide", Z),), True), "weld": Kind(),
    "point_on_plane": Kind(ALONG[:2], True), "free": Kind(ALONG, True), "fixed_orientation": Kind(ALONG),
}
FLAT = ("revolute", "prismatic", "planar", "weld")
LARGE = ("revolute", "revolute", "revolute", "prismatic", "screw", "universal", "cylindrical", "weld")


@dataclass(frozen=True)
class Wave:
    """constant + slope t + height sin(2 t)."""

    constant: float
    slope: float = 0.0
    height: float = 0.0

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Value, rate and second derivative."""
        s, c, h = np.sin(2 * t), np.cos(2 * t), self.height
        return self.constant + self.slope * t + h * s, self.slope + 2 * h * c, -4 * h * s


#: the same in all trees, so that expressions of time are compiled once
DRIVE = Wave(0.1, 0.4, 0.2)
FORCE, TORQUE = (Wave(0.8, 0.3, -0.5), Wave(-1.1), Wave(0.4, -0.7)), (Wave(-0.6), Wave(0.2, 0.5, 0.9), Wave(0.7, -0.4))


@dataclass(frozen=True)
class Branch:
    """A body with the joint that holds it on its parent. outer: "l" where the body is l of the joint, "k" where its parent is.

    at, axes (3, 3) by columns: of the joint, inertial as drawn; centre, rotation: of the body; inertia (3, 3) about the centre in
    body axes, None of a point mass; spring, damper, load: of every coordinate; driven: numbers of prescribed coordinates."""

    kind: str
    parent: int
    outer: str
    at: Array
    axes: Array
    mass: float
    inertia: Array | None
    centre: Array
    rotation: Array
    spring: Array
    damper: Array
    load: Array
    driven: tuple[int, ...] = ()

    @property
    def of(self) -> Kind:
        """Its joint."""
        return KINDS[self.kind]

    @property
    def sign(self) -> int:
        """1 where the coordinates are those of the body relative to its parent, else -1."""
        return 1 if self.outer == "l" else -1


@dataclass(frozen=True)
class Spring:
    """Between a point of one body and one of another, as drawn."""

    k: int
    l: int
    at_k: Array
    at_l: Array
    stiffness: float
    damping: float
    length: float


@dataclass(frozen=True)
class Tree:
    """branches, parents before their children; the force FORCE on a point of a body, the torque TORQUE in the axes of another."""

    branches: tuple[Branch, ...]
    gravity: Array
    springs: tuple[Spring, ...] = ()
    pushed: tuple[int, Array] | None = None
    twisted: int | None = None
    flat: bool = False


@dataclass(frozen=True)
class State:
    """t; coordinates and their rates, of every branch in the order of its joint; rotation (3, 3) of the free rotation of l
    relative to k and its angular velocity (3,) of the body relative to its parent in axes of the body's side of the joint."""

    t: float
    values: list[Array]
    rates: list[Array]
    rotations: list[Array]
    spins: list[Array]


@dataclass
class Answer:
    """Of every body: its place r and R, velocities v and w, accelerations a (n, 6); of every joint the force and torque on l
    about the point of l (n, 6); second derivatives of coordinates, and the forces that drive prescribed ones, by branch and
    number."""

    r: Array
    R: Array
    v: Array
    w: Array
    a: Array
    wrench: Array
    second: list[Array]
    drives: dict[tuple[int, int], float] = field(default_factory=dict)


def unit(rng: np.random.Generator, flat: bool = False) -> Array:
    """A random direction."""
    a: Array = rng.normal(size=3) * (1, 1, 0 if flat else 1)
    return a / np.linalg.norm(a)


def random_tree(seed: int) -> Tree:
    """One to six bodies on any joints; every tenth tree has 12 to 20, most with more than 16 rates; a third is planar."""
    rng = np.random.default_rng(seed)
    flat, large = seed % 3 == 2, seed % 10 == 9
    count = int(rng.integers(12, 21) if large else rng.integers(1, 7))
    kinds = FLAT if flat else LARGE if large else tuple(KINDS)
    branches: list[Branch] = []
    for i in range(count):
        rooted = i == 0 or rng.random() < 0.1
        parents = [n for n in range(max(0, i - 4), i) if branches[n].inertia is not None]
        parent = GROUND if rooted or not parents else int(rng.choice(parents))
        branches.append(_branch(rng, str(rng.choice(kinds)) if i else kinds[seed % len(kinds)], parent, branches, flat))
    if all(b.kind == "weld" or len(b.driven) == len(b.of.steps) > 0 for b in branches):
        branches.append(_branch(rng, "revolute", GROUND, branches, flat, driven=False))
    turning = [i for i, b in enumerate(branches) if b.inertia is not None]
    springs = tuple(_spring(rng, branches, turning, flat) for _ in range(int(rng.integers(0, 3)))) if turning else ()
    pushed = (int(rng.choice(turning)), 0.3 * unit(rng, flat)) if turning and rng.random() < 0.7 else None
    if pushed:
        pushed = pushed[0], branches[pushed[0]].centre + pushed[1]
    twisted = int(rng.choice(turning)) if turning and rng.random() < 0.7 else None
    return Tree(tuple(branches), 9.81 * unit(rng, flat), springs, pushed, twisted, flat)


def _branch(rng: np.random.Generator, kind: str, parent: int, before: Sequence[Branch], flat: bool,
            driven: bool = True) -> Branch:
    size, mass = len(KINDS[kind].steps), float(10 ** rng.uniform(-0.5, 0.5))
    at = (np.zeros(3) if parent == GROUND else before[parent].centre) + 0.4 * unit(rng, flat)
    point = kind in ("prismatic", "fixed_orientation", "weld") and parent != GROUND and rng.random() < 0.15
    point = point and kind != "fixed_orientation"  # which holds nothing of a point mass
    inertia = None if point else _inertia(rng, mass)
    if flat and inertia is not None:
        inertia[2, :2] = inertia[:2, 2] = 0
    on = rng.random(size) < 0.5
    driven = driven and size > 0 and rng.random() < 0.2
    return Branch(kind, parent, "l" if point or rng.random() < 0.6 else "k", at, _axes(rng, kind, flat), mass, inertia,
                  at if point else at + 0.4 * unit(rng, flat), _turned(rng, flat), on * rng.uniform(2, 10, size),
                  on * rng.uniform(0.1, 1, size), on * rng.normal(size=size), (size - 1,) if driven else ())


def _inertia(rng: np.random.Generator, mass: float) -> Array:
    """Of six lumps at random."""
    lumps = 0.3 * rng.normal(size=(6, 3))
    found: Array = mass / 6 * (np.sum(lumps**2) * np.eye(3) - lumps.T @ lumps)
    return found


def _turned(rng: np.random.Generator, flat: bool) -> Array:
    found: Array = Rotation.from_rotvec([0, 0, rng.uniform(-3, 3)] if flat else 2 * unit(rng)).as_matrix()
    return found


def _axes(rng: np.random.Generator, kind: str, flat: bool) -> Array:
    """Axes of a joint; in the plane z normal to it, of a prismatic joint in it."""
    if not flat:
        return _turned(rng, False)
    if kind == "prismatic":
        x, z = np.array([0, 0, 1.0]), unit(rng, True)
        return np.column_stack([x, np.cross(z, x), z])
    x, z = unit(rng, True), np.array([0, 0, rng.choice([-1.0, 1.0])])
    return np.column_stack([x, np.cross(z, x), z])


def _spring(rng: np.random.Generator, branches: Sequence[Branch], turning: Sequence[int], flat: bool) -> Spring:
    l = int(rng.choice(turning))
    k = int(rng.choice([GROUND, *(i for i in turning if i != l)]))
    at_k = (np.zeros(3) if k == GROUND else branches[k].centre) + 0.7 * unit(rng, flat)
    return Spring(k, l, at_k, branches[l].centre + 0.2 * unit(rng, flat), rng.uniform(5, 20), rng.uniform(0.1, 1), 0.5)


def random_state(rng: np.random.Generator, tree: Tree) -> State:
    """Coordinates up to 1 (rad or m), any free rotations, rates about 1; prescribed ones as they are at t."""
    t = float(rng.uniform(0, 1))
    values, rates, rotations, spins = [], [], [], []
    for b in tree.branches:
        value, rate = rng.uniform(-1, 1, len(b.of.steps)), rng.normal(size=len(b.of.steps))
        for n in b.driven:
            value[n], rate[n], _ = DRIVE(t)
        values.append(value)
        rates.append(rate)
        rotations.append(Rotation.random(random_state=rng).as_matrix())
        spins.append(rng.normal(size=3))
    return State(t, values, rates, rotations, spins)


def far(one: Any, other: Any, size: float) -> float:
    """Largest difference over a size."""
    return float(np.max(np.abs(np.asarray(one) - np.asarray(other)), initial=0.0) / size)
