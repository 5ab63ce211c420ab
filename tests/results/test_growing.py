"""Motions that leave an unstable rest: their growth is followed, its amount told, and needless words are not said."""

from __future__ import annotations

import warnings
from math import log, sqrt
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.inputs.resolution import Bound
from mbdae.integrators.base import Asked
from mbdae.run import amplification, control, growing

G = 9.81
RATE = sqrt(1.5 * G)  #: 1/s, of an upright rod of 1 m


def rod(off: float, wheel: bool = False, **options: Any) -> Any:
    """An upright rod 1 m long, `off` rad off; wheel: with one that spins beside, so that the characteristic time is short."""
    s = mb.Scene("rod", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (0, 1), mass=1.0), at=(0, 0), angle0=off, **options)
    if wheel:
        s.revolute("axle", s.ground, s.rigid_body("wheel", 1.0, 0.1, at=(3, 0)), at=(3, 0), rate0=5.0)
    return s


def fallen(off: float, times: Any) -> Any:
    return solve_ivp(lambda t, y: [y[1], 1.5 * G * np.sin(y[0])], (0, times[-1]), [off, 0], method="DOP853", rtol=3e-14,
                     atol=1e-20, t_eval=times).y[0]


@pytest.mark.parametrize("options", [
    {}, {"solver": mb.RadauIIA(3), "form": mb.GGL()}, {"solver": mb.RadauIIA(5)}, {"solver": mb.IDA()},
    {"solver": mb.CVODE(method="BDF")}, {"solver": mb.HHT()},
], ids=lambda o: str(next(iter(o.values()), "default"))[:12])
@pytest.mark.parametrize("wheel", [False, True])
def test_a_rod_that_seems_to_stand_falls(options: dict[str, Any], wheel: bool) -> None:
    off = 1e-10
    times = np.linspace(0, log(6 / off) / RATE, 61)
    r = rod(off, wheel, model=mb.Kinematic()).simulate(times[-1], accuracy=1e-3, outputs=times, **options)
    assert np.max(np.abs(r["hinge"].angle - fallen(off, times))) < 3e-3 or r.warnings


