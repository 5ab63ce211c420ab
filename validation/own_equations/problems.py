"""Equations of the test sets for initial value problems and differential algebraic equations, each with a reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from dae_problems import car_axis, circle, circle_exact, circle_ode, jay, jay_exact, pendulum, pendulum_exact
from scipy.integrate import solve_ivp

import mbdae as mb

Array = Any


@dataclass(frozen=True)
class Problem:
    """A problem: how its equations are made, its end (s), and its reference, times (k,) -> all unknowns (k, n); tight: the
    smallest accuracy at which it is run, because the reference or the cost ends there."""

    make: Callable[[], Any]
    t_end: float
    exact: Callable[[Array], Array]
    tight: float = 1e-9


def explicit(f: Callable[[float, Array], Array], y0: Array, **options: Any) -> Any:
    """y' = f(t, y) as a DAE, with its right-hand side."""
    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        out[:] = yp - f(t, y)

    return mb.DAE(residual, y0, f(0.0, np.asarray(y0, dtype=float)), rhs=lambda t, y, out: np.asarray(f(t, y)), **options)


def by_scipy(f: Callable[[float, Array], Array], y0: Array, t_end: float, atol: Any = 1e-14,
             full: Callable[[Array, Array], Array] = lambda t, y: y) -> Callable[[Array], Array]:
    """The reference by SciPy's Radau; full: all unknowns from the times (k,) and the states (k, m)."""
    @cache
    def solved() -> Any:
        return solve_ivp(f, (0.0, t_end), y0, method="Radau", rtol=2e-13, atol=atol, dense_output=True).sol

    return lambda times: full(times, solved()(times).T)


def by_radau(make: Callable[[], Any], t_end: float, rtol: float = 1e-11) -> Callable[[Array], Array]:
    """The reference by RadauIIA(5) at its smallest tolerance, where no other solver is at hand."""
    @cache
    def solved() -> Any:
        return mb.RadauIIA(5, rtol=rtol).solve(make(), t_end)

    return lambda times: solved()(times)


# -- index 1


def robertson() -> Any:
    """Robertson's reaction, the third equation replaced by the sum."""
    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        out[0] = yp[0] + 0.04 * y[0] - 1e4 * y[1] * y[2]
        out[1] = yp[1] - 0.04 * y[0] + 1e4 * y[1] * y[2] + 3e7 * y[1] ** 2
        out[2] = y[0] + y[1] + y[2] - 1

    return mb.DAE(residual, [1, 0, 0], [-0.04, 0.04, 0], names=["a", "b", "c"], scale=[1, 1e-4, 1])


def robertson_rates(t: float, y: Array) -> list[float]:
    """The reaction as an ordinary differential equation."""
    forth, back, pair = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return [back - forth, forth - back - pair, pair]


def akzo_rates(y: Array) -> Array:
    """Rates of the first five concentrations of the problem of Akzo Nobel; the sixth is 115.83 y[0] y[3]."""
    sixth = 115.83 * y[0] * y[3]
    r1, r2, r3 = 18.7 * y[0] ** 4 * np.sqrt(abs(y[1])), 0.58 * y[2] * y[3], 0.58 / 34.4 * y[0] * y[4]
    r4, r5, flow = 0.09 * y[0] * y[3] ** 2, 0.42 * sixth**2 * np.sqrt(abs(y[1])), 3.3 * (0.9 / 737 - y[1])
    return np.array([-2 * r1 + r2 - r3 - r4, -0.5 * r1 - r4 - 0.5 * r5 + flow, r1 - r2 + r3, -r2 + r3 - 2 * r4, r2 - r3 + r5])


def akzo() -> Any:
    """Chemical Akzo Nobel, index 1."""
    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        out[:5] = yp[:5] - akzo_rates(y)
        out[5] = 115.83 * y[0] * y[3] - y[5]

    start = np.array([0.444, 0.00123, 0, 0.007, 0])
    return mb.DAE(residual, [*start, 115.83 * start[0] * start[3]], [*akzo_rates(start), 0])


def amplifier_parts(t: float, y: Array) -> Array:
    """Currents of the transistor amplifier without those of its capacitors, A."""
    base = 0.1 * np.sin(200 * np.pi * t)
    first, second = (1e-6 * np.expm1(v / 0.026) for v in (y[1] - y[2], y[4] - y[5]))
    return np.array([(y[0] - base) / 1000, y[1] / 4500 - 6 / 9000 + 0.01 * first, y[2] / 9000 - first,
                     (y[3] - 6) / 9000 + 0.99 * first, y[4] / 4500 - 6 / 9000 + 0.01 * second, y[5] / 9000 - second,
                     (y[6] - 6) / 9000 + 0.99 * second, y[7] / 9000])


