"""Runs under inputs of time: nothing is stepped over, whatever the solver; against closed forms and SciPy split at the breaks."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from oracles.runs import between_breaks

import mbdae as mb

t = mb.t


class Spring(mb.Force):
    """Linear along k.x, with a stiffness that may depend on time."""

    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k, l):
        return self.stiffness * ((l.r - k.r) @ k.x) ** 2 / 2


ALL = [None, mb.RadauIIA(2), mb.RadauIIA(3), mb.IDA(), mb.CVODE(), mb.CVODE(method="BDF"), mb.HHT(), mb.GeneralizedAlpha(),
       mb.RadauIIA(3, step=0.5), mb.HHT(step=0.5)]


def slider(force: object, **options: object) -> mb.Scene:
    """1 kg on a rail along x."""
    s = mb.Scene("slider")
    body = s.rigid_body("m", 1.0, 1.0, at=(0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0), axis=(1, 0, 0), **options)
    s.force("F", body, (force, 0, 0))
    return s


@pytest.mark.parametrize("solver", ALL)
@pytest.mark.parametrize("width", [1e-5, 0.3])
def test_a_box_on_a_body_at_rest(solver: object, width: float) -> None:
    """Impulse 1 N s: x(10) = 10 - a - width/2 whatever the width; every method integrates a constant force exactly."""
    box = sp.Piecewise((1 / sp.Float(width), (t > 3.3) & (t < 3.3 + width)), (0, True))
    r = slider(box).simulate(10.0, accuracy=1e-4, solver=solver)
    assert abs(r["m"].position[-1, 0] - (10 - 3.3 - width / 2)) < 3e-4
    assert abs(r["m"].velocity[-1, 0] - 1) < 3e-4
    assert not r.warnings
    assert np.max(np.abs(r.energy.balance)) < 1e-3


@pytest.mark.parametrize("solver", ALL[:8])
@pytest.mark.parametrize("width", [1e-4, 0.05])
def test_a_bell_on_an_oscillator(solver: object, width: float) -> None:
    """A narrow bell of impulse sqrt(pi) J at t = 5: x = J/w sin(w (t - 5)) exp(-(w width)^2/4), exact behind it."""
    rate, impulse = 2.0, 0.5
    bell = impulse / (sp.Float(width) * sp.sqrt(sp.pi)) * sp.exp(-(((t - 5) / width) ** 2))
    accuracy = 1e-3 if isinstance(solver, mb.HHT | mb.GeneralizedAlpha) else 1e-5
    r = slider(bell, spring=rate**2).simulate(7.0, accuracy=accuracy, solver=solver)
    exact = impulse / rate * np.sin(rate * 2) * np.exp(-((rate * width) ** 2) / 4)
    assert abs(r["m"].position[-1, 0] - exact) < 3 * accuracy
    assert not r.warnings


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()])
@pytest.mark.parametrize("form", [None, mb.GGL(), mb.Index3(), mb.Index1()])
def test_a_prescribed_bump(model: object, form: object) -> None:
    """A (1 - cos) bump of 10 ms in a prescribed angle: the body follows, and the reaction jumps with the acceleration."""
    if isinstance(model, mb.Recursive):
        form = None
    w = 0.01
    bump = sp.Piecewise((0, t < 5), (0.05 * (1 - sp.cos(2 * sp.pi * (t - 5) / w)), t < 5 + w), (0, True))
    s = mb.Scene("driven")
    arm, tip = s.link("arm", (0, 0), (1, 0), mass=1.0), s.link("tip", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, arm, at=(0, 0), angle=bump, model=model)
    s.revolute("B", arm, tip, at=(1, 0), angle=0.1 * t)
    r = s.simulate(6.0, accuracy=1e-6, form=form, outputs=np.r_[np.linspace(0, 6, 11), 5 + w / 2, 6.0][np.argsort(
        np.r_[np.linspace(0, 6, 11), 5 + w / 2, 6.0])][:-1])
    peak = int(np.argmin(np.abs(r.t - 5 - w / 2)))
    assert abs(r["A"].angle[peak] - 0.1) < 3e-6
    assert abs(r["A"].angle[-1]) < 3e-6
    before, after = (r(5.0 + side * 1e-9)["A"].torque[0, 2] for side in (-1, 1))
    jump = 0.05 * (2 * np.pi / w) ** 2  # rad/s^2
    assert after - before > 1.0 * jump  # two rods, stretched: inertia about A above 1 kg m^2


def test_a_sawtooth_and_a_chirp_against_scipy() -> None:
    """A pendulum driven by Mod and by a chirp; SciPy stops at every tooth."""
    period, end = 0.37, 3.0
    torque = 3 * sp.Mod(t, period) + sp.sin(4 * t**2)
    s = mb.Scene("driven pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), torque=torque)
    r = s.simulate(end, accuracy=1e-7)

    def rates(at: float, y: np.ndarray, inside: float) -> list[float]:
        return [y[1], 3 * (3 * (at - inside // period * period) + np.sin(4 * at**2) - 9.81 / 2 * np.cos(y[0]))]

    angle = between_breaks(rates, [0.0, 0.0], [*np.arange(9) * period, end])[-1, 0]
    assert abs(r["A"].angle[-1] - angle) < 3e-7
    assert not r.warnings


def test_a_stiffness_that_jumps() -> None:
    """A user's law with a parameter of time: x'' = -k x with k = 4, then 25 from t = 1 on."""
    s = mb.Scene("parametric")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0.1, 0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0))
    s.add(Spring("k", s.ground, body, at=(0, 0, 0), at_l=(0.1, 0, 0), stiffness=sp.Piecewise((4, t < 1), (25, True))))
    r = s.simulate(2.0, accuracy=1e-8)
    x, v = 0.1 * np.cos(2), -0.2 * np.sin(2)
    exact = x * np.cos(5) + v / 5 * np.sin(5)
    assert abs(r["m"].position[-1, 0] - exact) < 3e-8


