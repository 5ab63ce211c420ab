"""Rows of velocities: what rolls without slip or moves along a blade, against closed forms and own equations."""

import numpy as np
import pytest
from rolling.own import PUBLISHED
from rolling.scenes import PROBLEMS, T_END, bicycle, times

import mbdae as mb

SLOPE, G = 0.3, 9.81  # rad, m/s^2


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_disc_rolls_down_a_slope(space):
    """A homogeneous disc accelerates by 2/3 g sin(slope); the plane carries its weight and a third of it along the slope, and
    does no work."""
    m, R = 2.0, 0.2
    J = m * R * R / 2
    s = mb.Scene("slope", gravity=(G * np.sin(SLOPE), -G * np.cos(SLOPE), 0), space=space)
    d = s.rigid_body("disc", m, (J / 2, J / 2, J), at=(0, R))
    s.rolling("edge", s.ground, d, at=(0, R), axis=(0, 0, 1), radius=R, normal=(0, 1))
    r = s.simulate(1.0, accuracy=1e-8)
    assert r["disc"].position[-1, 0] == pytest.approx(G * np.sin(SLOPE) / 3, abs=1e-8)
    np.testing.assert_allclose(r["edge"].force[-1, :2], (-m * G * np.sin(SLOPE) / 3, m * G * np.cos(SLOPE)), rtol=1e-7)
    np.testing.assert_allclose(r["edge"].power, 0.0, atol=1e-9)
    assert np.ptp(r.energy.total) < 1e-7


@pytest.mark.parametrize(("problem", "model", "options"), [
    ("coin", mb.Kinematic(), {}), ("sleigh", mb.Kinematic(), {"solver": mb.RadauIIA(3), "form": mb.Index3()}),
    ("ball_on_turntable", mb.Recursive(), {"solver": mb.IDA()}), ("steered_wheel", mb.Classical(), {})])
def test_motion_against_own_equations(problem, model, options):
    scene, read, found = PROBLEMS[problem](model)
    r = scene.simulate(T_END, accuracy=1e-6, outputs=times(), **options)
    assert np.max(np.abs(read(r) - found)) <= 3e-6 * np.max(np.abs(found))


def test_bicycle_has_the_published_roots():
    """Weave, capsize and castering of the benchmark bicycle at 5 m/s, to the digits published."""
    found = bicycle(5.0).linearize().eigenvalues
    for root in PUBLISHED[5.0]:
        assert np.min(np.abs(found - root)) < 1e-11


def test_generalised_alpha_keeps_rows_of_velocities():
    """Constant steps of order 2: the slip of the blade is that of the interpolation between steps alone."""
    scene, read, found = PROBLEMS["sleigh"](None)
    r = scene.simulate(T_END, accuracy=1e-3, outputs=times(), solver=mb.GeneralizedAlpha())
    assert np.max(np.abs(read(r) - found)) <= 3e-3 * np.max(np.abs(found))
    assert np.max(r.drift.velocity) < 1e-6


def test_start_follows_the_velocity_stated():
    """A wheel whose speed alone is stated spins as it rolls, with a word where what is stated slips."""
    s = mb.Scene("wheel", gravity=(0, 0, -G))
    w = s.rigid_body("wheel", 1.0, (0.01, 0.02, 0.01), at=(0, 0, 0.2), velocity=(1.0, 0, 0))
    s.rolling("tyre", s.ground, w, at=(0, 0, 0.2), axis=(0, 1, 0), radius=0.2)
    r = s.simulate(0.1)
    np.testing.assert_allclose(r["wheel"].angular_velocity[0], (0, 5, 0), atol=1e-9)
    s = mb.Scene("slips", gravity=(0, 0, -G))
    w = s.rigid_body("wheel", 1.0, (0.01, 0.02, 0.01), at=(0, 0, 0.2), velocity=(1.0, 0, 0), angular_velocity=(0, 1, 0))
    s.rolling("tyre", s.ground, w, at=(0, 0, 0.2), axis=(0, 1, 0), radius=0.2)
    with pytest.warns(mb.AccuracyWarning, match="contradicts the joints"):
        s.simulate(0.1)