def amplifier() -> Any:
    """Transistor amplifier: capacitors between nodes, so that the matrix of y' is singular without a zero row."""
    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        a, b, c = 1e-6 * (yp[1] - yp[0]), 3e-6 * (yp[4] - yp[3]), 5e-6 * (yp[7] - yp[6])
        out[:] = np.array([a, -a, -2e-6 * yp[2], b, -b, -4e-6 * yp[5], c, -c]) - amplifier_parts(t, y)

    y0 = np.array([0, 3, 3, 6, 3, 3, 6, 0])
    rates = [51.338775, 51.338775, -1 / 6e-3, -24.9757667, -24.9757667, -1 / 12e-3, -10.00564453, -10.00564453]
    return mb.DAE(residual, y0, rates)


def hires_rates(t: float, y: Array) -> Array:
    """High irradiance response of photomorphogenesis."""
    pair = 280 * y[5] * y[7]
    return np.array([-1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007, 1.71 * y[0] - 8.75 * y[1],
                     -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4], 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
                     -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6], -pair + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
                     pair - 1.81 * y[6], -pair + 1.81 * y[6]])


HIRES = np.array([1, 0, 0, 0, 0, 0, 0, 0.0057])


def ring_rates(t: float, y: Array) -> Array:
    """Ring modulator with parasitic capacitors of 2e-12 F."""
    one, two = 0.5 * np.sin(2e3 * np.pi * t), 2 * np.sin(2e4 * np.pi * t)
    voltages = np.array([y[2] - y[4] - y[6] - two, -y[3] + y[5] - y[6] - two, y[3] + y[4] + y[6] + two,
                         -y[2] - y[5] + y[6] + two])
    q = 40.67286402e-9 * np.expm1(np.minimum(17.7493332 * voltages, 300))
    return np.array([
        (y[7] - 0.5 * y[9] + 0.5 * y[10] + y[13] - y[0] / 25e3) / 1.6e-8,
        (y[8] - 0.5 * y[11] + 0.5 * y[12] + y[14] - y[1] / 25e3) / 1.6e-8,
        (y[9] - q[0] + q[3]) / 2e-12, (-y[10] + q[1] - q[2]) / 2e-12, (y[11] + q[0] - q[2]) / 2e-12,
        (-y[12] - q[1] + q[3]) / 2e-12, (-y[6] / 50 + q[0] + q[1] - q[2] - q[3]) / 1e-8, -y[0] / 4.45, -y[1] / 4.45,
        (0.5 * y[0] - y[2] - 17.3 * y[9]) / 5e-4,
        (-0.5 * y[0] + y[3] - 17.3 * y[10]) / 5e-4, (0.5 * y[1] - y[4] - 17.3 * y[11]) / 5e-4,
        (-0.5 * y[1] + y[5] - 17.3 * y[12]) / 5e-4, (-y[0] + one - 86.3 * y[13]) / 2e-3, (-y[1] - 636.3 * y[14]) / 2e-3,
    ])


def ring() -> Any:
    """The ring modulator as equations."""
    return explicit(ring_rates, np.zeros(15), scale=RING_SCALE)


RING_SCALE = np.array([0.1] * 7 + [1e-6] * 2 + [1e-3] * 4 + [1e-4] * 2)


def oscillator_rates(t: float, y: Array) -> Array:
    """Van der Pol's oscillator, stiffness 1e3 (mu^2 = 1e3)."""
    return np.array([y[1], ((1 - y[0] ** 2) * y[1] - y[0]) * 1e3])


# -- index 2 and 3


def path() -> Any:
    """The force that moves a mass of 1 kg as x = sin t^2, and its integral: index 3 without a constraint between positions."""
    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        x, v, force, _ = y
        out[:] = yp[0] - v, yp[1] - force, x - np.sin(t * t), yp[3] - force * v

    return mb.DAE(residual, [0, 0, 2, 0], [0, 2, 0, 0], index=[1, 2, 3, 2], names=["x", "v", "force", "work"])


def path_exact(t: Array) -> Array:
    """(k, 4) of `path`."""
    v, s, c = 2 * t * np.cos(t * t), np.sin(t * t), np.cos(t * t)
    return np.array([s, v, 2 * c - 4 * t * t * s, v * v / 2]).T


FEKETE = 4  #: particles


