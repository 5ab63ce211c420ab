"""Long chains against equations written by hand, energy, and what a run of 500 bodies says of itself."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.prepare import prepare

from .scenes import chain

LENGTH, MASS, G = 0.1, 1.0, 9.81


def by_hand(q, u):
    """Second rates of the relative angles and the forces on every hinge of a chain of slender rods, by Lagrange's equations in
    absolute angles and Newton's for every rod."""
    n, angle, rate = len(q), np.cumsum(q), np.cumsum(u)
    i, j = np.indices((n, n))
    A = MASS * LENGTH**2 * (n - 1 - np.maximum(i, j) + np.where(i == j, 0.25, 0.5))
    M = A * np.cos(angle[:, None] - angle) + np.eye(n) * MASS * LENGTH**2 / 12
    f = -(A * np.sin(angle[:, None] - angle)) @ rate**2 - MASS * G * LENGTH * (n - 0.5 - np.arange(n)) * np.cos(angle)
    second = np.linalg.solve(M, f)
    e, e2 = np.array([np.cos(angle), np.sin(angle)]).T, np.array([-np.sin(angle), np.cos(angle)]).T
    tip = LENGTH * (e2 * second[:, None] - e * rate[:, None] ** 2)
    centre = np.cumsum(tip, axis=0) - tip / 2
    return np.diff(second, prepend=0), np.cumsum((MASS * (centre + np.array([0, G])))[::-1], axis=0)[::-1]


@pytest.mark.parametrize("count", [30, 200])
def test_a_planar_chain_moves_as_by_hand(count):
    scene, rng = chain(count, "planar"), np.random.default_rng(4)
    q, u = rng.normal(size=(2, count))
    system, out = scene.system(mb.ODE()), np.empty(2 * count)
    system.rhs(0.0, np.r_[q, u], out)
    second, force = by_hand(q, u)
    assert np.max(np.abs(out[count:] - second)) < 1e-9 * np.max(np.abs(second))
    p = prepare(scene)
    full_q, full_u = p.all_bodies.states(np.zeros(1), np.r_[q, u][None])
    _, multipliers = p.mechanics.accelerations(np.zeros(1), full_q, full_u, np.zeros((1, 0)))
    size = {r.name: abs(x) for r, x in zip(p.mechanics.rows, multipliers[0], strict=True)}
    found = np.array([np.hypot(size[f"j{i}.x"], size[f"j{i}.y"]) for i in range(count)])
    assert np.max(np.abs(found - np.linalg.norm(force, axis=1))) < 1e-9 * np.max(np.abs(force))


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_energy_stays(space):
    r = chain(40, space).simulate(0.3, accuracy=1e-7)
    assert r.prepared.all_bodies.moved.ordered
    total = r.energy.total
    assert np.max(np.abs(total - total[0])) < 1e-6 * np.max(r.energy.kinetic)


def test_a_chain_of_500_bodies_is_judged_like_any_other():
    scene = chain(500)
    r = scene.simulate(0.02, accuracy=1e-4, outputs=11)
    assert isinstance(r.info.solver, mb.DOP853)
    assert r.accuracy.estimated < 1e-4
    assert {"motion", "reactions"} <= set(r.accuracy.covers)
    assert np.all(np.isfinite(r["j499"].force))


def test_a_motion_without_inertia_is_named():
    s = chain(20)
    s.revolute("idle", s.bodies[-1], s.rigid_body("nothing", 0.0, (0, 0, 0), at=(2, 0, 0)), at=(2, 0, 0), model=mb.Recursive())
    with pytest.raises(mb.SceneError, match="joint 'idle': what it moves has no inertia"):
        prepare(s)


def test_a_long_chain_hangs_at_rest_and_vibrates_as_with_kinematic_joints():
    found = []
    for model in (mb.Recursive(), mb.Kinematic()):
        s = mb.Scene("hanging", gravity=(0, -9.81, 0))
        last = s.ground
        for i in range(18):
            rod = s.link(f"b{i}", (0, -0.1 * i), (0, -0.1 * (i + 1)), mass=1.0)
            s.revolute(f"j{i}", last, rod, at=(0, -0.1 * i), model=model)
            last = rod
        found.append(np.sort(np.abs(np.imag(s.linearize().eigenvalues)))[-6:])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-8)
