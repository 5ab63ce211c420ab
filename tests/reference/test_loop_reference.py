"""The dense reference of mechanisms with loops by itself: closed forms, differences along motions, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import loops
from oracles import overconstrained as over
from oracles.bodies import GROUND, Body, Input, Joint, Mechanism
from oracles.mechanisms import LETTERS, a_body, a_joint, loop, second_loop, unit
from scipy.spatial.transform import Rotation

Z = np.array([0.0, 0.0, 1.0])


def random_state(rng, mechanism):
    """Any state, consistent or not."""
    state = mechanism.drawn.moved(rng.normal(size=(len(mechanism.bodies), 6)))
    u = np.zeros((len(mechanism.bodies) + 1, 6))
    u[:-1] = rng.normal(size=(len(mechanism.bodies), 6)) * mechanism.moving.reshape(-1, 6)
    return replace(state, t=0.3, v=u[:, :3], w=u[:, 3:])


def consistent(rng, mechanism):
    """A state that satisfies the joints, near to the one drawn."""
    state = random_state(rng, mechanism)
    near = mechanism.drawn.moved(0.02 * rng.normal(size=(len(mechanism.bodies), 6)) * mechanism.moving.reshape(-1, 6))
    state = loops.projected(mechanism, loops.closed(mechanism, replace(state, r=near.r, R=near.R)))
    assert np.max(np.abs(loops.constraints(mechanism, state).g)) < 1e-12
    return state


@pytest.mark.parametrize("letter", LETTERS)
@pytest.mark.parametrize("ends", [(0, 1), (GROUND, 0), (1, GROUND)])
def test_rows_are_those_of_differences_along_any_motion(letter, ends):
    """Velocity and acceleration of every row by differences in time along a random motion: h^2 is 1e-6 and 1e-8."""
    rng = np.random.default_rng(len(LETTERS[letter]))
    bodies = tuple(a_body(rng, name, rng.normal(size=3)) for name in "ab")
    joint = a_joint(rng, letter, "J", *ends, rng.normal(size=3))
    if letter == "P":
        joint = replace(joint, drive=Input(0.1, 0.4, 0.3, 2.0))
    m = Mechanism(bodies, (joint,))
    state, a = random_state(rng, m), rng.normal(size=(2, 6))
    c, u = loops.constraints(m, state), np.hstack([state.v, state.w])[:-1]
    h = 1e-4
    before, here, after = (loops.constraints(m, state.later(s, a)).g for s in (-h, 0.0, h))
    np.testing.assert_allclose((after - before) / (2 * h), c.J @ u.ravel() - c.speed, atol=1e-6)
    np.testing.assert_allclose((after - 2 * here + before) / h**2, c.J @ a.ravel() + c.bias, atol=1e-5)


def test_angle_of_a_drive_by_differences():
    """Where the axes are together, as its joint keeps them."""
    rng, h = np.random.default_rng(4), 1e-4
    m = Mechanism((a_body(rng, "a", unit(rng)), a_body(rng, "b", unit(rng))),
                  (a_joint(rng, "R", "A", GROUND, 0, unit(rng)), a_joint(rng, "R", "B", 0, 1, unit(rng))))
    state = consistent(rng, m)
    a = loops.solve(replace(m, gravity=unit(rng)), state).a
    _, rate, second = loops.coordinate(m, state, m.joints[1], a)
    before, here, after = (loops.coordinate(m, state.later(s, a), m.joints[1])[0] for s in (-h, 0.0, h))
    assert (after - before) / (2 * h) == pytest.approx(rate, abs=1e-6)
    assert (after - 2 * here + before) / h**2 == pytest.approx(second, abs=1e-5)


@pytest.mark.parametrize("make", [
    lambda rng: loop(rng, "RUSR", springs=()), lambda rng: loop(rng, "RPSRRR", springs=(0, 1)), over.under_forces(over.bennett),
    lambda rng: loop(rng, "RSDR", points=(1,)), over.under_forces(over.sarrus), over.under_forces(over.spherical),
    lambda rng: second_loop(rng, loop(rng, "RSSR"), "D", 0, 2),
])
def test_energy_changes_by_what_acts(make):
    """dE/dt along the motion is the power of dampers and loads, and joints stay closed to the second order."""
    rng = np.random.default_rng(7)
    m = make(rng)
    state, h = consistent(rng, m), 1e-4
    motion = loops.solve(m, state)
    assert motion.contradiction < 1e-10
    after, before = state.later(h, motion.a), state.later(-h, motion.a)
    undamped = replace(m, joints=tuple(replace(j, damper=0.0, load=0.0) for j in m.joints), loads=(),
                       springs=tuple(replace(s, damping=0.0) for s in m.springs))
    u = np.hstack([state.v, state.w])[:-1].ravel()
    power = u @ (loops.forces(m, state) - loops.forces(undamped, state))
    change = (loops.energy(m, after) - loops.energy(m, before)) / (2 * h)
    assert abs(power) > 1e-3  # a hundred times what is allowed below
    assert change == pytest.approx(power, abs=1e-5 * (1 + abs(power)))
    g = [loops.constraints(m, s).g for s in (before, state, after)]
    assert np.max(np.abs(g[0] - 2 * g[1] + g[2])) / h**2 < 1e-4


def rod(inertia=(0.02, 0.3, 0.5), at=(0.7, 0, 0), mass=1.3):
    return Body("rod", mass, np.diag(inertia), np.array(at, dtype=float))


def test_pendulum():
    """(I + m d^2) phi'' = m g d cos(phi) - k phi - c phi' + load, and the force at the hinge."""
    g, k, c, load = 9.81, 3.0, 0.4, 0.7
    joint = Joint("revolute", "hinge", GROUND, 0, np.zeros(3), np.array([0, 1.0, 0]), spring=k, damper=c, load=load)
    m = Mechanism((rod(),), (joint,), gravity=-g * Z)
    phi, rate = 0.4, 1.7
    R = Rotation.from_rotvec([0, phi, 0]).as_matrix()
    r, w = R @ np.array([0.7, 0, 0]), rate * np.array([0, 1.0, 0])
    state = replace(m.drawn, r=np.array([r, np.zeros(3)]), R=np.array([R, np.eye(3)]), w=np.array([w, np.zeros(3)]),
                    v=np.array([np.cross(w, r), np.zeros(3)]))
    motion = loops.solve(m, state)
    second = (1.3 * g * 0.7 * np.cos(phi) - k * phi - c * rate + load) / (0.3 + 1.3 * 0.7**2)
    assert motion.a[0, 4] == pytest.approx(second, rel=1e-12)
    assert loops.coordinate(m, state, joint, motion.a) == pytest.approx((phi, rate, second), rel=1e-12)
    np.testing.assert_allclose(motion.wrench[0, :3], 1.3 * (motion.a[0, :3] + g * Z), atol=1e-12)
    assert motion.wrench[0, 4] == pytest.approx(-k * phi - c * rate + load, rel=1e-12)
    assert motion.unique.all()


