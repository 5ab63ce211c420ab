"""Multipliers of periodic motions: Mathieu's equation, steady motions, differences of nonlinear runs, and what is refused."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scenes import ground_resonance, steady_sliding
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.system.start import Start

G, ARM, W = 9.81, 1.0, 9.0
T = 2 * np.pi / W
ROTOR = 2 * np.pi / 20.01


def ordered(values: Any) -> np.ndarray:
    return np.array(sorted(values, key=lambda z: (round(abs(z), 6), round(z.imag, 6))))


def shaken(space: str = "auto", model: Any = None, amplitude: float = 0.2, up: float = -1.0, damper: float = 0.0) -> mb.Scene:
    """A point mass on a light rod whose pivot is moved up and down by amplitude cos(W t); up: 1 stands, -1 hangs."""
    s = mb.Scene("shaken pendulum", gravity=(0, -G, 0), space=space)
    pivot = s.rigid_body("pivot", 1.0, 0.1 if space == "auto" else (0.1, 0.1, 0.1), at=(0, 0))
    inertia = 0.0 if space == "auto" else (0, 0, 0)
    rod = s.rigid_body("rod", 1.0, inertia, at=(0, up * ARM))
    s.prismatic("slide", s.ground, pivot, at=(0, 0), axis=(0, 1, 0), position=amplitude * sp.cos(W * mb.t), model=model)
    s.revolute("pin", pivot, rod, at=(0, 0), damper=damper, model=model)
    return s


def mathieu(amplitude: float, up: float, damper: float) -> np.ndarray:
    """Multipliers of x'' + damper x' - up (g + y'') x = 0, y = amplitude cos(W t), by DOP853."""

    def rhs(t: float, x: Any) -> Any:
        return [x[1], up * (G - amplitude * W * W * np.cos(W * t)) * x[0] - damper * x[1]]

    ends = [solve_ivp(rhs, (0, T), e, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1] for e in np.eye(2)]
    return np.linalg.eigvals(np.array(ends).T)


VARIANTS = [("auto", None), ("spatial", None), ("auto", mb.Classical()), ("spatial", mb.Recursive())]


@pytest.mark.parametrize(("space", "model"), VARIANTS)
@pytest.mark.parametrize(("amplitude", "up", "damper"), [(0.2, -1, 0.0), (0.5, -1, 0.3), (0.3, 1, 0.2)])
def test_mathieu(space: str, model: Any, amplitude: float, up: float, damper: float) -> None:
    f = shaken(space, model, amplitude, up, damper).floquet(T)
    expected = mathieu(amplitude, up, damper)
    assert ordered(f.multipliers) == pytest.approx(ordered(expected), abs=1e-7)
    assert f.stable == (np.max(np.abs(expected)) < 1 + 1e-9)
    assert f.growth.max() == pytest.approx(np.log(np.max(np.abs(expected))) / T, abs=1e-7)
    assert np.prod(f.multipliers).real == pytest.approx(np.exp(-damper * T), rel=1e-7)  # Liouville


def test_a_mode_names_its_bodies_and_shape() -> None:
    f = shaken(amplitude=0.2).floquet(T)
    (mode,) = f.modes
    assert mode.participation["rod"] == pytest.approx(1)
    assert abs(mode["rod"].displacement[0]) == pytest.approx(1)
    assert mode["rod"].displacement[0] == pytest.approx(mode["rod"].rotation[2] * ARM)
    assert mode["pivot"].displacement == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.exp(mode.eigenvalue * T) == pytest.approx(mode.multiplier)
    assert "rod 100%" in str(f)
    assert "known up to multiples of 9 rad/s" in str(f)


@pytest.mark.parametrize(("multiplier", "error", "listed"), [
    (0.9, 1.2, True), (0.9, 1e3, True), (1e-17, 1.2, True), (1e-17, 1e6, False), (1e-4, 1e6, True)])
