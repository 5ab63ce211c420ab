"""Contact of free bodies: closed forms, balances, and nothing that passes through."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import mbdae as mb
from mbdae.laws.surfaces import BallOnBall, BallOnCylinder, BallOnPlane, CylinderOnPlane

G = 9.81
STIFF = mb.Hertz(1e9, 0.5)


def rolling(body: str, planar: bool, slope: float = math.radians(10)) -> tuple[mb.Scene, float]:
    """A ball or cylinder on a slope, and its inertia over m R^2."""
    R, m, c = 0.1, 2.0, 0.4 if body == "ball" else 0.5
    up = np.array([0, 1, 0]) if planar else np.array([0, 0, 1])
    s = mb.Scene("slope", gravity=G * (math.sin(slope) * np.array([1, 0, 0]) - math.cos(slope) * up))
    across = m * (3 * R**2 + 0.09) / 12 if body == "cylinder" else c * m * R**2
    b = s.rigid_body("b", m, c * m * R**2 if planar else (across, c * m * R**2, across), at=R * up)
    axis = (0, 0, 1) if planar else (0, 1, 0)
    shape = mb.Sphere(radius=R) if body == "ball" else mb.Cylinder(axis=axis, radius=R, length=0.3)
    s.contact("floor", s.ground, b, mb.Plane(at=(0, 0), normal=up), shape, normal=STIFF, friction=mb.Coulomb(0.5, 1e-3))
    return s, c


@pytest.mark.parametrize("body", ["ball", "cylinder"])
@pytest.mark.parametrize("planar", [True, False])
def test_what_rolls_down_is_as_fast_as_its_inertia_says(body: str, planar: bool) -> None:
    s, c = rolling(body, planar)
    r = s.simulate(0.3, 1e-5)
    expected = G * math.sin(math.radians(10)) * 0.3 / (1 + c)
    assert r["b"].velocity[-1, 0] == pytest.approx(expected, rel=2e-3)  # it creeps by a part of v_c
    assert abs(r["floor"].slip[-1]) < 1e-3 if body == "ball" else np.all(abs(r["floor"].slip[-1]) < 1e-3)
    assert abs(r.energy.balance[-1]) < 1e-4 * r.energy.kinetic[-1]


def test_a_sliding_ball_begins_to_roll_at_five_sevenths_of_its_speed() -> None:
    s = mb.Scene("bowling", gravity=(0, 0, -G))
    b = s.rigid_body("b", 1.0, (0.004,) * 3, at=(0, 0, 0.1 - (G / 1e9) ** (2 / 3)), velocity=(2, 1, 0))
    s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=STIFF, friction=mb.Coulomb(0.3, 1e-3))
    end = 2 / 7 * math.hypot(2, 1) / (0.3 * G)  # s, until it rolls
    r = s.simulate(2 * end, 1e-6)
    assert np.allclose(r["b"].velocity[-1, :2], np.array([2, 1]) * 5 / 7, rtol=1e-3)
    assert r.energy.friction[-1] == pytest.approx(0.5 * 5 * 2 / 7, rel=2e-3)
    assert r["floor"].friction_force[len(r.t) // 8] == pytest.approx(0.3 * G, rel=1e-3)


def test_a_bouncing_ball_returns_what_its_law_says() -> None:
    law = mb.Hertz.restitution(1e9, 0.8, 4.0)
    s = mb.Scene("bounce")
    b = s.rigid_body("b", 1.0, (0.004,) * 3, at=(0.3, 0.2, 0.5), velocity=(0, 0, -4))
    s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=law)
    r = s.simulate(0.2)
    assert r["b"].velocity[-1, 2] == pytest.approx(0.8 * 4, rel=1e-5)
    assert r["floor"].contacts.first == pytest.approx(0.1, abs=1e-9)
    assert r.energy.impact[-1] == pytest.approx(0.5 * 16 * (1 - 0.64), rel=1e-5)


@pytest.mark.parametrize("planar", [True, False])
def test_two_balls_that_meet_head_on_exchange_their_momentum(planar: bool) -> None:
    s = mb.Scene("billiards")
    J = 0.004 if planar else (0.004,) * 3
    a, b = s.rigid_body("a", 1.0, J, velocity=(2, 0, 0)), s.rigid_body("b", 2.0, J, at=(1, 0, 0))
    s.contact("c", a, b, mb.Sphere(radius=0.1), mb.Sphere(radius=0.1), normal=mb.Hertz(1e8))
    r = s.simulate(1.0)
    assert np.allclose([r["a"].velocity[-1, 0], r["b"].velocity[-1, 0]], [-2 / 3, 4 / 3], atol=1e-5)


HITS = [((1, 0, 0.1), (-1, 0, 0)), ((0.05, 0.02, 1), (0, 0, -1)), ((0.6, 0, 0.65), (-1, 0, -1))]


@pytest.mark.parametrize(("at", "towards"), HITS)
def test_a_ball_leaves_side_end_and_rim_of_a_cylinder_along_the_normal(at: tuple[float, ...], towards: tuple[float, ...]) -> None:
    s = mb.Scene("post")
    b = s.rigid_body("b", 1.0, (0.004,) * 3, at=at, velocity=2 * np.array(towards) / np.linalg.norm(towards))
    s.contact("c", s.ground, b, mb.Cylinder(at=(0, 0, 0), radius=0.2, length=0.5), mb.Sphere(radius=0.1), normal=mb.Hertz(1e9))
    r = s.simulate(1.0)
    assert np.allclose(r["b"].velocity[-1], -r["b"].velocity[0], atol=1e-4)  # all three are hit along the normal
    assert r["c"].contacts.deepest < 2e-3


def test_a_box_comes_to_rest_on_its_corners() -> None:
    s = mb.Scene("box", gravity=(0, -G, 0))
    b = s.rigid_body("b", 1.0, 0.05 / 12, at=(0, 0.051), angular_velocity=(0, 0, 0.2))
    s.contact("floor", s.ground, b, mb.Plane(at=(0, 0), normal=(0, 1)), mb.Box(size=(0.2, 0.1)), normal=mb.Hertz(1e8, 5.0),
              friction=mb.Coulomb(0.3, 1e-3))
    r = s.simulate(0.5, 1e-4)
    assert r["floor"].force[-1, 1] == pytest.approx(G, rel=1e-2)
    assert r["floor"].gap.shape == (len(r.t), 4)
    assert abs(r["b"].position[-1, 1] - 0.05) < 1e-4


def test_thrown_balls_stay_in_their_room() -> None:
    random = np.random.default_rng(7)
    for planar in (True, False, True, False):
        speed, radius, way = 10 ** random.uniform(0, 2), 0.05, random.normal(size=3)
        way[2] *= not planar
        s = mb.Scene("room", gravity=(0, -G, 0))
        b = s.rigid_body("b", 1.0, 1e-3 if planar else (1e-3,) * 3, velocity=speed * way / np.linalg.norm(way))
        for axis in np.eye(3)[: 2 if planar else 3]:
            for side in (-1, 1):
                s.contact(f"wall {side * axis}", s.ground, b, mb.Plane(at=0.5 * side * axis, normal=-side * axis),
                          mb.Sphere(radius=radius), normal=mb.Hertz.restitution(1e10, 0.8, speed),
                          friction=mb.Coulomb(0.2, 1e-2 * speed))
        r = s.simulate(2 / speed, 1e-4)
        at = r.prepared.states(r.solution.t, r.solution.y)[0][:, :3]
        assert np.max(np.abs(at[:, : 2 if planar else 3])) < 0.5 - radius + radius / 5
        assert np.max(np.abs(r.energy.balance)) < 1e-2 * r.energy.kinetic[0]
        assert sum(one["contacts"] for one in r.contacts.values()) >= 2


def test_a_scene_with_shapes_is_stored(tmp_path: object) -> None:
    for size in ((0.2, 0.1), (0.2, 0.1, 0.3)):
        s = mb.Scene("box", gravity=(0, 0, -G))
        b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 1))
        s.contact("floor", b, s.ground, mb.Box(size=size), mb.Plane(), normal=STIFF)  # in either order
        r = s.simulate(0.1)
        r.save(f"{tmp_path}/run.npz")
        assert np.array_equal(mb.load(f"{tmp_path}/run.npz")["floor"].gap, r["floor"].gap)


LONG = [pytest.param(law, marks=pytest.mark.slow) for law in (BallOnBall, BallOnCylinder, CylinderOnPlane)]  # 3, 20 and 50 s


@pytest.mark.parametrize("law", [BallOnPlane, *LONG])
def test_every_pair_keeps_the_contract(law: type) -> None:
    mb.selftest(law, normal=mb.Hertz(1e7, 0.3), friction=None)
    if law is not BallOnBall:  # two mass points have no arm for friction
        mb.selftest(law, normal=mb.Hertz(1e7, 0.3), friction=mb.Coulomb(0.3, 1e-2))


def test_mistakes_are_named() -> None:
    s = mb.Scene("mistakes")
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 1))
    s.contact("two planes", s.ground, b, mb.Plane(), mb.Plane(at=(0, 0, 1)), normal=STIFF)
    s.contact("radius", s.ground, b, mb.Plane(), mb.Sphere(radius=-1), normal=STIFF)
    s.contact("shape", s.ground, b, mb.Plane(), "ball", normal=STIFF)
    s.contact("law", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=3.0)
    with pytest.raises(mb.SceneError) as error:
        s.check()
    told = str(error.value)
    for words in ("no contact of mb.Plane and mb.Plane", "shape_l.radius = -1", "'ball' is no shape", "3.0 is no normal law"):
        assert words in told


def test_a_start_inside_and_friction_with_states_in_space_are_refused() -> None:
    bristles = mb.LuGre(0.2, 0.3, 0.01, 1e5, 100.0)
    for friction, at, words in ((None, 0.02, "draw the bodies apart"), (bristles, 0.1, "internal states")):
        s = mb.Scene("refused", gravity=(0, 0, -G))
        b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, at))
        s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=STIFF, friction=friction)
        with pytest.raises(mb.MbdaeError, match=words):
            s.simulate(0.1)


def test_bristles_hold_a_mass_on_a_planar_slope() -> None:
    s = mb.Scene("stuck", gravity=(0.2 * G, -G, 0))
    s.point_mass("b", 1.0, at=(0, -((G / 1e9) ** (2 / 3))))
    s.contact("floor", s.ground, "b", mb.Plane(at=(1, 0), normal=(0, 1)), mb.Point(), normal=STIFF,
              friction=mb.LuGre(0.25, 0.3, 0.01, 1e5, 100.0))
    r = s.simulate(1.0)
    assert abs(r["b"].velocity[-1, 0]) < 1e-6
    assert 0.2 / 1e5 < r["b"].position[-1, 0] < 1e-5  # the bristles give way by load over stiffness, and a little at first
    assert r["floor"].friction_force[-1] == pytest.approx(0.2 * G, rel=1e-3)


@pytest.mark.parametrize("shape", [
    mb.Plane(), mb.Sphere(at=(0, 0, -0.3), radius=0.3), mb.Cylinder(at=(0, 0, -0.3), axis=(0, 1, 0), radius=0.3, length=2.0),
    mb.Cylinder(at=(0, 0, -0.5), axis=(0, 0, 1), radius=0.3, length=1.0)])
def test_forces_act_in_the_middle_of_the_overlap(shape: object) -> None:
    """A ball slides: the moment of friction about its centre over the friction is the distance of the place where both act."""
    R, depth, m, J = 0.1, 8e-3, 2.0, 0.01
    s = mb.Scene("slides")
    b = s.rigid_body("b", m, (J, J, J), at=(0, 0, R - depth), velocity=(0, 1, 0))
    s.contact("c", s.ground, b, shape, mb.Sphere(radius=R), normal=mb.Hertz(1e4, 0.3), friction=mb.Coulomb(0.3, 1e-3))
    r = s.simulate(1e-6)
    friction, moment = m * r["b"].acceleration[0, 1], J * r["b"].angular_acceleration[0, 0]
    assert friction == pytest.approx(-0.3 * 1e4 * depth**1.5, rel=1e-6)
    assert moment / friction == pytest.approx(R - depth / 2, rel=1e-6)
    assert r["c"].friction_power[0] == pytest.approx(-friction * 1.0, rel=1e-6)  # W, lost at 1 m/s


class Spring(mb.Normal):
    """A law of one's own that states no damping, and so loses nothing."""

    params = mb.params(stiffness="N/m")

    def energy(self, p: Any) -> Any:
        return self.stiffness * p**2 / 2

    def penetration(self, force: float) -> float:
        return force / float(self.stiffness)

    def impact(self, mass: float, speed: Any) -> tuple[Any, Any]:
        return np.abs(speed) * math.sqrt(mass / self.stiffness), math.pi * math.sqrt(mass / self.stiffness)


