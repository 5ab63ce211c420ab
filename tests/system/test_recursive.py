"""Recursive joints: the same motion as constraints, exact derivatives, exact reactions, honest refusals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import mbdae as mb
from mbdae.formulations import GGL, Index3, system_for
from mbdae.system.base import Array
from mbdae.system.mechanics import Mechanics
from mbdae.system.prepare import Prepared, prepare

R = mb.Recursive()
TILTED = (0.3, -0.5, 0.8)
INERTIA = ((0.3, 0.02, 0.01), (0.02, 0.2, -0.03), (0.01, -0.03, 0.4))


def rotation(x: float, y: float, z: float) -> Array:
    from mbdae.system.rotations import rotation_matrices, turned

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
    """A free body carries the tree; a kinematic joint hangs a free body on a carried one; a bushing between the two."""
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


SCENES = [tree_on_ground, tree_on_free_body, prescribed, loop, planar_tree]


def random_state(prepared: Prepared, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """t and a reduced state near the start, as one row each."""
    e = prepared.expansion
    q0, u0 = e.reduced(prepared.start.q[None], prepared.start.u[None])
    return np.array([rng.uniform(0, 1)]), q0 + 0.3 * rng.normal(size=q0.shape), u0 + rng.normal(size=u0.shape)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("form", [GGL(algebraic=True), GGL(algebraic=False), Index3()])
def test_residual_vanishes_on_the_constrained_motion(scene: Callable[[], mb.Scene], form: object) -> None:
    """Accelerations and multipliers of the full constrained equations satisfy the recursive ones, at any state."""
    prepared = prepare(scene())
    m, e = prepared.mechanics, prepared.expansion
    system = system_for(prepared, form)  # type: ignore[arg-type]
    nb, rng = system.numbering, np.random.default_rng(3)
    for _ in range(5):
        t, q, u = random_state(prepared, rng)
        s = np.zeros((1, len(nb.states)))
        all_q, all_u = e.states(t, np.hstack([q, u]))
        a, lam = Mechanics(m.model, m.rows).accelerations(t, all_q, all_u, s)
        y, yp, F = np.zeros(system.n), np.zeros(system.n), np.empty(system.n)
        y[: nb.nq], y[nb.nq : nb.nq + nb.nu] = q[0], u[0]
        yp[: nb.nq] = m.rates(all_q[0], all_u[0])[nb.of_positions]
        yp[nb.nq : nb.nq + nb.nu] = a[0][nb.of_velocities]
        multipliers = lam[0][nb.rows_among(m.rows)]
        (yp if system.spec.derivatives else y)[nb.start["lambda"] : nb.start["lambda"] + nb.m] = multipliers
        system.residual(float(t[0]), y, yp, F)
        dynamics = slice(0, nb.nq + nb.nu)
        assert np.max(np.abs(F[dynamics])) < 1e-11 * (1 + np.max(np.abs(a)) + np.max(np.abs(lam), initial=0.0))


def differenced(f: Callable[[float], Array]) -> Array:
    """f'(0) by central differences of order 8: h^8 and round-off / h are near 1e-13."""
    h, weights = 2e-3, (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return sum((w * (f((k + 1) * h) - f(-(k + 1) * h)) for k, w in enumerate(weights)), np.zeros(1)) / h


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("sparse", [False, True])
def test_jacobian_is_exact(scene: Callable[[], mb.Scene], sparse: bool) -> None:
    from mbdae.system.prepare import make_system

    prepared = prepare(scene())
    system = make_system(prepared, GGL(algebraic=True).spec(), sparse)
    rng = np.random.default_rng(4)
    t, q, u = random_state(prepared, rng)
    y, yp = rng.normal(size=system.n), rng.normal(size=system.n)
    y[: q.size + u.size] = np.r_[q[0], u[0]]

    def F(t: float, y: Array, yp: Array) -> Array:
        out = np.empty(system.n)
        system.residual(t, y, yp, out)
        return out

    parts = system.jacobian_parts(float(t[0]), y, yp)
    for which, part in enumerate(parts):
        if sparse:
            pattern = system.sparsity.copy()
            pattern.data = part
            part = pattern.toarray()
        for j, column in enumerate(np.eye(system.n)):
            moved = (lambda h, c=column: F(float(t[0]), y + h * c, yp)) if which == 0 else (
                lambda h, c=column: F(float(t[0]), y, yp + h * c))  # fmt: skip
            slope = differenced(moved)
            assert np.max(np.abs(part[:, j] - slope)) < 2e-10 * (1 + np.max(np.abs(slope))), system.names[j]


@pytest.mark.parametrize("scene", SCENES)
def test_reactions_are_the_multipliers(scene: Callable[[], mb.Scene]) -> None:
    """Leaf to root against the constrained equations, spatial and planar, prescribed coordinates included."""
    prepared = prepare(scene())
    m, e, rng = prepared.mechanics, prepared.expansion, np.random.default_rng(5)
    for _ in range(10):
        t, q, u = random_state(prepared, rng)
        all_q, all_u = e.states(t, np.hstack([q, u]))
        s = np.zeros((1, len(m.numbering.states)))
        a, lam = m.accelerations(t, all_q, all_u, s)
        a_full, lam_full = Mechanics(m.model, m.rows).accelerations(t, all_q, all_u, s)
        assert np.max(np.abs(a - a_full)) < 1e-11 * (1 + np.max(np.abs(a_full)))
        assert np.max(np.abs(lam - lam_full)) < 1e-11 * (1 + np.max(np.abs(lam_full)))
