"""Mechanisms with one or two loops against dense equations of motion written by hand (`loops.py`), at random states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import loops
from oracles import overconstrained as over
from oracles.bodies import Input
from oracles.mechanisms import Drawn, flattened, scene_of, start_of
from oracles.random_loops import (
    AGREE,
    ALL,
    CHAINS,
    DOUBLE,
    MODELS,
    SPECIAL,
    agree,
    drawn,
    far,
    freedoms,
    reactions_off,
    scene,
    solved,
)
from threadpoolctl import threadpool_limits

import mbdae as mb
from mbdae.formulations import GGL, Index1, system_for
from mbdae.system.prepare import prepare

PLANAR = {
    "four-bar": over.planar,
    "four-bar, driven": over.driven(over.planar),
    "slider-crank": lambda rng, **own: over.planar(rng, "RRRP", springs=(0, 3), **own),
    "five-bar": lambda rng, **own: over.planar(rng, "RRRRR", **own),
    "six-bar": over.six_bar,
}
ONE = [(name, seed) for name in CHAINS for seed in range(4)] + [(name, seed) for name in SPECIAL for seed in range(2)]
TWO = [(name, seed) for name in DOUBLE for seed in range(3)]


@pytest.fixture(autouse=True)
def one_thread():
    """Matrices are small."""
    with threadpool_limits(1):
        yield


#: one of every mechanism, two of every second
@pytest.mark.parametrize(("name", "seed"), [pytest.param(*p, marks=[pytest.mark.slow] * (p[1] > len(p[0]) % 2))
                                            for p in ONE + TWO])
def test_accelerations_reactions_and_freedoms(name, seed):
    """With one of the joint models in turn; programs of recursive trees take longest to compile."""
    start, p = drawn(name, seed, MODELS[(seed + len(name)) % 4 if seed < 4 else seed % 2])
    agree(start.mechanism, p)
    assert (p.rank.degrees_of_freedom, len(p.rank.dropped)) == freedoms(start.mechanism, p)
    assert not p.rank.singular_here
    assert not p.rank.doubtful


@pytest.mark.parametrize("name", ["one universal joint", "door on two hinges", "door on three hinges"])
def test_rows_that_joint_coordinates_satisfy_by_themselves(name):
    """Of a redundant row nothing but rounding is left over the coordinates of recursive joints: reactions stay finite, and those
    that are unique right."""
    start, p = drawn(name, 0, "recursive")
    agree(start.mechanism, p)
    assert np.max(np.abs(p.with_all_rows.accelerations(np.zeros(1), p.start.q[None], p.start.u[None], p.start.s[None])[1])) < 1e4


@pytest.mark.parametrize("seed", range(4))
def test_a_linkage_driven_through_turns_contradicts_nothing(seed):
    """Without its redundant rows Bennett's linkage closes on other branches too."""
    m = over.driven(over.bennett)(np.random.default_rng(seed))
    m = replace(m, joints=(replace(m.joints[0], drive=Input(slope=1.3)), *m.joints[1:]))
    assert scene_of(m).check().degrees_of_freedom == 0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [*ONE, *TWO])
def test_every_model(name, seed):
    for model in MODELS:
        start, p = drawn(name, seed, model)
        agree(start.mechanism, p)
        assert (p.rank.degrees_of_freedom, len(p.rank.dropped)) == freedoms(start.mechanism, p)


def forms(m, p, chosen):
    """Accelerations of the equations of motion in a form, and what is left of them with those of the reference."""
    _, motion, expected = solved(m, p, p.start.t, p.start.q, p.start.u)
    system = system_for(p, chosen, 0 if chosen == Index1() else 1)
    nb, own = system.numbering, expected[p.all_bodies.numbering.of_velocities]
    moving = slice(nb.nq, nb.nq + nb.nu)
    if system.rhs is not None:  # multipliers eliminated
        out = np.empty(system.n)
        system.rhs(system.t0, system.y0, out)
        assert far(out[moving], own) < AGREE
        return
    assert far(system.yp0[moving], own) < AGREE
    yp, left = system.yp0.copy(), np.empty(system.n)
    yp[moving] = own
    system.residual(system.t0, system.y0, yp, left)
    assert np.max(np.abs(left)) < AGREE * max(np.max(np.abs(own)), np.max(np.abs(motion.wrench)))


FORMS = (GGL(), Index1(), GGL(algebraic=True), Index1(multipliers="derivatives"))


#: whose derivatives as a tree of recursive joints compile in seconds; longer trees of joints in space take minutes
SHORT = ("RUSR", "RSSR", "RRURU", "PRDR", "RSDR", "planar", "spherical", "Bennett", "Cardan", "door on three hinges", "wedge")


def choices(models):
    """Mechanisms with models whose equations compile in seconds."""
    return [(name, model) for name in ALL for model in models if model != "recursive" or name in SHORT]


