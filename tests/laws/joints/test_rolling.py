"""Rows of velocities: what rolls without slip or moves along a blade, against closed forms and own equations."""

import numpy as np
import pytest
import symengine as se
import sympy as sp
from rolling.check import ACCURACY, drawn
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


@pytest.mark.parametrize("seed", [pytest.param(3, marks=pytest.mark.slow), 9])
def test_scenes_at_random_against_equations_by_hand(seed):
    """Two rollers on a table that turns, stated as drawn, and turned, moved and backwards: the same motion, without work."""
    assert drawn(seed).error <= 3 * ACCURACY


@pytest.mark.parametrize(("speed", "stable"), [(3.0, False), (6.0, True), (7.0, False)])
def test_bicycle_has_the_published_roots(speed, stable):
    """Weave, capsize and castering of the benchmark bicycle to the digits published, although at 6 m/s the capsize is 0.004 1/s
    beside six roots 0 of where it is, its heading, its wheels and its speed, which no error of rounding hides."""
    found = bicycle(speed).linearize()
    for root in PUBLISHED[speed]:
        assert np.min(np.abs(found.eigenvalues - root)) < 1e-11
    assert found.stable is stable
    assert np.count_nonzero((found.eigenvalues == 0) & (found.errors == 0)) == 6


def cart(speed, model):
    """A cart on two wheels beside it, with a caster that trails ahead of it: forwards its wheel follows, backwards it turns."""
    s, r = mb.Scene("cart", gravity=(0, 0, -G)), 0.1
    moving = {"velocity": (speed, 0, 0)}
    rolls = moving | {"angular_velocity": (0, speed / r, 0)}
    frame = s.rigid_body("frame", 10.0, (1, 1, 1), at=(0.3, 0, 0.3), **moving)
    fork = s.rigid_body("fork", 0.4, (0.01, 0.01, 0.01), at=(0.8, 0, 0.2), **moving)
    s.revolute("steer", frame, fork, at=(0.8, 0, 0.2), axis=(0, 0, 1), model=model)
    for name, body, at in (("left", frame, (0, 0.3, r)), ("right", frame, (0, -0.3, r)), ("front", fork, (0.7, 0, r))):
        wheel = s.rigid_body(name, 0.5, (0.002, 0.003, 0.002), at=at, **rolls)
        s.revolute(f"hub {name}", body, wheel, at=(at[0], 0.8 * at[1], r), axis=(0, 1, 0), model=model)
        s.rolling(f"tyre {name}", s.ground, wheel, at=at, axis=(0, 1, 0), radius=r)
    return s


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical()])
def test_caster_follows_forwards_and_turns_backwards(model):
    """Roots of the reversed motion are those of the motion with the other sign; hubs that carry moments hide no root 0."""
    ahead, back = (cart(speed, model).linearize() for speed in (1.0, -1.0))
    assert (ahead.stable, back.stable) == (True, False)
    np.testing.assert_allclose(np.sort(ahead.growth), np.sort(-back.growth), atol=1e-9)


@pytest.mark.parametrize("speed", [0.5, 0.6])
def test_coin_that_rolls_fast_enough_stays_upright(speed):
    """A disc is upright above v^2 = g r / 3: (J_d + m r^2) x'' = (m g r - (J_a + m r^2) J_a w^2 / J_d) x, w = v / r, with
    J_a = m r^2 / 2 = 2 J_d. Its roots lie on the imaginary axis there, as its motion and its mirror image are each other's
    reverse."""
    m, r = 0.3, 0.1
    J = m * r * r / 4
    s = mb.Scene("coin", gravity=(0, 0, -G))
    d = s.rigid_body("coin", m, (J, 2 * J, J), at=(0, 0, r), velocity=(speed, 0, 0), angular_velocity=(0, speed / r, 0))
    s.rolling("edge", s.ground, d, at=(0, 0, r), axis=(0, 1, 0), radius=r)
    found = s.linearize()
    square = (m * G * r - (2 * J + m * r * r) * 2 * J * (speed / r) ** 2 / J) / (J + m * r * r)
    assert found.stable is bool(square < 0)
    np.testing.assert_allclose(np.max(np.abs(found.eigenvalues)) ** 2, np.abs(square), rtol=1e-9)


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


class Belt(mb.Joint):
    """Carries the point of l along k.x at a speed that is prescribed."""

    params = mb.params(speed=("m/s", "of the belt"))

    def velocity_constraints(self, k, l):
        return {"carried": k.x @ (l.v - k.v - k.w.cross(l.r - k.r)) - self.speed}


