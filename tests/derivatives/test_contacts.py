"""Derivatives through contacts: steps end on touches and move with them (`derivatives/landings.py`)."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.derivatives import Refined, remaining

J = 4e-3  # kg m^2, of balls of 1 kg and 0.1 m


def dropped(damping):
    """A slider that falls on a stop; a damper in it makes the force jump at the touch."""
    s = mb.Scene("dropped", gravity=(0, 0, -9.81))
    body = s.rigid_body("body", 1.0, (J, J, J), at=(0, 0, 0))
    s.prismatic("slide", s.ground, body, at=(0, 0, 0), axis=(0, 0, 1), limits=(-0.3, 1.0), stop=mb.Stop(1e5, damping=damping))
    return s


def two_balls(speed=1.0, second=0.0, stiffness=1e9):
    """A ball that hits another one, elastic."""
    s = mb.Scene("two balls")
    a = s.rigid_body("a", 1.0, (J, J, J), at=(0, 0, 0), velocity=(speed, 0, 0))
    b = s.rigid_body("b", 1.0, (J, J, J), at=(0.5, 0, 0), velocity=(second, 0, 0))
    s.contact("hit", a, b, mb.Sphere(radius=0.1), mb.Sphere(radius=0.1), normal=mb.Hertz(stiffness))
    return s


def ball(height=0.3, stiffness=1e6, damping=0.2, mu=0.3, normal=mb.Hertz, v_c=0.05):
    """A ball thrown to the floor, with friction."""
    s = mb.Scene("ball", gravity=(0, 0, -9.81))
    b = s.rigid_body("ball", 1.0, (J, J, J), at=(0, 0, height + 0.1), velocity=(0.7, 0, 0))
    s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=normal(stiffness, damping=damping),
              friction=mb.Coulomb(mu, v_c))
    return s


def shaken(rate=20.0, drop=0.05):
    """A ball on a plate that is driven up and down: gaps and forces depend on the time too."""
    s, w = mb.Scene("shaken", gravity=(0, 0, -9.81)), mb.number("w", rate)
    plate, b = s.rigid_body("plate", 1.0, (1, 1, 1), at=(0, 0, 0)), s.rigid_body("ball", 1.0, (J, J, J), at=(0, 0, 0.1 + drop))
    s.prismatic("drive", s.ground, plate, at=(0, 0, 0), axis=(0, 0, 1), position=0.01 * sympy.sin(w * mb.t))
    s.contact("hit", plate, b, mb.Plane(), mb.Sphere(radius=0.1), normal=mb.Hertz(1e6, damping=0.3))
    return s


def by_differences(made, at, of, t_end, by):
    """Derivative by differences of order 4 of runs that are much more exact."""
    def value(x):
        return made(x).simulate(t_end, solver=mb.DOP853(rtol=1e-13)).value(of)[-1]

    return (8 * (value(at + by) - value(at - by)) - value(at + 2 * by) + value(at - 2 * by)) / (12 * by)


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
def test_an_elastic_impact_exchanges_the_speeds(solver):
    """Also for both speeds a little larger, so that the derivatives are exactly 0 and 1; frozen steps give up to 8."""
    r = two_balls().simulate(1.0, 1e-8, solver=solver)
    g = r.gradient(mb.at_end("b.velocity[0]"), to=["a.velocity.0", "b.velocity.0"])
    for name, exact in (("a.velocity.0", 1.0), ("b.velocity.0", 0.0)):
        assert abs(g[name].value - exact) <= max(g[name].error, 1e-12)
        assert g[name].error < 1e-4


@pytest.mark.parametrize(("made", "at", "name", "of"), [
    (lambda x: ball(height=x), 0.3, "ball.at.2", "ball.position[2]"),
    (lambda x: ball(stiffness=x), 1e6, "floor.normal.stiffness", "ball.position[2]"),
    (lambda x: ball(mu=x), 0.3, "floor.friction.mu", "ball.position[0]"),
    (lambda x: shaken(rate=x), 20.0, "w", "ball.position[2]"),
])
def test_bounces_against_differences(made, at, name, of):
    d = by_differences(made, at, of, 0.45, 1e-3 * at)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        g = made(at).simulate(0.45, 1e-8).gradient(mb.at_end(of), to=name)[name]
    assert g.value == pytest.approx(d, rel=1e-6)
    assert g.error < 1e-4 * abs(d)


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
def test_errors_fall_evenly_as_steps_are_halved(solver):
    """Of a ball on a plate that is driven; the differences of four runs fall at least as steps at touches let them, also where
    the tolerance is at its smallest, which alone decides nothing."""
    r = shaken().simulate(0.45, 1e-7, solver=solver)
    names = ["w", "hit.normal.damping", "hit.normal.stiffness"]
    refined, levels = Refined(r, names), []
    for finer in (1.0, 10.0, 100.0, 1000.0):
        levels.append(refined.level(finer, levels[-1] if levels else None))
    steps = [len(one.run.t) for one in levels]
    assert all(1.9 < b / a < 2.3 for a, b in pairwise(steps))
    for k in range(len(names)):
        ends = np.array([one.tangent.y[-1].reshape(-1, len(names))[:, k] for one in levels])
        apart = np.abs(np.diff(ends, axis=0)).max(axis=1) / np.abs(ends[-1]).max()
        assert all(b < a / 2.5 + 1e-10 for a, b in pairwise(apart))


@pytest.mark.parametrize(("off", "before", "fall", "error"), [
    (1e-6, 32e-6, 32.0, 6e-6 / (2 ** 3.25 - 1)), (1e-6, 1e-6, 1.0, 6e-6 / (2 ** 1.5 - 1)),
    (1e-6, 32e-6, 4.0, 6e-6 / (2 ** 1.75 - 1)), (0.0, 1e-3, np.inf, 6e-3 / 2 ** 10), (0.0, 0.0, 0.0, 0.0)])
def test_what_remains_after_two_differences(off, before, fall, error):
    """Steps halved: differences that fell 32-fold; that did not fall; that fell less before; that vanish by chance; that never
    were."""
    assert remaining(off, before, fall, 2.0) == pytest.approx(error)


def test_rounding_of_the_motion_is_part_of_the_error():
    """A friction that is saturated throughout hardly depends on its slope: 1e-10 of the motion, known to a few digits."""
    v_c = 0.07
    r = ball(mu=0.002, v_c=v_c).simulate(0.27, 1e-8, solver=mb.DOP853())
    d, v = r.gradient(mb.at_end("ball.velocity[0]"), to="floor.friction.v_c")["floor.friction.v_c"], r["ball"].velocity[-1, 0]
    assert 1e-12 * v < abs(d.value) * v_c < 1e-8 * v
    assert d.error * v_c >= 10 * np.finfo(float).eps * v


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
def test_a_body_that_rests_has_no_force_that_jumps(solver):
    """The plate is driven at a constant speed: its acceleration is rounding alone, and jumps by that wherever it is read."""
    s = mb.Scene("lift", gravity=(0, 0, -9.81))
    plate, b = s.rigid_body("plate", 3.0, (1, 1, 1), at=(0, 0, 0)), s.rigid_body("ball", 1.0, (J, J, J), at=(0, 0, 0.15))
    s.prismatic("drive", s.ground, plate, at=(0, 0, 0), axis=(0, 0, 1), position=0.3 * mb.t, model=mb.Kinematic())
    s.contact("hit", plate, b, mb.Plane(), mb.Sphere(radius=0.1), normal=mb.Hertz(1e6, damping=0.3))
    r = s.simulate(0.15, 1e-6, solver=solver)
    assert abs(r.gradient(mb.at_end("ball.position[2]"), to="hit.normal.damping")["hit.normal.damping"].value) > 1e-3


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
@pytest.mark.parametrize("after", [1e-12, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6])
def test_a_run_may_end_just_after_a_touch(solver, after):
    """A ball falls on the floor with speed v, so that dv/dh = -k/m (1 + c v) (v dt)^1.5 / v just after the touch."""
    v, k, c = np.sqrt(2 * 9.81 * 0.3), 1e6, 0.2
    r = ball(0.3, k, c).simulate(v / 9.81 + after, 1e-8, solver=solver)
    g = r.gradient(mb.at_end("ball.velocity[2]"), to="ball.at.2")["ball.at.2"]
    exact = -k * (1 + c * v) * (v * after) ** 1.5 / v
    assert abs(g.value - exact) <= 3 * g.error + 1e-3 * abs(exact) + 1e-8 * 9.81 / v
    assert g.error < 1e-3


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
@pytest.mark.parametrize("after", [1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5])
def test_a_run_may_end_just_after_bodies_part(solver, after):
    """By then the derivative of the speed is that of a run which ends later, without the shift of the instant by gravity."""
    runs = (ball().simulate(0.2585168459760838 + by, 1e-8, solver=solver) for by in (after, 1e-3))
    one, later = (run.gradient(mb.at_end("ball.velocity[2]"), to="ball.at.2")["ball.at.2"] for run in runs)
    assert abs(one.value - later.value) <= 3 * (one.error + later.error)
    assert one.error < 1e-4


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
@pytest.mark.parametrize("after", [1e-10, 1e-9, 1e-7, 1e-5, 1e-3])
def test_only_forces_that_jump_are_refused_soon_after_a_touch(after, solver):
    smooth, jumping = (dropped(damping).simulate(np.sqrt(2 * 0.3 / 9.81) + after, 1e-8, solver=solver) for damping in (0, 100))
    smooth.gradient(mb.at_end("body.velocity[2]"), to="slide.stop.stiffness")
    with pytest.raises(mb.DerivativeError, match=r"jumps at t = 0\.247"):
        jumping.gradient(mb.at_end("body.velocity[2]"), to="slide.stop.stiffness")


@pytest.mark.parametrize("mass", [0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
def test_errors_cover_where_the_tolerance_falls_no_further(mass):
    """The last two runs for these derivatives are at the smallest tolerance and differ little in their steps. Reference: the same
    flight from 0.3 m, and the bounce by its own equation of motion, z'' = k p^1.5 (1 + c p') / m - g; derivatives by c."""
    from scipy.integrate import solve_ivp

    k, c, g, end = 1e6, 0.2, 9.81, 0.4
    t = np.sqrt(2 * 0.2 / g)  # s, of the touch

    def rates(_, y):
        z, v, by_z, by_v = y
        p, rate = max(-z, 0.0), -v
        force = k * p**1.5
        return [v, force * (1 + c * rate) / mass - g, by_v,
                (force * rate - 1.5 * k * p**0.5 * (1 + c * rate) * by_z - c * force * by_v) / mass]

    def parts(_, y):
        return y[0] - 1e-300 if y[1] > 0 else -1.0

    parts.terminal = True
    out = solve_ivp(rates, (t, end), [0.0, -g * t, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-15, events=parts, first_step=1e-9)
    exact = out.y[2, -1] + out.y[3, -1] * (end - out.t[-1])
    s = mb.Scene("ball", gravity=(0, 0, -g))
    b = s.rigid_body("ball", mass, (J, J, J), at=(0, 0, 0.3))
    s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=0.1), normal=mb.Hertz(k, damping=c))
    for accuracy in (1e-6, 1e-8):
        r = s.simulate(end, accuracy, solver=mb.DOP853())
        g_c = r.gradient(mb.at_end("ball.position[2]"), to="floor.normal.damping")["floor.normal.damping"]
        assert abs(g_c.value - exact) <= g_c.error + 1e-10 * abs(exact)


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.DOP853()])
@pytest.mark.parametrize("stiffness", [5e5, 7e5, 1e6, 1.4e6])
def test_steps_at_touches_become_shorter_with_the_tolerance(stiffness, solver):
    """Errors of derivatives fall with their power 1.5; without a bound these steps are what happens to remain, and two runs whose
    derivatives agree tell nothing."""
    r = ball(stiffness=stiffness).simulate(0.3, 1e-6, solver=solver)
    refined, level, longest = Refined(r, ["floor.normal.stiffness"]), None, []
    for finer in (1.0, 10.0, 100.0):
        level = refined.level(finer, level)
        t, h, (first, last) = level.run.t, np.diff(level.run.t), level.derived.landings
        longest.append(max(h[first], h[last - 1]) / (t[last] - t[first]))
    assert longest[0] < 1e-4
    assert max(longest[1] / longest[0], longest[2] / longest[1]) < 0.5


