"""Periodic motions by shooting: Duffing's and van der Pol's equations against SciPy, mechanisms against long runs, refusals."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from scipy.special import ellipk

import mbdae as mb

G, W, LOAD, LOSS = 9.81, 1.2, 0.3, 0.1
T = 2 * np.pi / W


class Cubic(mb.Force):
    """A spring that stiffens: V = b x^4 / 4."""

    params = mb.params(b=("N/m^3", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.b * ((l.r - k.r) @ k.x) ** 4 / 4


class Pol(mb.Force):
    """Van der Pol's damper: mu (1 - x^2) x', x in m."""

    params = mb.params(mu=("N s/m", "growth"))

    def wrench(self, k: Any, l: Any) -> Any:
        x = (l.r - k.r) @ k.x
        return self.mu * (1 - x**2) * ((l.v - k.v) @ k.x) * k.x, 0 * k.x


def slider(law: Any, damper: float = 0.0, x: float = 0.0, load: Any = None, mu: float = 1.0) -> mb.Scene:
    """A mass of 1 kg on a line with a spring of 1 N/m and a law."""
    s = mb.Scene("slider")
    m = s.point_mass("m", 1.0, (x, 0))
    s.prismatic("J", s.ground, m, at=(x, 0), axis=(1, 0), damper=damper)
    s.spring("spring", s.ground, m, at_k=(0, 0), at_l=(x, 0), stiffness=1.0, length=0.0)
    s.add(law("law", s.ground, m, at=(0, 0), at_l=(x, 0), **({"b": 1.0} if law is Cubic else {"mu": mu})))
    if load is not None:
        s.force("load", m, (load, 0))
    return s


def begun_at(x: float, mu: float) -> mb.Scene:
    """Van der Pol's oscillator, drawn at rest and started at x (m)."""
    s = mb.Scene("oscillator")
    m = s.point_mass("m", 1.0, (0, 0))
    at, rate = s.sensor("J.displacement"), s.sensor("J.rate")
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0), position0=x, force=mu * (1 - at**2) * rate - at)
    return s


def duffing(damper: float = LOSS) -> mb.Scene:
    w = mb.number("w", W)
    return slider(Cubic, damper, load=LOAD * sp.cos(w * mb.t))


