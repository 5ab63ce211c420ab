"""Motions with recursive joints: closed forms, the same motion as other models and solvers, loops closed by one joint."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from random_scenes import random_scene
from recursive_scenes import four_bar, prescribed, tree_on_free_body, tree_on_ground
from scipy.integrate import trapezoid

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.base import Solver
from mbdae.system.base import Array
from mbdae.system.prepare import prepare

R, K = mb.Recursive(), mb.Kinematic()
TURNS, LONG = 1e4, 10.0  # -, s


def wheel(space: str, model: mb.Recursive | mb.Kinematic, torque: float | None = None, rate0: float = 0.0) -> mb.Scene:
    """A wheel of J = 0.5 kg m^2 about its axis."""
    s = mb.Scene("wheel", space=space)
    body = s.rigid_body("wheel", 2.0, (0.3, 0.3, 0.5))
    s.revolute("hub", s.ground, body, at=(0, 0, 0), model=model, torque=torque, rate0=rate0)
    return s


@pytest.mark.parametrize(("space", "model"), [("planar", R), ("spatial", R), ("planar", K)])
def test_ten_thousand_turns_under_a_constant_torque(space: str, model: mb.Recursive | mb.Kinematic) -> None:
    """angle = torque t^2 / 2 J, whole turns counted, to 1e-9."""
    torque = 0.5 * 2 * TURNS * 2 * np.pi / LONG**2
    r = wheel(space, model, torque).simulate(LONG, solver=mb.IDA(rtol=1e-8), outputs=5)
    np.testing.assert_allclose(r["hub"].angle, torque * r.t**2, rtol=1e-9)
    np.testing.assert_allclose(r["hub"].rate, 2 * torque * r.t, rtol=1e-9)


@pytest.mark.slow
def test_ten_thousand_turns_of_a_spatial_kinematic_joint() -> None:
    """Its quaternion goes round with the wheel, 20 steps for every turn; the angle is counted along them."""
    rate = TURNS * 2 * np.pi / LONG
    r = wheel("spatial", K, rate0=rate).simulate(LONG, solver=mb.RadauIIA(3, step=LONG / TURNS / 20), outputs=5)
    np.testing.assert_allclose(r["hub"].angle, rate * r.t, rtol=1e-9)


def told(scene: mb.Scene, t_end: float, **options: Any) -> tuple[mb.Result, list[str]]:
    """A result with what it warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        r = scene.simulate(t_end, **options)
    return r, [str(w.message) for w in caught]


def test_four_bar_with_three_recursive_joints_moves_as_in_the_plane() -> None:
    """In space the closing joint has five rows for a loop that needs two; the other three are left out and named."""
    options = {"accuracy": 1e-10, "solver": mb.RadauIIA(3), "outputs": 51}
    flat = four_bar("planar").simulate(1.0, **options)
    r, said = told(four_bar("spatial", R), 1.0, **options)
    assert not said
    for joint in "ABCD":
        assert np.max(np.abs(r[joint].angle - flat[joint].angle)) < 1e-9
    found = four_bar("spatial", R).check()
    assert sorted(found.redundant) == ["D.tilt_x", "D.tilt_y", "D.z"]
    assert found.unknowns == {"positions": 3, "velocities": 3, "states": 0, "multipliers": 2}
    assert not r["D"].reaction_is_unique


def test_a_tilt_of_a_millionth_is_told() -> None:
    """The loop locks if the rows are taken at their word: they are left out with a warning, and the motion stays."""
    options = {"accuracy": 1e-8, "solver": mb.RadauIIA(3), "outputs": 11}
    straight, _ = told(four_bar("spatial", R), 0.3, **options)
    tilted, said = told(four_bar("spatial", R, tilt=1e-6), 0.3, **options)
    assert any("constraint row D.tilt_y is nearly redundant" in text and "align the joints" in text for text in said)
    assert not any("is violated by" in text for text in said)  # that it stays off is told once
    assert np.max(np.abs(tilted["D"].angle - straight["D"].angle)) < 1e-6
    with pytest.raises(mb.StartError, match=r"contradict the joints: [BC]\.tilt_y"):  # a tenth is meant: the loop is locked
        four_bar("spatial", R, tilt=0.1).check()


