"""What the accuracy of a run covers: motion, reactions and the mesh of beams, each by its own error; the rest is named."""

from __future__ import annotations

import importlib
import json
import signal
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from beam_scenes import bend45, cantilever, slider_crank, steel_pendulum, thin
from contact_scenes import ball

import mbdae as mb
from mbdae.integrators.base import Asked
from mbdae.results.accuracy import Accuracy
from mbdae.results.clearance import AtTimes, OtherRun
from mbdae.results.errors import Errors
from mbdae.results.sensors import forces_apart, wrenches
from mbdae.results.states import states_of
from mbdae.run import verification
from mbdae.run.estimate import Controlled
from mbdae.run.verification import distance_of_meshes, mesh_error, with_finer_beams
from mbdae.system.prepare import prepare

G, LENGTH, MASS = 9.81, 1.0, 2.0
SOFT = mb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=50.0, EI2=50.0, EI3=80.0, mass_per_length=1.0, rotary_inertia=0.01)


def pendulum() -> mb.Scene:
    """A slender rod released from the horizontal."""
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (LENGTH, 0), mass=MASS), at=(0, 0))
    return s


def dropped(elements: int, order: int) -> mb.Scene:
    """A soft cantilever released straight under its weight."""
    s = mb.Scene("dropped", gravity=(0, -G, 0))
    s.weld("clamp", s.ground, s.beam("beam", (0, 0), (1, 0), section=SOFT, elements=elements, order=order).at(0.0))
    return s


def hinge_force(angle: np.ndarray) -> np.ndarray:
    """(nt, 2) force on the rod at an angle (rad, below the horizontal negative), by its energy: no equation is solved."""
    fallen = -np.sin(angle)
    along, across = -2.5 * MASS * G * fallen, 0.25 * MASS * G * np.cos(angle)
    return np.column_stack([along * np.cos(angle) - across * np.sin(angle), along * np.sin(angle) + across * np.cos(angle)])


# ---- reactions


@pytest.mark.parametrize("solver", [None, mb.IDA(), mb.RadauIIA(3), mb.HHT()], ids=["default", "IDA", "RadauIIA", "HHT"])
def test_reactions_within_the_accuracy_are_covered_and_are_within_it(solver):
    exact = pendulum().simulate(2.0, 1e-9)
    r = pendulum().simulate(2.0, 1e-4, solver=solver, outputs=501)
    error = np.abs(r["hinge"].force[:, :2] - hinge_force(exact(r.t)["hinge"].angle)).max() / (2.5 * MASS * G)
    assert r.accuracy.covers == {"motion", "reactions"}
    assert set(r.accuracy.not_covered) == {"model"}
    assert error <= 3 * r.accuracy.reactions  # measured: 0.1 to 1
    assert r.accuracy.reactions <= 1e-4


def true_error(r: mb.Result, exact: mb.Result, t_end: float, count: int = 201) -> float:
    """Error of the reactions of a run, over the largest force."""
    return Errors(r.prepared, r.solution, (OtherRun(exact.solution, np.linspace(0, t_end, count), 1.0),))()


def test_reactions_beyond_the_accuracy_of_the_motion_are_named_with_their_error():
    """A fast top: nutation shows in its reactions before it shows in its motion."""
    s = mb.Scene("top", gravity=(0, 0, -G))
    top = s.rigid_body("top", 15.0, (0.234375, 0.46875, 0.234375), at=(0, 1, 0), angular_velocity=(0, 150.0, -4.61538))
    s.spherical("tip", s.ground, top, at=(0, 0, 0))
    r = s.simulate(0.5, 1e-5, solver=mb.RadauIIA(3))
    error = true_error(r, s.simulate(0.5, solver=mb.RadauIIA(3, rtol=1e-10)), 0.5)
    assert r.accuracy.met
    assert 1e-5 < error < 3 * r.accuracy.reactions
    assert r.accuracy.covers == {"motion"}
    assert f"about {r.accuracy.reactions:.1e} of the largest" in r.accuracy.not_covered["reactions"]


@pytest.mark.parametrize(("scene", "t_end"), [(slider_crank(2, 2), 0.01), (steel_pendulum(100), 0.05)], ids=["crank", "pendulum"])
def test_reactions_that_miss_the_vibrations_of_a_beam_are_not_covered(scene, t_end):
    """Long steps damp vibrations of no amplitude to speak of, whose forces are tenths of the largest."""
    r = scene.simulate(t_end, 1e-3)
    error = true_error(r, scene.simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-6), form=replace(form_of(r), waves=True)), t_end)
    assert r.accuracy.met
    assert 0.01 < error < 3 * r.accuracy.reactions
    assert r.accuracy.covers == {"motion"}