def fekete() -> Any:
    """Particles on the unit sphere that repel each other and come to rest, stabilised: index 2."""
    n = FEKETE
    rng = np.random.default_rng(7)
    start = rng.normal(size=(n, 3))
    start /= np.linalg.norm(start, axis=1)[:, None]

    def forces(p: Array, q: Array) -> Array:
        apart = p[:, None] - p
        distance = np.sum(apart**2, axis=2) + np.eye(n)
        return np.sum(apart / distance[..., None], axis=1) - 0.5 * q

    def residual(t: float, y: Array, yp: Array, out: Array) -> None:
        p, q = y[: 3 * n].reshape(n, 3), y[3 * n : 6 * n].reshape(n, 3)
        force, shift = y[6 * n : 7 * n, None], y[7 * n :, None]
        out[: 3 * n] = (yp[: 3 * n].reshape(n, 3) - q - 2 * p * shift).ravel()
        out[3 * n : 6 * n] = (yp[3 * n : 6 * n].reshape(n, 3) - forces(p, q) - 2 * p * force).ravel()
        out[6 * n : 7 * n] = np.sum(p * p, axis=1) - 1
        out[7 * n :] = 2 * np.sum(p * q, axis=1)

    push = forces(start, np.zeros((n, 3)))
    pull = -0.5 * np.sum(start * push, axis=1)
    rates = push + 2 * start * pull[:, None]
    zeros = np.zeros(3 * n)
    return mb.DAE(residual, np.concatenate([start.ravel(), zeros, pull, np.zeros(n)]),
                  np.concatenate([zeros, rates.ravel(), np.zeros(2 * n)]), index=2)


def swinging(form: str) -> Callable[[Array], Array]:
    """All unknowns of the pendulum, with its multiplier lambda = v^2 - g y, and 0 for that of stabilised forms."""
    def exact(t: Array) -> Array:
        x, y, u, v = pendulum_exact(t, 2.0).T
        pull = u * u + v * v - 9.81 * y
        return np.array([x, y, u, v, pull, *([np.zeros_like(t)] if form == "ggl" else [])]).T

    return exact


def turning(form: str) -> Callable[[Array], Array]:
    """All unknowns of the point driven on a circle."""
    return lambda t: np.hstack([circle_exact(t), np.zeros((len(t), int(form == "ggl")))])


def plain(make: Callable[[], Any]) -> Callable[[], Any]:
    """The equations without their Jacobian, so that differences serve."""
    def made() -> Any:
        d = make()
        return mb.DAE(d.residual, d.y0, d.yp0, index=d.index, names=d.names, scale=d.scale, partition=d.partition)

    return made


PROBLEMS: dict[str, Problem] = {
    "Robertson": Problem(robertson, 40.0, by_scipy(robertson_rates, [1, 0, 0], 40.0, [1e-15, 1e-19, 1e-15])),
    "Akzo Nobel": Problem(akzo, 180.0, by_scipy(lambda t, y: akzo_rates(y), [0.444, 0.00123, 0, 0.007, 0], 180.0, 1e-16,
                                                lambda t, y: np.column_stack([y, 115.83 * y[:, 0] * y[:, 3]]))),
    "amplifier": Problem(amplifier, 0.05, by_radau(amplifier, 0.05)),
    "HIRES": Problem(lambda: explicit(hires_rates, HIRES), 321.8122, by_scipy(hires_rates, HIRES, 321.8122, 1e-16)),
    "ring modulator": Problem(ring, 1e-4, by_radau(ring, 1e-4)),
    "Van der Pol": Problem(lambda: explicit(oscillator_rates, [2.0, 0.0]), 2.0, by_scipy(oscillator_rates, [2, 0], 2.0)),
    "circle, ODE": Problem(circle_ode, 2.0, lambda t: circle_exact(t)[:, :2]),
    "circle, index 3": Problem(lambda: circle("index3"), 2.0, turning("index3")),
    "circle, stabilised": Problem(lambda: circle("ggl"), 2.0, turning("ggl")),
    "pendulum, index 1": Problem(lambda: pendulum("index1"), 2.0, swinging("index1")),
    "pendulum, index 2": Problem(plain(lambda: pendulum("ggl")), 2.0, swinging("ggl")),
    "pendulum, index 3": Problem(plain(lambda: pendulum("index3")), 2.0, swinging("index3")),
    "car axis": Problem(lambda: car_axis("index3"), 3.0, lambda t: CAR(t)[:, :10]),
    "Jay": Problem(jay, 1.0, jay_exact),
    "path": Problem(path, 2.0, path_exact),
    "Fekete": Problem(fekete, 5.0, by_radau(fekete, 5.0)),
}
CAR = by_radau(lambda: car_axis("ggl"), 3.0)
#: published values of the transistor amplifier at 0.2 s and of the ring modulator at 1e-3 s, the ends of the test set's runs
AMPLIFIED = np.array([-0.5562145012262709e-2, 3.006522471903042, 2.849958788608128, 2.926422536206241, 2.704617865010554,
                      2.761837778393145, 4.770927631616772, 1.236995868091548])
RING = np.array([-0.2339057358486745e-1, -0.7367485485540825e-2, 0.2582956709291169, -0.4064465721283450, -0.4039455665149794,
                 0.2607966765422943, 0.1106761861269975, 0.2939904342435596e-6, -0.2840029933642329e-7, 0.7267198267264553e-3,
                 0.7929487196960840e-3, -0.7255283495698965e-3, -0.7941401968526521e-3, 0.7088495416976114e-4,
                 0.2390059075236570e-4])
