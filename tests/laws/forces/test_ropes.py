"""Ropes over pulleys against closed forms and SciPy: tension, slack, drums, belts, in the plane and in space."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.laws.forces import rope_over, tangents, wraps_of

G = 9.81  # m/s^2
R = 0.2  # m


def turned(turn, *points):
    """Points turned from the plane z = 0 by a rotation matrix."""
    return [tuple(turn @ np.array([*p, 0.0])) for p in points]


PLANE = np.eye(3)
#: the plane of the drawing, turned so that no axis of it is one of the inertial frame
SPACE = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3


def atwood(turn, stiffness=2e4):
    """Masses of 1 and 2 kg on a rope over a smooth pulley, at rest where the rope is as long as its path."""
    a, b, centre, down, axis = turned(turn, (-R, -1), (R, -2), (0, 0), (0, -G), (0, 0))
    s = mb.Scene("Atwood", gravity=down)
    one, two = s.point_mass("one", 1.0, at=a), s.point_mass("two", 2.0, at=b)
    axis = turn @ np.array([0.0, 0.0, 1.0])
    s.rope("rope", one, two, at_k=a, at_l=b, stiffness=stiffness, over=[(s.ground, -R, centre)], axis=axis)
    return s


@pytest.mark.parametrize("turn", [PLANE, SPACE], ids=["plane", "space"])
def test_tension_of_an_elastic_atwood_machine(turn):
    """Over its mean, 2 g m for the reduced mass m = 2/3 kg, the tension swings with sqrt(k/m)."""
    s = atwood(turn)
    length, mass = 3 + np.pi * R, 2 / 3
    assert s["rope"].laws[0].length == pytest.approx(length, rel=1e-14)
    k = 2e4 / length
    r = s.simulate(0.2, accuracy=1e-8)
    np.testing.assert_allclose(r["rope"].tension, 2 * G * mass * (1 - np.cos(np.sqrt(k / mass) * r.t)), atol=1e-4)
    np.testing.assert_allclose(r["rope"].on_pulleys[:, 0], np.pi * R, atol=1e-9)
    assert np.max(np.abs(r.energy.balance)) < 1e-6


def test_a_pulley_without_slip_takes_its_share_of_the_torque():
    """A wheel of inertia J between two ropes that end on it: the acceleration is (m2 - m1) g / (m1 + m2 + J/R^2), the tensions
    are m1 (g + a) and m2 (g - a), once the damper has stilled the ropes. It winds a turn and more: whole turns count."""
    J = 0.02
    s = mb.Scene("wheel", gravity=(0, -G, 0))
    one, two = s.point_mass("one", 1.0, at=(-R, -4)), s.point_mass("two", 2.0, at=(R, -1))
    wheel = s.rigid_body("wheel", 1.0, J)
    s.revolute("axle", s.ground, wheel, at=(0, 0))
    options = {"stiffness": 2e5, "damping": 4e3}
    s.rope("left", one, wheel, at_k=(-R, -4), at_l=(0, 0), radius_l=-R, **options)
    s.rope("right", wheel, two, at_k=(0, 0), at_l=(R, -1), radius_k=-R, **options)
    r = s.simulate(1.2, accuracy=1e-7)
    a = G / (3 + J / R**2)
    assert r["axle"].angle[-1] < -2 * np.pi
    assert r["axle"].angle[-1] == pytest.approx(-a * 1.2**2 / 2 / R, rel=1e-3)  # the ropes are longer by a ten-thousandth
    assert r["left"].tension[-1] == pytest.approx(G + a, rel=1e-3)
    assert r["right"].tension[-1] == pytest.approx(2 * (G - a), rel=1e-3)


def test_a_rope_that_goes_slack_lets_the_mass_fly():
    """A mass on a rope, thrown up: against SciPy, in which the tension max(0, EA e + D e') / L ends where it would push."""
    EA, D, L, speed, mass = 2000.0, 20.0, 1.0, 3.0, 2.0
    s = mb.Scene("slack", gravity=(0, -G, 0))
    body = s.point_mass("body", mass, at=(0, -L), velocity=(0, speed))
    s.rope("rope", s.ground, body, at_k=(0, 0), at_l=(0, -L), stiffness=EA, damping=D)
    r = s.simulate(1.5, accuracy=1e-7, outputs=601)

    def rates(t, y):
        over = -y[0] - L
        return [y[1], -G + max(0.0, EA * over - D * y[1]) / L / mass if over > 0 else -G]

    found = solve_ivp(rates, (0, 1.5), [-L, speed], rtol=1e-10, atol=1e-12, max_step=1e-3, dense_output=True,
                      events=lambda t, y: -y[0] - L)
    np.testing.assert_allclose(r["body"].position[:, 1], found.sol(r.t)[0], atol=2e-6)
    assert len(found.t_events[0]) >= 3
    assert r["rope"].tension.min() == 0.0
    assert r["rope"].tension.max() > mass * G


def test_elevator_on_a_drum_against_scipy():
    """A car lifted by a drum that turns at a rate: the free rope grows shorter and stiffer, l = L - R angle."""
    EA, D, L, car, drum, J = 4e5, 4e4, 20.0, 800.0, 0.3, 5.0
    torque = 2600.0
    s = mb.Scene("elevator", gravity=(0, -G, 0))
    cabin, wheel = s.rigid_body("cabin", car, 1.0, at=(drum, -L)), s.rigid_body("drum", 1.0, J)
    s.revolute("axle", s.ground, wheel, at=(0, 0), torque=torque)
    s.prismatic("guide", s.ground, cabin, at=(drum, -L), axis=(0, 1, 0))
    s.rope("rope", wheel, cabin, at_k=(0, 0), at_l=(drum, -L), radius_k=-drum, stiffness=EA, damping=D)
    r = s.simulate(3.0, accuracy=1e-7)

    def rates(t, y):
        x, v, angle, w = y
        wound = drum * angle
        over, free = wound - x, L - wound
        stretch = max(0.0, EA * over + D * (drum * w - v)) if over > 0 else 0.0
        pull = stretch / free
        return [v, pull / car - G, w, (torque - drum * pull) / J]

    found = solve_ivp(rates, (0, 3.0), [0, 0, 0, 0], rtol=1e-10, atol=1e-12, t_eval=r.t, max_step=1e-2)
    np.testing.assert_allclose(r["guide"].displacement, found.y[0], atol=1e-5)
    np.testing.assert_allclose(r["axle"].angle, found.y[2], atol=1e-5)
    assert found.y[0, -1] > 3.0


def test_a_drum_carries_tension_times_radius():
    """At rest, whatever the strain (here 5 %): torque m g R, the mass under the drum's edge, V no part of it."""
    s = mb.Scene("winch", gravity=(0, -G, 0))
    mass, drum = s.point_mass("mass", 100.0, at=(0.3, -3)), s.rigid_body("drum", 1.0, 1.0)
    s.revolute("axle", s.ground, drum, at=(0, 0), angle=0.0)
    s.rope("rope", drum, mass, at_k=(0, 0), at_l=(0.3, -3), radius_k=-0.3, stiffness=2e4, length=2.99)
    rest = s.equilibrium()
    assert abs(rest["axle"].torque[0, 2]) == pytest.approx(100 * G * 0.3, rel=1e-9)
    assert rest["mass"].position[0, 0] == pytest.approx(0.3, abs=1e-9)
    assert rest["rope"].tension[0] == pytest.approx(100 * G, rel=1e-9)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_a_tension_that_jumps_is_judged_on_either_side(accuracy, recwarn):
    """A damped rope that tightens: its tension jumps by damping times rate over length, at an instant that runs find to within
    their accuracy; what stands before and after it is right."""
    mass, EA, D, L, drop = 1.0, 1e3, 5.0, 1.1, 1.0
    s = mb.Scene("bungee", gravity=(0, -G, 0))
    body = s.point_mass("body", mass, at=(0, -drop))
    s.rope("rope", s.ground, body, at_k=(0, 0), at_l=(0, -drop), stiffness=EA, damping=D, length=L)
    r = s.simulate(0.6, accuracy=accuracy)
    tension = r["rope"].tension

    def pull(y):
        return max(0.0, EA * (y[0] - L) + D * y[1]) / L if y[0] > L else 0.0

    def slackens(t, y):
        return EA * (y[0] - L) + D * y[1]

    def tightens(t, y):
        return y[0] - L

    begin, y, known, slack = 0.0, [drop, 0.0], np.zeros(len(r.t)), False
    while begin < 0.6:
        slack = not slack
        event = tightens if slack else slackens
        event.terminal, event.direction = True, 1 if slack else -1
        part = solve_ivp(lambda t, y, slack=slack: [y[1], G - (0.0 if slack else pull(y)) / mass], (begin, 0.6), y, rtol=1e-11,
                         atol=1e-13, events=event, dense_output=True)
        now = (r.t >= begin) & (r.t <= part.t[-1])
        known[now] = [0.0 if slack else pull(one) for one in part.sol(r.t[now]).T]
        begin, y = part.t[-1], part.y[:, -1]
    assert np.max(abs(tension - known)) < accuracy * known.max() * 3
    assert not recwarn.list
    assert r.error("rope.tension") < 3 * accuracy * known.max()


def crane(lift=0.0):
    """A hook block on two falls of a rope, from the boom over its pulley and back; a winch takes in the length `lift`."""
    s = mb.Scene("crane", gravity=(0, -G, 0))
    hook = s.point_mass("hook", 100.0, at=(0, -5))
    s.rope("rope", s.ground, s.ground, at_k=(-R, 0), at_l=(R, 0), stiffness=5e6, damping=5e5, over=[(hook, R)],
           length=10 + np.pi * R - lift)
    return s


def test_a_hook_block_rises_by_half_of_what_the_winch_takes():
    """Smoothly by 1 m in 4 s; the tension carries half of the weight and of the inertia each."""
    x = mb.t / 4
    lift = 10 * x**3 - 15 * x**4 + 6 * x**5
    at_rest = crane(1e-4).equilibrium()  # drawn taut: a rope that is just as long as its path resists nothing yet
    assert at_rest["rope"].tension[0] == pytest.approx(50 * G, rel=1e-6)
    r = crane(lift).simulate(4.0, accuracy=1e-7)
    risen = r["hook"].position[:, 1] + 5
    assert risen[-1] == pytest.approx(0.5, abs=1e-3)
    assert risen[len(r.t) // 2] == pytest.approx(0.25, abs=1e-3)
    assert r["rope"].tension[-1] == pytest.approx(50 * G, rel=1e-2)
    assert r.energy.balance[-1] == pytest.approx(0, abs=1e-2)


def test_a_crane_hook_swings_as_scipy_has_it():
    """A hook block that is a point, moved aside: the path is two tangents and an arc about it; against the same by numbers, the
    force by differences of the path."""
    EA, mass, length = 1e5, 50.0, 6.0
    s = mb.Scene("swing", gravity=(0, -G, 0))
    hook = s.point_mass("hook", mass, at=(1.0, -2.5))
    s.rope("rope", s.ground, s.ground, at_k=(-1, 0), at_l=(1, 0), stiffness=EA, over=[(hook, R)], length=length)
    r = s.simulate(1.0, accuracy=1e-7)
    radii, axis = np.array([0.0, R, 0.0]), np.array([0.0, 0.0, 1.0])

    def path(x, y):
        spans, ways = tangents(np.array([[-1.0, 0, 0], [x, y, 0], [1.0, 0, 0]]), radii, axis)
        return np.sum(np.linalg.norm(spans[:, 1] - spans[:, 0], axis=1)) + R * wraps_of(ways, radii, axis)[0]

    def rates(t, y):
        pull, h = EA * max(path(*y[:2]) - length, 0.0) / length, 1e-6
        gradient = [(path(y[0] + h, y[1]) - path(y[0] - h, y[1])) / 2 / h, (path(y[0], y[1] + h) - path(y[0], y[1] - h)) / 2 / h]
        return [y[2], y[3], -pull * gradient[0] / mass, -pull * gradient[1] / mass - G]

    found = solve_ivp(rates, (0, 1.0), [1.0, -2.5, 0, 0], rtol=1e-9, atol=1e-11, t_eval=r.t)
    np.testing.assert_allclose(r["hook"].position[:, 0], found.y[0], atol=1e-5)
    np.testing.assert_allclose(r["hook"].position[:, 1], found.y[1], atol=1e-5)


def belt(turn=PLANE, crossed=False, pretension=100.0):
    """Two wheels, radii 0.1 and 0.2 m, 1 m apart, two strands of a belt; a motor of 3 N m on one, a brake on the other."""
    small, large, EA = 0.1, 0.2 * (-1 if crossed else 1), 1e5
    first, second = turned(turn, (0, 0), (1, 0))
    axis = turn @ np.array([0.0, 0.0, 1.0])
    s = mb.Scene("belt", gravity=(0, 0, 0))
    driver = s.rigid_body("driver", 1.0, (0.01,) * 3, at=first)
    driven = s.rigid_body("driven", 1.0, (0.05,) * 3, at=second)
    s.revolute("in", s.ground, driver, at=first, axis=axis, torque=3.0)
    s.revolute("out", s.ground, driven, at=second, axis=axis, damper=0.3)
    free = np.sqrt(1 - (large - small) ** 2)
    options = {"stiffness": EA, "damping": 300.0, "length": free * (1 - pretension / EA), "axis": axis}
    s.rope("there", driver, driven, at_k=first, at_l=second, radius_k=small, radius_l=large, **options)
    s.rope("back", driven, driver, at_k=second, at_l=first, radius_k=large, radius_l=small, **options)
    return s


@pytest.mark.parametrize(("turn", "crossed"), [(PLANE, False), (PLANE, True), (SPACE, False)], ids=["plane", "crossed", "space"])
def test_a_belt_drives_with_the_ratio_of_its_wheels(turn, crossed):
    """In the steady state the motor's torque is the difference of the tensions times its radius; their sum stays that of the
    pretension. A crossed belt turns the other way."""
    r = belt(turn, crossed).simulate(3.0, accuracy=1e-6)
    assert r["out"].rate[-1] / r["in"].rate[-1] == pytest.approx(-0.5 if crossed else 0.5, rel=1e-3)
    assert abs(r["there"].tension[-1] - r["back"].tension[-1]) == pytest.approx(3.0 / 0.1, rel=2e-3)
    assert r["there"].tension[-1] + r["back"].tension[-1] == pytest.approx(200.0, rel=2e-3)


def test_a_rope_that_leaves_its_pulley_is_told():
    s = mb.Scene("off", gravity=(0, 0, 0))
    a = s.point_mass("a", 1.0, at=(1, -0.3), velocity=(0, 2.0))
    s.rope("rope", s.ground, a, at_k=(-1, 0), at_l=(1, -0.3), stiffness=100.0, over=[(s.ground, -R, (0, 0))])
    with pytest.warns(mb.AccuracyWarning, match="rope has left a pulley"):
        r = s.simulate(1.0)
    assert r["rope"].on_pulleys.min() < 0


def test_constant_steps_begin_on_a_rope_as_long_as_drawn():
    """Two ropes that are off their natural length by rounding alone ask for no steps of nanoseconds."""
    s = mb.Scene("wheel", gravity=(0, -G, 0))
    wheel = s.rigid_body("wheel", 3.0, 0.05)
    one, two = s.point_mass("one", 1.0, at=(-R, -1)), s.point_mass("two", 2.0, at=(R, -2))
    s.revolute("axle", s.ground, wheel, at=(0, 0))
    s.rope("left", one, wheel, at_k=(-R, -1), at_l=(0, 0), radius_l=-R, stiffness=1e4)
    s.rope("right", wheel, two, at_k=(0, 0), at_l=(R, -2), radius_k=-R, stiffness=1e4)
    r = s.simulate(0.1, accuracy=1e-2, solver=mb.HHT())
    assert r.stats.steps < 2000
    assert r["axle"].angle[-1] == pytest.approx(s.simulate(0.1)["axle"].angle[-1], abs=1e-3)


def test_ropes_are_stored_drawn_and_refused(tmp_path):
    s = crane(0.1 * mb.t)
    r = s.simulate(0.1)
    r.save(tmp_path / "r.npz")
    np.testing.assert_array_equal(mb.load(tmp_path / "r.npz")["rope"].tension, r["rope"].tension)
    s.draw(tmp_path / "crane.png")
    wrong = mb.Scene("wrong")
    a, b = wrong.point_mass("a", 1.0, at=(-1, -1)), wrong.point_mass("b", 1.0, at=(1, -1))
    wrong.rope("side", a, b, at_k=(-1, -1), at_l=(1, -1), stiffness=1.0, over=[(wrong.ground, R, (0, 0))])
    wrong.rope("near", a, b, at_k=(-1, -1), at_l=(1, -1), stiffness=1.0, over=[(wrong.ground, 1.5, (0, 0))])
    wrong.rope("list", a, b, at_k=(-1, -1), at_l=(1, -1), stiffness=1.0, over=[wrong.ground])
    wrong.rope("zero", a, b, at_k=(-1, -1), at_l=(1, -1), stiffness=1.0, radius_k=0.0)
    with pytest.raises(mb.SceneError) as refused:
        wrong.check()
    said = "\n".join(refused.value.problems)
    for words in ("the other sign", "circles overlap", "give a list of (body, radius)", "0 m"):
        assert words in said


@pytest.mark.slow
@pytest.mark.parametrize("pulleys", [0, 1, 2])
def test_the_law_keeps_the_contract(pulleys):
    """With circles far smaller than the distances that are drawn, so that none overlap: there is no tangent then."""
    numbers = {"radius_k": 0.1, "radius_l": -0.15, "angle_k": 0.3, "angle_l": -0.2, "length": 0.4}
    for n in range(pulleys):
        numbers |= {f"radius_{n + 1}": 0.12 * (-1) ** n, f"wrap_{n + 1}": 1.5 * (-1) ** n}
    assert mb.selftest(rope_over(pulleys), **numbers).worst["Jacobian"][0] < 1e-10
