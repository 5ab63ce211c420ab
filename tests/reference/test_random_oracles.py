"""The references of the claims timed_inputs and local_laws: against closed forms, balances, and errors made on purpose."""

from __future__ import annotations

import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

sys.path.insert(0, str(Path(__file__).parents[2] / "validation"))

from local_laws import scenes as laws
from local_laws.shapes import SHAPES, Field, bell
from timed_inputs import inputs, judge, oracle, scenes
from timed_inputs.bars import cantilever
from timed_inputs.inputs import Input

import mbdae as mb

NOTHING = Input("nothing", 1.0, sp.Integer(0), ((-inf, sp.Integer(0)),))


def one_of(make, name, **wanted):
    """The first random problem of a name whose attributes are as wanted."""
    for seed in range(200):
        problem = make(np.random.default_rng(seed))
        if problem.name == name and all(getattr(problem, key) == value for key, value in wanted.items()):
            return problem
    raise AssertionError(name)


def box(a, b, height):
    """A force between two instants."""
    zero = sp.Integer(0)
    said = sp.Piecewise((0, inputs.t < a), (height, inputs.t < b), (0, True))
    return Input("box", b - a, said, ((-inf, zero), (a, sp.Float(height)), (b, zero)))


@pytest.mark.parametrize("make", [*dict.fromkeys(inputs.LOADS), inputs.smoothstep, inputs.load])
def test_what_is_said_is_what_the_reference_integrates(make):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        i = make(rng, 3.0) if make is inputs.load else make(rng, 3.0, inputs.width(rng, 3.0, 1e-4))
        said = sp.lambdify(inputs.t, i.said, "numpy")
        edges = [0.0, *[b for b in i.breaks if 0 < b < 3], *[e for a, b, _ in i.fine for e in (a, b) if 0 < e < 3], 3.0]
        for a, b in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
            for share in (0.02, 0.37, 0.98) if b - a > 1e-12 else ():
                at = np.float64(a + share * (b - a))
                with np.errstate(all="ignore"):
                    shown = float(said(at))
                # 1e-8: (t - a) / w as SymPy multiplies it out loses 1e-16 t / w, and slopes are 1 / w
                assert shown == pytest.approx(inputs.numeric(i.piece(at))(at), abs=1e-8), (i.said, at)


def test_impulse_on_a_mass():
    p = one_of(scenes.mass, "mass")
    p.inputs = [box(0.7, 0.7 + 1e-6, 1e6), NOTHING]
    x0 = p.start
    at = oracle.solve(p, np.array([0.0, p.t_end]))
    free = oracle.solve(_with(p, [NOTHING, NOTHING]), np.array([0.0, p.t_end]))
    mass = 1 / p.rhs(0.0, np.zeros(4), [lambda t: 1.0, lambda t: 0.0])[2]
    assert x0[2] + 1 / mass == pytest.approx(at["b.velocity"][-1, 0], rel=1e-10)  # 1 N s
    moved = at["b.position"][-1, 0] - free["b.position"][-1, 0]
    assert moved == pytest.approx((p.t_end - 0.7 - 5e-7) / mass, rel=1e-10)


def test_box_on_an_oscillator():
    """x = F/k (cos w (t - b) - cos w (t - a)) after a box from a to b, without damping."""
    p = one_of(scenes.oscillator, "oscillator")
    w, a, b = 2.0, 1.0, 1.3
    p.rhs, p.start, p.inputs, p.t_end = (lambda t, y, u: [y[1], u[0](t) - w**2 * y[0]]), np.zeros(2), [box(a, b, 3.0)], 9.0
    times = np.linspace(0, 9, 50)
    exact = 3.0 / w**2 * (np.cos(w * (times - b)) - np.cos(w * (times - a)))
    after = times > b
    np.testing.assert_allclose(oracle.solve(p, times)["p.displacement"][after], exact[after], atol=1e-11)


def _with(problem, made):
    from dataclasses import replace

    return replace(problem, inputs=made)


ENERGIES = {  # of problems without inputs, by what they read
    "pendulum": lambda y: y[1] ** 2 / 6 - 9.81 / 2 * np.cos(y[0]),
    "double pendulum": lambda y: 0.25 * (2 / 3 * y[2] ** 2 + y[3] ** 2 / 6 + y[2] * y[3] * np.cos(y[0] - y[1]) / 2)
    - 0.5 * 9.81 * (1.5 * np.cos(y[0]) + 0.5 * np.cos(y[1])),
}


