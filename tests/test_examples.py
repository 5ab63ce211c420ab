"""Every example gives the number its docstring derives, or its published reference."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))


@pytest.fixture(autouse=True)
def _examples_importable(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))


def reference(name):
    return json.loads((HERE.parent / "validation" / name / "reference.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", NAMES)
def test_example_states_what_the_command_line_needs(name):
    example = importlib.import_module(name)
    scene = example.scene()
    assert scene.check().degrees_of_freedom >= 0
    assert example.t_end > 0
    item, _, quantity = example.measure.rpartition(".")
    assert scene[item] is not None
    assert quantity
    assert f"examples/{name}.py" in example.__doc__


def test_pendulum_has_the_period_of_the_elliptic_integral():
    import pendulum

    result = pendulum.scene().simulate(pendulum.t_end, accuracy=1e-8, solver=mb.RadauIIA(3))
    assert pendulum.period_measured(result) == pytest.approx(pendulum.period_exact(), rel=1e-8)
    published = dict(zip(*(reference("physical_pendulum")[key] for key in ("amplitude_deg", "period_s")), strict=True))
    assert pendulum.period_exact() == pytest.approx(published[135], rel=1e-12)


@pytest.mark.parametrize("mass", [1.0, 0.2])
def test_exported_equations_give_the_same_motion(mass):
    import exported_equations as example

    own = example.scene(mass).simulate(example.t_end, accuracy=1e-9)["elbow"].angle[-1]
    assert example.by_scipy(mass) == pytest.approx(own, abs=1e-7)


def test_bicycle_has_its_published_roots_and_rights_itself():
    import bicycle as example

    found = example.roots(5.0)
    for root in (-0.77534188219585 + 4.46486771378823j, -0.32286642900409, -14.07838969279822):
        assert np.min(np.abs(found - root)) < 1e-10
    r = example.scene().simulate(example.t_end)
    assert abs(r["steer"].angle[-1]) < 0.3 * np.max(np.abs(r["steer"].angle))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), 2])
def test_door_closer_has_the_numbers_it_was_measured_with(seed):
    """Also where the search first asks for a friction that feeds energy (2), which is refused."""
    import door_closer as example

    f = example.fitted(seed)
    assert f.spread < 1.4  # of 57 degrees of freedom: 4 standard deviations
    assert all(abs(f.values[name] - true) < 4 * f.errors[name] for name, true in example.TRUE.items())


def test_robot_arm_needs_the_torques_that_its_drives_exert():
    import robot_arm as example

    r = example.scene().simulate(example.t_end, accuracy=1e-8)
    drives = np.array([r[name].drive for name in example.NAMES]).T
    np.testing.assert_allclose(drives, example.torques(r.t), atol=1e-7 * np.max(np.abs(drives)))
    weight = -9.81 * np.array([0, 3.0 * 0.2 + 1.5 * 0.58, 1.5 * 0.18])  # at rest as drawn, about axes whose angles lower the arm
    np.testing.assert_allclose(example.torques([0.0])[0], weight, atol=1e-12)


def test_arm_under_computed_torque_forgets_its_error():
    import arm_control as example

    r = example.scene().simulate(example.t_end, accuracy=1e-7)
    wanted = np.array([[float(path.subs(mb.t, t)) for t in r.t] for path in example.PATH])
    error = wanted - np.array([r[f"q{i}"].angle for i in range(1, 7)])
    np.testing.assert_allclose(error, example.error(r.t), atol=1e-7)


def test_arm_under_a_sampled_pid_comes_to_rest():
    import arm_control as example

    r = example.scene(example.sampled_pid).simulate(4.0)
    np.testing.assert_allclose([r[f"q{i}"].angle[-1] for i in range(1, 7)], example.START, atol=1e-4)


def test_crane_swings_as_far_as_its_energy_takes_it():
    import crane

    first, second = crane.runs()
    assert first["rail"].displacement[-1] == pytest.approx(crane.STOP, abs=1e-9)
    expected = crane.swing(second["pivot"].angle[0], second["pivot"].rate[0])
    turns = [event.time for event in second.events if event.name == "pivot.rate == 0"]
    assert len(turns) > 5
    np.testing.assert_allclose(np.abs(second(turns)["pivot"].angle), expected, atol=1e-8)


def test_four_bar_rocker_follows_the_two_circles():
    import four_bar

    result = four_bar.scene().simulate(four_bar.t_end, accuracy=1e-6)
    np.testing.assert_allclose(result["D"].angle, four_bar.rocker_angle(result.t), atol=1e-7)


def test_heavy_top_agrees_with_its_ode_and_the_reference():
    import heavy_top

    known = reference("heavy_top")["own"]
    t = np.array(known["t"][:4])
    np.testing.assert_allclose(heavy_top.centre(t), np.array(known["x"])[:4], atol=1e-9)
    result = heavy_top.scene().simulate(heavy_top.t_end, accuracy=1e-7, solver=mb.RadauIIA(3))
    np.testing.assert_allclose(result(t)["top"].position, np.array(known["x"])[:4], atol=1e-6)


def test_andrews_squeezer_reaches_the_published_angles():
    import andrews_squeezer

    known = reference("andrews_squeezer")["own"]
    result = andrews_squeezer.scene().simulate(andrews_squeezer.t_end, accuracy=1e-7, solver=mb.RadauIIA(3))
    angles = andrews_squeezer.published_angles(result)[-1]
    np.testing.assert_allclose(angles, known["q"], rtol=1e-7, atol=1e-7)


def test_screw_falls_with_its_closed_form_over_many_turns():
    import screw

    result = screw.scene().simulate(screw.t_end, accuracy=1e-7)
    np.testing.assert_allclose(result["thread"].displacement, screw.travel(result.t), atol=1e-6)
    np.testing.assert_allclose(-result["nut"].position[:, 2], screw.travel(result.t), atol=1e-6)
    assert screw.travel(screw.t_end) / screw.PITCH / (2 * np.pi) > 100  # turns


def test_flapping_wing_closes_its_turn_and_bends_by_a_hundredth():
    import flapping_wing
    import flapping_wing_study

    turn = 2 * np.pi / flapping_wing.OMEGA
    rigid = flapping_wing.scene().simulate(turn, accuracy=1e-8, solver=mb.RadauIIA(3))
    for name in ("4", "8", "9"):
        assert rigid["L" + name].angle[-1] == pytest.approx(0, abs=1e-8)
        np.testing.assert_allclose(rigid["L" + name].angle, -rigid["R" + name].angle, atol=1e-8)
    for solver in (mb.RadauIIA(3, step=1e-3), mb.HHT(step=1e-3)):
        assert flapping_wing_study.bending(solver) == pytest.approx(0.0118, rel=0.01)  # rad


def test_flapping_wing_draws_its_pictures(tmp_path):
    import flapping_wing_study

    flapping_wing_study.pictures(tmp_path / "out", flexible=False)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"wing.png", "tip.png", "angles.png", "torque.png"}


def test_flapping_wing_with_clearance_stays_near_the_one_without():
    import flapping_wing

    one, three = (flapping_wing.scene(case=case).simulate(0.1, solver=mb.RadauIIA(3, rtol=1e-8)) for case in ("I", "III"))
    contacts = three["L4"].contacts
    assert 1e-6 < contacts.deepest < 5e-5  # m
    play = flapping_wing.OUTER - flapping_wing.INNER + contacts.deepest
    lever = 0.01 * np.linalg.norm(np.subtract(flapping_wing.POINTS[4], flapping_wing.POINTS[12]))
    off = np.max(np.abs(one["L12"].angle - three["L12"].angle))
    assert 0.2 * play < off * lever < 2 * play
    assert np.max(np.abs(three.energy.balance)) < 1e-6 * np.max(three.energy.kinetic)


@pytest.mark.parametrize("play", ["B", "C", pytest.param("BC", marks=pytest.mark.slow)])
def test_soft_slider_crank_converges_and_two_clearances_are_not_the_sum(play):
    import slider_crank_clearance
    import slider_crank_steel

    assert max(slider_crank_steel.differences(play, turn=0.25)) < 1e-8  # m
    if play == "BC":
        deviations = {name: d for name, (_, d) in slider_crank_clearance.run().items()}
        assert np.max(np.abs(deviations["BC"] - deviations["B"] - deviations["C"])) > 5e-4  # m


def test_a_pin_that_oscillates_in_its_race_is_no_whirl():
    import slider_crank_clearance as example

    assert example.scene("C").simulate(example.t_end, solver=mb.RadauIIA(3, rtol=1e-8)).warnings == ()


CASES = {(1, False): "A1_prescribed_1axis", (2, False): "A2_prescribed_2axis_iso",
         (1, True): "B1_free_1axis", (2, True): "B2_free_2axis_iso"}


WAYS = {"IDA": (mb.IDA(), None), "RadauIIA(3)": (mb.RadauIIA(3), None), "recursive": (None, mb.Recursive())}


@pytest.mark.parametrize(("axes", "free", "solver", "model"), [
    pytest.param(*case, *way, id=f"{CASES[case]}, {name}", marks=[pytest.mark.slow] * ((i + k) % 3 != 1 or case == (2, False)))
    for i, case in enumerate(CASES) for k, (name, way) in enumerate(WAYS.items())])
def test_ground_resonance_follows_the_nonlinear_reference(axes, free, solver, model):
    import ground_resonance

    known = reference("ground_resonance")["nonlinear"][CASES[axes, free]]
    chosen = np.array(known["t"]) <= ground_resonance.t_end
    t, lags, hub = (np.array(known[key])[chosen] for key in ("t", "lag_angles", "hub"))
    result = ground_resonance.scene(axes, free, model).simulate(ground_resonance.t_end, accuracy=3e-7, solver=solver)(t)
    np.testing.assert_allclose(np.stack([result[f"lag {i + 1}"].angle for i in range(4)], axis=1), lags, atol=1e-6)
    np.testing.assert_allclose(result["hub"].position[:, :axes], hub, atol=1e-6)
    assert result.info.form == ("ODE" if model else "GGL")  # one word makes it an ODE


def test_ground_resonance_draws_its_flexible_blades():
    import ground_resonance

    s = ground_resonance.scene(axes=1, flexible=True)
    assert {f"blade {i}" for i in range(1, 5)} <= {text.get_text() for text in s.draw().texts}
    figure = s.simulate(ground_resonance.t_end, accuracy=1e-2).plot(*(f"lag {i}.angle" for i in range(1, 5)))
    assert [line.get_label() for line in figure.axes[0].lines] == [f"lag {i}.angle" for i in range(1, 5)]


def test_flexible_blades_differ_in_their_lag_nearly_as_rigid_ones():
    import ground_resonance

    differences = []
    for flexible in (True, False):
        scene = ground_resonance.scene(axes=1, flexible=flexible)
        r = scene.simulate(1.0, solver=mb.RadauIIA(3, step=5e-3))
        lags = np.array([r[f"lag {i + 1}"].angle for i in range(4)])
        differences.append(lags - lags.mean(axis=0))
    assert scene.check().degrees_of_freedom == 5
    assert ground_resonance.scene(flexible=True).check().beams == dict.fromkeys([f"blade {i}" for i in range(1, 5)], 3)
    print(np.max(np.abs(differences[0] - differences[1])))
    np.testing.assert_allclose(*differences, atol=1e-3)


def test_clearance_rotor_runs_on_the_orbit_of_its_reference_with_either_friction_law():
    import clearance_rotor

    times = np.array(reference("clearance_rotor")["orbit"]["coulomb"]["t"][:7])
    orbits = []
    for friction in clearance_rotor.LAWS:
        r = clearance_rotor.scene(friction).simulate(times[-1], solver=mb.RadauIIA(3, rtol=3e-7), outputs=times)
        known = np.array(reference("clearance_rotor")["orbit"][friction]["rel_yz"][:7])
        orbits.append(clearance_rotor.orbit(r))
        np.testing.assert_allclose(orbits[-1], known, atol=1e-5)  # m
        assert np.max(np.abs(r.energy.balance)) < 1e-3 * r.energy.friction[-1]
        assert r.warnings == ()
    np.testing.assert_allclose(*orbits, atol=2e-6)  # sliding at 1.9 m/s does not tell them apart


@pytest.mark.slow
def test_clearance_rotor_draws_its_pictures(tmp_path):
    import clearance_rotor

    clearance_rotor.pictures(tmp_path / "out", t_end=0.102, solver=mb.RadauIIA(3, rtol=3e-7))
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"rotor.png", "orbits.png", "friction_force.png", "friction_coefficient.png"}


def test_stick_slip_breaks_away_at_the_force_of_static_friction():
    import stick_slip

    lugre, coulomb = stick_slip.runs(outputs=5001).values()
    assert stick_slip.pull(lugre).max() == pytest.approx(1.5, rel=0.01)  # N: mu_s N
    assert stick_slip.pull(coulomb).max() == pytest.approx(stick_slip.largest_pull_coulomb(), rel=0.01)
    known = np.array(reference("lugre_stick_slip")["slip_events_v_cross_0p01"])[::2]  # those that begin a jump
    np.testing.assert_allclose(stick_slip.slips(lugre), known, atol=0.02)  # s
    assert stick_slip.slips(coulomb)[0] < 5.5


def test_dampers_move_the_boundary_of_ground_resonance():
    import ground_resonance_boundary as example

    speed, by = example.run()
    assert speed == pytest.approx(example.boundary(*example.DAMPERS.values()), rel=1e-9)
    for i, (name, (value, error)) in enumerate(by.items()):
        one, other = (example.boundary(*(d * (1 + k * (j == i)) for j, d in enumerate(example.DAMPERS.values())))
                      for k in (1e-3, -1e-3))
        assert value == pytest.approx((one - other) / (2e-3 * example.DAMPERS[name]), rel=1e-5)
        assert error < 1e-5 * abs(value)


@pytest.mark.slow
def test_ground_resonance_map_needs_floquet_where_a_damper_failed(tmp_path):
    import ground_resonance_map as example

    known = {e["c_zeta"]: e["growth"] for e in reference("floquet")["lag_damper_sweep"] if e["axes"] == 2}
    found = example.main(tmp_path, {"speed": [20.01, 21.0], "damper": [400, 2000]})
    assert not found.failures
    np.testing.assert_allclose(found.array("floquet"), found.array("linearize"), atol=1e-7)
    assert found.array("floquet")[0, 0] == pytest.approx(known[400], abs=1e-7)
    assert found.array("mean")[1, 1] == pytest.approx(-0.33240, abs=1e-5)  # the mean of the dampers would do
    assert found.array("failed")[1, 1] == pytest.approx(0.68544, abs=1e-5)
    assert (tmp_path / "ground_resonance_map.png").stat().st_size > 10_000


def test_a_failed_damper_needs_floquet():
    import ground_resonance_map as example

    known = {e["c_zeta"]: e["growth"] for e in reference("floquet")["lag_damper_sweep"] if e["axes"] == 2}
    found = example.growth(20.01, 400)
    assert found["linearize"] == pytest.approx(known[400], abs=1e-7)
    assert found["floquet"] == pytest.approx(known[400], abs=1e-7)
    with pytest.raises(mb.SteadyError, match=r"s.floquet\(period\)"):
        example.scene(dampers=(0, 400, 400, 400), isotropic=False).linearize(frame="hub")


def test_a_bouncing_ball_hops_as_its_restitution_says_and_rolls_at_last():
    import bouncing_ball as example

    r = example.scene().simulate(example.t_end, accuracy=1e-6)
    times, heights = zip(*example.hops(4), strict=True)
    impacts = r["floor"].contacts
    np.testing.assert_allclose(impacts.begin[:4], times, atol=8e-3)  # s; an impact takes a millisecond
    between = [np.linspace(a, b, 400) for a, b in zip(impacts.end[:3], impacts.begin[1:4], strict=True)]
    rise = [np.max(r(t)["ball"].position[:, 2]) - example.RADIUS for t in between]
    np.testing.assert_allclose(rise, heights[:3], rtol=1e-3)
    assert r["ball"].velocity[-1, 0] == pytest.approx(5 / 7 * example.SPEED, rel=2e-3)


@pytest.mark.parametrize("rolls", [True, False])
def test_a_ball_leaves_a_cylinder_where_its_normal_force_ends(rolls):
    import ball_over_cylinder as example

    r = example.scene(100.0 if rolls else 0.0).simulate(example.t_end, accuracy=1e-6)
    assert example.left(r) == pytest.approx(example.leaves(rolls), abs=2e-3)  # rad
    assert np.max(np.abs(r.energy.balance)) < 1e-5 * np.max(r.energy.kinetic)


def test_a_door_meets_its_stop_and_is_caught_by_its_latch():
    import latched_door as example

    free, caught = (example.scene(latch).simulate(example.t_end, accuracy=1e-7) for latch in (False, True))
    first, end = free["hinge"].contacts.begin[0], free["hinge"].contacts.end[0]
    assert -free(first)["hinge"].rate[0] == pytest.approx(example.speed_at_the_stop(), rel=1e-6)
    assert free(end)["hinge"].rate[0] == pytest.approx(example.rebound() * example.speed_at_the_stop(), rel=2e-3)
    assert np.max(free["hinge"].angle[free.t > end]) > 0.1  # it opens again
    assert np.max(np.abs(caught["hinge"].angle[caught.t > 1.5])) < 0.04  # it does not
    assert caught["latch"].contacts.begin.size >= 1
    for r in (free, caught):
        assert abs(r.energy.balance[-1]) < 1e-4 * np.max(r.energy.kinetic)


def test_the_gearbox_keeps_its_ratio():
    import gearbox_torques

    r = gearbox_torques.run()
    np.testing.assert_allclose(r["S"].rate, 4 * r["C"].rate, rtol=1e-9, atol=1e-12)


def test_swing_up_comes_upright():
    import gym_pendulum as example

    assert example.nearest(example.scene().stepper(example.DT), 0.1) < 0.2


def test_gymnasiums_own_checker_accepts_the_environment():
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    import gym_pendulum as example

    checker.check_env(example.environment(), skip_render_check=True)


def test_co_simulation_is_of_order_one_in_its_step():
    import hydraulic_cylinder as example

    exact = example.scene(together=True).simulate(example.t_end, accuracy=1e-8)["slide"].displacement[-1]
    coarse, fine = (example.coupled(dt)[0] - exact for dt in (4e-4, 2e-4))
    assert coarse / fine == pytest.approx(2, rel=0.02)
    assert abs(fine) < 1e-3 * exact
    assert example.coupled(2e-4)[1].error < 1e-6  # of the motion under the forces as they were held


def test_a_loop_in_real_time_holds_the_rod_upright():
    import real_time as example

    step, margin = example.run(2.0)
    assert abs(step["pin.angle"]) < 0.05
    assert margin < 1


def test_the_hook_rises_with_a_quarter_of_the_drums_speed():
    import hook_block as example

    r = example.scene().simulate(2.0, accuracy=1e-5)
    assert r["guide"].rate[-1] == pytest.approx(example.R * example.RATE / 4, rel=3e-3)  # the rope to the drum is not upright
    assert r["rope"].tension[-1] == pytest.approx(example.LOAD * example.G / 4, rel=3e-3)


@pytest.mark.parametrize("name", ["crane_scipy", "crane_torch", "crane_jax"])
def test_a_crane_leaves_no_swing(name):
    """By SciPy, and by torch and jax where they are installed: the same two numbers."""
    pytest.importorskip(name.removeprefix("crane_"))
    example = importlib.import_module(name)
    r = example.run()
    found, expected = example.number(r)
    assert found == pytest.approx(expected, rel=1e-6)
    assert abs(r["rope"].angle[-1]) < 1e-6
    assert abs(r["rope"].rate[-1]) < 1e-6
