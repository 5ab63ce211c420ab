"""Contacts of bodies on joints and beams, of cylinders in every position, and of bodies that cannot move."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mbdae as mb

G = 9.81
LAW = mb.Hertz(1e7, 0.3)
RUBS = mb.Coulomb(0.3, 1e-2)
MODELS = [mb.Kinematic(), mb.Classical(), mb.Recursive(), None]


def test_a_hinged_bar_falls_on_the_floor_alike_in_every_joint_model() -> None:
    found = []
    for model in MODELS:
        s = mb.Scene("bar", gravity=(0, -G, 0))
        bar = s.link("bar", (0, 0.5), (1, 0.6), mass=1.0)
        s.revolute("J", s.ground, bar, at=(0, 0.5), model=model)
        s.contact("tip", s.ground, bar, mb.Plane(at=(0, 0), normal=(0, 1)), mb.Point(at=(1, 0.6)), normal=LAW, friction=RUBS)
        r = s.simulate(0.6, 1e-6)
        found.append([r["J"].angle[-1], r["tip"].contacts.first, r.energy.friction[-1]])
        assert abs(r.energy.balance[-1]) < 1e-5
    np.testing.assert_allclose(found, np.broadcast_to(found[0], np.shape(found)), rtol=1e-4)


@pytest.mark.parametrize("space", ["planar", pytest.param("spatial", marks=pytest.mark.slow)])
def test_two_links_of_one_mechanism_touch_alike_in_every_joint_model(space: str) -> None:
    found = []
    for model in MODELS:
        s = mb.Scene("fold", gravity=(0, -G, 0), space=space)
        a = s.link("a", (0, 0), (1, 0), (1, -0.01), mass=1.0)
        b = s.link("b", (1, 0), (0.5, 0.7), (0.51, 0.7), mass=0.5)
        s.revolute("A", s.ground, a, at=(0, 0), model=model)
        s.revolute("B", a, b, at=(1, 0), model=model, rate0=4.0)
        post, ball = mb.Cylinder(at=(0.2, 0), axis=(0, 0, 1), radius=0.1, length=0.3), mb.Sphere(at=(0.5, 0.7), radius=0.05)
        s.contact("c", a, b, post, ball, normal=LAW, friction=RUBS)
        r = s.simulate(0.5, 1e-6)
        found.append([r["A"].angle[-1], r["B"].angle[-1], r["c"].contacts.first, len(r["c"].contacts.begin)])
        assert abs(r.energy.balance[-1]) < 1e-5
    assert found[0][3] >= 1
    np.testing.assert_allclose(found, np.broadcast_to(found[0], np.shape(found)), rtol=1e-4)


def test_a_contact_that_cannot_move_harms_no_run() -> None:
    """The ball turns about a point on the axis of the cylinder: their distance never changes."""
    s = mb.Scene("held", gravity=(0, 0, -G))
    a = s.rigid_body("a", 1.0, (0.01, 0.1, 0.1), at=(0.5, 0, 0))
    b = s.rigid_body("b", 0.5, (0.05, 0.001, 0.05), at=(1, 0.45, 0))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0))
    s.spherical("B", a, b, at=(1, 0, 0))
    rod = mb.Cylinder(at=(0.5, 0, 0), radius=0.1, axis=(1, 0, 0), length=1)
    s.contact("c", a, b, rod, mb.Sphere(at=(1, 0.9, 0), radius=0.05), normal=LAW)
    r = s.simulate(0.1, 1e-6)
    assert r["c"].contacts.begin.size == 0
    assert abs(r.energy.balance[-1]) < 1e-9


@pytest.mark.parametrize("tilt", [0.0, pytest.param(0.01, marks=pytest.mark.slow), 0.5])
def test_a_can_comes_to_stand_and_gains_no_energy(tilt: float) -> None:
    m, R, L = 1.0, 0.1, 0.3
    turn = np.array([[math.cos(tilt), 0, math.sin(tilt)], [0, 1, 0], [-math.sin(tilt), 0, math.cos(tilt)]])
    across = m * (3 * R**2 + L**2) / 12
    height = L / 2 * math.cos(tilt) + R * math.sin(tilt) + 1e-3
    s = mb.Scene("can", gravity=(0, 0, -G))
    can = s.rigid_body("can", m, (across, across, m * R**2 / 2), at=(0, 0, height), rotation=turn)
    s.contact("floor", s.ground, can, mb.Plane(), mb.Cylinder(axis=turn[:, 2], radius=R, length=L), normal=mb.Hertz(1e7, 5.0),
              friction=mb.Coulomb(0.4, 1e-2))
    r = s.simulate(1.0 if tilt < 0.1 else 3.0, solver=mb.RadauIIA(3, rtol=1e-5))
    assert np.max(np.abs(r.energy.balance)) < 1e-4 * m * G * height
    assert np.max(np.diff(r.energy.total)) < 1e-5
    if tilt < 0.1:
        assert abs(r["can"].position[-1, 2] - (L / 2 - (m * G / 1e7) ** (2 / 3))) < 2e-5
        assert r.read("can.rotation")[-1, 2, 2] > 1 - 1e-6


@pytest.mark.parametrize("axis", [
    (0.6, 0.8, 0), *(pytest.param(axis, marks=pytest.mark.slow) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))])
def test_cylinders_in_the_plane_and_in_space_move_alike(axis: tuple[float, ...]) -> None:
    found = []
    for space in ("planar", "spatial"):
        s = mb.Scene("log", gravity=(0, -G, 0), space=space)
        b = s.rigid_body("b", 1.0, (0.01, 0.01, 0.01), at=(0, 0.3), angular_velocity=(0, 0, 1.0))
        floor, log = mb.Plane(at=(0, 0), normal=(0, 1)), mb.Cylinder(axis=axis, radius=0.1, length=0.4)
        post = mb.Cylinder(at=(0.2, -0.1), axis=(0, 0, 1), radius=0.2, length=0.3)
        s.contact("floor", s.ground, b, floor, log, normal=LAW, friction=RUBS)
        s.contact("post", s.ground, b, post, mb.Sphere(radius=0.1), normal=LAW, friction=RUBS)
        r = s.simulate(0.25, 1e-6)
        found.append([*r["b"].position[-1, :2], r["b"].angular_velocity[-1, 2], r["floor"].contacts.first])
    np.testing.assert_allclose(*found, rtol=1e-4)
    t = found[0][3]
    up = axis[0] * math.sin(t) + axis[1] * math.cos(t)  # part of the axis along the normal, after a turn by 1 rad/s
    lowest = 0.2 * abs(up) + 0.1 * math.sqrt(1 - up**2)
    assert axis[2] or 0.3 - G * t**2 / 2 == pytest.approx(lowest, abs=1e-6)  # the disc meets the post first


def test_a_shape_without_a_point_is_at_the_place_given() -> None:
    section = mb.Section.rectangular(0.02, 0.01, 2e9, 0.3, 1000, damping=1e-2)
    found = []
    for place in (lambda b: b.at(1.0), lambda b: b):
        s = mb.Scene("whip", gravity=(0, 0, -G))
        beam = s.beam("beam", (0, 0, 0.3), (1, 0, 0.3), section=section, elements=2)
        s.revolute("J", s.ground, beam, at=(0, 0, 0.3), axis=(0, 1, 0))
        at = None if place(beam) is not beam else (1, 0, 0.3)
        s.contact("c", s.ground, place(beam), mb.Plane(), mb.Sphere(at=at, radius=0.05), normal=mb.Hertz(1e6, 0.3))
        found.append(s.simulate(0.2, 1e-3)["c"].contacts.first)
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_a_point_that_rests_on_a_plane_is_a_start() -> None:
    v = np.array([3.0, 4.0, 0.0])
    s = mb.Scene("slides", gravity=(0, 0, -G))
    s.point_mass("b", 1.0, at=(0, 0, -((G / 1e9) ** (2 / 3))), velocity=v)
    s.contact("c", s.ground, "b", mb.Plane(), mb.Point(), normal=mb.Hertz(1e9, 0.5), friction=mb.Coulomb(0.3, 1e-3))
    r = s.simulate(1.0)
    np.testing.assert_allclose(r["b"].velocity[-1], v * (1 - 0.3 * G / 5), atol=1e-4)  # friction against the motion
    deep = mb.Scene("deep", gravity=(0, 0, -G))
    deep.point_mass("b", 1.0, at=(0, 0, -1e-3))
    deep.contact("c", deep.ground, "b", mb.Plane(), mb.Point(), normal=mb.Hertz(1e9, 0.5))
    with pytest.raises(mb.MbdaeError, match="draw the bodies apart"):
        deep.simulate(0.1)


def test_a_ball_on_a_turntable_runs_in_circles_at_two_sevenths_of_its_rate() -> None:
    """A ball that rolls without slipping on a plane that turns at W: its centre runs on a circle at 2 W / 7."""
    W, R, m, at = 3.0, 0.1, 1.0, np.array([0.5, 0, 0])
    v = np.array([0, 0.2, 0])
    d = np.cross((0, 0, W), at) - v
    s = mb.Scene("turntable", gravity=(0, 0, -G))
    disc = s.rigid_body("disc", 1.0, (1, 1, 1))
    s.revolute("J", s.ground, disc, at=(0, 0, 0), axis=(0, 0, 1), angle=W * mb.t)
    J = 0.4 * m * R**2
    spin = d[1] / R, -d[0] / R, 0
    s.rigid_body("b", m, (J, J, J), at=(at[0], 0, R - (m * G / 1e9) ** (2 / 3)), velocity=v, angular_velocity=spin)
    s.contact("c", disc, "b", mb.Plane(), mb.Sphere(radius=R), normal=mb.Hertz(1e9, 0.5), friction=mb.Coulomb(0.8, 1e-4))
    r = s.simulate(1.0, 1e-4, outputs=101)
    turned = np.unwrap(np.arctan2(r["b"].velocity[:, 1], r["b"].velocity[:, 0]))
    assert (turned[-1] - turned[0]) / W == pytest.approx(2 / 7, rel=1e-3)
