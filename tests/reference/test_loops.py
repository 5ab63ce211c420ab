"""Mechanisms with one or two loops against dense equations of motion written by hand (`loops.py`), at random states."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

import loops
import overconstrained as over
from bodies import Input
from mechanisms import COORDINATE, Drawn, flattened, loop, node_accelerations, scene_of, second_loop, start_of, state_of
from threadpoolctl import threadpool_limits

import mbdae as mb
from mbdae.formulations import GGL, Index1, system_for
from mbdae.results.reactions import wrenches
from mbdae.results.states import States
from mbdae.system.prepare import prepare

AGREE = 1e-9  #: of the largest acceleration, or force; what is measured is near 1e-13

#: single loops: joints from the ground to the ground by their letters, and what acts on them
CHAINS = {
    "RUSR": {},
    "RSSR": {"drives": (0,), "springs": (3,)},
    "RRURU": {"springs": (0, 1)},
    "RSPUR": {"springs": (2,)},
    "RPSRRR": {"springs": (1,), "drives": (0,)},
    "RRRRRRR": {},
    "RRPRRWUR": {"springs": (0, 2)},
    "PRDR": {},
    "RSDR": {"points": (1,)},
}
SPECIAL = {
    "planar": over.planar,
    "planar, driven": over.driven(over.planar),
    "slider-crank": lambda rng: over.planar(rng, "RRRP", springs=(0, 3)),
    "wedge": lambda rng: over.planar(rng, "PPP"),
    "parallelogram": over.parallelogram,
    "spherical": over.spherical,
    "Bennett": over.bennett,
    "Bennett, driven": over.driven(over.bennett),
    "Sarrus": over.sarrus,
    "Cardan": over.cardan,
    "Cardan, driven": over.driven(over.cardan),
    "one universal joint": over.one_joint_shaft,
    "welded twice": over.welded_twice,
    "door on two hinges": lambda rng: over.door(rng, 2),
    "door on two balls": lambda rng: over.door(rng, 2, "S"),
}
DOUBLE = {
    "RRURU, SUR": lambda rng: second_loop(rng, loop(rng, "RRURU"), "SUR", 0, -1, (2,)),
    "RSSR, D": lambda rng: second_loop(rng, loop(rng, "RSSR"), "D", 0, 2),
    "RPSRRR, RSU": lambda rng: second_loop(rng, loop(rng, "RPSRRR", springs=(1,)), "RSU", 1, 3, (0,)),
    "RRRRRRR, SPU": lambda rng: second_loop(rng, loop(rng, "RRRRRRR", drives=(0,), springs=()), "SPU", 2, -1, (1,)),
    "platform on three cranks": over.cranks,
    "platform on three cranks, driven": over.driven(over.cranks),
    "door on three hinges": over.door,
    "planar six-bar": over.six_bar,
    "spherical six-bar": lambda rng: over.six_bar(rng, True),
    "four-bar and SUS": over.crossed,
}


PLANAR = {
    "four-bar": over.planar,
    "four-bar, driven": over.driven(over.planar),
    "slider-crank": lambda rng, **own: over.planar(rng, "RRRP", springs=(0, 3), **own),
    "five-bar": lambda rng, **own: over.planar(rng, "RRRRR", **own),
    "six-bar": over.six_bar,
}
MODELS = ("kinematic", "classical", "recursive", "mixed")
ALL = {letters: (lambda rng, letters=letters: loop(rng, letters, **CHAINS[letters])) for letters in CHAINS}
ALL |= {name: over.under_forces(make) for name, make in (SPECIAL | DOUBLE).items()}
ONE = [(name, seed) for name in CHAINS for seed in range(8)] + [(name, seed) for name in SPECIAL for seed in range(2)]
TWO = [(name, seed) for name in DOUBLE for seed in range(5)]


@pytest.fixture(autouse=True)
def one_thread():
    """Matrices are small."""
    with threadpool_limits(1):
        yield


def scene(start, model, space="auto"):
    """The scene of a start with all its joints "kinematic", "classical", "recursive" (as many as form a tree), or "mixed"."""
    names = [j.name for j in start.mechanism.joints if j.kind in COORDINATE]
    models = {n: mb.Classical() if model == "classical" else mb.Kinematic() for n in names}
    if model == "mixed":
        models |= {n: mb.Classical() for n in names[1::2]} | {names[0]: mb.Recursive()}
    made = scene_of(start.mechanism, models, start.hold, start.velocities, space)
    return made.recursive() if model == "recursive" else made


def drawn(name, seed, model="kinematic"):
    """A mechanism with its start, as near to where it is drawn as it must be to close, and its prepared scene."""
    rng = np.random.default_rng(seed)
    start = start_of(rng, ALL[name](rng))
    for share in (1.0, 0.3, 0.1):
        try:
            return start.nearer(share), prepare(scene(start.nearer(share), model))
        except mb.SceneError:
            continue
    return start.nearer(0.0), prepare(scene(start.nearer(0.0), model))


def solved(mechanism, prepared, t, q, u, closed=1e-9):
    """The reference at a state of a prepared scene, which it finds consistent: the state, its motion, and the accelerations
    (nu,) of all nodes."""
    state = state_of(prepared, t, q, u)
    c, speeds = loops.constraints(mechanism, state), np.hstack([state.v, state.w])[:-1].ravel()
    assert np.max(np.abs(c.g)) < closed
    assert np.max(np.abs(c.J @ speeds - c.speed)) < closed * (1 + np.max(np.abs(speeds)))
    motion = loops.solve(mechanism, state)
    joints = [j for j in mechanism.joints if j.kind in COORDINATE]
    of_joints = {j.name: loops.coordinate(mechanism, state, j, motion.a)[2] for j in joints}
    return state, motion, node_accelerations(prepared, state, motion.a, of_joints)


def far(one, other):
    """Largest difference over the largest value."""
    return float(np.max(np.abs(one - other), initial=0.0) / np.max(np.abs(other), initial=1e-300))


def reactions_off(mechanism, motion, found):
    """How far the reactions (joints, 6) are off that are unique, over the largest force or torque."""
    size = np.max(np.abs(motion.wrench))
    return float(np.max(np.abs(found - motion.wrench)[motion.unique], initial=0.0) / size)


def agree(m, p):
    """Accelerations and unique reactions at the start of a prepared scene are those of the reference."""
    begin = p.start
    _, motion, expected = solved(m, p, begin.t, begin.q, begin.u)
    assert motion.contradiction < 1e-9
    assert far(begin.acceleration, expected) < AGREE
    shown = wrenches(p, States(np.array([begin.t]), begin.q[None], begin.u[None], begin.s[None], None))[0]
    at = [c.name for c in p.model.scene.connections]
    assert reactions_off(m, motion, shown[[at.index(j.name) for j in m.joints]]) < AGREE


def freedoms(mechanism, prepared):
    """Degrees of freedom and number of redundant rows by the reference."""
    begin = prepared.start
    state = state_of(prepared, begin.t, begin.q, begin.u)
    return loops.freedoms(mechanism, state, np.random.default_rng(1), 1)


@pytest.mark.parametrize(("name", "seed"), [*ONE, *TWO])
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
                         + [(i, n, "recursive") for i, n in enumerate(SHORT[::4][:2])])  # fmt: skip
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
                                             ("Sarrus", "classical"), ("door on three hinges", "recursive")])  # fmt: skip
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
])  # fmt: skip
def test_mistakes_in_the_reference_are_seen(monkeypatch, name, mistake):
    """A term left out, or a sign: accelerations are off by more than ten thousand times what is allowed.

    Gyroscopic torques do no work, so the accelerations of one freedom alone would not show them."""
    start, p = drawn(name, 0)
    m, state = start.mechanism, (p.start.t, p.start.q, p.start.u)
    assert far(p.start.acceleration, solved(m, p, *state)[2]) < AGREE
    mistake(monkeypatch)
    assert far(p.start.acceleration, solved(m, p, *state)[2]) > 1e4 * AGREE
