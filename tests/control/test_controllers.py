"""Sampled controllers: called at their instants, held in between, pure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.errors import ControllerError, OptionError, SceneError

G, EVERY = 9.81, 0.01


def pid(t, angle, rate, integral):
    """With anti-windup: the integral stands while the output is at its limit."""
    error = 0.5 - angle
    wanted = 30 * error - 4 * rate + 8 * (integral + EVERY * error)
    u = min(max(wanted, -10.0), 10.0)
    return u, integral + EVERY * error if u == wanted else integral


def pendulum(f=pid, model=None, every=EVERY, sets=("u",), memory=0.0, reads=("J.angle", "J.rate")):
    s = mb.Scene("sampled", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.controller("pid", f, every=every, reads=list(reads), sets=list(sets), memory=memory)
    s.revolute("J", s.ground, rod, at=(0, 0), torque="u", model=model)
    return s


@pytest.fixture(scope="module")
def reference():
    """Angle, rate and output at every instant of 2 s by SciPy, interval by interval."""
    y, integral, rows = np.zeros(2), 0.0, []
    for k in range(200):
        u, integral = pid(k * EVERY, *y, integral)
        rows.append([*y, u])
        y = solve_ivp(lambda t, y, u=u: [y[1], 3 * (u - 0.5 * G * np.cos(y[0]))], (0, EVERY), y, method="DOP853", rtol=1e-11,
                      atol=1e-13).y[:, -1]
    return np.array([*rows, [*y, u]])


@pytest.mark.parametrize("form", [None, mb.GGL(), mb.Index3(), mb.Index1()])
@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Recursive()])
def test_pid_at_a_hundred_hertz(reference, model, form):
    r = pendulum(model=model).simulate(2.0, form=form, accuracy=1e-7, outputs=201)
    np.testing.assert_allclose(r["J"].angle, reference[:, 0], atol=1e-8)
    for part in (0.01, 0.99):  # from one instant to the next
        np.testing.assert_allclose(r((np.arange(200) + part) * EVERY)["u"], reference[:-1, 2], atol=1e-6)


def test_runs_repeat_to_the_last_bit():
    first, second = (pendulum().simulate(1.0) for _ in range(2))
    np.testing.assert_array_equal(first.solution.y, second.solution.y)


@pytest.mark.parametrize("solver", ["radau3", "ida", "cvode", "dop853"])
def test_solvers_agree(reference, solver):
    r = pendulum().recursive().simulate(1.0, solver=solver, accuracy=1e-6)
    assert r["J"].angle[-1] == pytest.approx(reference[100, 0], abs=1e-6)


def test_two_rates_and_time_inputs():
    """Controllers of different periods, with a break of an input between instants."""
    import sympy as sp

    calls = {"fast": [], "slow": []}

    def called(name):
        def f(t):
            calls[name].append(t)
            return t

        return f

    s = mb.Scene("rates")
    body = s.point_mass("b", 1.0, at=(0, 0))
    s.controller("fast", called("fast"), every=0.1, sets=["a"])
    s.controller("slow", called("slow"), every=0.25, sets=["b2"])
    s.force("F", body, (s.sensor("a"), sp.Piecewise((0, mb.t < 0.33), (s.sensor("b2"), True)), 0))
    r = s.simulate(1.0, accuracy=1e-9, solver=mb.DOP853(rtol=1e-10))
    np.testing.assert_allclose(sorted(set(calls["fast"])), 0.1 * np.arange(10), atol=1e-12)
    np.testing.assert_allclose(sorted(set(calls["slow"])), 0.25 * np.arange(4), atol=1e-12)
    held = 0.1 * np.arange(10)
    velocity, way = 0.0, 0.0
    for a in held:
        way, velocity = way + 0.1 * velocity + a * 0.005, velocity + 0.1 * a
    assert r["b"].position[-1, 0] == pytest.approx(way, abs=1e-10)
    assert r["b"].velocity[-1, 1] == pytest.approx(0.25 * (0.5 - 0.33) + 0.5 * 0.25 + 0.75 * 0.25, abs=1e-10)


def raising(t, angle, rate, memory):
    return (1 / 0 if t > 0.095 else 0.0), memory


@pytest.mark.parametrize(("f", "said"), [
    (raising, "raised ZeroDivisionError: division by zero"),
    (lambda t, a, w, m: (math.nan, m), "u = nan, but has to return finite numbers"),
    (lambda t, a, w, m: ((1.0, 2.0), m), "returned 2 outputs"),
    (lambda t, a, w, m: 1.0, "has to return (outputs, memory)"),
    (lambda t, a, w, m: ("x", m), "which is not a number for u"),
])
def test_controllers_that_fail_are_named_with_time_and_inputs(f, said):
    with pytest.raises(ControllerError, match="controller 'pid'") as failed:
        pendulum(f).simulate(1.0)
    assert said in str(failed.value)
    assert "J.angle = " in str(failed.value)
    assert set(failed.value.inputs) == {"J.angle", "J.rate"}
    assert failed.value.time == pytest.approx(0.1 if f is raising else 0.0)


def test_a_controller_that_is_not_pure_is_named():
    kept = []

    def counting(t, angle, rate, memory):
        kept.append(t)
        return 0.1 * len(kept), memory

    with pytest.raises(ControllerError, match="is not pure"):
        pendulum(counting).simulate(0.5)


def test_memory_that_is_changed_in_place_is_a_run_s_own():
    def adds(t, angle, rate, memory):
        memory[0] += 0.5 - angle
        return 3 * memory[0] - rate, memory

    memory = np.zeros(1)
    first = pendulum(adds, memory=memory).simulate(0.5)
    second = pendulum(adds, memory=memory).simulate(0.5)
    assert memory[0] == 0
    np.testing.assert_array_equal(first["u"], second["u"])


@pytest.mark.parametrize(("change", "said"), [
    ({"f": lambda t: 0.0}, "f cannot be called with (t, value 1, value 2, memory)"),
    ({"f": 3}, "is no function"),
    ({"every": 0}, "every = 0 s is not positive"), ({"memory": None}, "f cannot be called with (t, value 1, value 2)"),
    ({"sets": ()}, "sets names no output that can be used"),
    ({"reads": ("J.angel",)}, "did you mean 'J.angle'?"),
    ({"sets": ("u", "u")}, "give every name once"),
])
def test_statements_of_controllers_are_checked_before_solving(change, said):
    with pytest.raises(SceneError) as refused:
        pendulum(**{"f": pid, **change}).check()
    assert said in str(refused.value)


def test_analyses_that_know_no_instants_refuse():
    for analysis in (lambda s: s.equilibrium(), lambda s: s.linearize(), lambda s: s.floquet(1.0)):
        with pytest.raises(OptionError, match=r"controller 'pid' is a function called every 0\.01 s"):
            analysis(pendulum())


def test_results_with_controllers_are_stored(tmp_path):
    r = pendulum().simulate(0.3)
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz", laws=[pid])
    np.testing.assert_array_equal(again["u"], r["u"])


def test_comparisons_run_controllers():
    found = mb.compare(pendulum(), 0.2)
    assert not found.failures
    assert all(run.error < 1e-3 for run in found.runs)


@pytest.mark.parametrize("parts", [[1.0], [1.003], [0.5, 1.0, 1.507], "J.angle > 0.3"])
def test_a_continued_run_goes_on_with_what_a_controller_remembers(parts, tmp_path):
    """At its instants, also from files, and where an event ended the run between two of them."""
    whole, r = pendulum().simulate(2.0, accuracy=1e-9), None
    if isinstance(parts, str):
        r = pendulum().simulate(2.0, accuracy=1e-9, until=parts)
        assert r.t[-1] < 1
        parts = []
    for end in parts:
        r = pendulum().simulate(end, accuracy=1e-9, start=r)
        r.save(tmp_path / "run.npz")
        r = mb.load(tmp_path / "run.npz", laws=[pid])
    r = pendulum().simulate(2.0, accuracy=1e-9, start=r)
    assert r["J"].angle[-1] == pytest.approx(whole["J"].angle[-1], abs=1e-11)
    assert r["u"][-1] == pytest.approx(whole["u"][-1], abs=1e-9)


def test_other_controllers_begin_anew_in_a_continued_run():
    first = pendulum().simulate(1.003, accuracy=1e-9)
    other = pendulum(every=0.02).simulate(1.1, accuracy=1e-9, start=first, outputs=[1.003, 1.0035, 1.0229, 1.0231])
    u = other["u"]
    assert u[0] == u[1] == u[2] != u[3]
    assert u[0] == pytest.approx(pid(0.0, first["J"].angle[-1], first["J"].rate[-1], 0.0)[0], abs=1e-9)


def test_a_function_that_has_changed_is_named_where_a_run_goes_on():
    gains = [30.0]

    def f(t, angle, rate, memory):
        return gains[0] * (0.5 - angle) - 4 * rate, memory

    first = pendulum(f).simulate(0.5)
    gains[0] = 20.0
    with pytest.raises(ControllerError, match="when the steps were made"):
        pendulum(f).simulate(1.0, start=first)