def end(f: Any, x: Any, period: float) -> Any:
    return solve_ivp(f, (0, period), x, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


@pytest.mark.parametrize("accuracy", [1e-4, 1e-7])
def test_duffing_against_shooting_by_scipy(accuracy: float) -> None:
    def rhs(t: float, y: Any) -> Any:
        return [y[1], -y[0] - y[0] ** 3 - LOSS * y[1] + LOAD * np.cos(W * t)]

    r = duffing().periodic(period=2 * sp.pi / mb.number("w", W), accuracy=accuracy)
    found = np.array([r["m"].position[0, 0], r["m"].velocity[0, 0]])
    exact = fsolve(lambda z: end(rhs, z, T) - z, found, xtol=1e-11)
    assert np.abs(found - exact).max() <= accuracy / 10
    assert r.accuracy.estimated <= accuracy
    assert (r.t[-1], r.period, r.period_error, r.stable) == (pytest.approx(T), pytest.approx(T, rel=1e-15), 0.0, True)
    steps = 1e-6 * np.eye(2)
    matrix = np.array([end(rhs, exact + e, T) - end(rhs, exact - e, T) for e in steps]).T / 2e-6
    assert np.sort_complex(r.multipliers) == pytest.approx(np.sort_complex(np.linalg.eigvals(matrix)), abs=1e-6)


def test_a_motion_that_takes_thousands_of_periods_to_settle() -> None:
    """Newton's method from rest, with a hundredth of a percent of damping: a run would take 5000 periods."""
    r = duffing(1e-3).periodic(T)
    before, after = r.states(r.t[[0, -1]])[0]
    assert np.abs(after - before).max() < 1e-6
    assert 0.99 < np.abs(r.multipliers).max() < 1.0
    assert r.stable


@pytest.mark.parametrize(("mu", "x"), [(1e-2, 1.0), (1e-3, 0.1), (1e-2, 0.01)])
def test_a_slowly_growing_motion_is_followed_to_its_limit_cycle(mu: float, x: float) -> None:
    """Corrections of a small motion lead to rest, from which it grows. Amplitude 2 and period 2 pi (1 + mu^2 / 16)."""
    r = begun_at(x, mu).periodic()
    assert r.peak("J.displacement").value == pytest.approx(2.0, abs=2e-5)
    assert r.period == pytest.approx(2 * np.pi * (1 + mu**2 / 16), abs=1e-8)
    assert r.stable


def test_a_motion_that_dies_out_is_refused() -> None:
    with pytest.raises(mb.SteadyError, match="rest"):
        begun_at(1.0, -1e-2).periodic()


@pytest.mark.parametrize("mu", [1.0])
def test_van_der_pol_with_its_period(mu: float) -> None:
    """From a start far outside the limit cycle."""
    r = slider(Pol, x=3.5).periodic()
    z = fsolve(lambda z: end(lambda t, y: [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]], [z[0], 0.0], z[1]) - [z[0], 0.0],
               [2.0, 6.66], xtol=1e-12)
    assert abs(r.period - z[1]) <= max(3 * r.period_error, 1e-9) <= 1e-8 * r.period * 3
    assert r.peak("m.position").value == pytest.approx(z[0], rel=1e-6)
    assert r.stable
    assert sorted(abs(r.multipliers - 1))[0] < 1e-6


@pytest.mark.parametrize("mu", [10.0, pytest.param(100.0, marks=pytest.mark.slow), pytest.param(1000.0, marks=pytest.mark.slow)])
def test_jumps_between_slow_parts(mu: float) -> None:
    """Relaxation oscillations, whose jumps last 1 / mu^2 of the period; SciPy's period is that between two highest points."""
    def turns(t: float, y: Any) -> Any:
        return y[1]

    turns.direction = -1  # type: ignore[attr-defined]
    run = solve_ivp(lambda t, y: [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]], (0, 3.6 * mu + 24), [2.0, 0.0], method="Radau",
                    jac=lambda t, y: [[0, 1], [-2 * mu * y[0] * y[1] - 1, mu * (1 - y[0] ** 2)]], rtol=1e-9, atol=1e-11,
                    events=turns)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)  # the accuracy of the motion is told where it is not met
        r = slider(Pol, x=2.0, mu=mu).periodic()
        assert r.stable
    assert r.period == pytest.approx(np.diff(run.t_events[0])[-1], rel=1e-7)
    assert r.period_error <= 1e-8 * r.period


def pendulum(damper: float = 0.0) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=damper)
    return s


def test_a_pendulum_is_one_of_a_family() -> None:
    """Without losses: the motion of the amplitude at the start, 4 K(sin 45 deg) sqrt(2 l / 3 g), and others are told of."""
    with pytest.warns(mb.AccuracyWarning, match="one of a family of periodic motions.* others, of other periods"):
        r = pendulum().periodic()
    assert r.family
    assert r.period == pytest.approx(4 * ellipk(0.5) * np.sqrt(2 / 3 / G), rel=1e-6)
    assert r.peak("hinge.angle").value == pytest.approx(np.pi, rel=1e-6)


def test_a_stated_period_chooses_one_of_a_family() -> None:
    with pytest.warns(mb.AccuracyWarning, match="one of a family"):
        r = pendulum().periodic(2.0)
    assert (r.period, r.period_error) == (2.0, 0.0)
    amplitude = np.ptp(r["hinge"].angle) / 2
    assert 4 * ellipk(np.sin(amplitude / 2) ** 2) * np.sqrt(2 / 3 / G) == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-2])