def test_only_modes_that_surely_die_out_are_not_listed(multiplier: float, error: float, listed: bool) -> None:
    """error: 1/s, over a period of .7 s: an error of 1.2 1/s leaves a digit; one whose multiplier may be above one half stays."""
    f = shaken(amplitude=0.2).floquet(T)
    f.modes[:] = [replace(f.modes[0], multiplier=complex(multiplier), error=error)]
    assert ("rod 100%" in str(f)) == listed
    assert ("not listed: 1 mode " in str(f)) != listed


def at_rest() -> mb.Scene:
    """A spatial loop with springs, dampers and followed angles."""
    s = mb.Scene("tangled", gravity=(1, -2, -G), space="spatial")
    a = s.rigid_body("a", 1.0, (0.1, 0.2, 0.25), at=(0.5, 0, 0))
    b = s.rigid_body("b", 2.0, (0.3, 0.2, 0.25), at=(1.5, 0.2, 0), rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    s.spherical("A", s.ground, a, at=(0, 0, 0))
    s.revolute("B", a, b, at=(1, 0, 0), axis=(0, 1, 1), spring=5.0, damper=0.7)
    s.bushing("tie", s.ground, b, (2, 0, 0), (30, 40, 50, 2, 3, 4), (0.3, 0.4, 0.5, 0.2, 0.3, 0.4))
    s.spring("stay", s.ground, a, (0, 1, 1), (1, 0, 0), stiffness=20.0, damping=0.3)
    return s


def sticking() -> mb.Scene:
    """A mass with a bristle under it: an internal state that acts, and a third root."""
    s = mb.Scene("sticking")
    mass = s.rigid_body("mass", 1.0, 0.1, at=(0, 0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        friction = mb.LuGre(0.3, 0.4, 0.1, 50.0, 1.0)
    s.prismatic("slide", s.ground, mass, at=(0, 0), axis=(1, 0, 0), friction=friction, normal_force=2.0, spring=30.0)
    return s


@pytest.mark.parametrize("scene", [at_rest, sticking])
def test_rest_repeats_after_any_period(scene: Callable[[], mb.Scene]) -> None:
    s, period = scene(), 0.37
    rest = s.equilibrium() if scene is at_rest else None
    linear = s.linearize(at=rest)
    f = s.floquet(period, at=rest)
    exponents = [v for mode in linear for v in {mode.eigenvalue, np.conj(mode.eigenvalue)}]
    assert ordered(f.multipliers) == pytest.approx(ordered(np.exp(np.array(exponents) * period)), abs=1e-7)


@pytest.mark.parametrize("model", [pytest.param(None, marks=pytest.mark.slow), mb.Recursive()])
def test_steady_rotation_has_the_growth_of_the_rotating_frame(model: Any) -> None:
    s, same = ground_resonance(2), ground_resonance(2, model=model)  # slides of a support do not turn with the hub
    linear = s.linearize(at=s.equilibrium(frame="hub"), frame="hub")
    f = same.floquet(ROTOR, at=same.equilibrium(frame="hub"))
    assert f.growth == pytest.approx(np.sort(linear.growth)[::-1], abs=1e-7)
    turned = np.angle(np.exp(1j * linear.angular_frequencies * ROTOR)) / ROTOR
    assert np.sort(f.angular_frequencies) == pytest.approx(np.sort(np.abs(turned)), abs=1e-6)
    assert f.steps <= 512
    assert f.departure < 1e-8


def test_monodromy_is_the_difference_of_nonlinear_runs() -> None:
    """A driven crank swings a double pendulum on soft springs: central differences of tight runs in joint coordinates."""
    s = mb.Scene("driven", gravity=(0, -G, 0))
    crank = s.link("crank", (0, 0), (0.3, 0), mass=1.0)
    upper, lower = s.link("upper", (0.3, 0), (0.3, -1), mass=1.0), s.link("lower", (0.3, -1), (0.3, -1.5), mass=0.5)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=W * mb.t, model=mb.Recursive())
    s.revolute("B", crank, upper, at=(0.3, 0), damper=2.0, model=mb.Recursive())
    s.revolute("C", upper, lower, at=(0.3, -1), damper=2.0, spring=2.0, model=mb.Recursive())
    r = s.simulate(60 * T, solver=mb.RadauIIA(3, rtol=1e-10))  # the crank turns with the pendulum far behind: a forced motion
    f = s.floquet(T, at=r)
    y0 = r.solution.y[-1]
    matrix = np.empty((4, 4))
    for i in range(4):
        ends = []
        for sign in (1, -1):
            y = y0.copy()
            y[i] += sign * 1e-6
            system = s.system(start=_start(r, y))
            ends.append(mb.RadauIIA(3, rtol=1e-11, atol=1e-12).solve(system, r.t[-1] + T).y[-1])
        matrix[:, i] = (ends[0] - ends[1]) / 2e-6
    assert ordered(f.multipliers) == pytest.approx(ordered(np.linalg.eigvals(matrix)), abs=1e-5)


def _start(r: mb.Result, y: np.ndarray) -> Start:
    q, u, s = r.prepared.states(r.t[-1:], y[None])
    return Start(float(r.t[-1]), q[0], u[0], s[0], np.zeros_like(u[0]), np.zeros(0))


def test_free_rotor_has_multipliers_one() -> None:
    s = mb.Scene("free rotor", space="spatial")
    s.revolute("shaft", s.ground, s.rigid_body("disc", 1.0, (1, 1, 2)), at=(0, 0), rate0=5.0)
    f = s.floquet(2 * np.pi / 5)
    assert f.multipliers == pytest.approx([1, 1], abs=1e-6)
    assert f.stable


def test_nothing_is_free() -> None:
    s = mb.Scene("crank")
    s.revolute("A", s.ground, s.link("crank", (0, 0), (1, 0), mass=1.0), at=(0, 0), angle=W * mb.t)
    f = s.floquet(T)
    assert len(f) == len(f.multipliers) == 0
    assert f.stable


# ---- what is refused -------------------------------------------------------------------------------------------------


def wound() -> mb.Scene:
    """A driven disc on a torsion spring: every turn winds it up further, and the drive has to hold more."""
    s = mb.Scene("wound")
    disc = s.rigid_body("disc", 1.0, 1.0)
    s.revolute("shaft", s.ground, disc, at=(0, 0), angle=W * mb.t, spring=3.0)
    return s


def swinging() -> mb.Scene:
    s = mb.Scene("swinging", gravity=(0, -G, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (0, -1), mass=1.0), at=(0, 0), angle0=0.3, damper=0.5)
    return s


@pytest.mark.parametrize(
    ("scene", "period", "message"),
    [
        (shaken, 1.1 * T, r"after period = 0.767944871 s the velocity of 'pivot' differs .* by 0.81 of the largest"),
        (lambda: steady_sliding(0.1), 0.5, "after period = 0.5 s 'mass' is 0.05 m from its start"),
        (swinging, 1.0, "after period = 1 s (the velocity of )?'rod' "),
        (wound, T / 2, "'disc' is turned by 3.14 rad from its start"),
        (wound, T, "the equations do not repeat after period = 0.698.* s, although .*: momentum of disc.omega at t = .* differs"),
    ],
)
def test_what_does_not_repeat_is_named(scene: Callable[[], mb.Scene], period: float, message: str) -> None:
    with pytest.raises(mb.SteadyError, match=message) as caught:
        scene().floquet(period)
    remedy = "loads and prescribed motions repeat too" if "the equations" in message else "pass at=(result, t)"
    assert remedy in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "period = 0.0 is not positive: give the time in s after which the motion repeats"),
        ({"period": "T"}, "period = 'T'"),
        ({"period": T, "count": 0}, "count = 0 is not 1 or more: give the number of largest multipliers"),
        ({"period": T, "accuracy": 1.0}, "accuracy = 1.0"),
        ({"period": T, "at": 3.0}, r"at = 3.0 is no state: give a Result"),
    ],
)
def test_bad_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(mb.OptionError, match=message):
        shaken().floquet(**options)


