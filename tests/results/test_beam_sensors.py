"""Sensors of beams: places move with the interpolated fields, strains and stress resultants agree with closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.deferred import as_full

SECTION = mb.Section.rectangular(0.02, 0.01, 2e9, 0.3, 1000, damping=1e-3)
STIFFNESSES = np.array([SECTION.EA, SECTION.GA2, SECTION.GA3, SECTION.GJ, SECTION.EI2, SECTION.EI3])
PLACES = [("rod", 0.0), ("rod", 0.37), ("rod", 1.0), ("rod", (0.6, 0.1)), ("hook", 0.2), ("hook", 0.9), ("hook", (1.0, -0.7))]


@pytest.mark.parametrize(("beam", "where"), PLACES)
def test_a_place_starts_as_drawn_and_its_velocities_are_rates(flexible_run: Any, beam: str, where: Any) -> None:
    place = flexible_run.prepared.model.scene[beam].at(where)
    np.testing.assert_allclose(flexible_run[place].position[0], place.point, atol=1e-15)
    h = 1e-4
    x = flexible_run(0.3 + h * np.arange(-2, 3))[place]

    def rate(a: Any) -> Any:
        return (a[0] - 8 * a[1] + 8 * a[3] - a[4]) / (12 * h)

    spin = rate(x.rotation) @ x.rotation[2].T
    # dense output of order 3 (rtol 1e-6): its derivative differs from the velocities by about 1e-4
    np.testing.assert_allclose(x.velocity[2], rate(x.position), atol=1e-3 * np.linalg.norm(x.velocity[2]) + 1e-4)
    np.testing.assert_allclose(x.angular_velocity[2], (spin[2, 1], spin[0, 2], spin[1, 0]), atol=2e-2)
    np.testing.assert_allclose(x.rotation @ x.rotation.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (5, 3, 3)), atol=1e-14)


def test_places_at_joints_meet_their_partners(flexible_run: Any) -> None:
    for a, b in (("crank.at(1.0)", "rod.at(0)"), ("rod.at(1)", "block"), ("rod.at(0.5)", "hook.at(0.0)")):
        apart = flexible_run[a].position - flexible_run[b].position
        assert np.max(np.abs(apart)) < 1e-7  # m, drift at rtol 1e-6
    np.testing.assert_allclose(flexible_run["rod"].at(0.5).position, flexible_run.read("rod.at(0.9, 0).position"), atol=1e-15)


def test_the_whole_beam_is_its_centre_of_mass_and_its_middle(flexible_run: Any) -> None:
    m, line = flexible_run.prepared.mechanics, flexible_run.prepared.model.lines[0]
    n, at = line.kind.translations, line.places("u")
    own, mass = np.unique(at), as_full(m.mass)
    push = np.array([np.isin(own, at[..., i]) for i in range(n)], dtype=float)
    momentum = flexible_run.u[:, own] @ mass[np.ix_(own, own)] @ push.T
    np.testing.assert_allclose(flexible_run["rod"].velocity[:, :n] * line.beam.mass, momentum, rtol=1e-12, atol=1e-14)
    middle = flexible_run["rod"].at(0.5)
    np.testing.assert_array_equal(flexible_run["rod"].rotation, middle.rotation)
    np.testing.assert_array_equal(flexible_run["rod"].angular_velocity, middle.angular_velocity)


# ---- closed forms: clamped at x = 0, length 1 m


def clamped(space: str, axis2: Any = None, **mesh: Any) -> tuple[mb.Scene, Any]:
    s = mb.Scene("clamped", space=space)
    b = s.beam("b", (0, 0), (1, 0), section=SECTION, axis2=axis2, **mesh)
    s.weld("W", s.ground, b, at=(0, 0))
    return s, b


@pytest.mark.parametrize(("order", "elements", "near"), [(2, 4, 5.3e-3), (3, 2, 1e-6), (4, 1, 1e-6)])
@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_moment_and_shear_of_a_uniform_load(space: str, order: int, elements: int, near: float) -> None:
    """M3 = -w (1 - x)^2 / 2, N2 = -w (1 - x): a parabola is beyond order 2, whose Gauss points have it nevertheless."""
    w = 0.01  # N/m: deflection 4e-5 m
    s, b = clamped(space, order=order, elements=elements)
    b.load((0, -w))
    e = s.equilibrium()
    points = (np.polynomial.legendre.leggauss(order)[0] + 1) / 2 / elements
    for places, tolerance in (((0.0, 0.3, 0.5, 1.0), near), (points, 1e-6)):
        for x in places:
            place = e["b"].at(x)
            expected = np.array([0, -w * (1 - x), 0, 0, 0, -w * (1 - x) ** 2 / 2])
            assert np.all(np.abs(place.stress_resultants[0] - expected)[1:] <= tolerance * w)
            assert abs(place.stress_resultants[0, 0]) < 1e-3 * w  # by the slope of 5e-4
            np.testing.assert_allclose(place.strain[0] * STIFFNESSES, place.stress_resultants[0], 1e-6, 1e-6 * w)
    root = e["b"].at(0.0)
    np.testing.assert_allclose(e["W"].force[0], (0, w, 0), atol=1e-9 * w)
    np.testing.assert_allclose(root.rotation[0], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_a_moment_at_the_tip_bends_a_quarter_circle(space: str) -> None:
    s, b = clamped(space, order=2, elements=8)
    s.torque("M", b.at(1.0), (0, 0, SECTION.EI3 * np.pi / 2))
    e = s.equilibrium()
    radius = 2 / np.pi
    np.testing.assert_allclose(e.read("b.at(1.0).position")[0], (radius, radius, 0), atol=2e-6)
    middle = radius * np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0])
    np.testing.assert_allclose(e.read("b.at(0.5).position")[0], middle, atol=2e-6)
    np.testing.assert_allclose(e["b"].position[0], radius * np.array([2 / np.pi, 1 - 2 / np.pi, 0]), atol=2e-5)
    np.testing.assert_allclose(e["b"].at(0.5).rotation[0, :, 0], (np.sqrt(0.5), np.sqrt(0.5), 0), atol=2e-6)
    for x in (0.0, 0.31, 1.0):
        np.testing.assert_allclose(e["b"].at(x).strain[0], (0, 0, 0, 0, 0, np.pi / 2), atol=2e-4)


def test_section_axes_follow_axis2_in_space() -> None:
    """A force along -y on a beam whose axis 2 is z: shear along axis 3 = -y, moment about axis 2."""
    s, b = clamped("spatial", axis2=(0, 0, 1), order=3, elements=2)
    s.force("F", b.at(1.0), (0, -0.01, 0))
    place = s.equilibrium()["b"].at(0.25)
    np.testing.assert_allclose(place.stress_resultants[0], (0, 0, 0.01, 0, -0.0075, 0), atol=1e-5)
    np.testing.assert_allclose(place.rotation[0], np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), atol=2e-3)


def test_damping_is_part_of_the_stress_and_not_of_the_strain(flexible_run: Any) -> None:
    h = 1e-4
    x = flexible_run(0.3 + h * np.arange(-1, 2))["rod"].at(0.3)
    stiffness = SECTION.EI3 * 1e8 / 2e9  # N m^2, of the section of that run
    rate = (x.strain[2, 5] - x.strain[0, 5]) / (2 * h)
    assert x.stress_resultants[1, 5] == pytest.approx(stiffness * (x.strain[1, 5] + 1e-2 * rate), rel=1e-3)
    assert abs(rate) * 1e-2 > 0.01 * abs(x.strain[1, 5])


def test_places_along_a_curve_go_by_length() -> None:
    s = mb.Scene("arc")
    b = s.beam("b", (1, 0), (np.sqrt(0.5), np.sqrt(0.5)), (0, 1), curve="arc", section=SECTION, elements=3)
    s.weld("W", s.ground, b, at=(1, 0))
    r = s.simulate(1e-3, solver=mb.RadauIIA(3, rtol=1e-3), outputs=2)
    for x in (0.0, 0.25, 0.8, 1.0):
        a = x * np.pi / 2
        np.testing.assert_allclose(b.at(x).point, (np.cos(a), np.sin(a), 0), atol=1e-6)
        np.testing.assert_allclose(r["b"].at(x).position[0], b.at(x).point, atol=1e-15)
        np.testing.assert_allclose(r["b"].at(x).rotation[0, :, 0], (-np.sin(a), np.cos(a), 0), atol=2e-3)  # interpolated
    assert np.max(np.abs(r["b"].at(0.4).strain[0])) < 1e-12
    np.testing.assert_allclose(r["b"].position[0], b.drawn.position, atol=1e-14)
    np.testing.assert_allclose(b.drawn.position, (2 / np.pi, 2 / np.pi, 0), atol=1e-3)
    assert b.mass == pytest.approx(SECTION.mass_per_length * np.pi / 2, rel=1e-4)


def test_paths(flexible_run: Any, tmp_path: Any) -> None:
    r = flexible_run
    assert r.read("rod.at(0.5).position").shape == (11, 3)
    assert r.read("rod.at(0.5).strain").shape == r.read("hook.at(1.0,-0.5).stress_resultants").shape == (11, 6)
    np.testing.assert_array_equal(r.read("crank.at(0.5).velocity"), r["crank"].at(0.5).velocity)
    figure = r.plot("rod.at(0.5).position", "rod.at(0.5).stress_resultants", "rod.at(0.5).strain", "rod.velocity")
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["position [m]", "section force [N]", "section moment [N m]", "strain [-]", "curvature [1/m]",
                      "velocity [m/s]"]
    for place in ("rod.at(0.5)", "rod.at(0.5).position", r.prepared.model.scene["rod"].at(0.5), "rod", "E"):
        (axis,) = r.orbit(place).axes
        assert axis.get_xlabel().endswith("x [m]")
    with pytest.raises(mb.SceneError, match=r"there is no sensor 'rod\.at\(0\.5\)\.gap'"):
        r.read("rod.at(0.5).gap")
    with pytest.raises(mb.SceneError, match=r"there is no place 'rod\.at\(x\)'; give a body and a number from 0 to 1"):
        r.read("rod.at(x).position")
    with pytest.raises(mb.SceneError, match=r"there is no place 'A\.at\(0\.5\)'"):
        r.read("A.at(0.5).position")
    with pytest.raises(mb.OptionError, match=r"'rod'\.at: point = 1\.5 is not between 0 and 1; give a number"):
        r.read("rod.at(1.5).position")
    with pytest.raises(mb.OptionError, match="'wind' is a distributed load: it has no sensors; read its beam 'hook'"):
        r.read("wind.force")


def test_a_place_is_a_measure_of_comparisons() -> None:
    s, b = clamped("planar", elements=2)
    b.load((0, -5.0))
    runs = [mb.Run(mb.RadauIIA(3)), mb.Run(mb.RadauIIA(2))]
    reference = s.simulate(0.02, solver=mb.RadauIIA(3, rtol=1e-8))
    w = mb.compare(s, 0.02, runs, [1e-3], measure="b.at(1.0).position", reference=reference)
    assert all(row.error is not None and row.error < 1e-3 for row in w.runs)
    assert "b.at(1.0).position [m]" in w.what
