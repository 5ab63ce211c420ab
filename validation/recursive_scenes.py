"""Scenes with recursive joints: every kind of tree, for the tests of their equations, and random states of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import mbdae as mb
from mbdae.system.base import Array
from mbdae.system.model.nodes import rotation_matrices, turned
from mbdae.system.prepare import Prepared

R = mb.Recursive()
SPRING = 60.0  #: N m/rad in every joint of the spring chain
TILTED = (0.3, -0.5, 0.8)
INERTIA = ((0.3, 0.02, 0.01), (0.02, 0.2, -0.03), (0.01, -0.03, 0.4))


def rotation(x: float, y: float, z: float) -> Array:
    """Rotation matrix of a rotation vector."""
    return rotation_matrices(turned(np.array([1.0, 0, 0, 0]), np.array([x, y, z])))


def body(s: mb.Scene, name: str, at: tuple[float, ...], turn: tuple[float, ...] = (0.2, -0.4, 0.3)) -> object:
    return s.rigid_body(name, mass=1.3, inertia=INERTIA, at=at, rotation=rotation(*turn))


def tree_on_ground() -> mb.Scene:
    """Branches, both sides of a joint as parent, a prismatic joint, spring, damper, motor, load, spring to the ground."""
    s = mb.Scene("tree", gravity=(0.4, -1.0, -9.81))
    a, b, c, d = (body(s, n, p) for n, p in zip("abcd", ((0.4, 0, 0), (1, 0.5, 0), (1.2, 0, 0.4), (0.3, -0.6, 0.2)), strict=True))
    s.revolute("A", s.ground, a, at=(0.1, 0, 0), axis=TILTED, model=R, spring=3.0, damper=0.2, torque=mb.t)
    s.revolute("B", b, a, at=(0.7, 0.2, 0.1), axis=(0, 1, 1), model=R, spring=1.0)
    s.prismatic("C", a, c, at=(0.8, 0, 0.2), axis=(1, 0.2, 0), model=R, spring=5.0, damper=0.1, force=0.7)
    s.revolute("D", c, d, at=(0.7, -0.3, 0.3), axis=(1, 0, 0), model=R, damper=0.05)
    s.spring("S", s.ground, d, (0, -1, 0), (0.3, -0.7, 0.2), stiffness=4.0, damping=0.3, length=0.2)
    s.spring("T", b, d, (1.1, 0.5, 0), (0.2, -0.6, 0.2), stiffness=2.0, damping=0.1)
    s.force("F", c, (0.3, mb.t, 0.1), at=(1.3, 0, 0.4), frame="body")
    return s


def tree_on_free_body() -> mb.Scene:
    """A tree of recursive joints on a free body; a kinematic joint from the tree to another free body; a bushing between both."""
    s = mb.Scene("free root", gravity=(0, 0, -9.81))
    a, b, c, d = (body(s, n, p) for n, p in zip("abcd", ((0.4, 0, 0), (1, 0.5, 0), (1.2, 0, 0.4), (0.3, -0.6, 0.2)), strict=True))
    s.revolute("A", a, b, at=(0.7, 0.2, 0.1), axis=TILTED, model=R, spring=1.0)
    s.revolute("B", b, c, at=(1.1, 0.2, 0.1), axis=(0, 1, 1), model=R)
    s.revolute("K", c, d, at=(0.7, -0.3, 0.3), axis=(1, 0, 0), spring=1.0)
    s.bushing("S", a, d, at=(0.35, -0.3, 0.1), stiffness=(3, 4, 5, 1, 2, 3), damping=(0.1, 0.2, 0.3))
    s.spring("P", s.ground, a, (0, 0, 1), (0.4, 0, 0.1), stiffness=10.0)
    return s


def prescribed() -> mb.Scene:
    """Angles prescribed in time and at a constant value, between free coordinates."""
    s = mb.Scene("prescribed", gravity=(0, 0, -9.81))
    a, b, c, d = (body(s, n, p) for n, p in zip("abcd", ((0.4, 0, 0), (1, 0.5, 0), (1.2, 0, 0.4), (1.3, -0.6, 0.2)), strict=True))
    s.revolute("A", s.ground, a, at=(0.1, 0, 0), axis=TILTED, model=R, spring=1.0)
    s.revolute("B", a, b, at=(0.7, 0.2, 0.1), axis=(0, 1, 1), model=R, angle=0.3 * mb.t + 0.2 * mb.t**2, spring=2.0, damper=0.3)
    s.prismatic("C", c, b, at=(0.8, 0, 0.2), axis=(1, 0.2, 0), model=R, position=0.25)
    s.revolute("D", c, d, at=(1.2, -0.3, 0.3), axis=(1, 0, 0), model=R)
    return s


def loop() -> mb.Scene:
    """A spatial loop: three recursive joints, closed by a rod."""
    s = mb.Scene("loop", gravity=(0, 0, -9.81))
    a, b, c = (body(s, n, p) for n, p in zip("abc", ((0.4, 0, 0), (1, 0.5, 0), (0.5, 1.0, 0.2)), strict=True))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=TILTED, model=R)
    s.revolute("B", a, b, at=(0.8, 0.1, 0.1), axis=(0, 1, 1), model=R, spring=2.0)
    s.revolute("C", b, c, at=(0.9, 0.8, 0.1), axis=(1, 0, 1), model=R)
    s.distance("Z", c, s.ground, (0.1, 1.1, 0.3), (-0.5, 0.9, 1.0))
    return s


def planar_tree() -> mb.Scene:
    """In the plane: a free root, an axis against the normal, a prismatic joint in the plane, a point mass on a slide."""
    s = mb.Scene("planar", gravity=(0, -9.81, 0))
    a = s.rigid_body("a", 1.0, 0.2, at=(0.3, 0.1), rotation=rotation(0, 0, 0.4))
    b = s.rigid_body("b", 2.0, 0.3, at=(1.0, 0.2), rotation=rotation(0, 0, -0.7))
    c, d = s.link("c", (1.5, 0.5), (2.0, 1.0), mass=0.7), s.link("d", (1.5, 0.5), (1.0, 1.5), mass=0.6)
    p = s.point_mass("p", 0.4, at=(2.0, 1.5))
    s.revolute("A", a, b, at=(0.6, 0.3), axis=(0, 0, -1), model=R, spring=1.0, damper=0.1)
    s.prismatic("B", b, c, at=(1.4, 0.4), axis=(1, 0.5, 0), model=R, spring=4.0)
    s.revolute("C", d, c, at=(1.5, 0.5), model=R)
    s.prismatic("P", c, p, at=(2.0, 1.5), axis=(0, 1, 0), model=R, spring=2.0)
    s.spring("S", s.ground, d, (0, 2), (1.0, 1.5), stiffness=3.0, damping=0.1)
    return s


def spring_chain(bodies: int = 3, model: mb.Kinematic | mb.Classical | mb.Recursive = R) -> mb.Scene:
    """Rods hinged about changing axes, held by springs against gravity along x, y and z."""
    s = mb.Scene("spring chain", gravity=(1.0, -2.0, -9.81))
    before = s.ground
    for i in range(bodies):
        rod = s.link(f"rod{i + 1}", (i, 0.1 * i, 0), (i + 1, 0.1 * i + 0.1, 0.2), mass=1.0)
        axis = ((0, 1, 0.2), (0.3, 0, 1), (1, 0.5, 0.2))[i % 3]
        s.revolute(f"J{i + 1}", before, rod, at=(i, 0.1 * i, 0), axis=axis, model=model, spring=SPRING)
        before = rod
    return s


def four_bar(space: str = "auto", model: mb.Recursive | None = None, tilt: float = 0.0) -> mb.Scene:
    """Crank, coupler and rocker on joints A, B, C of a model, C tilted by so many rad; D closes the loop, kinematic."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0), space=space)
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, crank, at=A, model=model, rate0=6.0)
    s.revolute("B", crank, coupler, at=B, model=model)
    s.revolute("C", coupler, rocker, at=C, model=model, axis=(0, tilt, 1), spring=2.0, damper=0.01)
    s.revolute("D", rocker, s.ground, at=D)
    return s


SCENES = [tree_on_ground, tree_on_free_body, prescribed, loop, planar_tree]


def random_state(prepared: Prepared, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """t and a reduced state near the start, as one row each; quaternions of length 1."""
    e = prepared.all_bodies
    q0, u0 = e.reduced(prepared.start.q[None], prepared.start.u[None])
    q, u = q0 + 0.3 * rng.normal(size=q0.shape), u0 + rng.normal(size=u0.shape)
    for node in prepared.model.nodes:
        first = np.flatnonzero(e.numbering.of_positions == node.q)
        if node.kind.sizes == (7, 6) and len(first):
            part = slice(first[0] + 3, first[0] + 7)
            q[0, part] /= np.linalg.norm(q[0, part])
    return np.array([rng.uniform(0, 1)]), q, u


def random_states(prepared: Prepared, count: int, seed: int) -> Iterator[tuple[Array, Array, Array]]:
    """t, and q, u of all nodes at random states, as one row each."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        t, q, u = random_state(prepared, rng)
        yield (t, *prepared.all_bodies.states(t, np.hstack([q, u])))