@pytest.mark.parametrize(("number", "name", "model"), [(i, n, m) for i, (n, m) in enumerate(choices(["mixed"])[1::8])]
                         + [(i, n, "recursive") for i, n in enumerate(SHORT[::4][:2])])
def test_equations_in_a_form(number, name, model):
    start, p = drawn(name, 0, model)
    forms(start.mechanism, p, FORMS[number % 2])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model"), choices(MODELS))
@pytest.mark.parametrize("form", FORMS)
def test_equations_in_every_form(name, form, model):
    start, p = drawn(name, 0, model)
    forms(start.mechanism, p, form)


def later(name, model, seed=0):
    """Accelerations and reactions of a result at a later time, in the state of the run."""
    start, _ = drawn(name, seed, model)
    r = scene(start, model).simulate(0.1, solver=mb.RadauIIA(3, rtol=1e-9), form=mb.GGL(), outputs=[0.0, 0.1])
    m, p = start.mechanism, r.prepared
    _, motion, expected = solved(m, p, 0.1, r.q[-1], r.u[-1])
    assert far(r.acceleration[-1], expected) < AGREE
    assert reactions_off(m, motion, np.array([np.r_[r[j.name].force[-1], r[j.name].torque[-1]] for j in m.joints])) < AGREE
    for joint, unique in zip(m.joints, motion.unique, strict=True):
        assert r[joint.name].reaction_is_unique == bool(np.all(unique))


@pytest.mark.parametrize(("name", "model"), [("RUSR", "recursive"), ("planar", "kinematic"), ("Bennett", "mixed"),
                                             ("Sarrus", "classical"), ("door on three hinges", "recursive")])
def test_at_a_later_time(name, model):
    later(name, model)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model"), choices(MODELS))
def test_every_model_at_a_later_time(name, model):
    later(name, model)


@pytest.mark.parametrize("name", PLANAR)
@pytest.mark.parametrize("model", ["kinematic", "classical", "recursive"])
def test_in_the_plane_and_in_space(name, model):
    """The model in the plane, and the over-constrained one in space, against the same reference."""
    rng = np.random.default_rng(5)
    start = start_of(rng, over.under_forces(lambda rng: PLANAR[name](rng, placed=(np.eye(3), np.zeros(3))))(rng))
    start = flattened(start.nearer(0.3))
    for space in ("planar", "spatial"):
        p = prepare(scene(start, model, space))
        agree(start.mechanism, p)
        assert p.model.planar == (space == "planar")
        dof, redundant = freedoms(start.mechanism, p)
        assert p.rank.degrees_of_freedom == dof
        assert len(p.rank.dropped) == (0 if p.model.planar else redundant)


def test_a_chain_that_ends_free_is_an_ordinary_differential_equation():
    start, _ = drawn("RRURU", 3)
    m = replace(start.mechanism, joints=start.mechanism.joints[:2], bodies=start.mechanism.bodies[:2], springs=(), loads=())
    p = prepare(scene(Drawn(m, start.hold, start.velocities[:2]), "recursive"))
    agree(m, p)
    forms(m, p, mb.ODE())


def without_gyroscopic_torque(monkeypatch):
    f = loops.forces

    def forces(mechanism, state):
        M, w = loops.inertia(mechanism, state), np.hstack([0 * state.w, state.w])[:-1]
        momentum = (M @ w.ravel()).reshape(-1, 6)
        return f(mechanism, state) + np.hstack([0 * w[:, :3], np.cross(w[:, 3:], momentum[:, 3:])]).ravel()

    monkeypatch.setattr(loops, "forces", forces)


def with_another_sign(row):
    def change(monkeypatch):
        own = getattr(loops.Sides, row)

        def turned(self, *given):
            *rest, bias = own(self, *given)
            return *rest, -bias

        monkeypatch.setattr(loops.Sides, row, turned)

    return change


def with_another_second_derivative(monkeypatch):
    own = Input.__call__
    monkeypatch.setattr(Input, "__call__", lambda self, t: own(self, t) * (1, 1, -1))


@pytest.mark.parametrize(("name", "mistake"), [
    ("RPSRRR", without_gyroscopic_torque), ("RRURU", with_another_sign("along")), ("RRURU", with_another_sign("square")),
    ("RPSRRR", with_another_sign("along_of_k")), ("PRDR", with_another_sign("apart")), ("RSSR", with_another_second_derivative),
])
def test_mistakes_in_the_reference_are_seen(monkeypatch, name, mistake):
    """A term left out, or a sign: accelerations are off by more than ten thousand times what is allowed.

    Gyroscopic torques do no work, so the accelerations of one freedom alone would not show them."""
    start, p = drawn(name, 0)
    m, state = start.mechanism, (p.start.t, p.start.q, p.start.u)
    assert far(p.start.acceleration, solved(m, p, *state)[2]) < AGREE
    mistake(monkeypatch)
    assert far(p.start.acceleration, solved(m, p, *state)[2]) > 1e4 * AGREE
