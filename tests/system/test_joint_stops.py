"""Stops at the limits of joints against closed forms and runs split at every contact: never stepped over."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare

MASS, V = 2.0, 3.0
MODELS = {"kinematic": mb.Kinematic(), "classical": mb.Classical(), "recursive": mb.Recursive()}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def slider(model=None, **given):
    s = mb.Scene("slider")
    body = s.rigid_body("a", MASS, 1.0, at=(0, 0))
    s.prismatic("J", s.ground, body, at=(0, 0), axis=(1, 0, 0), model=model, **given)
    return s


def bouncing(t, low, high, speed, lasts):
    """Place at a time in flight between two undamped stops, from 0 at a positive speed; impacts last `lasts` seconds."""
    t, at, sense = t - (high / speed + lasts), high, -1
    while t > (high - low) / speed + lasts:
        t, sense = t - ((high - low) / speed + lasts), -sense
        at = high if sense < 0 else low
    return at + sense * speed * t


@every_model
def test_bouncing_between_two_stops(model):
    k, low, high = 1e5, -0.1, 0.2
    r = slider(model, rate0=V, limits=(low, high), stop=mb.Stop(k)).simulate(1.0, accuracy=1e-6)
    lasts = math.pi * math.sqrt(MASS / k)
    assert r["J"].displacement[-1] == pytest.approx(bouncing(1.0, low, high, V, lasts), abs=1e-6)
    contacts = r["J"].contacts
    assert contacts.end - contacts.begin == pytest.approx(np.full(9, lasts), rel=1e-5)
    assert contacts.peak == pytest.approx(np.full(9, V * math.sqrt(MASS / k)), rel=1e-4)
    assert abs(r.energy.balance).max() < 1e-5
    assert not r.warnings


@pytest.mark.parametrize("damping", [50.0, 447.2, 2 * math.sqrt(MASS * 1e5), 2000.0])
def test_one_damped_impact(damping):
    """m x'' = -k x - d x' from entry until the force vanishes: below, at and above critical damping."""
    k = 1e5
    w = math.sqrt(k / MASS)
    z = damping / (2 * MASS * w)
    a = 1.0 if abs(z - 1) < 1e-9 else math.acos(z) / math.sqrt(1 - z * z) if z < 1 else math.acosh(z) / math.sqrt(z * z - 1)
    e = math.exp(-2 * z * a)
    r = slider(rate0=V, limits=(None, 0.2), stop=mb.Stop(k, damping)).simulate(0.2, accuracy=1e-7)
    assert r["J"].rate[-1] == pytest.approx(-e * V, abs=1e-6 * V)
    assert r["J"].contacts.deepest == pytest.approx(V / w * math.exp(-z * a), rel=1e-5)
    assert r.energy.impact[-1] == pytest.approx(MASS * V**2 / 2 * (1 - e * e), rel=1e-6)
    assert abs(r.energy.balance).max() < 1e-6
    (contact,) = prepare(r.prepared.model.scene).contacts
    assert contact.mass == pytest.approx(MASS)
    assert contact.law.restitution(MASS) == pytest.approx(e, rel=1e-5)
    assert contact.depth == pytest.approx(V / w * math.exp(-z * a), rel=1e-4)
    assert not r.warnings


@pytest.mark.parametrize("damping", [0.0, 50.0, 447.2, 2 * math.sqrt(MASS * 1e5), 2000.0])
def test_the_force_of_a_stop_ends_after_the_duration_stated(damping):
    """Place and velocity in the stop by the exponential of m x'' = -k x - d x'."""
    k, d = 1e5, damping
    law = slider(limits=(None, 0.2), stop=mb.Stop(k, d)).check().prepared.contacts[0].law
    lasts = law.contact_duration(MASS, V)
    A = np.array([[0.0, 1.0], [-k / MASS, -d / MASS]])
    force = [k * x + d * v for x, v in (expm(A * share * lasts) @ (0.0, V) for share in (0.01, 0.5, 0.99, 1.0))]
    assert min(force[:3]) > 0
    assert force[3] == pytest.approx(0.0, abs=1e-4 * max(force))
    assert expm(A * lasts) @ (0.0, V) @ (0.0, 1.0) == pytest.approx(-law.restitution(MASS) * V, rel=1e-4)


@every_model
def test_turns_are_counted_in_space(model):
    """A rotor about a slanted axis, stopped after more than three turns either way; without damping."""
    k, speed, limit = 1e5, 20.0, 20.0
    s = mb.Scene("rotor", space="spatial")
    axis = np.array([0.3, 0.2, 1.0])
    J = np.array([0.1, 0.1, 0.2])
    s.revolute("J", s.ground, s.rigid_body("a", 1.0, J, at=(0, 0, 0)), at=(0, 0, 0), axis=axis, model=model, rate0=speed,
               limits=(-limit, limit), stop=mb.Stop(k))
    r = s.simulate(4.0, accuracy=1e-6)
    inertia = axis**2 @ J / (axis @ axis)
    assert r.prepared.contacts[0].mass == pytest.approx(inertia)
    assert r["J"].angle[-1] == pytest.approx(bouncing(4.0, -limit, limit, speed, math.pi * math.sqrt(inertia / k)), abs=1e-6)
    assert not r.warnings