def test_a_stated_period_of_a_motion_without_drives_may_be_off(off: float) -> None:
    """The period is that of the motion, and stability does not hang on the last digit of the one stated."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        r = slider(Pol, x=2.0).periodic(6.663286859323 * (1 + off))
    assert r.period == pytest.approx(6.663286859323, rel=1e-8)
    assert r.stable
    assert [str(w.message)[:44] for w in told] == ["the scene has no drive and repeats by itself"] * (off > 1e-6)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
def test_light_damping_at_resonance_is_no_family_at_low_accuracy(accuracy: float) -> None:
    """Departures of one mass fall by 6e-5 in a period, less than the steps are off, those of the other by all."""
    s = mb.Scene("two masses")
    for name, y, load, loss in (("light", 0.0, 1e-5, 2e-5), ("heavy", 1.0, 1.0, 1.0)):
        m = s.point_mass(name, 1.0, (0, y))
        s.prismatic(f"{name} line", s.ground, m, at=(0, y), axis=(1, 0))
        x, v = s.sensor(f"{name} line.displacement"), s.sensor(f"{name} line.rate")
        s.force(f"{name} load", m, (-x - loss * v + load * sp.cos(mb.t), 0))
    with warnings.catch_warnings():
        warnings.simplefilter("error", mb.AccuracyWarning)
        r = s.periodic(2 * np.pi, accuracy)
    assert not r.family
    assert r.peak("light line.displacement").value == pytest.approx(0.5, abs=2 * accuracy)


def oscillator(size: float, begin: float, mu: float = 0.05) -> mb.Scene:
    """Van der Pol's, of 1 kg and 1 N/m, whose motion is `size` (m) large in a scene of 1 m, started at that part of it."""
    s = mb.Scene("small oscillator")
    m = s.point_mass("m", 1.0, (0, 0))
    at, rate = s.sensor("J.displacement"), s.sensor("J.rate")
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0), position0=begin * size, rate0=0.1 * begin * size,
                force=mu * (1 - (at / size) ** 2) * rate - at)
    return s


@pytest.mark.parametrize(("size", "begin", "mu", "period"), [(1e-2, 0.01, 0.05, 6.284166991), (1e-3, 0.01, 0.05, 6.284166991),
                                                              (1e-3, 1.0, 30.0, 50.54368646)])
def test_the_period_is_the_smallest_one_however_small_the_motion(size: float, begin: float, mu: float, period: float) -> None:
    """Periods of SciPy's Radau on the equation in its size; of three, sixteen and three of them the motion repeats too."""
    r = oscillator(size, begin, mu).periodic()
    assert r.period == pytest.approx(period, rel=1e-8)
    assert r.stable
    assert len(r.multipliers) == 2


def test_small_swings_have_the_smallest_period() -> None:
    s = mb.Scene("hanging", gravity=(0, -G, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (0, -1), mass=1.0), at=(0, 0), angle0=1e-4)
    with pytest.warns(mb.AccuracyWarning, match="one of a family"):
        r = s.periodic()
    assert r.period == pytest.approx(2 * np.pi * np.sqrt(2 / 3 / G), rel=1e-7)


@pytest.mark.parametrize(("loss", "accuracy", "x"), [(1e-8, 1e-6, 30.0), (1e-6, 1e-8, 0.0)])
def test_errors_near_a_resonance_contain_the_rounding_that_it_amplifies(loss: float, accuracy: float, x: float) -> None:
    s = mb.Scene("resonance")
    m = s.point_mass("m", 1.0, (0, 0))
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0), spring=1.0, damper=2 * loss, force=2 * loss * sp.sin(mb.t),
                position0=x)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = s.periodic(2 * np.pi, accuracy)
    assert not r.family
    assert np.max(np.abs(r["J"].displacement + np.cos(r.t))) < 3 * r.accuracy.estimated
    assert np.max(np.abs(r.value("J.force[0]") - np.cos(r.t))) < 3 * r.error("J.force[0]")