def test_a_load_along_a_beam() -> None:
    """A short transverse load per length on a free beam: momentum of its centre of mass is the impulse."""
    s = mb.Scene("free beam")
    beam = s.beam("b", (0, 0), (1, 0), section=mb.Section.circular(0.01, 2e11, 0.3, 7800), elements=2)
    width = 1e-3
    beam.load((0, sp.Piecewise((2.0, (t > 0.4) & (t < 0.4 + width)), (0, True))))
    r = s.simulate(0.5, accuracy=1e-4)
    mass = 7800 * np.pi * 0.01**2
    places = np.linspace(0, 1, 81)
    speeds = np.array([r[f"b.at({x:.6f})"].velocity[-1, 1] for x in places])
    mean = float(np.sum((speeds[1:] + speeds[:-1]) / 2 * np.diff(places)))
    assert abs(mean - 2.0 * width / mass) < 0.02 * 2.0 * width / mass


def test_runs_stop_and_go_on_at_a_break() -> None:
    """Continued exactly at the edge of a box, and saved in two kinds of dense output."""
    box = sp.Piecewise((1, t <= 1), (-1, True))
    whole = slider(box).simulate(2.0, accuracy=1e-8)
    first = slider(box).simulate(1.0, accuracy=1e-8)
    second = slider(box).simulate(2.0, accuracy=1e-8, start=first)
    assert abs(second["m"].position[-1, 0] - 1.0) < 1e-9
    assert abs(whole["m"].position[-1, 0] - 1.0) < 1e-9
    assert abs(second.solution.yp[0] @ np.ones(len(second.solution.yp[0])) - (1 - 1)) < 1e-9  # v = 1, v' = -1


@pytest.mark.parametrize("solver", [mb.IDA(), mb.RadauIIA(3), mb.CVODE()])
def test_a_run_with_breaks_is_stored(tmp_path: object, solver: object) -> None:
    """Values between the steps and on both sides of a break come back as they were."""
    box = sp.Piecewise((1, (t > 0.5) & (t < 1.5)), (0, True))
    r = slider(box, spring=3.0).simulate(2.0, accuracy=1e-6, solver=solver)
    path = tmp_path / "run.npz"  # type: ignore[operator]
    r.save(path)
    back, times = mb.load(path), np.sort(np.r_[np.linspace(0, 2, 57), 0.5, 0.5 - 1e-9, 1.5 + 1e-9])
    assert np.array_equal(back(times)["m"].position, r(times)["m"].position)
    assert np.array_equal(back(times).acceleration, r(times).acceleration)


def test_square_wave_stiffness_against_its_closed_monodromy() -> None:
    """Meissner's equation x'' + (3 + 1.5 sign(sin t)) x = 0: two harmonic arcs a period."""
    s = mb.Scene("Meissner")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0))
    s.add(Spring("k", s.ground, body, at=(0, 0, 0), at_l=(0, 0, 0), stiffness=3 + sp.Rational(3, 2) * sp.sign(sp.sin(t))))
    found = s.floquet(2 * np.pi)

    def arc(k: float) -> np.ndarray:
        w, a = np.sqrt(k), np.sqrt(k) * np.pi
        return np.array([[np.cos(a), np.sin(a) / w], [-w * np.sin(a), np.cos(a)]])

    exact = np.linalg.eigvals(arc(1.5) @ arc(4.5))
    assert np.min(np.abs(found.multipliers[0] - exact)) < 1e-8