def test_limits_of_two_coordinates():
    """Displacement and angle of one joint bounce without disturbing each other."""
    s = mb.Scene("tube")
    s.cylindrical("J", s.ground, s.rigid_body("a", 1.0, (0.1, 0.1, 0.2), at=(0, 0, 0)), at=(0, 0, 0), axis=(0, 0, 1),
                  start_rate={"displacement": 1.0, "angle": 30.0}, limits={"displacement": (-0.1, 0.2), "angle": (-2, 10)},
                  stop={"displacement": mb.Stop(1e5), "angle": mb.Stop(1e6)})
    for variant in (s, s.replace("J", model=mb.Classical())):
        r = variant.simulate(1.0, accuracy=1e-6)
        assert r["J"].displacement[-1] == pytest.approx(bouncing(1.0, -0.1, 0.2, 1.0, math.pi * math.sqrt(1e-5)), abs=1e-6)
        assert r["J"].angle[-1] == pytest.approx(bouncing(1.0, -2, 10, 30.0, math.pi * math.sqrt(2e-7)), abs=1e-5)
        assert len(r["J"].contacts) == 5
        assert not r.warnings


GRAZING = {
    "default": {}, "IDA": {"solver": mb.IDA}, "CVODE": {"solver": mb.CVODE, "form": mb.Index1()},
    "Radau5": {"solver": mb.RadauIIA(5)}, "index 3": {"solver": mb.RadauIIA(3), "form": mb.Index3()},
}


@pytest.mark.parametrize("way", [pytest.param(way, marks=[pytest.mark.slow] * (way == "CVODE")) for way in GRAZING])
def test_a_limit_reached_only_briefly_is_not_missed(way):
    """A mass on a spring would pass its limit by 1e-5 of its amplitude for 1.4 ms a second; the stop turns it back earlier."""
    k, A, w, stop = MASS * 4 * math.pi**2, 0.1, 2 * math.pi, 1e6
    upper = A * (1 - 1e-5)
    s = slider(mb.Kinematic(), rate0=A * w, spring=k, limits=(None, upper), stop=mb.Stop(stop))
    r = s.simulate(10.0, accuracy=1e-6, **GRAZING[way])
    v, fast, rest = w * math.sqrt(A * A - upper * upper), math.sqrt((k + stop) / MASS), stop * upper / (stop + k)
    inside, phase = 2 * math.atan2(v / fast, upper - rest) / fast, math.acos(upper / A)
    period, first = inside + (2 * math.pi - 2 * phase) / w, math.asin(upper / A) / w
    since = (10.0 - first) % period
    exact = A * math.cos(phase + w * (since - inside))
    assert since > inside
    assert len(r["J"].contacts) == r.stats.contacts == 1 + (10.0 - first) // period == 10
    assert r["J"].displacement[-1] == pytest.approx(exact, abs=3e-5)
    assert abs(exact - A * math.sin(w * 10.0)) > 3e-4  # what a run would give that steps over the limit


def test_constant_steps_that_pass_a_limit_are_told():
    """A mass on a spring passes its limit for 14 ms in every second, a fifth of a step."""
    s = slider(mb.Recursive(), rate0=0.1 * 2 * math.pi, spring=MASS * 4 * math.pi**2, limits=(None, 0.0999), stop=mb.Stop(1e4))
    with pytest.warns(mb.AccuracyWarning, match=r"contacts? (stepped over|may have been stepped over)") as told:
        r = s.simulate(5.0, solver=mb.HHT(step=0.08))
    assert sum("stepped over" in str(warning.message) for warning in told) == 1
    assert r.reliable is False


@pytest.mark.parametrize("form", [mb.GGL(), mb.Index3(), mb.Index1()], ids=lambda f: f.label)
def test_constant_steps_that_resolve_an_impact(form):
    k = 1e4
    given = {"rate0": V, "limits": (-0.1, 0.2), "stop": mb.Stop(k)}
    exact = bouncing(0.5, -0.1, 0.2, V, math.pi * math.sqrt(MASS / k))
    r = slider(mb.Kinematic(), **given).simulate(0.5, solver=mb.RadauIIA(3, step=1e-3), form=form)
    assert r["J"].displacement[-1] == pytest.approx(exact, abs=1e-3)
    assert not r.warnings
    r = slider(mb.Recursive(), **given).simulate(0.5, solver=mb.HHT(step=2e-4))
    assert r["J"].displacement[-1] == pytest.approx(exact, abs=2e-3)


# -- effective inertia