@pytest.mark.parametrize("name", ENERGIES)
def test_pendulums_keep_their_energy(name):
    p = one_of(scenes.pendulum if name == "pendulum" else scenes.double_pendulum, name)
    rng, u = np.random.default_rng(1), [lambda t: 0.0]
    for y in rng.normal(size=(20, len(p.start))):
        h = 1e-6
        rate = np.array(p.rhs(0.0, y, u))
        change = (ENERGIES[name](y + h * rate) - ENERGIES[name](y - h * rate)) / (2 * h)
        lost = 0.05 * y[1] ** 2 if name == "pendulum" else 0.0  # W, the damper at the hinge
        assert change == pytest.approx(-lost, abs=1e-6)


def test_four_bar_stays_closed_and_keeps_its_energy():
    p = one_of(scenes.four_bar, "four-bar")
    lengths = np.array([0.3, np.hypot(0.5, 0.4), np.hypot(0.2, 0.7)])
    masses = 2 * lengths
    drawn = np.array([np.pi / 2, np.arctan2(0.4, 0.5), np.arctan2(0.7, -0.2)])
    bar = scenes.FourBar(lengths, masses, drawn, np.array([0.7, 0.0]))
    np.testing.assert_allclose(bar.closed(np.pi / 2), drawn, atol=1e-12)
    slope = (bar.closed(1.6 + 1e-6) - bar.closed(1.6 - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, bar.rates(bar.closed(1.6), 1.0), atol=1e-8)
    p = _with(p, [NOTHING])
    p.start = np.r_[drawn, bar.rates(drawn, 1.0)]

    def energy(a, w):
        l1, l2, l3 = lengths
        ends = [l1 * w[0] * np.array([-np.sin(a[0]), np.cos(a[0])]), l2 * w[1] * np.array([-np.sin(a[1]), np.cos(a[1])])]
        centre = ends[0] + ends[1] / 2
        kinetic = masses[0] * l1**2 * w[0] ** 2 / 6 + masses[2] * l3**2 * w[2] ** 2 / 6
        kinetic += masses[1] * (centre @ centre / 2 + l2**2 * w[1] ** 2 / 24)
        return kinetic + (a[2] - drawn[2]) ** 2 / 2

    at = oracle.solve(p, np.linspace(0, p.t_end, 7))
    for first, rate in zip(at["A.angle"], at["A.rate"], strict=True):
        a = bar.closed(drawn[0] + first)
        assert energy(a, bar.rates(a, rate)) == pytest.approx(energy(drawn, bar.rates(drawn, 1.0)), rel=1e-9)


def test_a_free_body_keeps_its_angular_momentum_and_a_torque_adds_to_it():
    p = one_of(scenes.spinning_body, "spinning body")
    y, J, h = np.random.default_rng(3).normal(size=9), np.array([1.0, 1.6, 2.2]), 1e-6

    def momentum(y):
        return scenes.rotation(y[:4]) @ (J * y[4:7])

    for torque in (0.0, 1.0):
        rate = np.array(p.rhs(0.0, y, [lambda t, torque=torque: torque, lambda t: 0.0]))
        change = (momentum(y + h * rate) - momentum(y - h * rate)) / (2 * h)
        assert np.linalg.norm(change) == pytest.approx(torque, abs=1e-8)  # the axis is a unit vector


def test_bars_have_the_frequency_and_deflection_of_the_continuum():
    fine = cantilever(100.0, 1.0, 1.0, 8, 0.0)
    exact = np.pi / 2 * 10  # sqrt(EA / (rho A)) pi / (2 L)
    assert fine.slowest / exact - 1 == pytest.approx((np.pi / 2 / 8) ** 4 / 1440, rel=0.05)  # what quadratic elements are off
    bent = cantilever(1.0, 1.0, 1.0, 2, 0.0, shear=40.0, rotary=1e-2)
    # L^3 / (3 EI) + L / GA, and L^4 / (8 EI) + L^2 / (2 GA): exact at nodes
    assert bent.tip @ np.linalg.solve(bent.K, bent.tip) == pytest.approx(1 / 3 + 1 / 40, rel=1e-10)
    assert bent.tip @ np.linalg.solve(bent.K, bent.spread) == pytest.approx(1 / 8 + 1 / 80, rel=1e-10)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
def test_slopes_are_those_of_the_energies(shape):
    value, slope = Field(shape, 2.0, 0.5, 0.1).functions()
    for s in (0.05, 0.41, 0.47, 0.53, 0.57):
        assert (value(s + 1e-7) - value(s - 1e-7)) / 2e-7 == pytest.approx(slope(s), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(("height", "reflected"), [(0.4, False), (3.0, True), (-2.0, False)])
@pytest.mark.parametrize("width", [1e-1, 1e-4])
def test_a_bell_in_space_is_passed_or_reflects(width, height, reflected):
    """The reference itself: the speed far from the bell is the speed before it."""
    value, slope = Field(bell, height / 2, 0.5, width).functions()
    p = oracle.Problem("bell", lambda said: None, [], 2.0, np.array([0.0, 1.0]), lambda t, y, u: [y[1], -slope(y[0])],
                       lambda t, y, u: {"x": y[0], "v": y[1]})
    laws.local(p, Field(bell, height / 2, 0.5, width), 1.2 * np.sqrt(1 + 2 * abs(height)), lambda y: y[0])
    at = oracle.solve(p, np.linspace(0, 2, 21))
    before = value(0.0)
    np.testing.assert_allclose(at["v"] ** 2 / 2 + [value(x) for x in at["x"]], 0.5 + before, atol=1e-9)
    assert (at["v"][-1] < 0) == reflected


def test_the_judge_sees_a_force_that_was_left_out():
    """A run without the force is silent where nothing is said and told where something is; the same run with it is right."""
    p = one_of(scenes.mass, "mass", constrained=False)
    p.inputs = [box(0.5, 1.0, 0.3), NOTHING]
    way = judge.Way("RadauIIA(3)", mb.RadauIIA(3))
    times = oracle.instants(p)
    truth = oracle.solve(p, times)
    without = judge.simulate(p.build([0, 0]), p.t_end, 1e-4, way)
    error = judge.error_of(without, times, truth)
    gone = np.linalg.norm(truth["b.position"] - oracle.solve(_with(p, [NOTHING, NOTHING]), times)["b.position"], axis=1).max()
    assert error >= gone / without.prepared.length * 0.999
    assert judge.judged(error, 3e-4, "") == "silent"
    assert judge.judged(error, 3e-4, "not met") == "told"
    assert judge.judged(1e-4, 3e-4, "") == "right"
    assert judge.judged(2e-4, 3e-4, "not met") == "told"
    assert judge.judged(0.9e-4, 3e-4, "not met") == "told needlessly"
    known = oracle.solve(_with(p, [NOTHING, NOTHING]), times)
    assert judge.error_of(without, times, known) < 1e-8


def test_what_is_raised_is_judged_too():
    assert judge.failed(mb.SceneError(["no"]))[0] == "refused needlessly"
    assert judge.failed(mb.SolverError("stopped", 1.0))[0] == "told"
    assert judge.failed(RuntimeError("no"))[0] == "crashed"


def test_a_constant_step_is_compared_with_the_same_step_split_by_hand(monkeypatch):
    """The split run of a method of order 5 integrates a box on a mass exactly; a step across the edges, of a run that does not
    look at its inputs before, does not."""
    monkeypatch.setattr("mbdae.system.scene_system.WATCH_INPUTS_AND_SWITCHES", False)
    p = one_of(scenes.mass, "mass", constrained=False)
    p.inputs = [box(0.5, 0.613, 3.0), NOTHING]
    way, times = judge.Way("step", mb.RadauIIA(3, step=0.07)), oracle.instants(p)
    truth = oracle.solve(p, times)
    assert judge.by_hand(p, way, 1e-6, times, truth)[0] < 1e-9
    assert judge.error_of(judge.simulate(p.build([i.said for i in p.inputs]), p.t_end, 1e-6, way), times, truth) > 1e-4


def test_forces_on_the_quarter_car_and_the_moved_pivot_balance():
    """Masses times accelerations of the car are the tyre's force; a pendulum at tan(angle) = -a / g stays there."""
    y, tyre = np.array([0.01, 0.03, 0.2, -0.1]), 150e3 * (0.02 - 0.01) + 100.0 * (0.5 - 0.2)
    road = oracle.Truth(sp.Float(0.02) + sp.Float(0.5) * inputs.t)
    rate = one_of(scenes.quarter_car, "quarter car").rhs(0.0, y, [road])
    assert 40 * rate[2] + 300 * rate[3] == pytest.approx(tyre, rel=1e-12)
    pivot = one_of(scenes.moved_pivot, "moved pivot")
    assert pivot.rhs(0.3, np.array([-np.arctan(2 / 9.81), 0.0]), [oracle.Truth(inputs.t**2)])[1] == pytest.approx(0.0, abs=1e-12)


def test_the_pin_in_its_race_loses_what_its_damping_takes():
    p, y, h = one_of(scenes.loose_pin, "loose pin"), np.array([0.02, 0.012, 0.3, -0.4]), 1e-7

    def energy(y):
        return 0.25 * (y[2] ** 2 + y[3] ** 2) + 0.4 * 1e5 * max(0.0, np.hypot(y[0], y[1]) - 0.02) ** 2.5

    rate = np.array(p.rhs(0.0, y, [lambda t: 0.0] * 2))
    deep, speed = np.hypot(y[0], y[1]) - 0.02, (y[:2] @ y[2:]) / np.hypot(y[0], y[1])
    change = (energy(y + h * rate) - energy(y - h * rate)) / (2 * h)
    assert change == pytest.approx(-1e5 * deep**1.5 * 0.3 * speed**2, rel=1e-6)
