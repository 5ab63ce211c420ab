"""Contacts with exact answers, as ODEs with exact Jacobians and guards: a ball and a wall, an oscillator that grazes one.

Masses are 1 kg; k in N/m^1.5; damping (of Hunt and Crossley) in s/m.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, log1p, pi, sqrt
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from mbdae.system.dae import DAE

K = 1e9


def duration(v: float, k: float = K) -> float:
    """Duration (s) of an impact at v (m/s)."""
    return 2.94 * (1.25 / k) ** 0.4 * abs(v) ** -0.2 if v else inf


def penetration(v: float, k: float = K) -> float:
    """Largest penetration (m) of an elastic impact at v (m/s)."""
    return (1.25 * v * v / k) ** 0.4


def law(a: float, rate: float, k: float = K, damping: float = 0.0) -> tuple[float, float, float]:
    """Hunt and Crossley: force k a^1.5 (1 + damping rate) and its derivatives by a and rate."""
    factor = 1 + damping * rate
    if a <= 0 or factor <= 0:
        return 0.0, 0.0, 0.0
    return k * a**1.5 * factor, 1.5 * k * sqrt(a) * factor, k * a**1.5 * damping


def point_mass(
    x0: float, v0: float, force: Callable[[float, float], tuple[float, float, float]], guards: Any, scale: Any, names: Any = None
) -> DAE:
    """x' = v, v' = force(x, v), which comes with its derivatives by x and v."""

    def rhs(t, y, out):
        out[0], out[1] = y[1], force(*y)[0]

    def residual(t, y, yp, out):
        rhs(t, y, out)
        out[:] = yp - out

    def jacobian(t, y, yp, cj, out):
        _, by_x, by_v = force(*y)
        out[...] = [[cj, -1.0], [-by_x, cj - by_v]]

    start = np.array([x0, v0])
    rates = [v0, force(x0, v0)[0]]
    return DAE(residual, start, rates, jacobian, names=["x", "v"], scale=scale, guards=guards, guard_names=names, rhs=rhs)


def ball(
    v0: float, height: float, damping: float = 0.0, wall: float = 0.0, gravity: float = 0.0, guarded: bool = True,
    watch: Any = None,
) -> DAE:
    """A ball `height` above a wall, moving towards it with v0; watch: other guards than its own."""

    def force(x, v):
        f, by_a, by_rate = law(wall - x, -v, K, damping)
        return f - gravity, -by_a, -by_rate

    def guards(t, y):
        return np.array([y[0] - wall]), y[1:], np.array([duration(y[1])])

    return point_mass(wall + height, -v0, force, (watch or guards) if guarded else None, [max(height, 1e-3), max(v0, 1e-3)])


def exit_speed(v: float, damping: float) -> float:
    """Exact speed (m/s) after an impact at v: v / c - ln(1 + c v) / c^2 is the same before and after, with -v after."""
    if damping == 0:
        return v

    def H(v):
        x = damping * v
        series = sum((-x) ** n / n for n in range(2, 9))
        return (series if abs(x) < 1e-3 else x - log1p(x)) / damping**2

    return brentq(lambda w: H(-w) - H(v), 0, min(v, (1 - 1e-15) / damping), xtol=1e-18, rtol=1e-14)


def oscillator(phase: float, k: float, depth: float = 1e-4, guarded: bool = True) -> DAE:
    """x'' = -x of amplitude 1, with a wall at 1 - depth (m); x = sin(phase) at the start."""
    wall = 1 - depth

    def force(x, v):
        f, by_a, _ = law(x - wall, v, k)
        return -x - f, -1 - by_a, 0.0

    def guards(t, y):
        return np.array([wall - y[0]]), -y[1:], np.array([duration(y[1], k)])

    return point_mass(np.sin(phase), np.cos(phase), force, guards if guarded else None, None)


def oscillator_period(k: float, depth: float = 1e-4) -> float:
    """Exact time (s) from contact to contact."""
    wall = 1 - depth
    kinetic = 0.5 * (1 - wall**2)

    def energy(a):  # potential above the one at the wall
        return a * (wall + 0.5 * a) + 0.4 * k * a**2.5

    deepest = brentq(lambda a: energy(a) - kinetic, 0, depth * (1 + 1e-9), xtol=1e-20, rtol=1e-15)

    def slowness(s):  # dt / ds, a = deepest (1 - s^2): so the integrand has no pole
        return 2 * deepest * s / sqrt(2 * (energy(deepest) - energy(deepest * (1 - s * s))))

    contact = 2 * quad(slowness, 1e-6, 1, limit=200)[0]
    return 2 * pi - 2 * np.arctan2(sqrt(2 * kinetic), wall) + contact


def between_walls(v0: float, width: float = 1e-2, limit: float = np.inf) -> DAE:
    """A ball that flies to and fro between walls at 0 and `width`; its force is no number deeper than `limit` in one."""

    def force(x, v):
        if not -limit < x < width + limit:
            return np.nan, np.nan, np.nan
        low, high = law(-x, -v), law(x - width, v)
        return low[0] - high[0], -low[1] - high[1], 0.0

    def guards(t, y):
        return np.array([y[0], width - y[0]]), np.array([y[1], -y[1]]), np.full(2, duration(y[1]))

    return point_mass(width / 2, v0, force, guards, [width, v0], ["left wall", "right wall"])