def test_torque_of_a_drive():
    """The drive of a pendulum takes (I + m d^2) phi'' - m g d cos(phi)."""
    joint = Joint("revolute", "hinge", GROUND, 0, np.zeros(3), np.array([0, 1.0, 0]), drive=Input(0.1, 0.8, 0.5, 3.0))
    m = Mechanism((rod(),), (joint,), gravity=-9.81 * Z)
    state = loops.projected(m, loops.closed(m, replace(m.drawn, t=0.4)))
    phi, _, second = joint.drive(0.4)
    torque = (0.3 + 1.3 * 0.7**2) * second - 1.3 * 9.81 * 0.7 * np.cos(phi)
    assert loops.solve(m, state).wrench[0, 4] == pytest.approx(torque, rel=1e-12)


def test_euler_equations():
    """J w' + w x J w = 0 in the axes of the body."""
    rng, J = np.random.default_rng(2), np.array([0.2, 0.3, 0.45])
    m = Mechanism((rod(J),), ())
    state = random_state(rng, m)
    w = state.R[0].T @ state.w[0]
    exact = np.array([(J[1] - J[2]) * w[1] * w[2], (J[2] - J[0]) * w[2] * w[0], (J[0] - J[1]) * w[0] * w[1]]) / J
    np.testing.assert_allclose(state.R[0].T @ loops.solve(m, state).a[0, 3:], exact, rtol=1e-12)