def test_without_bounds_the_rod_stands_and_both_runs_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the bounds are for: two runs that take the growth for decay agree, and nothing is told."""
    monkeypatch.setattr(control, "growing", lambda *_: [])
    off = 1e-12
    r = rod(off, model=mb.Kinematic()).simulate(8.28, accuracy=1e-3, solver=mb.RadauIIA(3), form=mb.GGL())
    assert abs(r["hinge"].angle[-1]) < 1e-6
    assert r.accuracy.estimated < 1e-3
    assert fallen(off, np.array([0, 8.28]))[-1] > 5


@pytest.mark.parametrize(("solver", "stiffness"), [(None, -1e10), (mb.RadauIIA(3), -1e10), (mb.RadauIIA(3), -1e13)])
def test_growth_far_within_one_step_is_told(solver: Any, stiffness: float) -> None:
    """A rod at rest on a spring of negative stiffness: gravity moves it, and that grows at 2e5 and 5e6 1/s, where steps are .1 s;
    a method that takes growth for decay leaves it where it is."""
    s = mb.Scene("driven away", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), spring=stiffness)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = s.simulate(1e5 / sqrt(-3 * stiffness), solver=solver)
    assert r.accuracy.estimated > 1e-3


def test_growth_is_that_of_the_equations() -> None:
    """The logarithm of the largest factor: of an upright rod RATE t, of a swing about the lowest point 0, of Mathieu's equation
    that of its Floquet multiplier, which no frozen equation shows."""
    T = 3.0
    assert rod(1e-9).simulate(T).accuracy.amplification == pytest.approx(RATE * T - log(2), abs=0.8)
    hanging = rod(np.pi - 0.5).simulate(T)
    assert hanging.accuracy.amplification < 0.5
    s = mb.Scene("Mathieu")
    x = s.sensor("guide.displacement")
    s.prismatic("guide", s.ground, s.rigid_body("mass", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), position0=1e-6,
                force=-(1 + 0.4 * sp.cos(2 * mb.t)) * x)
    found, period = s.simulate(20 * np.pi).accuracy.amplification, np.pi
    turned = solve_ivp(lambda t, y: np.r_[y[2:], -(1 + 0.4 * np.cos(2 * t)) * y[:2]], (0, period), [1, 0, 0, 1], rtol=1e-11,
                       atol=1e-12)
    multiplier = np.max(np.abs(np.linalg.eigvals(turned.y[:, -1].reshape(2, 2))))
    assert found == pytest.approx(20 * log(multiplier), abs=0.5)


def test_turning_over_the_top_is_no_growth() -> None:
    """The roots of frozen equations add up to e^30 or more, disturbances grow in proportion to time: nothing is said."""
    r = rod(0.0, rate0=20.0).simulate(20.0, accuracy=1e-8)
    assert growing.total(growing.growing(r.solution.systems[0][1], r.solution, closely=True)) > 15
    assert r.warnings == ()
    assert r.accuracy.amplification < 8


def driven_chain(points: int) -> Any:
    """Three rods, of which a torque whirls the first: a table of points 0.15 s apart."""
    s = mb.Scene("chain")
    before = s.ground
    load = mb.table((0.15 * np.arange(points)).tolist(), (3 * np.sin(np.arange(points))).tolist())
    for i in range(3):
        rod = s.link(f"rod {i}", (i, 0), (i + 1, 0), mass=1.0)
        s.revolute(f"J{i}", before, rod, at=(i, 0), damper=0.05, torque=load if i == 0 else None)
        before = rod
    return s


def test_the_judgement_takes_no_more_pieces_than_the_runs_have_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """And finds the growth of the finest pieces within the tenths that are promised."""
    taken, along = list[int](), amplification.Disturbances._along
    monkeypatch.setattr(amplification.Disturbances, "_along",
                        lambda self, ends, enough: (taken.append(len(ends)), along(self, ends, enough))[1])
    r = driven_chain(200).simulate(75.0, accuracy=1e-8)
    assert 0 < sum(taken) < r.info.stats.steps
    coarse = r.accuracy.amplification
    monkeypatch.setattr(amplification, "TOGETHER", (1,))
    finest = amplification.Disturbances(r.solution.systems[0][1], r.solution).growth()
    assert finest is not None
    assert coarse == pytest.approx(finest[0], abs=0.5)


def test_round_off_that_decides_is_told() -> None:
    with pytest.warns(mb.AccuracyWarning, match="small disturbances grow by a factor of e"):
        r = rod(1e-13).simulate(8.5, accuracy=1e-6, solver=mb.DOP853())
    assert r.accuracy.amplification > 25


def test_constant_steps_that_do_not_follow_growth_are_told() -> None:
    off, kinematic = 1e-9, {"model": mb.Kinematic()}
    with pytest.warns(mb.AccuracyWarning, match="do not follow"):
        rod(off, **kinematic).simulate(5.0, solver=mb.RadauIIA(3, step=1.0))
    assert rod(off, **kinematic).simulate(5.0, solver=mb.RadauIIA(3, step=0.05)).warnings == ()


@pytest.mark.parametrize("solver", [None, mb.RadauIIA(3), mb.IDA()])
def test_a_body_that_turns_faster_and_faster_is_left_alone(solver: Any) -> None:
    """Under a constant torque, and as a ball that rolls down a plane, frozen roots are positive, while disturbances grow as a
    power of the time: 3388 and 10 443 steps were taken for them, and words said."""
    free = mb.Scene("free")
    free.torque("torque", free.rigid_body("b", 1.0, (0.004, 0.004, 0.004), at=(0, 0, 0)), (0, 0.05, 0))
    rolling = mb.Scene("ball", gravity=(1.0, 0, -9.81))
    ball = rolling.rigid_body("b", 1.0, (0.004, 0.004, 0.004), at=(0, 0, 0.1))
    rolling.rolling("rolls", rolling.ground, ball, at=(0, 0, 0.1), radius=0.1)
    for s in (free, rolling):
        r = s.simulate(5.0, 1e-3, solver=solver)
        assert not r.warnings
        assert r.stats.steps < 1500  # of BDF 900
    assert r["b"].position[-1, 0] == pytest.approx(5.0**2 / 2.8, rel=1e-3)


def test_a_tolerance_of_ones_own_follows_growth_too() -> None:
    off = 1e-10
    times = np.linspace(0, 6.5, 14)
    r = rod(off, model=mb.Kinematic()).simulate(6.5, outputs=times, solver=mb.RadauIIA(3, rtol=1e-3), form=mb.GGL())
    np.testing.assert_allclose(r["hinge"].angle, fallen(off, times), atol=0.05)


@pytest.mark.parametrize("solver", [mb.RadauIIA(3, rtol=1e-3), mb.RadauIIA(2, step=0.5)])
def test_own_equations_follow_growth_too(solver: Any) -> None:
    """By a tolerance of their own they do, to 3e-4 rad; constant steps that do not are told."""
    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[:] = yp[0] - y[1], yp[1] - 1.5 * G * np.sin(y[0])

    off, times = 1e-10, np.linspace(0, 6.5, 14)
    r = mb.DAE(residual, [off, 0.0], [0.0, 1.5 * G * off]).simulate(6.5, outputs=times, solver=solver)
    if solver.fixed:
        assert "steps do not follow" in " ".join(r.warnings)
    else:
        np.testing.assert_allclose(r.solution(times)[:, 0], fallen(off, times), atol=3e-3)
        assert r.accuracy.amplification == pytest.approx(RATE * 6.5 - 2, abs=1.5)


def logistic(off: float) -> mb.DAE:
    """y' = y (1 - y) from a small start."""
    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[0] = yp[0] - y[0] * (1 - y[0])

    def rates(t: float, y: Any, out: Any) -> None:
        out[0] = y[0] * (1 - y[0])

    return mb.DAE(residual, [off], [off], rhs=rates)


