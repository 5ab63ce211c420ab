"""Seeded mechanisms that hit stops: driven, swinging, bouncing, in a chain, and some that hardly touch; equations by hand."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.system.sampling import distance

G = 9.81  #: m/s^2
#: longest step of the reference, as a fraction of the time scale sqrt(mass / stiffness) of an impact, and where bodies hardly
#: touch also in s; a fiftieth of the former changes motions by at most 1e-9
STEP, GRAZING_STEP = 0.05, 1.5e-4
COUNTED = 3.0  #: a run that is off by more than this many times the accuracy has to say so


class Problem(NamedTuple):
    """A scene in recursive coordinates, its equations y' = f(t, y) with y = (coordinates, rates), start, end (s), and the longest
    step (s) of the reference."""

    scene: mb.Scene
    f: Callable[[float, Any], list[float]]
    y0: list[float]
    end: float
    step: float


class Stop(NamedTuple):
    """Limits of a coordinate (m or rad), with the stiffness and damping of their stops."""

    low: float | None
    high: float | None
    K: float
    D: float

    def force(self, q: float, v: float) -> float:
        """Force or torque on the coordinate."""
        if self.high is not None and q > self.high:
            return -max(0.0, self.K * (q - self.high) + self.D * v)
        if self.low is not None and q < self.low:
            return max(0.0, self.K * (self.low - q) - self.D * v)
        return 0.0

    def given(self) -> dict[str, Any]:
        """The arguments of a joint."""
        return {"limits": (self.low, self.high), "stop": mb.Stop(self.K, self.D)}


def drawn_stop(rng: Any, inertia: float, low: float | None, high: float | None, stiff: tuple[float, float]) -> Stop:
    """A stop of drawn stiffness, without damping, lightly, strongly or overdamped."""
    K = 10 ** rng.uniform(*stiff) * inertia
    ratio = (0.0, rng.uniform(0, 0.1), rng.uniform(0.1, 0.8), rng.uniform(0.8, 1.5))[rng.integers(4)]
    return Stop(low, high, K, 2 * ratio * sqrt(K * inertia))


def driven(rng: Any) -> Problem:
    """A mass with play in a carriage that is shaken."""
    m, A, w = 10 ** rng.uniform(-2, 1), rng.uniform(0.02, 0.3), rng.uniform(3, 15)
    stop = drawn_stop(rng, m, -rng.uniform(0.01, 0.1), rng.uniform(0.01, 0.1), (3, 6))
    s = mb.Scene("shaken")
    base, c = s.rigid_body("base", 1.0, 1.0, at=(0, 0)), s.rigid_body("c", m, 1.0, at=(0, 0))
    s.prismatic("d", s.ground, base, at=(0, 0), axis=(1, 0, 0), position=A * sp.sin(w * mb.t))
    s.prismatic("j", base, c, at=(0, 0), axis=(1, 0, 0), rate0=0.05, **stop.given())
    return Problem(s, lambda t, y: [y[1], stop.force(*y) / m + A * w * w * sin(w * t)], [0, 0.05], rng.uniform(1, 3),
                   STEP * sqrt(m / stop.K))


def swinging(rng: Any) -> Problem:
    """A rod that swings between two stops, some of them driven by a torque."""
    m, l, torque, w = 10 ** rng.uniform(-1, 1), rng.uniform(0.2, 1), rng.uniform(5, 60) * rng.integers(2), rng.uniform(3, 15)
    J = m * l * l / 3
    stop = drawn_stop(rng, J, -rng.uniform(0.1, 1), rng.uniform(0.1, 1), (2, 7))
    a0, w0 = 0.9 * rng.uniform(stop.low, stop.high), rng.uniform(-5, 5)
    s = mb.Scene("swinging", gravity=(0, -G, 0))
    s.revolute("j", s.ground, s.link("c", (0, 0), (0, -l), mass=m), at=(0, 0), angle0=a0, rate0=w0,
               torque=J * torque * sp.sin(w * mb.t), **stop.given())
    return Problem(s, lambda t, y: [y[1], stop.force(*y) / J - 1.5 * G / l * sin(y[0]) + torque * sin(w * t)], [a0, w0],
                   rng.uniform(1, 3), STEP * sqrt(J / stop.K))


def bouncing(rng: Any) -> Problem:
    """A mass that falls on one stop, and comes to rest on it where that is damped."""
    m, h = 10 ** rng.uniform(-2, 1), rng.uniform(0.05, 0.5)
    stop = drawn_stop(rng, m, 0.0, None, (3.5, 7))
    s = mb.Scene("bouncing", gravity=(0, -G, 0))
    s.prismatic("j", s.ground, s.rigid_body("c", m, 1.0, at=(0, 0)), at=(0, 0), axis=(0, 1, 0), position0=h, **stop.given())
    return Problem(s, lambda t, y: [y[1], stop.force(*y) / m - G], [h, 0], rng.uniform(0.5, 2), STEP * sqrt(m / stop.K))


def chain(rng: Any) -> Problem:
    """Two masses, the second with play in the first, which has play in the ground and is pushed to and fro."""
    m1, m2, w = 10 ** rng.uniform(-1, 0.5), 10 ** rng.uniform(-1, 0.5), rng.uniform(3, 12)
    both, P = m1 * m2 / (m1 + m2), (m1 + m2) * rng.uniform(0, 8)
    outer = drawn_stop(rng, m1, -rng.uniform(0.02, 0.2), rng.uniform(0.02, 0.2), (3, 5))
    inner = drawn_stop(rng, both, -rng.uniform(0.02, 0.1), rng.uniform(0.02, 0.1), (3, 5))
    v1, v2 = rng.uniform(-1, 1), rng.uniform(-1, 1)
    s = mb.Scene("chain")
    a, b = s.rigid_body("a", m1, 1.0, at=(0, 0)), s.rigid_body("b", m2, 1.0, at=(0, 0))
    s.prismatic("i", s.ground, a, at=(0, 0), axis=(1, 0, 0), rate0=v1, force=P * sp.sin(w * mb.t), **outer.given())
    s.prismatic("j", a, b, at=(0, 0), axis=(1, 0, 0), rate0=v2, **inner.given())

    def f(t: float, y: Any) -> list[float]:
        between = inner.force(y[1], y[3])
        of_first = (outer.force(y[0], y[2]) - between + P * sin(w * t)) / m1
        return [y[2], y[3], of_first, between / m2 - of_first]

    return Problem(s, f, [0, 0, v1, v2], rng.uniform(0.7, 2), STEP * min(sqrt(m1 / outer.K), sqrt(both / inner.K)))


def grazing(rng: Any) -> Problem:
    """An oscillator whose amplitude is larger than the distance of a stop by 1e-6 to 3e-3 of it."""
    m, w, amplitude, phase = 10 ** rng.uniform(-1, 1), rng.uniform(3, 10), rng.uniform(0.1, 0.5), rng.uniform(-1, 1)
    stop = drawn_stop(rng, m, None, amplitude * (1 - 10 ** rng.uniform(-6, -2.5)), (3, 6))
    k, q0, v0 = m * w * w, amplitude * sin(phase), amplitude * w * cos(phase)
    s = mb.Scene("grazing")
    s.prismatic("j", s.ground, s.rigid_body("c", m, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), spring=k, position0=q0, rate0=v0,
                **stop.given())
    return Problem(s, lambda t, y: [y[1], (stop.force(*y) - k * y[0]) / m], [q0, v0], rng.uniform(1, 3),
                   min(STEP * sqrt(m / stop.K), GRAZING_STEP))


KINDS = (driven, swinging, bouncing, chain, grazing)


def run(seed: int, accuracy: float, solver: Any) -> tuple[str, str]:
    """Verdict on one run (right, told, needless, silent), and what tells which run it was."""
    kind = KINDS[seed % len(KINDS)]
    problem = kind(np.random.default_rng([41, seed]))
    exact = solve_ivp(problem.f, (0, problem.end), problem.y0, method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True,
                      max_step=problem.step).sol
    r = problem.scene.recursive().simulate(problem.end, accuracy=accuracy, solver=solver)
    t = np.unique(np.r_[r.t, r.solution.t])
    off = float(np.max(distance(r.prepared, t, exact(t).T, r.solution(t)))) / accuracy
    told = bool(r.warnings) or r.reliable is False
    verdict = ("needless" if off <= 1 else "told") if told else ("silent" if off > COUNTED else "right")
    return verdict, f"{kind.__name__} {seed} at {accuracy:g}: {off:.2g} times the accuracy, {' '.join(r.warnings)[:60]}"