def test_an_elastic_law_of_ones_own_returns_the_speed_after_half_a_period() -> None:
    m, k = 2.0, 5e4
    s = mb.Scene("bounce")
    s.point_mass("b", m, at=(0, 0, 0.1), velocity=(0, 0, -3.0))
    s.contact("floor", s.ground, "b", mb.Plane(), mb.Point(), normal=Spring(stiffness=k))
    assert "jumps" not in str(s.check())
    r = s.simulate(0.1)
    assert r["b"].velocity[-1, 2] == pytest.approx(3.0, rel=1e-6)
    assert r.energy.impact[-1] == pytest.approx(0.0, abs=1e-9)
    begin, end = r["floor"].contacts.begin, r["floor"].contacts.end
    assert end - begin == pytest.approx(math.pi * math.sqrt(m / k), rel=1e-4)


class Begins(Spring):
    """A spring that is strained at the first touch, with a damper beside it: forces that do not begin at 0."""

    params = mb.params(stiffness="N/m", preload="N", damper="N s/m")

    def energy(self, p: Any) -> Any:
        return self.preload * p + self.stiffness * p**2 / 2

    def damping_force(self, p: Any, rate: Any) -> Any:
        return self.damper * rate


@pytest.mark.parametrize(("preload", "damper"), [(0.0, 100.0), (5.0, 0.0), (5.0, 100.0)])
def test_a_law_that_begins_with_a_force_does_not_act_at_a_distance(preload: float, damper: float) -> None:
    """In flight neither the normal force nor friction acts; the rebound is that of the mass on the spring and the damper, until
    they would pull."""
    k, m, h, c = 1e5, 1.0, 0.4, damper
    s = mb.Scene("fall", gravity=(0, 0, -9.81))
    s.rigid_body("b", m, (1, 1, 1), at=(0, 0, 0.1 + h), velocity=(1, 0, 0))
    law = Begins(stiffness=k, preload=preload, damper=damper)
    s.contact("floor", s.ground, "b", mb.Plane(), mb.Sphere(radius=0.1), normal=law, friction=mb.Coulomb(0.3, 1e-2))
    assert "its force jumps as it closes" in str(s.check())
    touch, v = math.sqrt(2 * h / 9.81), math.sqrt(2 * h * 9.81)
    r = s.simulate(touch + 0.05, accuracy=1e-7)
    flight = r.t < touch
    assert not r["floor"].normal_force[flight].any()
    np.testing.assert_allclose(r["b"].position[flight, 0], r.t[flight], rtol=1e-12)
    # p'' = g - (preload + k p + c p') / m, from p = 0 at the speed v until the force or p is 0
    root = np.roots([m, c, k]).astype(complex)
    rest = (m * 9.81 - preload) / k
    a = np.linalg.solve(np.array([[1, 1], root]), np.array([-rest, v]))
    p = lambda t, of=1.0: float(np.real(a @ (of * np.exp(root * t)))) + rest  # noqa: E731
    speed = lambda t: p(t, of=root) - rest  # noqa: E731
    end = brentq(lambda t: min(p(t), preload + k * p(t) + c * speed(t)), math.pi / 2 / math.sqrt(k / m), 0.015)
    left = 0.05 - end
    assert r["b"].position[-1, 2] == pytest.approx(0.1 - p(end) - speed(end) * left - 9.81 * left**2 / 2, abs=2e-7)