def grown(off: float, times: Any) -> Any:
    return 1 / (1 + (1 / off - 1) * np.exp(-times))


@pytest.mark.parametrize(("solver", "off", "end", "accuracy"), [
    (mb.IDA(), 3.83e-8, 25.1, 1e-5), (mb.IDA(), 1e-12, 40.0, 1e-4), (mb.CVODE(), 1e-8, 30.0, 1e-4),
    (mb.CVODE(method="BDF"), 1e-8, 30.0, 1e-4), (mb.RadauIIA(3), 1e-8, 30.0, 1e-4), (mb.DOP853(), 1e-8, 30.0, 1e-4),
], ids=lambda x: str(x)[:12])
def test_what_begins_at_order_one_follows_growth_too(solver: Any, off: float, end: float, accuracy: float) -> None:
    """Errors of the first steps stay in what grows. IDA and CVODE were silently 3 to 22 times the accuracy off."""
    times = np.linspace(0, end, 101)
    r = logistic(off).simulate(end, accuracy=accuracy, solver=solver, outputs=times)
    assert not r.warnings
    assert np.max(np.abs(r.solution(times)[:, 0] - grown(off, times))) < accuracy / 2


@pytest.mark.parametrize("solver", [mb.RadauIIA(3), mb.IDA(), mb.CVODE()], ids=str)
def test_growth_at_a_rate_that_varies_is_followed(solver: Any) -> None:
    """Roots that are others a little later are believed where disturbances carried along the run grow: with RadauIIA(3) the error
    was 2.9 times the accuracy."""
    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[0] = yp[0] - (1 + 0.85 * np.sin(3.5 * t)) * y[0] * (1 - y[0])

    def rates(t: float, y: Any, out: Any) -> None:
        out[0] = (1 + 0.85 * np.sin(3.5 * t)) * y[0] * (1 - y[0])

    off, accuracy, times = 7e-9, 1e-6, np.linspace(0, 21.7, 101)
    r = mb.DAE(residual, [off], [off], rhs=rates).simulate(times[-1], accuracy=accuracy, solver=solver, outputs=times)
    longer = times + 0.85 / 3.5 * (1 - np.cos(3.5 * times))
    assert np.max(np.abs(r.solution(times)[:, 0] - grown(off, longer))) < accuracy / 2
    assert any(part.unseen for part in growing.growing(r.solution.systems[0][1], r.solution))


