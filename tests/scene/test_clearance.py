"""Scenes with clearance joints: start, motion, sensors, models side by side, bad input."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb

HERTZ = mb.Hertz(1e9, damping=5.0)
COULOMB = mb.Coulomb(0.1, 1e-2)
RATE = 20.0  # rad/s of the crank


def crank(space: str = "auto", play: float = 1e-4, friction: Any = COULOMB, loose: str = "B", **options: Any) -> mb.Scene:
    """A slider-crank with play in its crank pin B or piston pin C; contact of k = 1e9 N/m^1.5 is regular here."""
    s = mb.Scene("slider-crank", space=space)
    s.link("crank", (0, 0), (0.15, 0), mass=0.5)
    s.link("rod", (0.15, 0), (0.55, 0), mass=0.3)
    s.rigid_body("slider", 1.0, 1e-3, at=(0.55, 0))
    model = mb.Clearance(outer=0.02 + play, inner=0.02, normal=HERTZ, friction=friction, **options)
    s.revolute("A", s.ground, "crank", at=(0, 0), angle0=0.7, rate0=RATE)
    s.revolute("B", "crank", "rod", at=(0.15, 0), model=model if "B" in loose else None)
    s.revolute("C", "rod", "slider", at=(0.55, 0), model=model if "C" in loose else None)
    s.prismatic("D", s.ground, "slider", at=(0.55, 0), axis=(1, 0, 0))
    return s


def ball(v0: float, law: Any, play: float = 1e-3, at: Any = (0, 0)) -> mb.Scene:
    """A mass point that flies against the wall of a round hole."""
    s = mb.Scene("ball")
    m = s.point_mass("m", 1.0, at, velocity=(v0, 0))
    s.revolute("J", s.ground, m, at=(0, 0), model=mb.Clearance(outer=0.05 + play, inner=0.05, normal=law))
    return s


# ---- single impacts ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", [None, mb.IDA(rtol=1e-9), mb.RadauIIA(2, rtol=1e-8)], ids=["default", "IDA", "Radau 2"])
def test_impacts_end_with_the_exact_speed_and_duration(solver: Any) -> None:
    for damping, v0 in ((0.0, 1.0), (0.3, 1.0), (1.0, 0.1)):
        law = mb.Hertz(1e9, damping)
        depth, lasts = mb.Hertz(1e9).impact(1.0, v0)
        r = ball(v0, law).simulate(1e-3 / v0 + 2 * lasts, accuracy=1e-7, solver=solver)
        contacts = r["J"].contacts
        e = law.coefficient_of_restitution(v0)
        assert r["m"].velocity[-1, 0] == pytest.approx(-e * v0, rel=1e-6)
        assert (len(contacts), contacts.first) == (1, pytest.approx(1e-3 / v0, rel=1e-7))
        if not damping:
            assert contacts.end[0] - contacts.first == pytest.approx(lasts, rel=1e-5)
            assert contacts.deepest == pytest.approx(depth, rel=1e-4)
        assert r.energy.impact[-1] == pytest.approx((1 - e**2) * v0**2 / 2, abs=1e-6 * v0**2)
        assert np.max(np.abs(r.energy.balance)) < 1e-6 * v0**2


def test_slow_impacts_after_a_long_way_are_neither_missed_nor_silently_wrong() -> None:
    for v0, way, accuracy in ((1e-3, 1e3, 1e-3), (1e-3, 1e3, 1e-5), (10.0, 1e3, 1e-3), (1e-3, 1e-3, 1e-3)):
        law = mb.Hertz(1e9, 0.3)
        r = ball(v0, law, play=way).simulate(1.1 * way / v0, accuracy=accuracy)
        e = law.coefficient_of_restitution(v0)
        assert abs(r["m"].velocity[-1, 0] / (-e * v0) - 1) < 10 * accuracy
        assert not r.warnings


def test_grazing_contacts_are_not_stepped_over() -> None:
    """12 contacts, 1e-4 of the amplitude deep, with an accuracy that would not notice one."""
    s = mb.Scene("oscillator", space="planar")
    m = s.point_mass("m", 1.0, (0, 0), velocity=(1, 0))
    s.bushing("spring", s.ground, m, at=(0, 0), stiffness=(1, 1, 1))
    s.revolute("J", s.ground, m, at=(0, 0), model=mb.Clearance(outer=0.1 + 1 - 1e-4, inner=0.1, normal=mb.Hertz(1e7)))
    r = s.simulate(12 * np.pi, accuracy=1e-3)
    assert len(r["J"].contacts) == 12
    assert not r.warnings


# ---- a mechanism -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def turned() -> mb.Result:
    return crank().simulate(0.1, accuracy=1e-6)


def test_energy_is_accounted_for_by_cause(turned: mb.Result) -> None:
    e = turned.energy
    assert np.max(np.abs(e.balance)) < 1e-6
    assert np.max(np.abs(e.other)) < 1e-12
    assert np.all(np.diff(e.friction) >= 0)
    assert np.all(np.diff(e.impact) >= -1e-12)
    assert e.friction[-1] > e.impact[-1] > 1e-3


def test_sensors_of_the_contact(turned: mb.Result) -> None:
    b = turned["B"]
    assert np.allclose(np.linalg.norm(b.orbit, axis=1), 1e-4 - b.gap, atol=1e-15)
    assert np.all((b.normal_force > 0) == (b.gap < 0))
    assert np.allclose(np.linalg.norm(b.force[:, :2], axis=1), np.hypot(b.normal_force, b.friction_force), rtol=1e-9, atol=1e-9)
    assert np.all(b.friction_force * b.slip <= 0)
    assert np.allclose(b.friction_power, np.abs(b.friction_force * b.slip), rtol=1e-6, atol=1e-9)
    assert b.wear == pytest.approx(turned.energy.friction[-1] / 0.1, rel=1e-3)  # saturated: power = mu f_n |v|
    c = b.contacts
    assert c.deepest == pytest.approx(np.max(b.penetration), rel=0.05)
    assert np.all(c.end > c.begin)
    assert np.all(c.begin[1:] >= c.end[:-1])
    assert turned.stats.shortest_contact >= 3


@pytest.mark.parametrize("other", [
    {"scene": crank("spatial")}, pytest.param({"solver": mb.IDA()}, marks=pytest.mark.slow), {"form": mb.Index3()},
    {"scene": crank().recursive()},
    {"scene": crank(loose="").replace("B", model=mb.Clearance(0.0201, 0.02, HERTZ, COULOMB))},
], ids=["in space", "IDA", "index 3", "recursive", "replaced"])
def test_the_same_motion_by_another_way(turned: mb.Result, other: dict[str, Any]) -> None:
    r = other.pop("scene", crank()).simulate(0.1, accuracy=1e-6, **other)
    assert np.max(np.abs(r["slider"].position - turned["slider"].position)) < 1e-6


def test_starts_as_the_ideal_joint(turned: mb.Result) -> None:
    ideal = crank(loose="").check().prepared.start
    start = crank().check().prepared.start
    assert np.allclose(start.q, ideal.q, atol=1e-12)
    assert np.allclose(start.u, ideal.u, atol=1e-9)
    assert turned["B"].gap[0] == pytest.approx(1e-4, rel=1e-9)


def test_no_play_comes_near_the_ideal_joint() -> None:
    ideal = crank(loose="").simulate(0.1, accuracy=1e-7)["slider"].position
    for play in (1e-4, 1e-6, 0.0):
        r = crank(play=play, friction=None).simulate(0.1, accuracy=1e-5)
        deviation = np.max(np.abs(r["slider"].position - ideal))
        assert deviation < 3 * (play + r["B"].contacts.deepest)


def test_play_in_both_pins() -> None:
    r = crank(loose="BC").simulate(0.05, accuracy=1e-5)
    assert min(len(r["B"].contacts), len(r["C"].contacts)) > 2
    assert np.max(np.abs(r.energy.balance)) < 1e-5


def test_pin_tilts_in_a_bearing_of_finite_length() -> None:
    """A disk on a pin that sticks out of its bearing by d leans on both ends: forces F (L/2 + d)/L and F (d - L/2)/L."""
    s = mb.Scene("overhung", space="spatial")
    body = s.rigid_body("disk", 2.0, (1e-2, 1e-2, 2e-2), at=(0, 0, 0.1))
    s.force("weight", body, (0, -20.0, 0))
    model = mb.Clearance(0.0201, 0.02, mb.Hertz(1e9, 30.0), length=0.08)
    s.revolute("J", s.ground, body, at=(0, 0, 0), model=model)
    r = s.simulate(1.5, accuracy=1e-4)
    near, far = r["J"].normal_force[-1]
    assert (near, far) == (pytest.approx(20 * 0.06 / 0.08, rel=1e-3), pytest.approx(20 * 0.14 / 0.08, rel=1e-3))
    assert r["J"].gap.shape == (201, 2)
    tilt = abs(r["disk"].rotation[-1, 1, 2])
    assert tilt == pytest.approx(2e-4 / 0.08, rel=0.2)


def test_a_run_is_stored_and_continued(turned: mb.Result, tmp_path: Path) -> None:
    turned.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    assert np.array_equal(again["B"].gap, turned["B"].gap)
    whole = crank().simulate(0.05, accuracy=1e-6)
    half = crank().simulate(0.03, accuracy=1e-6)
    rest = crank().simulate(0.05, accuracy=1e-6, start=half)
    assert np.allclose(rest["slider"].position[-1], whole["slider"].position[-1], atol=1e-7)


# ---- what is said ------------------------------------------------------------------------------------------------------


def problems(scene: mb.Scene) -> str:
    with pytest.raises(mb.SceneError) as caught:
        scene.check()
    return str(caught.value)


@pytest.mark.parametrize(("model", "words"), [
    (lambda: mb.Clearance(0.02, 0.0201, HERTZ), "model.inner = 0.0201 m is larger than model.outer = 0.02 m"),
    (lambda: mb.Clearance(-0.02, 0.0201, HERTZ), "model.outer = -0.02 m is negative; give a positive number in m"),
    (lambda: mb.Clearance(0.0201, 0.02, 1e9), "model.normal = 1000000000.0 is no normal law"),
    (lambda: mb.Clearance(0.0201, 0.02, HERTZ, friction=0.3), "model.friction = 0.3 is no friction law"),
    (lambda: mb.Clearance(0.0201, 0.02, HERTZ, length=0.0), "model.length = 0 m is not positive"),
])
def test_wrong_clearances_are_refused_by_name(model: Any, words: str) -> None:
    text = problems(crank(loose="").replace("B", model=model()))
    assert "revolute 'B'" in text
    assert words in text


def test_a_prismatic_joint_has_no_clearance_and_a_mass_point_no_race() -> None:
    with pytest.raises(mb.SceneError, match=r"prismatic 'D': model = Clearance.* not for a Prismatic; use mb.Kinematic"):
        crank().replace("D", model=mb.Clearance(0.0201, 0.02, HERTZ))
    s = mb.Scene("point")
    m = s.point_mass("m", 1.0, (0, 0))
    s.revolute("J", m, s.ground, at=(0, 0), model=mb.Clearance(0.0201, 0.02, HERTZ))
    assert "the point mass 'm' cannot carry the race" in problems(s)


def test_a_start_in_contact_is_told_and_a_deep_one_refused() -> None:
    r = ball(0.0, HERTZ, play=1e-3, at=(1.01e-3, 0)).simulate(1e-4, accuracy=1e-4)
    assert r.start.changes == ["'J' starts with a penetration of 1e-05 m (elastic load 31.6 N, energy 0.000126 J)"]
    text = problems(ball(0.0, HERTZ, play=1e-3, at=(8e-3, 0)))
    assert "'J' starts with a penetration of 0.007 m" in text
    assert "more than 0.1 of the pin's radius of 0.05 m" in text


def test_tolerances_that_lose_contact_or_friction_are_refused_with_what_to_use() -> None:
    with pytest.raises(mb.OptionError, match=r"'B' is expected to penetrate by .* use rtol = "):
        crank().simulate(0.01, solver=mb.IDA(rtol=1e-2))
    with pytest.raises(mb.OptionError, match=r"friction of 'B' \(Coulomb\) changes within 1e-08 m/s"):
        crank(friction=mb.Coulomb(0.1, 1e-8)).simulate(0.01)
    with pytest.warns(mb.AccuracyWarning, match=r"'B' penetrates by .* give that solver rtol = "):
        crank().simulate(0.05, solver=mb.IDA(rtol=3e-5))


def test_energy_made_by_a_loose_run_is_told() -> None:
    """Steel, rtol chosen by hand: the solver reports success, the balance does not."""
    s = crank(play=5e-4).replace("B", model=mb.Clearance(0.0205, 0.02, mb.Hertz(6.6e10, 0.01)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        s.simulate(0.3, solver=mb.IDA(rtol=1e-5))
    assert any("not reliable: the energy balance is off" in str(w.message) for w in caught)


def test_chaotic_motion_is_told() -> None:
    s = crank(play=5e-4).replace("B", model=mb.Clearance(0.0205, 0.02, mb.Hertz(1e9, 0.1), mb.Coulomb(0.1, 1e-2)))
    with pytest.warns(mb.AccuracyWarning, match="the motion is chaotic"):
        r = s.simulate(0.3, accuracy=1e-6)
    assert np.max(np.abs(r.energy.balance)) < 1e-4


def test_reference_of_hunt_and_crossley() -> None:
    reference = Path(__file__).parents[2] / "validation/hunt_crossley_impact/reference.json"
    for row in json.loads(reference.read_text(encoding="utf-8"))["rows"]:
        r = ball(row["v0"], mb.Hertz(1e9, row["mu"])).simulate(1e-3 / row["v0"] + 2e-3, solver=mb.IDA(rtol=1e-9))
        assert r["m"].velocity[-1, 0] == pytest.approx(row["v_exit"], rel=1e-6)
        assert r["J"].normal_force.min() >= 0
        assert math.isclose(r["J"].contacts.deepest, row["a_max"], rel_tol=1e-4)