def test_the_dropped_row_of_a_prescribed_angle_is_its_drive_torque() -> None:
    """Torque, force and power of the drives equal those of kinematic joints along the run."""
    s = prescribed()
    options = {"accuracy": 1e-9, "solver": mb.RadauIIA(3), "outputs": 21}
    recursive, kinematic = s.simulate(0.5, **options), s.replace(model=K).simulate(0.5, **options)
    for joint, quantity in (("B", "torque"), ("B", "power"), ("C", "force"), ("A", "force"), ("D", "torque")):
        a, b = getattr(recursive[joint], quantity), getattr(kinematic[joint], quantity)
        assert np.max(np.abs(a - b)) < 1e-6 * np.max(np.abs(b)), (joint, quantity)
    assert np.max(np.abs(recursive["B"].power)) > 0.1
    assert recursive.info.form == "ODE"


def test_a_driven_tree_without_a_coordinate_left_carries_others() -> None:
    """A bob hangs on an arm whose angle is prescribed: the tree has no row of its own, its torque is read all the same."""
    s = mb.Scene("driven arm", gravity=(0, -9.81, 0))
    arm = s.link("arm", (0, 0), (1, 0), mass=1.0)
    s.revolute("motor", s.ground, arm, at=(0, 0), angle=2 * mb.t, model=R)
    s.distance("rod", arm, s.point_mass("bob", 0.5, at=(1, -0.5)), (1, 0), (1, -0.5))
    fixed = s.rigid_body("box", 0.3, 0.1, at=(1, 0.2))
    s.weld("weld", arm, fixed)
    r, k = (scene.simulate(1.0, accuracy=1e-8, solver=mb.RadauIIA(3), outputs=11) for scene in (s, s.replace(model=K)))
    np.testing.assert_allclose(r["bob"].position, k["bob"].position, atol=1e-7)
    np.testing.assert_allclose(r["motor"].torque, k["motor"].torque, atol=1e-4)
    np.testing.assert_allclose(r["motor"].angle, 2 * r.t, atol=1e-12)


@pytest.mark.parametrize("seed", [0, 8, 9, 29, 38, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (12, 36))])
def test_random_scenes_move_the_same(seed: int) -> None:
    """Trees and loops of all joints and forces, drawn at random: whatever can be recursive is."""
    s = random_scene(seed)
    recursive = s.recursive()
    assert recursive.check().recursive
    a, b = (scene.simulate(0.3, accuracy=1e-6, outputs=4) for scene in (recursive, s))
    for body in s.bodies:
        assert np.max(np.abs(a[body.name].position - b[body.name].position)) < 3e-6, body.name
    for joint in s.joints:
        if b[joint.name].reaction_is_unique:
            force = b[joint.name].force
            assert np.max(np.abs(a[joint.name].force - force)) < 1e-4 * (1 + np.max(np.abs(force))), joint.name


@pytest.mark.parametrize("solver", [mb.CVODE(), mb.CVODE(method="BDF"), mb.IDA(), mb.RadauIIA(3), mb.RadauIIA(2)])
def test_solvers_agree_on_a_chain_of_a_slide_and_a_hinge(solver: Solver) -> None:
    """A pendulum on a spring-held slide: horizontal momentum of both follows from the spring's force alone."""
    s = mb.Scene("slide and hinge", gravity=(0, -9.81, 0))
    slide = s.rigid_body("slide", 2.0, 0.1, at=(0, 0))
    rod = s.link("rod", (0, 0), (0.6, -0.8), mass=1.0)
    s.prismatic("x", s.ground, slide, at=(0, 0), axis=(1, 0, 0), spring=30.0, model=R)
    s.revolute("phi", slide, rod, at=(0, 0), model=R)
    r = s.simulate(2.0, accuracy=1e-6, solver=solver, outputs=np.linspace(0, 2, 41))
    reference = s.replace(model=K).simulate(2.0, accuracy=1e-8, solver=mb.RadauIIA(3), outputs=np.linspace(0, 2, 41))
    assert np.max(np.abs(r["x"].displacement - reference["x"].displacement)) < 2e-6
    assert np.max(np.abs(r["phi"].angle - reference["phi"].angle)) < 2e-6
    fine = r(np.linspace(0, 2, 2001))
    momentum = 2.0 * fine["slide"].velocity[:, 0] + fine["rod"].velocity[:, 0]
    impulse = trapezoid(-30.0 * fine["x"].displacement, fine.t)
    assert momentum[-1] == pytest.approx(impulse, abs=2e-5)
    assert np.max(np.abs(r.energy.balance)) < 1e-4


@pytest.mark.parametrize("scene", [tree_on_ground, tree_on_free_body, prescribed])
def test_energy_is_balanced(scene: Any) -> None:
    """Springs, dampers, loads, drives: what they deliver is what the bodies have."""
    r = scene().simulate(1.0, accuracy=1e-8, solver=mb.RadauIIA(3))
    size = np.max(np.abs(r.energy.kinetic)) + np.max(np.abs(r.energy.potential))
    assert np.max(np.abs(r.energy.balance)) < 1e-6 * size
    assert np.max(r.drift.position) < 1e-9