@pytest.mark.parametrize(("solver", "error"), [(mb.IDA(rtol=1e-9), 1e-4), (mb.CVODE(rtol=1e-9), 1e-6),
                                               (mb.CVODE(rtol=1e-9, method="BDF"), 1e-3)], ids=lambda x: str(x)[:12])
def test_steps_held_by_growth_have_a_high_order(solver: Any, error: float) -> None:
    """Although the error test sees nothing, and would take the order that lets the step grow most: with that the error of what
    grows was 9e-3 (Adams) and 4e-1 (BDF) of it. Steps that a bound holds are equal to the last digit: the BDF of IDA need that
    for a higher order."""
    off, end = 1e-10, 12.0
    run = solver.run(logistic(off), Asked(end, bounds=(Bound(0.0, end, 0.1, True),)))
    assert np.max(np.abs(run.y[:, 0] / grown(off, run.t) - 1)) < error
    assert np.ptp(np.diff(run.t)[len(run.t) // 2 : -2]) < 1e-14 * end


@pytest.mark.parametrize("off", [1e-8, np.pi - 1e-8])
def test_a_slow_start_is_not_stiff(off: float) -> None:
    """Near a rest the characteristic time at the start is long, and a decay is quick beside it only because it is a growth
    reversed in time, or an oscillation in few periods."""
    assert rod(off).simulate(4.0, accuracy=1e-4).info.solver.label == "DOP853"


def test_growth_of_beams_and_large_chains_is_seen() -> None:
    """The test without all roots: an upright chain of 40 rods has growth, the same chain hanging has none."""
    for sign, grows in ((1, True), (-1, False)):
        s, below = mb.Scene("chain", gravity=(0, -G, 0)), None
        for j in range(40):
            body = s.link(f"rod {j}", (0, sign * 0.1 * j), (0, sign * 0.1 * (j + 1)), mass=0.1)
            s.revolute(f"J{j}", s.ground if below is None else below, body, at=(0, sign * 0.1 * j),
                       angle0=1e-9 if j == 0 else None)
            below = body
        r = s.simulate(0.05, accuracy=1e-3)
        system = r.solution.systems[0][1]
        found = growing.growing(system, r.solution)
        assert system.n > amplification.SMALL
        assert (growing.total(found) > 0.1) == grows


def window(off: float, width: float, middle: float, shape: str, clock: bool = False) -> mb.DAE:
    """y' = g(t) y with growth from `off` to 1 in a window alone; clock: g is a function of an unknown that moves as the time
    does, so that the equations themselves do not depend on the time."""
    height = np.log(1 / off) / width

    def rate(t: float) -> float:
        u = (t - middle) / width
        if shape == "bell":
            return float(height / np.sqrt(np.pi) * np.exp(-min(u**2, 100.0)))
        return float(height / 2 * (1 + np.cos(np.pi * u))) if abs(u) < 1 else 0.0

    def rates(t: float, y: Any, out: Any) -> None:
        out[:] = rate(y[1] if clock else t) * y[0], 1.0

    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        rates(t, y, out)
        out[:] = yp - out

    return mb.DAE(residual, [off, 0.0], [rate(0.0) * off, 1.0], rhs=rates)


SOLVERS = (None, mb.RadauIIA(3), mb.RadauIIA(5), mb.IDA(), mb.CVODE(), mb.CVODE(method="BDF"))


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda x: str(x)[:12])
@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.slow), pytest.param(4, marks=pytest.mark.slow)])
def test_growth_in_a_window_is_not_passed_over(solver: Any, seed: int) -> None:
    """Steps pass over a window in which something far below the tolerance grows: IDA, CVODE and Radau IIA left it at its start,
    without a word."""
    draw = np.random.default_rng([seed, SOLVERS.index(solver)])
    width, off = 10 ** draw.uniform(np.log10(0.02), 0), 10 ** draw.uniform(-11.7, -7)
    middle, accuracy = draw.uniform(3 * width, 10 - 3 * width), 10 ** draw.uniform(-4, -2)
    dae = window(off, width, middle, "bell" if draw.random() < 0.5 else "arch", bool(draw.random() < 0.5))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = dae.simulate(10.0, accuracy=accuracy, solver=solver)
    assert abs(r["y[0]"][-1] - 1) < (3 * accuracy if not r.warnings else 0.1)
    assert r.accuracy.amplification == pytest.approx(np.log(1 / off), abs=1)