def test_what_more_steps_do_not_give_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mbdae.analysis.multipliers.MOST", 32)
    with pytest.warns(mb.AccuracyWarning, match="steps a period, and more do not help; accuracy = 1e-11 was asked"):
        f = shaken(amplitude=0.5).floquet(T, accuracy=1e-11)
    expected = mathieu(0.5, -1, 0.0)
    off = np.abs(ordered(f.multipliers) - ordered(expected)) / np.abs(ordered(expected))
    assert np.all(off <= 3 * f.errors * T)  # and the errors given are true


def test_linearize_names_floquet() -> None:
    s = ground_resonance(1)
    e = s.equilibrium(frame="hub")
    with pytest.raises(mb.SteadyError, match=r"periodic, use s.floquet\(period\)"):
        s.linearize(at=e, frame="hub")
    assert s.floquet(ROTOR, at=e).growth.max() == pytest.approx(2.1013475883784443, abs=1e-8)


def test_blocks_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "analysis.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 8
    for block in blocks:
        exec(compile(block, "analysis.md", "exec"), {"__name__": "page"})


@pytest.mark.slow
def test_beams() -> None:
    """Elastic blades on two axes: the growth of the linearisation in the rotating frame."""
    from beam_scenes import flexible_rotor

    s = flexible_rotor(axes=2)
    e = s.equilibrium(frame="hub")
    f = s.floquet(ROTOR, at=e)
    linear = max(mode.growth for mode in s.linearize(e, "hub"))
    assert f.growth.max() == pytest.approx(linear, rel=1e-6)
    assert f.unresolved > 0
    assert "of motions too fast for" in str(f)


