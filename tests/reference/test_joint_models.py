"""Every joint in every model it admits against equations of motion by hand (`validation/joints/`): states, starts, runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joints import kinematics
from joints.chains import (
    LAWS,
    MODELS,
    Run,
    admits,
    as_drawn,
    by_hand,
    by_package,
    coordinate_nodes,
    drawn,
    off,
    random_state,
    scene_of,
    start_off,
    unknowns,
)
from joints.kinematics import KINDS
from joints.oracle import Chain, Wave

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare

AGREE = 1e-11  #: of the largest acceleration, or joint force
ALIKE = ("boom", "cam", "cylindrical", "fixed_orientation", "planar", "universal")  #: of turns and slides that others have too
EACH = [pytest.param(kind, marks=[pytest.mark.slow] * (kind in ALIKE)) for kind in KINDS]
TWO = [pytest.param(kind, *way, marks=[pytest.mark.slow] * ((i + k) % 2))  # each kind in one way, validation/joints has both
       for i, kind in enumerate(KINDS) for k, way in enumerate((("lk", None), ("kl", 1)))]


@pytest.mark.parametrize(("kind", "sides", "driven"), TWO)
def test_accelerations_and_reactions(kind, sides, driven):
    rng = np.random.default_rng(1)
    c = drawn(rng, (kind, kind), sides, driven)
    states = [random_state(rng, c) for _ in range(3)]
    for models in admits(c):
        prepared = prepare(scene_of(c, models))
        for state in states:
            assert max(off(by_package(c, prepared, *state), by_hand(c, *state))) < AGREE, models


@pytest.mark.parametrize("kinds", [("universal", "spherical", "screw"), ("planar", "boom", "cam"),
                                   ("free", "cylindrical", "universal")])
def test_joints_of_different_kinds_in_one_chain(kinds):
    rng = np.random.default_rng(7)
    c = drawn(rng, kinds, "lkl", 2)
    state = random_state(rng, c)
    for models in admits(c):
        assert max(off(by_package(c, prepare(scene_of(c, models)), *state), by_hand(c, *state))) < AGREE


@pytest.mark.parametrize("kind", EACH)
def test_equations_of_recursive_chains(kind):
    """The compiled right-hand side that a run integrates, in which forces are projected on the joint coordinates."""
    rng = np.random.default_rng(4)
    c = drawn(rng, (kind, kind), "kl")
    prepared = prepare(scene_of(c, [MODELS[2]] * 2))
    system, e = system_for(prepared, mb.ODE(), 0), prepared.all_bodies
    for _ in range(3):
        t, q, v = random_state(rng, c)
        positions, rates = unknowns(c, prepared, c.motion(q, v, 0 * v), q, v)
        y, out = np.concatenate(e.reduced(positions[None], rates[None]), axis=1)[0], np.empty(system.n)
        system.rhs(t, y, out)
        expected = c.second(t, q, v)
        order = np.concatenate([np.arange(*rate.indices(len(v))) for node, _, rate in coordinate_nodes(c, prepared)])
        assert np.max(np.abs(out[e.nq :] - expected[order])) < AGREE * np.max(np.abs(expected))


@pytest.mark.parametrize("kind", EACH)
def test_starts(kind):
    """Coordinates and rates that are stated, the velocities of bodies where a rotation is free."""
    rng = np.random.default_rng(2)
    c = drawn(rng, (kind, kind), "lk", 1)
    q, v = c.prescribed(0.0, *random_state(rng, c)[1:])
    q = as_drawn(c, q)
    for models in admits(c):
        assert start_off(c, prepare(scene_of(c, models, q, v)), 0.0, q, v) < AGREE


@pytest.mark.parametrize("kinds", [("universal", "screw"), pytest.param(("cylindrical", "boom"), marks=pytest.mark.slow),
                                   pytest.param(("spherical", "cam"), marks=pytest.mark.slow)])
def test_runs(kinds):
    rng = np.random.default_rng(3)
    c = drawn(rng, kinds, "lk")
    _, q, v = random_state(rng, c)
    q = as_drawn(c, q)
    reference = Run.of(c, q, v, 0.3)
    for models in admits(c, mixed=False):
        r = scene_of(c, models, q, v).simulate(0.3, accuracy=1e-7, outputs=reference.times)
        assert reference.off(c, r) < 10 * 1e-7


def test_a_free_rotation_has_no_classical_model():
    for kind in (kind for kind in KINDS if KINDS[kind].rotates):
        c = drawn(np.random.default_rng(1), (kind,), "l")
        with pytest.raises(mb.SceneError, match="free rotation"):
            prepare(scene_of(c, [mb.Classical()]))


# ---- the reference itself


@pytest.mark.parametrize("outer", ["l", "k"])
@pytest.mark.parametrize("kind", KINDS)
def test_kinematics_by_hand(kind, outer):
    """Velocities and accelerations are the derivatives of positions, by central differences of order 4."""
    rng, h = np.random.default_rng(5), 1e-3
    c = drawn(rng, (kind,), outer)
    _, q, v = random_state(rng, c)
    a = rng.normal(size=len(v))

    def rates(t, y):
        return np.r_[KINDS[kind].rates(y[: len(q)], y[len(q) :]), a]

    def at(t):
        y, step = np.r_[q, v], t / 4
        for _ in range(4):  # the classical method of Runge and Kutta, error near t^5 1e-3
            k1 = rates(0, y)
            k2 = rates(0, y + step / 2 * k1)
            k3 = rates(0, y + step / 2 * k2)
            y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + rates(0, y + step * k3))
        return c.motion(y[: len(q)], y[len(q) :], a)[0]

    def slope(f):
        return (8 * (f(at(h)) - f(at(-h))) - (f(at(2 * h)) - f(at(-2 * h)))) / (12 * h)

    here = at(0.0)
    spin = slope(lambda b: b.turn) @ here.turn.T
    for found, expected in ((slope(lambda b: b.r), here.v), (slope(lambda b: b.v), here.a), (slope(lambda b: b.w), here.w1),
                            (np.array([spin[2, 1], spin[0, 2], spin[1, 0]]), here.w)):
        np.testing.assert_allclose(found, expected, atol=1e-8 * (1 + np.max(np.abs(v)) ** 5))


def test_a_chain_by_hand_keeps_its_energy():
    """Without loads and dampers the power of inertial forces, gravity and springs vanishes."""
    rng = np.random.default_rng(6)
    c = drawn(rng, ("universal", "spherical", "planar"), "lkl")
    still = (Wave(), Wave(), Wave())
    c = replace(c, push=still, twist=still, links=tuple(replace(a, damper=0 * a.damper, load=0 * a.load) for a in c.links))

    def energy(q, v):
        total = sum(spring * q[at] ** 2 / 2 for at, _, spring, _, _ in c.scalars)
        for link, b in zip(c.links, c.motion(q, v, 0 * v), strict=True):
            W = (b.turn @ link.rotation).T @ b.w
            total += link.mass * (b.v @ b.v / 2 - c.gravity @ b.r) + W @ link.inertia @ W / 2
        return total

    _, q, v = random_state(rng, c)
    at_q, at_v = c.run(q, v, np.linspace(0, 0.15, 3))
    assert energy(at_q[-1], at_v[-1]) == pytest.approx(energy(q, v), rel=1e-9)


def without_coriolis(monkeypatch):
    own = KINDS["boom"].motion
    mistaken = replace(KINDS["boom"], motion=lambda q, v, a: own(q, np.r_[v[0], 0.0], a))
    monkeypatch.setitem(kinematics.KINDS, "boom", mistaken)


def without_gyroscopic_torque(monkeypatch):
    own = Chain.needed

    def needed(self, t, bodies):
        found = own(self, t, bodies)
        for row, link, b in zip(found, self.links, bodies, strict=True):
            R = b.turn @ link.rotation
            row[3:] -= np.cross(b.w, R @ link.inertia @ R.T @ b.w)
        return found

    monkeypatch.setattr(Chain, "needed", needed)


def with_another_lead(monkeypatch):
    monkeypatch.setattr(kinematics, "LEAD", -kinematics.LEAD)


@pytest.mark.parametrize(("kind", "mistake"), [("boom", without_coriolis), ("universal", without_gyroscopic_torque),
                                               ("screw", with_another_lead)])
def test_mistakes_in_the_reference_are_seen(monkeypatch, kind, mistake):
    rng = np.random.default_rng(1)
    c = drawn(rng, (kind, kind), "lk")
    state = random_state(rng, c)
    prepared = prepare(scene_of(c, [MODELS[2]] * 2))
    found = by_package(c, prepared, *state)
    assert max(off(found, by_hand(c, *state))) < AGREE
    mistake(monkeypatch)
    assert max(off(found, by_hand(c, *state))) > 1e4 * AGREE


def test_every_joint_that_states_a_motion_has_a_reference():
    """A joint added to the library must be added to `validation/joints/kinematics.py`."""
    from mbdae.laws import joints as library

    known = {law for law, _ in LAWS.values()}
    stated = [getattr(library, name) for name in library.__all__]
    missing = [law.__name__ for law in stated if isinstance(law, type) and issubclass(law, mb.Joint) and law.coordinates
               and law.states_motion() and law not in known]
    assert not missing
