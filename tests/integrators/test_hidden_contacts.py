"""Contacts that come and go inside a step: runs are repeated with shorter steps there, or say that they stepped over them."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.run import control
from mbdae.run.contacts import hidden_contacts


def flying():
    """A small, soft ball that another one passes with an overlap of a quarter of its diameter."""
    s = mb.Scene("passing")
    s.rigid_body("ball", 0.01, 1e-8, at=(-1, 0.0015), velocity=(1, 0))
    s.contact("post", s.ground, "ball", mb.Sphere(at=(0, 0), radius=0.001), mb.Sphere(radius=0.001), normal=mb.Hertz(100.0))

    def rates(t, y):
        away = math.hypot(y[0], y[1])
        push = 100.0 * max(0.002 - away, 0.0) ** 1.5 / 0.01
        return [y[2], y[3], push * y[0] / away, push * y[1] / away]

    return s, "ball", 3.0, rates, [-1, 0.0015, 1, 0]


def spinning(height=0.5, speed=100.0, stiffness=1e7):
    """A body that spins freely, with a tip that reaches a plane once a turn."""
    s = mb.Scene("spinning")
    b = s.rigid_body("body", 1.0, 0.1, at=(0, 0), angular_velocity=(0, 0, speed))
    s.contact("plane", s.ground, b, mb.Plane(at=(0, -height, 0), normal=(0, 1, 0)), mb.Sphere(at=(0.5, 0), radius=0.001),
              normal=mb.Hertz(stiffness))

    def rates(t, y):
        gap = y[1] + 0.5 * math.sin(y[4]) - 0.001 + height
        push = stiffness * max(-gap, 0.0) ** 1.5
        return [y[2], y[3], 0.0, push, y[5], push * 0.5 * math.cos(y[4]) / 0.1]

    return s, "body", 20 / speed, rates, [0, 0, 0, 0, 0, speed]


SCENES = {"passing": flying, "spinning": spinning, "grazing": lambda: spinning(0.5009, 1000.0, 1e10)}


@pytest.mark.parametrize("solver", [None, mb.DOP853(), mb.RadauIIA(2)])
@pytest.mark.parametrize("name", SCENES)
def test_contacts_inside_a_step_are_found(name, solver):
    """Against SciPy with short steps. Without the look inside the steps most of these runs passed through and said that they
    were right."""
    s, body, end, rates, y0 = SCENES[name]()
    right = solve_ivp(rates, (0, end), y0, "DOP853", rtol=1e-10, atol=1e-13, max_step=end / 3000).y[:2, -1]
    assert abs(right[1] - y0[1]) > 1e-4
    run = s.simulate(end, accuracy=1e-5, **({} if solver is None else {"solver": solver}))
    assert run.reliable
    assert run[body].position[-1][:2] == pytest.approx(right, abs=3e-5)


def test_what_a_single_run_steps_over_is_said():
    s, _, end, *_ = spinning()
    with pytest.warns(mb.AccuracyWarning, match=r"2 contacts stepped over .*, first 'plane' at t = 0\.04\d* s"):
        run = s.simulate(end, solver=mb.DOP853(rtol=1e-6), form="index1")
    assert run.reliable is False
    assert run.stats.missed_dips == 2


def test_what_repeated_runs_still_step_over_is_said(monkeypatch):
    monkeypatch.setattr(control, "REPEATS", 0)
    monkeypatch.setattr(control, "in_the_same_steps", lambda *runs: False)  # else a run with shorter steps meets them
    s, _, end, *_ = spinning()
    with pytest.warns(mb.AccuracyWarning, match="contacts stepped over"):
        run = s.simulate(end, solver=mb.DOP853(), accuracy=1e-5, form="index1")
    assert run.reliable is False
    assert "motion" not in run.accuracy.covers


def test_open_and_closed_contacts_are_no_hidden_ones():
    """A ball that bounces: its contacts begin and end at steps."""
    s = mb.Scene("bouncing", gravity=(0, -9.81, 0))
    s.rigid_body("ball", 1.0, 0.01, at=(0, 0.3))
    s.contact("floor", s.ground, "ball", mb.Plane(normal=(0, 1, 0)), mb.Sphere(radius=0.1), normal=mb.Hertz(1e6, 0.2))
    run = s.simulate(1.0, solver=mb.RadauIIA(3, rtol=1e-6))
    assert run.contacts["floor"]["contacts"] > 1
    assert hidden_contacts(run.solution.systems[0][1], run.solution, 1e-9) == []


def test_a_touch_at_the_end_of_one_step_is_felt() -> None:
    """An oscillator passes a damped stop by 4e-6 of its amplitude, for a part of a step. Coming in, the stop takes the damping
    times that depth of its momentum, which is its speed where it turns on the other side."""
    w, amplitude, over, damping, accuracy = 8.85, 0.116, 4.8e-7, 60.0, 1e-5  # rad/s, m, m, 1/s
    s = mb.Scene("graze")
    s.prismatic("j", s.ground, s.rigid_body("c", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), spring=w * w,
                rate0=amplitude * w, limits=(None, amplitude - over), stop=mb.Stop(8e3, damping))
    r = s.recursive().simulate(1.5 * math.pi / w, accuracy=accuracy, solver=mb.IDA())
    kick = damping * over  # m/s, 3 % less than with the stiffness of the stop
    assert not r.warnings
    assert r["j"].rate[-1] == pytest.approx(kick, abs=accuracy * amplitude * w + 0.05 * kick)