def test_a_derivative_that_is_none_warns_of_nothing(recwarn):
    """The height of a ball does not depend on friction; what differences leave of that is rounding."""
    r = ball().simulate(0.4, 1e-6, solver=mb.DOP853())
    found = r.sensitivity("ball.position", to="floor.friction.mu")["ball.position", "floor.friction.mu"]
    alone = r.sensitivity("ball.position[2]", to="floor.friction.mu")["ball.position[2]", "floor.friction.mu"]
    assert np.abs(alone.value).max() <= alone.error < 1e-9 * np.abs(found.value).max()
    assert not [one for one in recwarn if "estimated error" in str(one.message)]


def test_the_adjoint_is_the_tangent_transposed_through_contacts():
    """Of a plate that is driven, so that instants enter by forces and gaps; Radau IIA and DOP853."""
    names = ["w", "ball.mass", "hit.normal.stiffness", "hit.normal.damping"]
    of = mb.integral("ball.position[2]**2")
    for solver in (mb.RadauIIA(3), mb.DOP853()):
        r = shaken().simulate(0.45, 1e-6, solver=solver)
        level = Refined(r, names).level()
        assert len(level.derived.landings) >= 4
        times, weights = of.points(level.result)
        for k in range(len(names)):
            along = weights @ level.of(k, lambda one, times=times: of.read(one, times))[0]
            assert level.sums(of)[k][0] == pytest.approx(along, rel=1e-7)


@pytest.mark.parametrize(("offset", "told"), [(0.1999999, True), (0.2000001, True), (0.1, False), (0.3, False)])
def test_grazing_is_told_and_a_plain_hit_or_miss_is_not(offset, told):
    """Balls of .1 m whose centres pass each other at a distance; one resting ball is hit, hardly hit, or hardly missed."""
    s = mb.Scene("passing")
    a = s.rigid_body("a", 1.0, (J, J, J), at=(0, 0, 0), velocity=(1.0, 0, 0))
    b = s.rigid_body("b", 1.0, (J, J, J), at=(0.5, offset, 0))
    s.contact("hit", a, b, mb.Sphere(radius=0.1), mb.Sphere(radius=0.1), normal=mb.Hertz(1e7))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        s.simulate(1.0).gradient(mb.at_end("a.position[1]"), to="a.velocity.0")
    assert any("'hit' is grazed near t = " in str(one.message) for one in found) is told
