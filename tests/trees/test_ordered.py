"""Trees evaluated joint by joint: accelerations, reactions and derivatives are those of kinematic joints."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.prepare import prepare

from .scenes import chain, of_every_joint, planar


def states(p, count, seed=0):
    """Times, and random unknowns (count, nq + nu + states) with quaternions of unit length."""
    rng, e = np.random.default_rng(seed), p.all_bodies
    q, u = 0.4 * rng.normal(size=(count, e.nq)), rng.normal(size=(count, e.nu))
    for node in e.numbering.free:
        if node.kind.by_quaternion:
            n = node.kind.translations
            at = [e.numbering.node_place("q", node, n + i) for i in range(4)]
            q[:, at] += np.eye(4)[0]
            q[:, at] /= np.linalg.norm(q[:, at], axis=1, keepdims=True)
    return rng.uniform(0.1, 1, count), q, u, 0.01 * rng.normal(size=(count, len(p.mechanics.numbering.states)))


def as_in(other, p, values, head):
    """Values of all nodes of p, those of the nodes that another model of the same bodies has, in its order."""
    nodes, first = {n.name: n for n in p.model.nodes}, (lambda n: n.q) if head == "q" else (lambda n: n.u)
    parts = [(nodes[n.name], n.kind.sizes[0 if head == "q" else 1]) for n in other.model.nodes]
    return np.concatenate([values[:, first(n) : first(n) + size] for n, size in parts], axis=1)


def beside_kinematic(scene):
    recursive = prepare(scene)
    names = [c.name for c in scene.joints if c.recursive]
    return recursive, prepare(scene.replace(*names, model=mb.Kinematic()))


SCENES = [of_every_joint, lambda: of_every_joint(True), planar, lambda: chain(18), lambda: chain(18, "planar")]


@pytest.mark.parametrize("scene", SCENES)
def test_accelerations_and_reactions_are_those_of_kinematic_joints(scene):
    p, other = beside_kinematic(scene())
    assert p.all_bodies.moved.ordered
    assert not other.all_bodies.moved.ordered
    t, qr, ur, s = states(p, 4)
    q, u = p.all_bodies.states(t, np.hstack([qr, ur]))
    (a, force), kinematic = p.mechanics.accelerations(t, q, u, s), (as_in(other, p, q, "q"), as_in(other, p, u, "u"))
    assert np.max(np.abs(other.mechanics.position_residual(t, kinematic[0]))) < 1e-12
    assert np.max(np.abs(other.mechanics.velocity_residual(t, *kinematic))) < 1e-12
    b, expected = other.mechanics.accelerations(t, *kinematic, s)
    assert np.max(np.abs(as_in(other, p, a, "u") - b)) < 1e-11 * np.max(np.abs(b))
    at = [[row.name for row in p.mechanics.rows].index(row.name) for row in other.mechanics.rows]
    assert np.max(np.abs(force[:, at] - expected)) < 1e-10 * np.max(np.abs(expected))


@pytest.mark.parametrize("scene", SCENES)
def test_what_is_integrated_gives_the_same(scene):
    s = scene()
    p, system = prepare(s), s.system(mb.ODE())
    e, nb = p.all_bodies, p.all_bodies.numbering
    for t, q, u, z in zip(*states(p, 3, seed=1), strict=True):
        full_q, full_u = e.states(np.array([t]), np.r_[q, u][None])
        a, _ = p.mechanics.accelerations(np.array([t]), full_q, full_u, z[None])
        out = np.empty(system.n)
        system.rhs(t, np.r_[q, u, z], out)
        assert np.max(np.abs(out[nb.nq : nb.nq + nb.nu] - a[0][nb.of_velocities])) < 1e-12 * np.max(np.abs(a))
        qp = p.mechanics.rates(full_q[0], full_u[0])[nb.of_positions]
        assert np.max(np.abs(out[: nb.nq] - qp)) < 1e-13


@pytest.mark.parametrize("scene", SCENES)
def test_derivatives_are_those_of_differences(scene):
    s = scene()
    system = s.system(mb.ODE())
    (t,), q, u, z = states(prepare(s), 1, seed=2)
    y, h = np.r_[q[0], u[0], z[0]], 1e-5
    J, D = system.rate_jacobian(t, y), np.empty((system.n,) * 2)
    for k, step in enumerate(h * np.eye(system.n)):
        found = np.empty((4, system.n))
        for row, by in zip(found, (1, -1, 2, -2), strict=True):
            system.rhs(t, y + by * step, row)
        D[:, k] = (8 * (found[0] - found[1]) - (found[2] - found[3])) / (12 * h)
    assert np.max(np.abs(J - D)) < 1e-8 * np.max(np.abs(J))
    own = np.empty_like(J)
    system.jacobian(t, y, np.zeros_like(y), 3.0, own)  # of y' - f
    assert np.max(np.abs(own - (3.0 * np.eye(system.n) - J))) < 1e-12 * np.max(np.abs(J))
    v = np.random.default_rng(0).normal(size=(2, system.n))
    assert np.max(np.abs(system.rate_products(t, y, v) - v @ J.T)) < 1e-12 * np.max(np.abs(v @ J.T))
