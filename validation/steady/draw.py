"""Drawn oscillators of one mass, whose periodic motions SciPy finds by shooting on the equations written by hand."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from scipy.special import ellipk

import mbdae as mb

KINDS = ("driven", "limit cycle", "damped", "pendulum")
ACCURACY = 1e-6


@dataclass(frozen=True)
class Verdict:
    """One oscillator: what is wrong with its periodic motion, in words; "" where nothing is. told: whether it was refused, or its
    accuracy told as not reached, where it need not be."""

    seed: int
    kind: str
    wrong: str = ""
    told: bool = False


def slider(x: float, force: Callable[[Any, Any], Any], v: float = 0.0) -> mb.Scene:
    """1 kg on a line, at x (m) with velocity v (m/s), under a force of its place and velocity."""
    s = mb.Scene("slider")
    m = s.point_mass("m", 1.0, (0, 0), velocity=(v, 0))
    s.prismatic("J", s.ground, m, at=(0, 0), axis=(1, 0))
    s.force("F", m, (force(s.sensor("J.displacement") + x, s.sensor("J.rate")), 0))
    return s


def after(f: Callable[[float, float, float], float], z: Any, period: float) -> Any:
    """Place and velocity (2,) a period after z."""
    run = solve_ivp(lambda t, y: [y[1], f(t, y[0], y[1])], (0, period), z, method="DOP853", rtol=1e-12, atol=1e-13)
    return run.y[:, -1]


def solution(residual: Callable[[Any], Any], begin: Any, xtol: float) -> Any:
    """A root of SciPy's `fsolve`, which may tell that it cannot come nearer; no reference is one that leaves more than 1e-8."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        found = fsolve(residual, begin, xtol=xtol)
    left = float(np.abs(residual(found)).max())
    if left > 1e-8 * max(1.0, float(np.abs(found).max())):
        raise ArithmeticError(f"no reference: {left:.1e} is left")
    return found


def off(f: Callable[[float, float, float], float], r: Any, x: float) -> str:
    """What is wrong with a motion of a given period, against shooting by SciPy from its start, and its multipliers."""
    T, z = r.period, np.array([r["J"].displacement[0] + x, r["J"].rate[0]])
    exact = solution(lambda y: after(f, y, T) - y, z, 1e-12)
    if np.abs(z - exact).max() > 3 * max(ACCURACY, r.accuracy.estimated) * max(1.0, np.abs(exact).max()):
        return f"the start is {np.abs(z - exact).max():.1e} off"
    step = 1e-5
    M = np.array([after(f, exact + e, T) - after(f, exact - e, T) for e in step * np.eye(2)]).T / (2 * step)
    mu = np.linalg.eigvals(M)
    if abs(np.prod(mu) - np.prod(r.multipliers)) > 1e-4 or abs(np.sum(mu) - np.sum(r.multipliers)) > 1e-4 * max(1, abs(mu).max()):
        return f"the multipliers are {r.multipliers}, not {mu}"
    if abs(abs(mu).max() - 1) > 1e-4 and r.stable is not bool(abs(mu).max() < 1):
        return f"stable is {r.stable}"
    return ""


def driven(d: np.random.Generator) -> tuple[str, bool]:
    """A stiffening spring under a harmonic force."""
    loss, cubic, load = 10 ** d.uniform(-2.5, 0), 10 ** d.uniform(-1, 0.7), 10 ** d.uniform(-1, 0.5)
    w, x = d.uniform(0.3, 3), d.uniform(-1, 1)
    r = slider(x, lambda q, v: -q - cubic * q**3 - loss * v + load * sp.cos(w * mb.t)).periodic(2 * np.pi / w)
    return off(lambda t, q, v: -q - cubic * q**3 - loss * v + load * np.cos(w * t), r, x), not r.reliable


def limit_cycle(d: np.random.Generator) -> tuple[str, bool]:
    """Van der Pol's equation, its period stated nearly or not at all."""
    growth, x, stated = 10 ** d.uniform(-1, 1.3), d.uniform(0.3, 4), d.random() < 0.3
    s, right = slider(x, lambda q, v: growth * (1 - q**2) * v - q), lambda t, q, v: growth * (1 - q**2) * v - q
    r = s.periodic()
    if stated:
        r = s.periodic(r.period * (1 + 10 ** d.uniform(-12, -7)), start=(r, 0.0))
    z = np.array([r["J"].displacement[0] + x, r["J"].rate[0]])

    def residual(y: Any) -> Any:
        return [*(after(right, y[:2], y[2]) - y[:2]), (y[:2] - z) @ [z[1], right(0, *z)]]

    exact = solution(residual, [*z, r.period], 1e-13)
    if abs(r.period - exact[2]) > max(3 * r.period_error, 1e-8 * exact[2]):
        return f"the period is {abs(r.period - exact[2]):.1e} off, {r.period_error:.1e} estimated", False
    return "" if r.stable else f"stable is {r.stable} of growth {growth:.3g}", not r.reliable


def damped(d: np.random.Generator) -> tuple[str, bool]:
    """Comes to rest: no periodic motion, and none may be returned."""
    loss, cubic, x = 10 ** d.uniform(-2, 0.5), d.uniform(0, 2), d.choice([0.0, d.uniform(-2, 2)])
    s = slider(x, lambda q, v: -q - cubic * q**3 - loss * v)
    try:
        r = s.periodic(None if d.random() < 0.7 else d.uniform(2, 8))
    except mb.SteadyError:
        return "", False
    return f"rest with the period {r.period:.6g} s of a start at {x:.3g}, loss {loss:.3g}", False


def pendulum(d: np.random.Generator) -> tuple[str, bool]:
    """One of a family, which is told; its period is that of its amplitude."""
    angle = d.uniform(0.1, 2.8)
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (np.sin(angle), -np.cos(angle)), mass=1.0), at=(0, 0))
    r = s.periodic()
    amplitude = np.ptp(r(np.linspace(r.t[0], r.t[-1], 20001))["A"].angle) / 2
    exact = 4 * ellipk(np.sin(amplitude / 2) ** 2) * np.sqrt(2 / 3 / 9.81)
    if abs(r.period - exact) > 1e-4 * exact or abs(amplitude - angle) > 1e-2:
        return f"amplitude {amplitude:.6g} of {angle:.6g}, period {r.period:.9g}, not {exact:.9g}", False
    return "" if r.family else "the family is not told", not r.reliable


MAKE = dict(zip(KINDS, (driven, limit_cycle, damped, pendulum), strict=True))


def judged(seed: int) -> Verdict:
    """The oscillator of a seed."""
    kind = KINDS[seed % len(KINDS)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        try:
            wrong, told = MAKE[kind](np.random.default_rng(seed))
        except mb.SteadyError:
            return Verdict(seed, kind, told=True)
        except (mb.MbdaeError, ArithmeticError) as error:
            return Verdict(seed, kind, f"{type(error).__name__}: {error}")
    return Verdict(seed, kind, wrong, told)