class Squared(mb.Joint):
    """No law: its row is not linear."""

    def velocity_constraints(self, k, l):
        return {"speed": l.v @ l.v - 1}


class Still(mb.Joint):
    """No law: its row contains no velocity."""

    def velocity_constraints(self, k, l):
        return {"place": k.x @ l.r}


@pytest.mark.parametrize(("law", "told"), [(Squared, "row 'speed' of Squared is not linear in the velocities"),
                                           (Still, "row 'place' of Still contains no velocity")])
def test_rows_are_linear_in_velocities(law, told):
    s = mb.Scene("wrong")
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(1, 0))
    s.joint(law, "J", s.ground, b, at=(0, 0))
    with pytest.raises(mb.MbdaeError, match=told):
        s.simulate(0.1)


def test_point_mass_cannot_roll():
    s = mb.Scene("point", gravity=(0, 0, -G))
    s.rolling("tyre", s.ground, s.point_mass("p", 1.0, at=(0, 0, 0.2)), at=(0, 0, 0.2), radius=0.2)
    with pytest.raises(mb.MbdaeError, match=r"use s\.rigid_body"):
        s.simulate(0.1)


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_generic_joint_is_the_joint_with_its_freedoms(model):
    """Free to slide along and turn about one axis: a cylindrical joint; free to turn about two: a universal one."""
    ends = []
    for generic in (True, False):
        s = mb.Scene("joints", gravity=(0, 0, -G))
        a = s.rigid_body("a", 1.0, (0.01, 0.02, 0.02), at=(0.3, 0, 0))
        b = s.rigid_body("b", 1.0, (0.01, 0.02, 0.02), at=(0.6, 0.1, 0))
        options = {"model": model, "axis": (0, 1, 0.2)}
        if generic:
            s.generic("A", s.ground, a, at=(0, 0, 0), free=("z", "angle_z"), spring={"z": 40.0}, **options)
            s.generic("B", a, b, at=(0.5, 0, 0), axis=(0, 0, 1), axis_x=(1, 0, 0), free=("angle_x", "angle_y"), model=model)
        else:
            s.cylindrical("A", s.ground, a, at=(0, 0, 0), spring={"displacement": 40.0}, **options)
            s.universal("B", a, b, at=(0.5, 0, 0), axis=(0, 0, 1), pin=(1, 0, 0), model=model)
        ends.append(s.simulate(0.5, accuracy=1e-8)["b"].position[-1])
    np.testing.assert_allclose(ends[0], ends[1], atol=3e-8)


def test_gravity_of_a_body():
    """A body with its own gravity falls by it, whatever that of the scene is."""
    s = mb.Scene("two", gravity=(0, -G))
    s.rigid_body("balloon", 1.0, (1, 1, 1), at=(0, 0), gravity=(0, 1.0))
    s.point_mass("stone", 1.0, at=(1, 0))
    r = s.simulate(1.0, accuracy=1e-8)
    assert (r["balloon"].position[-1, 1], r["stone"].position[-1, 1]) == pytest.approx((0.5, -G / 2), abs=1e-7)


def test_what_does_not_know_rows_of_velocities_refuses_them():
    s = mb.Scene("disc on a line")
    disc = s.rigid_body("disc", 2.0, 0.09, at=(0, 0.3))
    s.rolling("tyre", s.ground, disc, radius=0.3, at=(0, 0.3), axis=(0, 0, 1), normal=(0, 1))
    with pytest.raises(mb.OptionError, match=r"floquet: 'tyre.*row of velocities"):
        s.floquet(1.0)
    s.beam("mast", (0, 1), (0, 2), section=mb.Section(1e6, 4e5, 4e5, 1.0, 1.0, 1.0, 1.0, 1e-6), elements=1)
    with pytest.raises(mb.OptionError, match=r"beside beams: 'tyre.*row of velocities"):
        s.linearize()