class Gearing(mb.Coupling):
    """The second angle turns 1 + sin(first) / 2 times as fast."""

    coordinates = mb.params(a=("rad", "first"), b=("rad", "second"))

    def velocity_constraints(self):
        return {"row": mb.rate(self.b) - (1 + se.sin(self.a) / 2) * mb.rate(self.a)}


@pytest.mark.parametrize("law", [Belt, Gearing])
def test_report_of_a_law_of_ones_own_is_read_back(law):
    text = mb.report(law).to_markdown()
    assert "comparisons hold" in text
    assert "of velocities must vanish" in text


def test_speed_that_is_prescribed_may_have_a_kink_but_no_jump():
    """A trapezoidal speed: the belt's force is the mass times the slope of its speed."""
    s = mb.Scene("ramp")
    b = s.rigid_body("b", 2.0, (1, 1, 1), at=(0, 0))
    s.joint(Belt, "belt", s.ground, b, at=(0, 0), speed=sp.Min(mb.t, 1))
    r = s.simulate(2.0, accuracy=1e-8)
    assert r["b"].position[-1, 0] == pytest.approx(1.5, abs=1e-8)
    assert r["belt"].force[[20, 180], 0] == pytest.approx([2.0, 0.0], abs=1e-7)
    s = mb.Scene("jump")
    s.joint(Belt, "belt", s.ground, s.rigid_body("b", 2.0, (1, 1, 1), at=(0, 0)), at=(0, 0),
            speed=sp.Piecewise((0, mb.t < 1), (1, True)))
    with pytest.raises(mb.SceneError, match="jumps by 1 m/s at t = 1 s"):
        s.simulate(2.0)


def test_coupling_of_rates():
    """J_a a'' + g (J_b (g a'' + g' a') + k b) = M, b' = g a', g = 1 + sin(a) / 2: the energy is the work of the torque."""
    s = mb.Scene("gearing")
    for i, (name, J) in enumerate((("a", 0.2), ("b", 0.3))):
        s.revolute(name, s.ground, s.rigid_body(f"body {name}", 1.0, (1, 1, J), at=(i, 0)), at=(i, 0),
                   **({"torque": 1.0} if name == "a" else {"spring": 2.0}))
    s.add(Gearing("gearing", of={"a": "a.angle", "b": "b.angle"}))
    r = s.simulate(2.0, accuracy=1e-8)
    a, b = r["a"].angle, r["b"].angle
    np.testing.assert_allclose(b, a + (1 - np.cos(a)) / 2, atol=1e-7)  # b is an integral of the row
    np.testing.assert_allclose(0.1 * r["a"].rate**2 + 0.15 * r["b"].rate**2 + b * b, a, atol=1e-7)


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


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Recursive()])
@pytest.mark.parametrize("turned", [0.4, 2.0])
def test_frames_of_a_joint_by_axes_of_both_bodies(model, turned):
    """A pendulum that is drawn turned about its rod, with the hinge's axis given on it, starts as one that is drawn in its hinge;
    turned by more than a right angle the start would find the axes in opposite senses, and says so."""
    c, n = np.cos(turned), np.sin(turned)
    ends = []
    for R in (np.eye(3), np.array([[1, 0, 0], [0, c, -n], [0, n, c]])):
        s = mb.Scene("drawn turned", gravity=(0, 0, -G))
        b = s.rigid_body("b", 1.0, (0.1, 0.2, 0.3), at=(1.1, 0, 0) if R[1, 2] else (1, 0, 0), rotation=R)
        s.joint(mb.Revolute, "J", s.ground, b, at=(0, 0, 0), at_l=(0.1, 0, 0) if R[1, 2] else None, axis=(0, 1, 0),
                axis_l=R[:, 1], start=0.3, model=model)
        if turned > 1.5 and R[1, 2]:
            with pytest.raises(mb.StartError, match="'J'"):
                s.simulate(0.1)
            return
        r = s.simulate(0.3, accuracy=1e-8)
        ends.append(np.r_[r["b"].position[-1], r["J"].angle[[0, -1]]])
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)


def test_an_axis_of_l_opposite_to_that_of_k_is_refused():
    s = mb.Scene("opposite")
    s.revolute("J", s.ground, s.rigid_body("b", 1.0, (1, 1, 1), at=(1, 0)), at=(0, 0), axis=(0, 0, 1), axis_l=(0, 0, -1))
    with pytest.raises(mb.SceneError, match=r"revolute 'J': axis_l = .* is opposite to axis"):
        s.simulate(0.1)


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