def test_where_every_motion_repeats_the_one_found_is_one_of_a_family() -> None:
    """Without losses, after two periods of a load at 1.5 times the natural frequency."""
    s = mb.Scene("all repeat")
    m = s.point_mass("m", 1.0, (0, 0))
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0), spring=1.0, force=sp.sin(1.5 * mb.t), position0=5.0)
    with pytest.warns(mb.AccuracyWarning, match="others lie beside it"):
        assert s.periodic(4 * np.pi).family


def test_a_swung_beam_with_material_damping_repeats() -> None:
    """Its stresses at the start are those of the motion that was found, not of the start of the scene."""
    s = mb.Scene("swing", gravity=(0, -G, 0))
    steel = mb.Section.rectangular(0.02, 0.01, E=210e9, nu=0.3, rho=7850.0, damping=1e-4)
    s.revolute("A", s.ground, s.beam("rod", (0, 0), (1, 0), section=steel, elements=1), at=(0, 0), angle=0.3 * sp.sin(3 * mb.t))
    r = s.periodic(2 * np.pi / 3, accuracy=1e-4, of=["A.torque"])
    assert r.stable
    assert r["A"].torque[-1] == pytest.approx(r["A"].torque[0], abs=2 * r.error("A.torque"))


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-6])
def test_errors_contain_that_of_the_start_that_was_found(accuracy: float) -> None:
    """At the start of the period the run and its companions agree; the motion is off there too."""
    def f(t: float, z: Any) -> list[float]:
        return [z[1], LOAD * np.cos(W * t) - z[0] - z[0] ** 3 - LOSS * z[1]]

    r = duffing().periodic(T, accuracy)
    x = fsolve(lambda z: end(f, z, T) - z, [r["J"].displacement[0], r["J"].rate[0]], xtol=1e-13)
    for sensor, true in (("m.acceleration", f(0.0, x)[1]), ("spring.force", x[0]), ("J.displacement", x[0])):
        off = abs(abs(r(r.t[:1]).value(sensor).ravel()[0]) - abs(true))
        peak = r.peak(sensor, t=(0.0, 1e-6)).error
        assert peak is not None
        assert off <= 3 * peak + 1e-14, sensor
        assert peak <= accuracy, sensor


def test_stability_is_read_of_a_motion_of_low_accuracy() -> None:
    assert slider(Pol, x=2.0).periodic(6.6633, accuracy=1e-2).stable


@pytest.mark.parametrize("scene", [slider(Cubic), slider(Cubic, 0.1, x=1.0), pendulum(0.3)])
def test_rest_is_no_periodic_motion(scene: mb.Scene) -> None:
    """At rest, and coming to rest."""
    with pytest.raises(mb.SteadyError, match="rest, which has no period"):
        scene.periodic()


def test_a_drawing_far_smaller_than_the_motion_is_told() -> None:
    with pytest.raises(mb.SteadyError, match="times the largest distance in the drawing"):
        slider(Pol, x=1e-9).periodic()


def four_bar() -> mb.Scene:
    """A loop that a motor turns through a soft coupling."""
    s = mb.Scene("four-bar", gravity=(0, -G, 0))
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
    motor = s.rigid_body("motor", 1.0, 0.05, at=A)
    s.revolute("M", s.ground, motor, at=A, angle=4 * np.pi * mb.t)
    s.revolute("A", motor, crank, at=A, spring=300.0, damper=1.0)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C)
    s.revolute("D", s.ground, rocker, at=D)
    return s


