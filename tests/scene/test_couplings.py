"""What couplings, joints and their options refuse, and by which words; friction and orientation by short statements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mbdae as mb


class Equal(mb.Coupling):
    """Two angles are equal."""

    coordinates = mb.params(a=("rad", "an angle"), b=("rad", "the other"))

    def constraints(self) -> Any:
        return {"equal": self.a - self.b}


def wheels() -> mb.Scene:
    """Two wheels on the ground, and a ball joint between them."""
    s = mb.Scene("wheels", gravity=(0, 0, -9.81))
    for name, x in (("a", 0.0), ("b", 0.3)):
        s.rigid_body(name, 1.0, (0.1, 0.1, 0.1), at=(x, 0, 0))
    s.revolute("A", s.ground, "a", at=(0, 0, 0))
    s.revolute("B", s.ground, "b", at=(0.3, 0, 0))
    s.spherical("U", "a", "b", at=(0.1, 0, 0))
    return s


@pytest.mark.parametrize(("of", "words"), [
    (None, "of = None is no dict: say which joint's coordinate each of a, b is"), ("A", "of = 'A' is no dict"),
    ({}, "of = {} must have the keys a, b and no others"),
    (5, "of = 5"),
])
def test_coordinates_of_a_coupling(of: Any, words: str) -> None:
    with pytest.raises(mb.LawError, match=words):
        Equal("g", of)
    with pytest.raises(mb.LawError, match="Coupling 'g' couples no coordinates; declare them"):
        mb.Coupling("g", of)


@pytest.mark.parametrize(("state", "words"), [
    (lambda s: s.add(Equal("g", {"a": "A", "b": "A.angle"})), "it names a coordinate twice; name different ones"),
    (lambda s: s.gear("g", "A", "A", ratio=2), "it names a coordinate twice; name different ones"),
    (lambda s: s.couple("g", {"A": 1, "A.angle": 1, "B": 2}), "it names 'A.angle' twice; name a coordinate once"),
    (lambda s: s.gear("g", "A", "U", ratio=2), "spherical 'U' has no angle; name a joint that has one; its rotation is no "),
    (lambda s: s.gear("g", "A", "C", ratio=2), "there are 'A.angle', 'B.angle'; state the joints before the coupling"),
    (lambda s: s.gear("g", "A", "B", ratio=float("nan")), "ratio = nan is not finite; give a number"),
    (lambda s: s.gear("g", "A", "B", ratio=mb.t), "ratio = t is not a number; give a number"),
    (lambda s: s.gear("g", "A", "B", ratio="2"), "ratio = '2' is not a number; give a number"),
    (lambda s: s.gear("g", "A", "B", ratio=0), "ratio = 0: the driven wheel would not turn; give angle(driven)/angle(driving)"),
    (lambda s: s.add(mb.Planar("g", s.ground, s["a"], at=(0, 0, 0), axis=(0, 0, 1), axis_x=(0, 0, 2))),
     "axis_x = [0.0, 0.0, 2.0] is along axis; give a direction at an angle"),
    (lambda s: s.planar("g", s.ground, "a", at=(0, 0, 0), axis=(0, 0, 1), axis_x=(0, 0, -1)), "is along axis; give"),
    (lambda s: s.point_on_plane("g", s.ground, "a", at=(0, 0, 0), axis=(0, 0, 1), axis_x=(0, 0, -1)), "is along axis"),
    (lambda s: s.joint(mb.Distance, "g", s.ground, "a", at=(1, 0, 0)), "length is missing; use s.distance(...), which"),
    (lambda s: s.cylindrical("g", s.ground, "a", at=(0, 0, 0), axis=(0, 0, 1), angle=1.0), "give prescribed={'angle': ...}"),
])
def test_refused_once_and_by_name(state: Callable[[mb.Scene], Any], words: str) -> None:
    s = wheels()
    state(s)
    with pytest.raises(mb.SceneError) as error:
        s.check()
    assert words in str(error.value)
    assert "1 problem in" in str(error.value)


@pytest.mark.parametrize(("factors", "joint"), [({"A": 1.0, "B": -1e10}, "A"), ({"A": 1e10, "B": -2e10}, "[AB]")])
def test_factors_beside_which_others_are_lost(factors: dict[str, float], joint: str) -> None:
    s = mb.Scene("wheels")
    for name, x in (("a", 0.0), ("b", 0.3)):
        s.rigid_body(name, 1.0, 0.1, at=(x, 0))
    s.revolute("A", s.ground, "a", at=(0, 0))
    s.revolute("B", s.ground, "b", at=(0.3, 0))
    s.couple("g", factors)
    with pytest.raises(mb.SceneError, match=rf"coupling 'g': its factors are from .*the angle of joint '{joint}'; give factors"):
        s.check()


class Doubled(mb.Joint):
    """Two angles about one axis."""

    coordinates = mb.params(a=("rad", "an angle"), b=("rad", "the same again"))

    def motion(self, from_k: Any) -> Any:
        return from_k.about("z", self.a).about("z", self.b)


class Cubic(mb.Joint):
    """A slide that does not begin to move."""

    coordinates = mb.params(a=("m", "way"))

    def motion(self, from_k: Any) -> Any:
        return from_k.along("z", self.a**3)


@pytest.mark.parametrize("law", [Doubled, Cubic])
@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_coordinates_that_nothing_determines(law: Any, model: Any) -> None:
    s = mb.Scene("undetermined", gravity=(0, 0, -9.81))
    s.rigid_body("b", 1.0, (1, 1, 1), at=(0.1, 0, 0))
    s.joint(law, "j", s.ground, "b", at=(0, 0, 0), model=model)
    with pytest.raises(mb.SceneError, match=r"joint 'j': its [ab] is an unknown that nothing .* not change with [ab] there"):
        s.check()


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_a_bearing_pressed_by_a_given_force(model: Any) -> None:
    s = mb.Scene("brake")
    s.rigid_body("b", 1.0, 0.1, at=(0, 0))
    s.revolute("A", s.ground, "b", at=(0, 0), rate0=4.0, friction=mb.Coulomb(0.1, 0.01), radius=0.1, normal_force=5.0,
               model=model)
    assert abs(s.simulate(0.1)["A"].rate[-1] - 3.95) < 1e-6  # 4 - 0.1 * 5 N * 0.1 m / 0.1 kg m2 * 0.1 s


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_fixed_orientation_takes_options(model: Any) -> None:
    s = mb.Scene("tray")
    s.rigid_body("b", 2.0, 0.1, at=(0.1, 0.2))
    item = s.fixed_orientation("A", s.ground, "b", model=model, spring={"y": 50.0}, start_rate={"y": 1.0})
    r = s.simulate(0.5, 1e-8)
    assert item.kind == "fixed_orientation"
    assert np.max(np.abs(r["A"].y - np.sin(5 * r.t) / 5)) < 1e-6


@pytest.mark.parametrize("model", [None, mb.Recursive()])
def test_a_sum_of_coordinates_follows_its_value(model: Any) -> None:
    """Two carriages on one rail: x1 + 2 x2 = 0.3 + t^2, and the force of the coupling shares like its factors."""
    s = mb.Scene("rail")
    for name, mass in (("a", 1.0), ("b", 3.0)):
        s.rigid_body(name, mass, (1, 1, 1), at=(0, 0, 0))
        s.prismatic(name.upper(), s.ground, name, at=(0, 0, 0), axis=(1, 0, 0), model=model)
    s.couple("c", {"A.displacement": 1, "B.displacement": 2}, value=0.3 + mb.t**2)
    r = s.simulate(1.0, accuracy=1e-8)
    np.testing.assert_allclose(r["A"].displacement + 2 * r["B"].displacement, 0.3 + r.t**2, atol=1e-8)
    force = 2 / (1 / 1.0 + 4 / 3.0)  # N: accelerations 1 F / 1 and 2 F / 3 give x1'' + 2 x2'' = 2
    assert r["a"].acceleration[-1, 0] == pytest.approx(force, rel=1e-6)
    assert r["b"].acceleration[-1, 0] == pytest.approx(2 * force / 3, rel=1e-6)