def test_constant_steps_that_pass_over_growth_in_a_window_are_told() -> None:
    r = window(1e-9, 0.1, 6.0, "bell").simulate(10.0, solver=mb.RadauIIA(2, step=0.05))
    assert "steps do not follow" in " ".join(r.warnings)


def test_switches_show_windows_that_are_shorter_than_the_times_looked_at() -> None:
    """Growth for 1/2500 of the run: the steps that declared switches shorten are looked at too."""
    off, width, middle = 1e-10, 0.002, 6.0123
    dae = window(off, width, middle, "bell")
    dae.switches = mb.Switches(lambda t, y: np.column_stack([-(((t - middle) / width) ** 2)]), ("decaying",), np.ones(1), ("g",))
    for solver in (mb.IDA(), mb.RadauIIA(3)):
        assert dae.simulate(10.0, accuracy=1e-2, solver=solver)["y[0]"][-1] == pytest.approx(1, abs=0.03)


def test_equations_that_do_not_grow_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """No roots are sought inside the steps, and the equations are evaluated at few times more: none in scenes, whose inputs bound
    the steps."""
    def unknown(*_: Any) -> Any:
        raise AssertionError("roots are sought")

    monkeypatch.setattr(growing, "rates_at", unknown)
    probed: list[int] = []
    suspects = growing.suspects
    monkeypatch.setattr(growing, "suspects", lambda system, run: (probed.append(system.n), suspects(system, run))[1])
    rod(0.5).simulate(1.0, accuracy=1e-4)
    assert not probed
    dae = mb.DAE(lambda t, y, yp, out: yp + y, [1.0], [-1.0])
    assert not dae.simulate(5.0, accuracy=1e-4).warnings
    assert probed == [1]


def test_a_run_repeated_for_growth_goes_on_from_the_one_before() -> None:
    """A nut that turns over: its first run keeps the bounds of a companion, and is that of the second, as accurate, one."""
    def nut() -> mb.Scene:
        s = mb.Scene("nut")
        s.rigid_body("nut", 0.2, (1.0e-4, 2.5e-4, 3.3e-4), at=(0, 0, 0), angular_velocity=(0.0, 6.0, 0.03))
        return s

    r, exact = nut().simulate(6.0, accuracy=1e-6), nut().simulate(6.0, accuracy=1e-10)
    assert r.info.runs == 3
    apart = float(np.max(np.abs(r["nut"].rotation - exact["nut"].rotation)))
    assert apart <= 3 * r.accuracy.motion <= 3e-6