def excited(stiffness: Any, growth: Any) -> mb.Scene:
    """Two discs, the first on a soft drive; the joint between them vibrates fast and is fed by `growth`, N m s/rad."""
    s = mb.Scene("excited")
    a, b = (s.rigid_body(name, 1.0, 1.0, at=(0, 0)) for name in "AB")
    s.revolute("JA", s.ground, a, at=(0, 0), spring=1.0, damper=0.1, torque=sp.cos(mb.t))
    s.revolute("JB", a, b, at=(0, 0), torque=growth * s.sensor("JB.rate") - stiffness * s.sensor("JB.angle"))
    return s


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e8])
@pytest.mark.parametrize("growth", [0.1, -0.1, 1.0])
def test_motions_faster_than_the_steps_count(stiffness: float, growth: float) -> None:
    """Steps damp them; the mode between both discs grows by (2 growth - 0.05) / 2."""
    s = excited(stiffness, growth)
    steady = s.periodic(2 * np.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for f in (steady.floquet, s.floquet(2 * np.pi, at=steady)):
            fast = f.fast_growth if f.unresolved else f.growth[np.argsort(-np.abs(f.growth + 0.025))]
            assert fast[0] == pytest.approx(growth - 0.025, abs=3e-5)
            assert f.stable is (growth < 0)
            assert np.all(f.exponents.real < np.max(np.append(fast, 0.0)) + 1e-5)
    assert steady.stable is (growth < 0)


@pytest.mark.parametrize(("growth", "stable"), [(0.1, False), (-0.05, True), (0.0, None)])
def test_the_growth_of_a_fast_motion_is_its_mean(growth: float, stable: bool | None) -> None:
    """Although it grows for a part of the period, and its frequency changes."""
    s = excited(1e8 * (1 + 0.5 * sp.cos(mb.t)), growth + 0.8 * sp.cos(mb.t + 0.3) + 0.025)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        f = s.floquet(2 * np.pi, at=s.periodic(2 * np.pi))
    assert f.unresolved == 2
    assert np.all(np.abs(f.fast_growth - growth) <= f.fast_errors + 1e-7)
    assert f.stable is stable
    assert any("too fast" in str(one.message) for one in told) == (stable is None)
