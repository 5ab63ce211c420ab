"""Mechanisms with contacts by equations of their own, with their derivatives: SciPy and nothing of mbdae.

Every contact has a gap. Steps of the integrator end where a gap closes or opens, the force is switched there, and the next steps
begin there. Along them go the derivatives S = dy/dp of the state at fixed times, S' = f_y S + f_p; f_y and f_p are complex steps
through f. Forces begin at 0, so that S does not jump at a touch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

STEP = 1e-30  #: imaginary part of complex steps
Numbers = Mapping[str, Any]


@dataclass(frozen=True)
class Own:
    """A mechanism with one contact. start(p), rates(t, y, p, touches), gap(t, y, p); p: numbers by name."""

    start: Callable[[Numbers], Any]
    rates: Callable[[float, Any, Numbers, bool], Any]
    gap: Callable[[float, Any, Numbers], Any]

    def run(self, p: Numbers, names: Sequence[str], times: Any, rtol: float = 1e-12) -> tuple[Any, Any, list[tuple[float, bool]]]:
        """y (times, n), its derivatives (times, n, names), and when the gap closes (True) and opens. times: rising, after 0."""
        y0 = np.asarray(self.start(p), dtype=float)
        n, count = len(y0), len(names)
        S0 = np.column_stack([np.imag(np.asarray(self.start({**p, k: p[k] + 1j * STEP}))) / STEP for k in names])
        t, z, touches, met, found = 0.0, np.concatenate([y0, S0.ravel()]), False, list[tuple[float, bool]](), []

        def rates(t: float, z: Any) -> Any:
            y, S = z[:n], z[n:].reshape(n, count)
            by_state = np.column_stack([np.imag(self.rates(t, y + 1j * STEP * e, p, touches)) / STEP for e in np.eye(n)])
            by_number = np.column_stack([np.imag(self.rates(t, y, {**p, k: p[k] + 1j * STEP}, touches)) / STEP for k in names])
            return np.concatenate([np.real(self.rates(t, y, p, touches)), (by_state @ S + by_number).ravel()])

        while t < times[-1]:
            def touch(t: float, z: Any) -> float:
                return float(self.gap(t, z[:n], p))

            touch.terminal, touch.direction = True, 1.0 if touches else -1.0  # type: ignore[attr-defined]
            some = solve_ivp(rates, (t, times[-1]), z, "DOP853", rtol=rtol, atol=1e-14, events=touch, dense_output=True,
                             first_step=min(1e-9, (times[-1] - t) / 2), max_step=times[-1] / 50)
            found += [some.sol(at) for at in times if t < at <= some.t[-1]]
            t, z = some.t[-1], some.y[:, -1]
            if some.status == 1:
                touches = not touches
                met.append((float(t), touches))
        all_of = np.array(found)
        return all_of[:, :n], all_of[:, n:].reshape(len(all_of), n, count), met


def pressed(p: Numbers, depth: Any, rate: Any) -> Any:
    """Hertz's force with damping, N; 0 where the surfaces are apart or it would pull."""
    if np.real(depth) <= 0:
        return 0.0
    force = p["stiffness"] * depth**1.5 * (1 + p["damping"] * rate)
    return force if np.real(force) > 0 else 0.0


# -- a ball thrown to the floor: x, z, vx, vz, w about y; J = 0.4 m r^2


def _ball(t: float, y: Any, p: Numbers, touches: bool) -> Any:
    _, z, vx, vz, w = y
    fx = fz = arm = 0.0
    if touches:
        depth = p["radius"] - z
        fz, arm = pressed(p, depth, -vz), depth / 2 - p["radius"]
        fx = -p["mu"] * np.tanh((vx + w * arm) / p["v_c"]) * fz
    return np.array([vx, vz, fx / p["mass"], fz / p["mass"] - p["g"], arm * fx / (p["mass"] * p["gyration"] ** 2)])


BALL = Own(lambda p: np.array([0.0, p["height"], p["speed"], 0.0, p["spin"]]), _ball, lambda t, y, p: y[1] - p["radius"])

# -- a ball on a plate that is driven by reach sin(w t): z, vz


def _shaken(t: float, y: Any, p: Numbers, touches: bool) -> Any:
    z, vz = y
    force = 0.0
    if touches:
        plate, rate = p["reach"] * np.sin(p["w"] * t), p["reach"] * p["w"] * np.cos(p["w"] * t)
        force = pressed(p, p["radius"] + plate - z, rate - vz)
    return np.array([vz, force / p["mass"] - p["g"]])


SHAKEN = Own(lambda p: np.array([p["height"], 0.0]), _shaken,
             lambda t, y, p: y[0] - p["radius"] - np.real(p["reach"] * np.sin(p["w"] * t)))

# -- two balls in flight, without friction: ax, ay, bx, by, and their velocities


def _two(t: float, y: Any, p: Numbers, touches: bool) -> Any:
    a, b, va, vb = y[0:2], y[2:4], y[4:6], y[6:8]
    force: Any = np.zeros(2)
    if touches:
        u = b - a
        d = np.sqrt(u @ u)
        force = u / d * pressed(p, 2 * p["radius"] - d, -(vb - va) @ u / d)
    return np.concatenate([va, vb, -force / p["mass_a"], force / p["mass_b"]])


TWO = Own(lambda p: np.array([0, 0, p["ahead"], p["aside"], p["speed_a"], 0, p["speed_b"], 0]), _two,
          lambda t, y, p: np.hypot(y[2] - y[0], y[3] - y[1]) - 2 * p["radius"])

# -- a slider-crank with play at the crank pin: x of the slider, angle of the rod from the slider's path, and their rates. The
#    uniform rod is hinged to the slider at x and ends in the pin, x - length (cos, sin); the race is at the end of the crank.

CRANK, ROD = 0.05, 0.12  # m


def _pin(t: float, y: Any, p: Numbers) -> tuple[Any, ...]:
    """Gap, and normal (2,) from the race's centre to the pin's."""
    race = CRANK * np.array([np.cos(p["w"] * t), np.sin(p["w"] * t)])
    u = np.array([y[0] - ROD * np.cos(y[1]), -ROD * np.sin(y[1])]) - race
    d = np.sqrt(u @ u)
    return p["outer"] - p["inner"] - d, u / d, race


def _slider_crank(t: float, y: Any, p: Numbers, touches: bool) -> Any:
    x, angle, vx, rate = y
    along, turning = 0.0, 0.0
    if touches:
        gap, n, race = _pin(t, y, p)
        at = race + p["outer"] * n
        arm = at - np.array([x, 0])
        v = np.array([vx - rate * arm[1] + p["w"] * at[1], rate * arm[0] - p["w"] * at[0]])
        fn, slip = pressed(p, -gap, v @ n), v[1] * n[0] - v[0] * n[1]
        rub = p["mu"] * np.tanh(slip / p["v_c"]) * fn
        force = -fn * n - rub * np.array([-n[1], n[0]])
        along, turning = force[0], arm[0] * force[1] - arm[1] * force[0]
    half = p["rod"] * ROD / 2
    mass, coupled, inertia = p["slider"] + p["rod"], half * np.sin(angle), p["rod"] * ROD**2 / 3
    along = along - half * np.cos(angle) * rate**2
    det = mass * inertia - coupled**2
    return np.array([vx, rate, (inertia * along - coupled * turning) / det, (mass * turning - coupled * along) / det])


SLIDER_CRANK = Own(lambda p: np.array([CRANK + ROD, 0.0, 0.0, -CRANK * p["w"] / ROD]), _slider_crank,
                   lambda t, y, p: _pin(t, y, p)[0])
