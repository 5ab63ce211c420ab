"""A joint stated in this file alone, by coordinates and motion, has all that the joints of the library have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import symengine as se

import mbdae as mb

MODELS = (mb.Kinematic(), mb.Classical(), mb.Recursive())
LEAD, G = 0.05, 9.81


class Thread(mb.Joint):
    """l turns about k.z and travels by `lead` a turn."""

    coordinates = mb.params(angle=("rad", "rotation of the nut"))
    params = mb.params(lead=("m", "travel a turn"))

    def motion(self, from_k: Any) -> Any:
        return from_k.about("z", self.angle).along("z", self.lead / (2 * se.pi) * self.angle)


class Crane(mb.Joint):
    """A boom that turns about k.z, on which l slides outwards along a line that rises with the angle."""

    coordinates = mb.params(angle=("rad", "rotation of the boom"), reach=("m", "way along the boom"))
    params = mb.params(rise=("m/rad", "lift a radian"))

    def motion(self, from_k: Any) -> Any:
        return from_k.about("z", self.angle).along("z", self.rise * self.angle).along("x", self.reach)


def nut(**options: Any) -> mb.Scene:
    s = mb.Scene("nut", gravity=(0, 0, -G))
    s.rigid_body("nut", 2.0, (0.01, 0.01, 3e-4), at=(0.1, 0, 0))
    s.joint(Thread, "J", s.ground, "nut", at=(0.1, 0, 0), axis=(0, 0, 1), lead=LEAD, **options)
    return s


def crane(k: str = "ground", l: str = "load", **options: Any) -> mb.Scene:
    s = mb.Scene("crane", gravity=(0, 0, -G))
    s.rigid_body("load", 2.0, (0.02, 0.03, 0.04), at=(0.5, 0.1, 0.2))
    s.joint(Crane, "J", k, l, at=(0.2, 0, 0), axis=(0, 0, 1), axis_x=(1, 0, 0), rise=0.1, **options)
    return s


def same_in_all_models(make: Any, read: Any, t_end: float = 0.6, accuracy: float = 1e-8) -> np.ndarray:
    """What is read of runs in all joint models, which must agree."""
    found = [read(make(model=m).simulate(t_end, accuracy)) for m in MODELS]
    for other in found[1:]:
        assert np.max(np.abs(other - found[0])) < 10 * accuracy * (1 + np.max(np.abs(found[0])))
    return np.asarray(found[0])


def end(r: mb.Run) -> np.ndarray:
    joint = r["J"]
    body = r[r.prepared.model.scene.bodies[0].name]
    return np.r_[body.position[-1], body.velocity[-1], joint.force[-1], joint.torque[-1], joint.angle[-1], joint.angle_rate[-1]]


def test_a_nut_falls_down_its_thread() -> None:
    """m p^2 + J = inertia of the angle, p = lead / (2 pi): phi'' = -m g p / (m p^2 + J)."""
    p = LEAD / (2 * np.pi)
    found = same_in_all_models(nut, lambda r: np.r_[r["J"].angle[-1], r["J"].rate[-1], r["nut"].position[-1]])
    slope = -2.0 * G * p / (2.0 * p**2 + 3e-4)
    assert found[0] == pytest.approx(slope * 0.6**2 / 2, rel=1e-7)  # more than a turn
    assert abs(found[0]) > 2 * np.pi
    assert found[1] == pytest.approx(slope * 0.6, rel=1e-7)
    assert found[4] == pytest.approx(p * found[0], rel=1e-7)


@pytest.mark.parametrize("options", [
    {"spring": 0.2, "damper": 0.01, "start": 0.5, "start_rate": 3.0}, {"load": 0.3 * mb.t}, {"prescribed": 3 * mb.t**2},
    {"friction": mb.Coulomb(0.1, 1e-2), "radius": 0.02, "normal_force": 5.0},
])
def test_options_of_one_coordinate(options: dict[str, Any]) -> None:
    def make(model: Any) -> mb.Scene:
        s = nut(model=model, **options)
        s.point_mass("other", 1.0, at=(1, 0, 0))  # else a prescribed recursive joint leaves nothing to solve for
        return s

    found = same_in_all_models(make, end)
    if "prescribed" in options:
        assert found[-2] == pytest.approx(3 * 0.6**2, abs=1e-9)


@pytest.mark.parametrize("options", [
    {"spring": {"angle": 3.0, "reach": 40.0}, "damper": {"reach": 0.5}, "start": {"angle": 0.3, "reach": -0.05},
     "start_rate": {"angle": 1.0, "reach": 0.2}},
    {"prescribed": {"angle": mb.t**2}, "load": {"reach": 2.0}},
    {"prescribed": {"reach": 0.1 * mb.t**2}, "friction": {"angle": mb.Coulomb(0.2, 1e-2)}, "radius": 0.1,
     "normal_force": {"angle": 3.0}},
])
@pytest.mark.parametrize("sides", [("ground", "load"), ("load", "ground")])
def test_options_of_two_coordinates(options: dict[str, Any], sides: tuple[str, str]) -> None:
    same_in_all_models(lambda model: crane(*sides, model=model, **options), end)


def test_friction_by_its_own_reaction_is_the_same_in_both_models_that_have_one() -> None:
    friction = {"friction": {"reach": mb.Coulomb(0.2, 1e-2)}, "start_rate": {"reach": 0.5, "angle": 1.0}}
    a, b = (end(crane(model=m, **friction).simulate(0.3, 1e-8)) for m in MODELS[:2])
    assert np.max(np.abs(a - b)) < 1e-6
    free = end(crane(start_rate={"reach": 0.5, "angle": 1.0}).simulate(0.3, 1e-8))
    assert abs(free[0] - a[0]) > 1e-3  # it acts
    with pytest.raises(mb.SceneError, match="a recursive joint has none among its unknowns"):
        crane(model=mb.Recursive(), **friction).check()


def test_it_is_replaced_and_made_recursive_like_any_other() -> None:
    s = nut()
    assert [j.recursive for j in s.recursive().joints] == [True]
    assert s.replace("J", model=mb.Recursive()).check().unknowns["multipliers"] == 0
    added = mb.Scene("added", gravity=(0, 0, -G))
    added.rigid_body("nut", 2.0, (0.01, 0.01, 3e-4), at=(0.1, 0, 0))
    added.add(Thread("J", added.ground, added["nut"], at=(0.1, 0, 0), axis=(0, 0, 1), lead=LEAD))
    for scene in (added, added.recursive(), added.replace("J", model=mb.Classical())):
        assert scene.simulate(0.6, 1e-8)["J"].angle[-1] == pytest.approx(s.simulate(0.6, 1e-8)["J"].angle[-1], rel=1e-6)


def test_it_is_saved_and_loaded(tmp_path: Path) -> None:
    s = crane(spring={"angle": 3.0}, prescribed={"reach": 0.1 * mb.t**2}, model=mb.Recursive())
    r = s.simulate(0.3)
    r.save(tmp_path / "r.npz")
    again = mb.load(tmp_path / "r.npz", laws=[Crane])
    assert np.array_equal(again["J"].angle, r["J"].angle)
    assert np.array_equal(again["J"].reach_rate, r["J"].reach_rate)


def test_couplings_act_on_its_coordinates() -> None:
    for m in MODELS:
        s = crane(model=m)
        s.couple("wire", {"J.reach": 1, "J.angle": -0.2})
        r = s.simulate(0.5, 1e-8)
        assert np.max(np.abs(r["J"].reach - 0.2 * r["J"].angle)) < 1e-9
        assert np.max(np.abs(r["J"].angle)) > 0.05


@pytest.mark.parametrize(("options", "wrong"), [
    ({"spring": 3.0}, "spring = 3.0; say for which coordinate, as in {'angle': ...}; the joint has angle, reach"),
    ({"spring": {"turn": 3.0}}, "there is no coordinate 'turn'; the joint has angle, reach"),
    ({"damper": {"reach": -1.0}}, "damper['reach'] = -1 N s/m is negative"),
    ({"model": mb.Clearance(0.0201, 0.02, mb.Hertz(1e9))}, "exists for joints with a pin in a race, not for a Crane"),
    ({"model": mb.Classical(scaling=2.0)}, "a Crane has no scaling and penalty"),
    ({"lead": 3.0}, "it has no argument 'lead': did you mean 'load'? it takes at, at_l, axis"),
    ({"angle": mb.t}, "it has no argument 'angle'; to prescribe its coordinate give prescribed={'angle': ...}, "),
    ({"reach_rate": 2.0}, "no argument 'reach_rate'; to start with a rate of its coordinate give start_rate={'reach': ...}"),
    ({"friction": {"angle": mb.Coulomb(0.1, 1e-3)}}, "friction in a bearing needs the radius of its pin"),
    ({"start": {"angle": 1.0}, "prescribed": {"angle": mb.t}}, "its angle is prescribed, which fixes the start already; omit"),
])
def test_what_a_joint_has_not_is_named(options: dict[str, Any], wrong: str) -> None:
    with pytest.raises(mb.SceneError) as error:
        crane(**options).check()
    assert wrong in str(error.value)


def test_sensors_it_has_not_are_named() -> None:
    r = crane().simulate(0.01)
    with pytest.raises(mb.OptionError, match=r"has no displacement; its coordinates: angle, reach"):
        _ = r["J"].displacement
    with pytest.raises(mb.OptionError, match=r"has no rate"):
        _ = r["J"].rate


@pytest.mark.parametrize("model", MODELS)
def test_a_boom_that_turns_and_reaches_starts_as_fast_as_both_say(model: Any) -> None:
    """The load, drawn at d from the foot, has R(angle) (d + reach e) + rise angle up: its derivative by hand."""
    angle, reach, turning, reaching = 0.4, 0.3, 2.0, 0.5
    s = crane(model=model, start={"angle": angle, "reach": reach}, start_rate={"angle": turning, "reach": reaching})
    s.rigid_body("hook", 1.0, (0.01, 0.02, 0.03), at=(0.6, 0.3, -0.2))
    s.revolute("P", "load", "hook", at=(0.5, 0.1, 0.0), axis=(1, 1, 0), model=model)
    r = s.simulate(1e-6)
    assert r["P"].rate[0] == pytest.approx(0.0, abs=1e-9)  # what is not said starts at rest beside the load
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    across, up = np.cross([0, 0, 1.0], along), np.array([0, 0, 1.0])
    d = np.array([0.3 + reach, 0.1, 0.2])
    at = along * d[0] + across * d[1]
    np.testing.assert_allclose(r["load"].position[0], [0.2, 0, 0] + at + up * (d[2] + 0.1 * angle), atol=1e-12)
    velocity = turning * np.cross(up, at) + reaching * along + 0.1 * turning * up
    np.testing.assert_allclose(r["load"].velocity[0], velocity, atol=1e-9)