def test_heavy_top():
    """theta'' = (A phi'^2 cos(theta) - C n phi' + m g l) sin(theta) / A, n = psi' + phi' cos(theta), of Lagrange's top."""
    mass, length, across, C, g = 1.3, 0.7, 0.3, 0.1, 9.81
    A = across + mass * length**2
    m = Mechanism((rod((across, across, C), (0, 0, length), mass),), (Joint("spherical", "tip", GROUND, 0, np.zeros(3), Z),),
                  gravity=-g * Z)
    theta, turning, nutating, spinning = 0.6, 0.9, -0.4, 12.0
    line = np.array([1.0, 0, 0])  # of nodes: tilted about x
    R = Rotation.from_rotvec(theta * line).as_matrix()
    axis = R @ Z
    w = turning * Z + nutating * line + spinning * axis
    r = length * axis
    zero = np.zeros(3)
    state = replace(m.drawn, r=np.array([r, zero]), R=np.array([R, np.eye(3)]), w=np.array([w, zero]),
                    v=np.array([np.cross(w, r), zero]))
    a = loops.solve(m, state).a[0, 3:]
    n = spinning + turning * np.cos(theta)
    exact = (A * turning**2 * np.cos(theta) - C * n * turning + mass * g * length) * np.sin(theta) / A
    # w.line = theta' and line' = turning Z x line, so theta'' = w'.line + w.line'
    assert a @ line + w @ (turning * np.cross(Z, line)) == pytest.approx(exact, rel=1e-12)


def test_a_drive_against_its_own_free_motion():
    """A joint driven by the angle that it would have had anyhow takes no torque."""
    rng = np.random.default_rng(9)
    m = loop(rng, "RSPUR", springs=())
    state = consistent(rng, m)
    free = loops.solve(m, state)
    value, rate, second = loops.coordinate(m, state, m.joints[0], free.a)

    class Same(Input):
        def __call__(self, t):
            return value, rate, second

    driven = replace(m, joints=(replace(m.joints[0], drive=Same()), *m.joints[1:]))
    held = loops.solve(driven, state)
    np.testing.assert_allclose(held.a, free.a, atol=1e-10)
    np.testing.assert_allclose(held.wrench, free.wrench, atol=1e-10)


def test_which_reactions_are_unique():
    """One hinge carries what it carries; two of one line share it, and what holds on the body beyond them is unique again."""
    rng = np.random.default_rng(1)
    for hinges, redundant in ((1, 0), (2, 5), (3, 10)):
        m = over.under_forces(lambda rng, hinges=hinges: over.door(rng, hinges))(rng)
        motion = loops.solve(m, consistent(rng, m))
        assert motion.rows - motion.rank == redundant
        assert motion.unique[-1].all()
        assert motion.unique[:-1].all() == (hinges == 1)
        assert loops.freedoms(m, m.drawn, rng) == (2, redundant)


def test_freedoms_at_a_singular_position():
    """A flat parallelogram has one freedom all the same: other positions tell."""
    rng = np.random.default_rng(3)
    x, z = np.eye(3)[0], Z
    m = over.chained(rng, "RRRR", [0 * x, 0.5 * x, 1.7 * x, 1.2 * x], [z] * 4, springs=())
    here = loops.constraints(m, m.drawn)
    assert loops.decomposed(here.J)[2] == 16
    assert loops.freedoms(m, m.drawn, rng) == (1, 3)