def slider_crank(angle0):
    """A crank that turns at 10 rad/s; its slider meets a stop 0.2 m inwards."""
    s = mb.Scene("slider-crank")
    s.link("crank", (0, 0), (0.15, 0), mass=0.5)
    s.link("rod", (0.15, 0), (0.55, 0), mass=0.3)
    s.rigid_body("slider", 1.0, 1e-3, at=(0.55, 0))
    s.revolute("A", s.ground, "crank", at=(0, 0), angle0=angle0, rate0=10.0)
    s.revolute("B", "crank", "rod", at=(0.15, 0))
    s.revolute("C", "rod", "slider", at=(0.55, 0))
    s.prismatic("D", s.ground, "slider", at=(0.55, 0), axis=(1, 0, 0), limits=(-0.2, None), stop=mb.Stop(1e6, 20.0))
    return s


def test_inertia_is_that_of_the_position_where_the_stop_acts():
    """At its dead centre nothing moves the slider: the mass at the start is infinite, the impact happens all the same."""
    assert prepare(slider_crank(0.0)).contacts[0].mass > 1e6
    runs = [slider_crank(0.0).simulate(0.5, accuracy=1e-5, **way)
            for way in ({}, {"solver": mb.IDA}, {"solver": mb.CVODE, "form": mb.Index1()})]
    for r in runs:
        assert len(r["D"].contacts) == 1
        assert r.stats.shortest_contact >= 5
        assert r["D"].displacement == pytest.approx(runs[0]["D"].displacement, abs=3e-5)
        assert not r.warnings
    r = runs[0]
    t = float(r["D"].contacts.begin[0]) - 1e-4
    _, (speed,), (duration,) = system_for(r.prepared, mb.GGL(), 2).guards(t, r.solution(t))
    mass = 2 * float(r(t).energy.kinetic[0]) / speed**2
    assert duration == pytest.approx(r.prepared.contacts[0].law.contact_duration(mass, speed), rel=1e-6)


def test_inertia_counts_what_joints_tie_to_the_bodies():
    """Two welded rods about one hinge: the inertia of both about it."""
    s = mb.Scene("two rods")
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("J", s.ground, a, at=(0, 0), limits=(-1, 1), stop=mb.Stop(1e5))
    s.weld("W", a, b, at=(1, 0))
    for variant in (s, s.recursive()):
        assert prepare(variant).contacts[0].mass == pytest.approx(2.0 * 2.0**2 / 3)


# -- a pendulum against a stiff narrow stop

STIFF, LIMIT, INERTIA, MOMENT = 1e8, -1.2, 1 / 3, 9.81 / 2


def reference(t_end):
    """Angle of the pendulum at t_end by SciPy, split wherever the stop begins or ends."""
    t, y, inside = 0.0, np.zeros(2), False

    def motion(t, y):
        return [y[1], (-MOMENT * math.cos(y[0]) + (STIFF * (LIMIT - y[0]) if inside else 0.0)) / INERTIA]

    def limit(t, y):
        return y[0] - LIMIT

    limit.terminal = True
    while t < t_end:
        limit.direction = 1 if inside else -1
        part = solve_ivp(motion, (t, t_end), y, "DOP853", rtol=1e-13, atol=1e-15, events=limit)
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 1:
            inside = not inside
    return y[0]


def pendulum(model):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=model, limits=(LIMIT, None),
               stop=mb.Stop(STIFF))
    return s


SOLVERS = {"IDA": mb.IDA, "CVODE": mb.CVODE, "Radau": mb.RadauIIA(3), "HHT": mb.HHT}


def check_pendulum(model, solver, accuracies, exact):
    for accuracy in accuracies:
        form = mb.Index1() if solver == "CVODE" and model != "recursive" else None
        if solver == "HHT":  # constant steps: an impact of 0.2 ms takes some millions of them, which it says
            with pytest.raises(mb.SolverError, match="needs steps of"):
                pendulum(MODELS[model]).simulate(2.0, accuracy=accuracy, solver=mb.HHT)
            continue
        r = pendulum(MODELS[model]).simulate(2.0, accuracy=accuracy, solver=SOLVERS[solver], form=form)
        error = abs(r["J"].angle[-1] - exact)
        assert error < 3 * accuracy or r.warnings, f"{model} {solver} {accuracy}: {error:.1e}"
        assert r.stats.contacts == 2
        assert not r.warnings


@pytest.mark.parametrize("solver", ["IDA", "CVODE", "Radau"])
@pytest.mark.parametrize("model", MODELS)
def test_pendulum_against_a_stiff_stop(model, solver):
    check_pendulum(model, solver, (1e-5,), reference(2.0))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mbdae.AccuracyWarning")
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("model", MODELS)
def test_pendulum_against_a_stiff_stop_at_every_accuracy(model, solver):
    check_pendulum(model, solver, (1e-4, 1e-5, 1e-6, 1e-7), reference(2.0))


def test_a_stop_that_is_only_touched_does_not_act():
    """The joint stands at its limit and moves past it: neither spring nor damper has acted yet."""
    r = slider(rate0=V, limits=(None, 0.0), stop=mb.Stop(1e5, 50.0)).simulate(1e-6)
    assert r["a"].acceleration[0, 0] == 0.0
    assert r["a"].acceleration[-1, 0] < -50.0 * V / MASS