def arms(model: mb.Recursive | mb.Kinematic, bodies: int = 12) -> mb.Scene:
    """A chain of bodies on ball joints, each carrying an arm and a forearm on hinges: trees on free bodies."""
    s = mb.Scene("arms", gravity=(0, 0, -9.81))
    before: Any = s.ground
    for i in range(bodies):
        body = s.rigid_body(f"body{i}", 1.0, (0.1, 0.2, 0.3), at=(i + 0.5, 0, 0))
        s.spherical(f"ball{i}", before, body, at=(i, 0, 0))
        arm = s.rigid_body(f"arm{i}", 0.3, (0.02, 0.01, 0.02), at=(i + 0.5, 0.25, 0))
        forearm = s.rigid_body(f"forearm{i}", 0.2, (0.02, 0.01, 0.02), at=(i + 0.5, 0.75, 0))
        s.revolute(f"shoulder{i}", body, arm, at=(i + 0.5, 0, 0), axis=(1, 0, 0), model=model, spring=2.0, damper=0.02)
        s.revolute(f"elbow{i}", arm, forearm, at=(i + 0.5, 0.5, 0), axis=(1, 1, 0), model=model, spring=1.0, damper=0.01)
        before = body
    return s


def test_many_trees_between_constraints_are_sparse_and_move_the_same() -> None:
    """Above 150 unknowns the Jacobian is sparse; twelve trees of one structure share their kernels."""
    prepared = prepare(arms(R))
    system = system_for(prepared)
    assert system.n > 150
    assert system.sparsity is not None
    assert len(prepared.all_bodies.moved.plans()) == 1
    times = np.linspace(0, 0.4, 9)
    a, b = (arms(m).simulate(0.4, accuracy=1e-6, solver=mb.IDA(), outputs=times) for m in (R, K))
    assert a.prepared.mechanics.nu == b.prepared.mechanics.nu + 24
    for name in ("forearm0", "forearm11", "body11"):
        assert np.max(np.abs(a[name].position - b[name].position)) < 1e-5
    for name in ("elbow11", "ball0"):
        assert np.max(np.abs(a[name].force - b[name].force)) < 1e-3 * np.max(np.abs(b[name].force))


@pytest.fixture(scope="module")
def run() -> mb.Result:
    return tree_on_free_body().simulate(0.6, accuracy=1e-8, solver=mb.RadauIIA(3), outputs=13)


def sensors(r: mb.Result) -> dict[str, Array]:
    paths = ("A.angle", "A.rate", "A.torque", "B.force", "K.torque", "c.position", "d.velocity", "c.rotation", "S.force")
    return {path: r.read(path) for path in paths}


def test_dense_output_reads_the_carried_bodies(run: mb.Result) -> None:
    """Between the steps the velocity of a carried body is the slope of its position."""
    h = 1e-4
    before, here, after = (run(0.3 + k * h) for k in (-1, 0, 1))
    slope = (after["c"].position - before["c"].position) / (2 * h)
    np.testing.assert_allclose(slope, here["c"].velocity, atol=1e-6)
    np.testing.assert_allclose((after["B"].angle - before["B"].angle) / (2 * h), here["B"].rate, atol=1e-6)


def test_saved_and_loaded(run: mb.Result, tmp_path: Any) -> None:
    """A file holds the joint model: the bodies without unknowns are there again, at and between the outputs."""
    run.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    for t in (run.t, np.linspace(0, 0.6, 7)):
        for path, value in sensors(run(t)).items():
            np.testing.assert_allclose(sensors(again(t))[path], value, rtol=1e-10, atol=1e-10, err_msg=path)
    assert again.prepared.all_bodies.nu == run.prepared.all_bodies.nu


def test_continued(run: mb.Result) -> None:
    """Stopped and continued is the run in one piece, also with joints that are no longer recursive."""
    s, options = tree_on_free_body(), {"accuracy": 1e-8, "solver": mb.RadauIIA(3)}
    half = s.simulate(0.3, **options)
    for scene in (s, s.replace("A", "B", model=K)):
        rest = scene.simulate(0.6, start=half, outputs=run.t[run.t >= 0.3], **options)
        for path in ("A.angle", "B.rate", "c.position", "d.velocity"):
            np.testing.assert_allclose(rest.read(path), run.read(path)[run.t >= 0.3], atol=1e-6, err_msg=path)