def form_of(r: mb.Result) -> Any:
    return {"GGL": mb.GGL(), "ODE": mb.ODE()}[r.info.form]


def test_forces_of_impacts_are_not_covered():
    """Runs meet a stiff wall at times that differ by their tolerance: so do the forces of a moment, in both runs beside it."""
    r = ball(1.0, mb.Hertz(1e9)).simulate(0.05, 1e-3)
    error = true_error(r, ball(1.0, mb.Hertz(1e9)).simulate(0.05, 1e-7), 0.05, 20001)
    assert (r.stats.contacts > 10, len(r.accuracy.found_reactions.others)) == (True, 2)
    assert 1e-3 < error < 3 * r.accuracy.reactions
    assert "reactions" not in r.accuracy.covers


@pytest.mark.parametrize(("late", "asked", "ratio", "apart"), [
    (1e-7, 1e-6, 1, 0.0), (1e-5, 1e-6, 1, 0.5), (1e-5, 1e-6, 30, 0.0), (1e-7, None, 1, 0.5)],
    ids=["within the accuracy", "later than that", "as loosely", "no accuracy"])
def test_a_force_may_jump_within_the_accuracy_earlier_or_later(late, asked, ratio, apart):
    """A force of 10 N across a guide becomes 5 N, in another run a little later."""
    def run(jump: float) -> mb.Result:
        s = mb.Scene("loaded")
        block = s.rigid_body("block", 1.0, 1.0, at=(0, 0), velocity=(1, 0, 0))
        s.prismatic("guide", s.ground, block, at=(0, 0), axis=(1, 0, 0))
        s.force("load", block, (0, sp.Piecewise((10, mb.t < jump), (5, True)), 0))
        return s.simulate(1.0, 1e-6)

    own, other = run(0.5), run(0.5 + late)
    times = np.array([0.1, 0.5 - 1e-3, 0.5 + late / 2, 0.9])
    assert forces_apart(own(times), other(times), ["guide"], asked, ratio) == pytest.approx((10.0, 10 * apart), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stick_slip", "latched_door"])
def test_stiff_forces_come_within_a_tight_accuracy_too(name, monkeypatch):
    """Friction that sticks, a latch that strikes: the true error of all reactions beside a far closer run."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    made = importlib.import_module(name)
    r = made.scene().simulate(made.t_end, 1e-6)
    exact = made.scene().simulate(made.t_end, solver=mb.RadauIIA(5, rtol=1e-12))
    other = OtherRun(exact.solution, np.linspace(0, made.t_end, 3001), 1.0, exact.prepared)
    true = Errors(r.prepared, r.solution, (other,), 1e-6)()
    assert true < 1e-6
    assert true < 3 * r.accuracy.reactions < 3e-6


def test_verification_compares_reactions_with_another_method():
    r = pendulum().simulate(1.0, 1e-5, verify=True)
    assert r.accuracy.reactions == pytest.approx(true_error(r, pendulum().simulate(1.0, 1e-9), 1.0), rel=0.5)
    assert r.accuracy.covers == {"motion", "reactions"}


def test_wrenches_are_what_sensors_show():
    """Forces of every law of an item: of a joint, and of the spring and the damper in it."""
    s = slider_crank(2, 2)
    spring = s.link("pointer", (0, 0), (0, 0.1), mass=0.2)
    s.revolute("P", s.ground, spring, at=(0, 0), spring=3.0, damper=0.1, angle0=0.5)
    r = s.simulate(0.01, solver=mb.RadauIIA(3, rtol=1e-5), outputs=11)
    items = [c.name for c in r.prepared.model.scene.connections]
    found = wrenches(r.prepared, states_of(r.prepared, r.solution, r.t), items)
    for i, item in enumerate(items):
        np.testing.assert_allclose(found[:, i, :3], r[item].force, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(found[:, i, 3:], r[item].torque, rtol=1e-12, atol=1e-9)


def test_difference_of_reactions_is_over_the_largest_force():
    """A pendulum at rest in its lowest position, beside one whose rod weighs a tenth more."""
    def hanging(mass: float):
        s = mb.Scene("hanging", gravity=(0, -G, 0))
        s.revolute("hinge", s.ground, s.link("rod", (0, 0), (0, -1), mass=mass), at=(0, 0))
        return s.simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-8))

    a, b = hanging(2.0), hanging(2.2)
    times = np.linspace(0, 1, 5)
    assert Errors(a.prepared, a.solution, (OtherRun(b.solution, times, 0.5),))() == pytest.approx(0, abs=1e-12)  # equal states
    y = b.solution(times) + np.array([0, 0, 0, 0, 0, 1.0, *[0] * (len(b.solution.names) - 6)])  # at 1 rad/s: m L / 2 N more
    moved = replace(b.solution, interpolant=AtTimes(times, y))
    assert Errors(a.prepared, a.solution, (OtherRun(moved, times, 0.5),))() >= 0.5 * (2.0 * 0.5) / (2.0 * G) * (1 - 1e-9)


# ---- nothing is claimed where nothing was measured


def test_a_solver_with_its_own_tolerance_covers_nothing_and_says_so():
    for solver in (mb.IDA(rtol=1e-8), mb.RadauIIA(3, step=0.01)):
        r = pendulum().simulate(0.5, solver=solver)
        assert r.accuracy.covers == frozenset()
        assert set(r.accuracy.not_covered) == {"motion", "reactions", "model"}
        assert all("verify=True" in r.accuracy.not_covered[word] for word in ("motion", "reactions"))
        assert "covers nothing" in repr(r)
    found = pendulum().simulate(0.5, 1e-5, solver=mb.IDA(rtol=1e-9), verify=True).accuracy
    assert found.covers == {"motion", "reactions"}


def test_a_stopped_run_covers_nothing_and_says_so():
    with pytest.raises(KeyboardInterrupt) as stopped:
        pendulum().simulate(500.0, accuracy=1e-9, solver=mb.RadauIIA(3), progress=stop)
    r = stopped.value.solution
    assert not r.complete
    assert r.accuracy.covers == frozenset()
    assert "interrupted" in r.accuracy.not_covered["motion"]


def stop(*_: object) -> None:
    signal.raise_signal(signal.SIGINT)


def test_what_is_beyond_the_accuracy_is_not_covered():
    worse = Accuracy(1e-9, 1e-6, None, found_reactions=2e-6)
    assert worse.covers == frozenset()
    assert "1.0e-06" in worse.not_covered["motion"]
    assert "2.0e-06" in worse.not_covered["reactions"]
    assert worse.met is False


# ---- the mesh of beams


def test_scenes_without_beams_have_no_mesh():
    a = pendulum().simulate(0.2).accuracy
    assert "mesh" not in a.covers
    assert "mesh" not in a.not_covered


def test_the_mesh_is_not_covered_unless_it_is_measured():
    a = dropped(2, 2).simulate(0.05, 1e-3).accuracy
    assert a.met
    assert "mesh" not in a.covers
    assert "verify=True" in a.not_covered["mesh"]


def true_mesh_error(r: mb.Result, t_end: float) -> float:
    """Against a mesh of 8 elements of order 4."""
    exact, times = dropped(8, 4).simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-7)), np.linspace(0, t_end, 101)
    return distance_of_meshes((r.prepared, r.states(times)[0]), (exact.prepared, exact.states(times)[0]))


@pytest.mark.parametrize(("elements", "order"), [(2, 1), (2, 2), (4, 2), (2, 3)])
def test_the_error_of_a_mesh_is_known_within_a_half(elements, order):
    solver = mb.RadauIIA(3, rtol=1e-7)
    r = dropped(elements, order).simulate(0.1, solver=solver)
    error = true_mesh_error(r, 0.1)
    assert error > 1e-5
    assert mesh_error(r.prepared, mb.GGL(), solver, r.solution, Asked(0.1))[0] == pytest.approx(error, rel=0.5)


def test_a_verified_run_measures_the_mesh_and_warns():
    r = dropped(2, 2).simulate(0.1, 1e-4, verify=True)
    assert r.accuracy.verified < 1e-4
    assert r.accuracy.mesh == pytest.approx(true_mesh_error(r, 0.1), rel=0.5)
    assert r.accuracy.met is False
    assert f"about {r.accuracy.mesh:.1e}" in r.accuracy.not_covered["mesh"]
    assert any(f"the error by the mesh of beams and the modes of bodies is about {r.accuracy.mesh:.1e}"
               in note for note in r.warnings)
    in_time = Errors(r.prepared, r.solution, r.accuracy.found_reactions.others[:1])()
    assert r.accuracy.reactions > 2 * in_time  # the rest is what the mesh makes of the forces


def test_the_mesh_of_a_run_with_all_vibrations_is_compared_with_all_vibrations(monkeypatch):
    """A finer mesh that steps over the vibrations that the run follows would be off by their amplitude, 6e-5 here."""
    monkeypatch.setattr(verification, "_by_another_method", lambda *_: verification.Verified())
    solver = mb.RadauIIA(3, rtol=1e-5)
    r = slider_crank(2, 4).simulate(0.005, solver=solver, form=mb.GGL(waves=True))
    run = Controlled(r.solution, solver, 1e-5, 2, 0.0, waves=True)
    found = verification.verified(r.prepared, mb.GGL(), run, 1e-4, Asked(0.005), False)
    assert found.mesh < 2e-5


def test_reactions_of_a_verified_run_contain_what_the_mesh_makes_of_them():
    """A beam, clamped and held by a spring at its end, falls into its weight: with linear elements its clamp's moment is off."""
    def clamped(elements: int, order: int) -> mb.Scene:
        s = mb.Scene("spring", gravity=(0, -G, 0))
        beam = s.beam("beam", (0, 0), (1, 0), section=SOFT, elements=elements, order=order)
        s.weld("clamp", s.ground, beam.at(0.0))
        s.spring("end", s.ground, beam, at_k=(1, 1), at_l=(1, 0), stiffness=300.0, length=1.0)
        return s

    solver = mb.RadauIIA(3, rtol=1e-7)
    r, fine = (clamped(n, p).simulate(0.05, solver=solver) for n, p in ((2, 1), (6, 4)))
    exact = OtherRun(fine.solution, np.linspace(0, 0.05, 201), 1.0, fine.prepared)
    error = Errors(r.prepared, r.solution, (exact,))()
    *_, finer = mesh_error(r.prepared, mb.GGL(), solver, r.solution, Asked(0.05))
    assert error > 0.01
    assert Errors(r.prepared, r.solution, (finer,))() == pytest.approx(error, rel=0.5)


@pytest.mark.parametrize(("of", "accuracy"), [("clamp.torque", 1e-3), ("beam.at(1.0).position", 5e-4)])
def test_the_mesh_that_is_named_serves_what_was_asked_for(of, accuracy):
    """The moment of the clamp needs a finer mesh than the motion; the same run on the mesh named is within the accuracy."""
    r = dropped(2, 2).simulate(0.1, accuracy, of=[of], verify=True)
    assert set(r.accuracy.meshes) == {"beam"}
    named = r.accuracy.meshes["beam"]
    assert any(f"elements={named['elements']}, order={named['order']}" in note for note in r.warnings)
    times = np.linspace(0, 0.1, 201)
    coarse, found, exact = (scene.simulate(0.1, 1e-4, of=[of])(times).value(of)
                            for scene in (dropped(2, 2), dropped(**named), dropped(8, 4)))
    size = np.abs(exact).max()
    assert np.abs(found - exact).max() < accuracy * size
    assert of != "clamp.torque" or np.abs(coarse - exact).max() > 1e-2 * size


def test_no_mesh_is_named_where_the_mesh_serves_or_none_was_found(monkeypatch):
    assert not dropped(4, 4).simulate(0.02, 1e-3, verify=True).accuracy.meshes
    monkeypatch.setattr(verification, "FINER", 0)
    r = dropped(1, 2).simulate(0.02, 1e-3, verify=True)
    assert not r.accuracy.meshes
    assert any("more elements or a higher order" in note for note in r.warnings)


def test_a_fine_mesh_is_covered():
    a = dropped(4, 4).simulate(0.02, 1e-3, verify=True).accuracy
    assert {"motion", "mesh"} <= a.covers
    assert a.met


def test_a_continued_run_does_not_know_its_mesh():
    first = dropped(2, 2).simulate(0.02, 1e-3)
    a = dropped(2, 2).simulate(0.04, 1e-3, start=first, verify=True).accuracy
    assert a.mesh is None
    assert "continues another" in a.not_covered["mesh"]


def test_a_finer_mesh_that_does_not_run_is_told(monkeypatch):
    """A finer run that fails takes no result away, and counts as no mesh without error; Ctrl-C comes out."""
    monkeypatch.setattr(verification, "_by_another_method", lambda *_: verification.Verified(1e-5))
    r = dropped(1, 1).simulate(0.01, 1e-3)
    run = Controlled(r.solution, r.info.solver, 1e-5, 2, 0.0)

    def again(**options: Any) -> verification.Verified:
        return verification.verified(r.prepared, mb.GGL(), run, 1e-3, Asked(0.01, **options), False)

    found = again(max_residuals=3)
    known = verification.accuracy_of(r.prepared, 1e-3, run, found)
    assert known.mesh is None
    assert "mesh" not in known.covers
    assert "failed: " in known.not_covered["mesh"]
    with pytest.raises(KeyboardInterrupt):
        again(progress=stop)
    vars(r.prepared.model.scene)["problem"] = threading.Lock()
    assert "cannot be copied" in again().unknown["mesh"]


def test_states_at_rest_do_not_claim_their_mesh():
    e = cantilever(thin(), 2, 2, force=(0, 10.0, 0)).equilibrium()
    assert "mesh: not covered" in repr(e)
    assert "order" in e.accuracy.not_covered["mesh"]
    assert e.accuracy.covers == frozenset()


def test_finer_beams_leave_the_scene_as_it_was():
    s = bend45(600, 4, 2)  # its curve is a function that cannot be stored
    finer = with_finer_beams(s)
    assert (prepare(s).model.lines[0].mesh.order, prepare(finer).model.lines[0].mesh.order) == (2, 3)
    assert with_finer_beams(dropped(3, 4)).bodies[0].elements == 6
    s = mb.Scene("corner")
    s.beam("b", (0, 0), (1, 0), (1, 1), section=SOFT, elements=[2, 1], order=4)
    assert len(prepare(with_finer_beams(s)).model.lines[0].mesh.elements) == 6


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_meshes_of_one_line_are_the_same_line_wherever_it_is_cut(space):
    """A bent line with attachments off the nodes, as drawn; a body beside it, displaced, is off by what it was moved."""
    def scene(elements: int, order: int) -> mb.Scene:
        s = mb.Scene("bent", space=space)
        beam = s.beam("b", (0, 0), (1, 0), (1, 2), (0, 2), section=SOFT, elements=elements, order=order)
        s.weld("clamp", s.ground, beam.at(0.0))
        s.revolute("J", beam, s.rigid_body("block", 1.0, (1, 1, 1), at=(1.5, 0.7)), at=(1, 0.7))
        return s

    a, b = prepare(scene(3, 2)), prepare(scene(7, 3))
    q = b.start.q[None].copy()
    assert distance_of_meshes((a, a.start.q[None]), (b, q)) < 1e-7  # the angle of two matrices is known to half the digits
    block = next(node for node in b.model.nodes if node.name == "block")
    q[0, block.q] += 0.1
    assert distance_of_meshes((a, a.start.q[None]), (b, q)) == pytest.approx(0.1 / a.length, rel=1e-9)


def test_the_error_of_a_curved_mesh_between_its_nodes_is_seen():
    """An arc of 45 degrees, radius 100, in 2 elements of order 1 is off by its sagitta over the length, between the nodes."""
    a, b = prepare(bend45(600, 2, 1)), prepare(bend45(600, 16, 4))
    sagitta = 100 * (1 - np.cos(np.pi / 16))
    found = distance_of_meshes((a, a.start.q[None]), (b, b.start.q[None]))
    assert found >= sagitta / a.length * (1 - 1e-3)


# ---- kept


def test_what_is_covered_is_stored(tmp_path: Path):
    r = dropped(1, 2).simulate(0.02, 1e-3, verify=True)
    r.save(tmp_path / "r.npz")
    again = mb.load(tmp_path / "r.npz")
    assert (again.accuracy, again.accuracy.reactions, again.accuracy.mesh) == (r.accuracy, r.accuracy.reactions, r.accuracy.mesh)
    assert (again.accuracy.covers, again.accuracy.not_covered) == (r.accuracy.covers, r.accuracy.not_covered)
    assert repr(again) == repr(r)
    assert again.accuracy.meshes == r.accuracy.meshes == {"beam": {"elements": 1, "order": 3}}


def test_files_of_before_do_not_claim_reactions_and_mesh(tmp_path: Path):
    path = tmp_path / "r.npz"
    dropped(1, 2).simulate(0.02, 1e-3).save(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(str(arrays.pop("header")))
    header["info"]["accuracy"] = {name: header["info"]["accuracy"][name] for name in ("asked", "estimated", "verified")}
    np.savez(path, header=np.array(json.dumps(header)), **arrays)
    a = mb.load(path).accuracy
    assert a.covers == {"motion"}
    assert all("version" in a.not_covered[word] for word in ("reactions", "mesh"))


def test_the_accuracy_tells_itself_in_words():
    text = repr(dropped(2, 2).simulate(0.05, 1e-3).accuracy)
    assert "covers motion" in text
    assert "mesh: not covered: not measured" in text
    assert "model: not covered" in text