def test_a_driven_loop_against_a_run_that_has_settled() -> None:
    """Whole turns are a return; the multipliers are below 1e-2, so that the fifth turn is the periodic one."""
    r, long = four_bar().periodic(0.5, of=["B.force"]), four_bar().simulate(2.5, accuracy=1e-7)
    last = long(np.linspace(2.0, 2.5, 201))
    assert r(np.linspace(0, 0.5, 201))["B"].force == pytest.approx(last["B"].force, abs=1e-5 * np.abs(last["B"].force).max())
    assert r.accuracy.of["B.force"] <= 1e-6
    assert r.peak("B.force").value == pytest.approx(long.peak("B.force", t=(2.0, 2.5)).value, rel=1e-5)


def test_a_mechanism_whose_motion_is_all_prescribed_repeats() -> None:
    s = mb.Scene("crank", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("crank", (0, 0), (0.1, 0), mass=1.0), at=(0, 0), angle=10 * mb.t)
    r = s.periodic(0.2 * np.pi)
    assert not r.family
    assert r.peak("A.drive").value == pytest.approx(0.05 * G, rel=1e-6)


def test_a_flexible_rod_without_the_shock_of_its_start() -> None:
    """3000 1/min, material damping: the first turns of a run from an unstrained rod have twice the force."""
    steel = mb.Section.rectangular(0.012, 0.02, E=210e9, nu=0.3, rho=7850.0, damping=1e-6)
    R, L = 0.045, 0.17
    s = mb.Scene("engine", gravity=(0, -G, 0))
    crank, rod = s.link("crank", (0, 0), (R, 0), mass=1.5), s.beam("rod", (R, 0), (R + L, 0), section=steel, elements=2)
    ram = s.rigid_body("ram", 0.6, 1e-3, at=(R + L, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=100 * np.pi * mb.t)
    s.revolute("B", crank, rod, at=(R, 0))
    s.revolute("C", rod, ram, at=(R + L, 0))
    s.prismatic("D", s.ground, ram, at=(R + L, 0), axis=(1, 0, 0))
    found = s.periodic(0.02, accuracy=1e-3, of=["B.force"])
    steady = found.peak("B.force")
    assert not found.family  # its stiff vibrations are damped
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shock = s.simulate(0.02, accuracy=1e-3, of=["B.force"]).peak("B.force")
    assert shock.value > 1.8 * steady.value
    assert steady.value == pytest.approx(4982.0, rel=5e-4)  # that of the tenth turn of a run, and of a relaxed start


@pytest.mark.slow
def test_a_loose_pin_in_lasting_contact_against_a_run_that_has_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slider-crank of the example, with play at the crank pin, of which every turn is a contact that does not end."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    example, accuracy, turns = importlib.import_module("slider_crank_clearance"), 1e-4, 8
    s, period = example.scene("B"), example.t_end
    r = s.periodic(period, accuracy, start=s.simulate(3 * period, accuracy))
    long = s.simulate(turns * period, accuracy / 10)
    t = np.linspace(0, period, 101)
    last = long(np.minimum((turns - 1) * period + t, turns * period))
    off = np.abs(r(np.minimum(r.t[0] + t, r.t[-1]))["slider"].position - last["slider"].position)
    assert off.max() <= 10 * accuracy * 0.17
    assert r.stable
    assert not r.family


@pytest.mark.parametrize(("options", "words"), [
    ({"period": 3.0}, "do not repeat after period = 3 s"), ({}, "'load' depends on it; give the period"),
    ({"period": -1}, "not positive"), ({"period": "x"}, "not a number"), ({"period": T, "start": 3}, "start = 3 is no state"),
    ({"accuracy": 1}, "accuracy = 1"), ({"period": T, "of": ["J.forces"]}, "no sensor"),
])
def test_what_cannot_be_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(mb.MbdaeError, match=words):
        duffing().periodic(**options)


def test_what_never_returns_is_refused() -> None:
    s = mb.Scene("fall", gravity=(0, -G, 0))
    s.point_mass("stone", 1.0, (0, 0))
    with pytest.raises(mb.SteadyError, match="does not come near to a state in which it was before"):
        s.periodic()