def test_check_tells_breaks_and_resolution() -> None:
    text = str(slider(sp.Piecewise((0, t < 6.3), (1, t < 7.3), (0, True)) + sp.exp(-(((t - 2) / 1e-3) ** 2))).check())
    assert "2 breaks, the first at t = 6.3 s" in text
    assert "finest change within" in text


def test_constant_steps_say_where_they_are_shorter() -> None:
    box = sp.Piecewise((1, (t > 0.501) & (t < 0.502)), (0, True))
    r = slider(box).simulate(1.0, solver=mb.RadauIIA(3, step=0.01))
    assert r.stats.shortened > 0
    assert "shortened" in repr(r)


@pytest.mark.parametrize("beside", [-5e-4, 5e-4])
def test_constant_steps_end_at_a_kink_beside_their_own_ends(beside: float) -> None:
    """A table bends a two-thousandth of a step before or after the end of one: no sliver of a step is left between them."""
    h = 0.1
    kink = 0.2 + beside * h
    r = slider(mb.table([0, kink, 0.5, 1.0], [0, 1, -1, 0])).simulate(1.0, solver=mb.RadauIIA(3, step=h))
    assert np.min(np.abs(r.solution.t - kink)) < 1e-12
    assert np.min(np.diff(r.solution.t)) > 10 * abs(beside) * h


@pytest.mark.parametrize("model", [None, mb.Kinematic(), mb.Classical(), mb.Recursive()])
@pytest.mark.parametrize("motion", [sp.Piecewise((0, t <= 0), (t, True)), sp.Max(0, t), t * sp.Heaviside(t), sp.Abs(t)])
def test_a_run_begins_with_what_comes_after_its_start(model: object, motion: object) -> None:
    """However x = t for t > 0 is written: it starts with rate 1, in every joint model, and no energy comes from nowhere."""
    s = mb.Scene("driven")
    body, other = s.rigid_body("b", 1.0, 1.0, at=(0, 0)), s.rigid_body("c", 1.0, 1.0, at=(1, 0))
    s.prismatic("p", s.ground, body, at=(0, 0), axis=(1, 0, 0), position=motion, model=model)
    s.prismatic("q", body, other, at=(1, 0), axis=(0, 1, 0))
    r = s.simulate(1.0)
    np.testing.assert_allclose(r["p"].rate, 1.0, atol=1e-9)
    np.testing.assert_allclose(r["p"].displacement, r.t, atol=1e-9)
    assert np.max(np.abs(r.energy.balance)) < 1e-9


@pytest.mark.parametrize(("motion", "text"), [
    (sp.Piecewise((0, t < 0.5), (t - 0.5, True)), "its rate jumps by 1 m/s at t = 0.5 s"),
    (sp.Piecewise((0, t < 0.5), (0.3, True)), r"jumps by 0.3 m at t = 0.5 s"),
])
def test_a_jump_where_a_run_is_continued_is_refused(motion: object, text: str) -> None:
    s = mb.Scene("driven")
    body, other = s.rigid_body("b", 1.0, 1.0, at=(0, 0)), s.rigid_body("c", 1.0, 1.0, at=(1, 0))
    s.prismatic("p", s.ground, body, at=(0, 0), axis=(1, 0, 0), position=motion)
    s.prismatic("q", body, other, at=(1, 0), axis=(0, 1, 0))
    first = s.simulate(0.5)
    with pytest.raises(mb.SceneError, match=text):
        s.simulate(1.0, start=first)


@pytest.mark.parametrize(("force", "speed"), [
    (sp.ceiling(5 * t), 3.0), (sp.sqrt(t), 2 / 3), (sp.Min(sp.sin(t), sp.sin(2 * t) + 1, sp.sin(3 * t) + 2), 1 - np.cos(1)),
    (sp.Abs(sp.Abs(sp.Abs(sp.Abs(t - 0.5) - 0.25) - 0.125) - 0.0625), 0.03125),
])
def test_impulses_of_odd_inputs(force: object, speed: float) -> None:
    """Integrals from 0 to 1 in closed form; nested functions take no time to prepare."""
    assert abs(slider(force).simulate(1.0, accuracy=1e-6)["m"].velocity[-1, 0] - speed) < 3e-6


def test_constant_steps_from_an_accuracy_on_a_beam() -> None:
    s = mb.Scene("cantilever")
    b = s.beam("b", (0, 0), (1, 0), section=mb.Section.rectangular(0.02, 0.02, E=1e7, nu=0.3, rho=1000), elements=2)
    s.weld("A", s.ground, b, at=(0, 0))
    s.line_load("q", b, (0, sp.sin(t), 0))
    r = s.simulate(0.2, accuracy=1e-3, solver=mb.HHT())
    assert r.accuracy.met
