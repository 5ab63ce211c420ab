"""Feedback in trees that are evaluated joint by joint: rates, Jacobians, events and controllers are those of kinematic joints."""

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.system.prepare import prepare

N = 18
R = mb.Recursive()


def chain(model=R, spatial=True, sampled=False):
    """A chain whose joints and bodies read each other: across the tree, along it, by states, and of the ground."""
    s = mb.Scene("chain", gravity=(0, 0, -9.81) if spatial else (0, -9.81, 0))
    before = s.ground
    for n in range(N):
        rod = s.rigid_body(f"b{n}", 0.2, (0.01, 0.02, 0.03) if spatial else 0.02, at=(0.3 * n + 0.15, 0, 0))
        axis = ((0, 1, 0) if n % 2 else (0.2, 1, 0.3)) if spatial else (0, 0, 1)
        far = s.sensor(f"J{(n + 7) % N}.angle")
        own = -0.5 * s.sensor(f"J{n}.rate") + sp.Min(0.4 * far, 0.3)
        torque = {0: "u" if sampled else own, 4: own + s.sensor("e")}.get(n, own)
        s.revolute(f"J{n}", before, rod, at=(0.3 * n, 0, 0), axis=axis, model=model, torque=torque)
        before = rod
    s.state("e", rate=s.sensor(f"b{N - 1}.position[0]") - s.sensor("e"))
    s.force("push", s["b5"].at((1.8, 0, 0)), (0, -2 * sp.Max(s.sensor("b9.velocity[1]"), -0.5), 0))
    if sampled:
        s.controller("c", lambda t, x, e: 0.1 * e - 0.2 * x, every=0.05, reads=["b9.velocity[1]", "e"], sets=["u"])
    return s


def agreeing(r, other):
    for name in ("b0", f"b{N - 1}"):
        np.testing.assert_allclose(r[name].position, other[name].position, atol=2e-6)
    np.testing.assert_allclose(r["e"], other["e"], atol=2e-6)


@pytest.mark.parametrize(("spatial", "sampled"), [
    pytest.param(spatial, sampled, marks=[pytest.mark.slow] * (spatial != sampled))
    for spatial in (True, False) for sampled in (True, False)])
def test_runs_are_those_of_kinematic_joints(spatial, sampled):
    s = chain(spatial=spatial, sampled=sampled)
    assert prepare(s).all_bodies.moved.ordered
    options = {"record": "b9.position[0] == 2.7", "accuracy": 1e-7}
    r, other = s.simulate(0.4, **options), chain(mb.Kinematic(), spatial, sampled).simulate(0.4, **options)
    agreeing(r, other)
    assert [event.direction for event in r.events] == [event.direction for event in other.events]
    assert len(r.events) > 0
    np.testing.assert_allclose([e.time for e in r.events], [e.time for e in other.events], atol=1e-4)


def test_jacobians_are_differences():
    s = chain()
    system = s.system(mb.ODE())
    rng = np.random.default_rng(0)
    y, h = system.y0 + 0.05 * rng.normal(size=system.n), 1e-6
    exact, out = system.rate_jacobian(0.1, y), np.empty((2, system.n))
    for k in range(system.n):
        for i, sign in enumerate((1, -1)):
            system.rhs(0.1, y + sign * h * np.eye(system.n)[k], out[i])
        np.testing.assert_allclose(exact[:, k], (out[0] - out[1]) / (2 * h), atol=1e-5 * np.abs(exact).max())


def test_switches_are_those_of_kinematic_joints():
    """Arguments of Min at states in motion, of bodies that the chain carries."""
    found = []
    for model in (R, mb.Kinematic()):
        s = chain(model)
        r = s.simulate(0.1, accuracy=1e-8, solver=mb.RadauIIA(3))
        system = r.solution.systems[0][1]
        found.append(np.sort(system.switches.arguments(r.solution.t[-1:], r.solution.y[-1:])[0]))
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)
