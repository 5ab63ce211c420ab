"""Motions that leave an unstable rest, each as a scene and as equations of motion by hand, in which nothing of mbdae is used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, log, sin, sqrt
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import mbdae as mb

Array = NDArray[np.float64]
G = 9.81
MODELS = {"open": {}, "kinematic": {"model": mb.Kinematic()}, "classical": {"model": mb.Classical()}}


@dataclass(frozen=True)
class Problem:
    """A scene that begins `seed` off a rest; rates: its equations y' = f(t, y); start: y as a function of the seed; seen, known:
    what is compared, from a result (k, m) and from y (k, n), in rad, or with `lengths` in m; tightest: smallest accuracy
    that is asked; atol: absolute tolerance of the reference."""

    name: str
    seed: float
    scene: Callable[[], Any]
    t_end: float
    rates: Callable[[float, Array], Any]
    start: Callable[[float], list[float]]
    seen: Callable[[Any], Array]
    known: Callable[[Array], Array]
    constrained: bool = True
    stiff: bool = False
    adaptive: bool = False  # whether only solvers with error control apply
    tightest: float = 1e-8
    lengths: bool = False
    atol: Any = 1e-26

    def reference(self, times: Array, seed: float | None = None) -> Array:
        """y (k, n) at times (s)."""
        begin = self.start(self.seed if seed is None else seed)
        found = solve_ivp(self.rates, (0, self.t_end), begin, method="Radau" if self.stiff else "DOP853",
                          rtol=1e-10 if self.stiff else 3e-14, atol=self.atol, t_eval=times)
        return np.asarray(found.y.T)

    def growth(self) -> float:
        """Natural logarithm of the factor by which a change of the seed grows."""
        times = np.linspace(0, self.t_end, 201)
        a, b = (self.known(self.reference(times, seed)) for seed in (self.seed, self.seed * (1 + 1e-5)))
        return log(max(float(np.max(np.abs(a - b))) / (self.seed * 1e-5), 1.0))


def _seed(rng: np.random.Generator, low: float = 1e-13, high: float = 1e-3) -> float:
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def _beside(rng: np.random.Generator, s: Any) -> None:
    """Now and then a wheel that spins beside, so that the scene's characteristic time is short."""
    if rng.uniform() < 0.35:
        wheel = s.rigid_body("wheel", 1.0, 0.1, at=(3, 0))
        s.revolute("axle", s.ground, wheel, at=(3, 0), rate0=float(rng.uniform(1, 20)))


def _model(rng: np.random.Generator) -> dict[str, Any]:
    return dict(MODELS[str(rng.choice(list(MODELS)))])


def rod(rng: np.random.Generator) -> Problem:
    """An upright rod, free, damped, or in honey, that falls."""
    e, m, L = _seed(rng), float(10 ** rng.uniform(-1, 1)), float(10 ** rng.uniform(-0.7, 0.7))
    J, k = m * L * L / 3, m * G * L / 2
    damper = float(rng.choice([0.0, 0.3, 20.0])) * sqrt(J * k)
    rate = (-damper + sqrt(damper**2 + 4 * J * k)) / (2 * J)
    options, beside = _model(rng), int(rng.integers(1 << 30))

    def scene() -> Any:
        s = mb.Scene("rod", gravity=(0, -G, 0))
        body = s.link("rod", (0, 0), (0, L), mass=m)
        s.revolute("hinge", s.ground, body, at=(0, 0), angle0=e, **({"damper": damper} if damper else {}), **options)
        _beside(np.random.default_rng(beside), s)
        return s

    return Problem("rod", e, scene, log(4 / e) / rate + float(rng.uniform(0, 1)) / rate,
                   lambda t, y: [y[1], (k * sin(y[0]) - damper * y[1]) / J], lambda seed: [seed, 0.0],
                   lambda r: r["hinge"].angle[:, None], lambda y: y[:, :1], stiff=damper > 10 * sqrt(J * k))


def column(rng: np.random.Generator) -> Problem:
    """Two or three rods on top of each other, with springs in their joints that are too weak."""
    n, e = int(rng.integers(2, 4)), _seed(rng)
    L, m, options = 0.5, 1.0, _model(rng)
    i = np.arange(n)
    c = m * L * L * (n - 1 - np.maximum(i[:, None], i) + 0.5 - np.eye(n) / 6)
    gravity = m * G * L * (n - 1 - i + 0.5)
    critical = float(np.max(np.linalg.eigvals(np.linalg.solve(_springs(n), np.diag(gravity))).real))
    K = critical * float(rng.uniform(0, 0.8))
    rate = float(np.sqrt(np.max(np.linalg.eigvals(np.linalg.solve(c, np.diag(gravity) - K * _springs(n))).real)))

    def rates(t: float, y: Array) -> Array:
        a, w = y[:n], y[n:]
        apart = a[:, None] - a
        pushed = gravity * np.sin(a) - K * _springs(n) @ a - (c * np.sin(apart)) @ w**2
        return np.r_[w, np.linalg.solve(c * np.cos(apart), pushed)]

    def scene() -> Any:
        s, below = mb.Scene("column", gravity=(0, -G, 0)), None
        for j in range(n):
            body = s.link(f"rod {j}", (0, j * L), (0, (j + 1) * L), mass=m)
            s.revolute(f"J{j}", s.ground if below is None else below, body, at=(0, j * L), spring=K,
                       **({"angle0": e} if j == 0 else {"angle0": 0.0}), **options)
            below = body
        return s

    return Problem("column", e, scene, log(2 / e) / rate, rates, lambda seed: [seed] * n + [0.0] * n,
                   lambda r: np.cumsum([r[f"J{j}"].angle for j in range(n)], axis=0).T, lambda y: y[:, :n])


def _springs(n: int) -> Array:
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1
    return K


class Surface(mb.Joint):
    """The point of l stays on the saddle z = (curved x^2 - falls y^2) / 2 of k."""

    params = mb.params(curved=("1/m", "curvature along x"), falls=("1/m", "curvature along y"))

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        d = l.r - k.r
        x, y, z = k.x @ d, k.y @ d, k.z @ d
        return {"surface": z - (self.curved * x * x - self.falls * y * y) / 2}


def saddle(rng: np.random.Generator) -> Problem:
    """A bead that swings along the valley of a saddle and falls off its crest."""
    e, curved, falls = _seed(rng), float(rng.uniform(0.5, 3)), float(rng.uniform(0.5, 2))
    u0 = float(rng.choice([0.0, rng.uniform(0.1, 1.5)]))  # m/s, along the valley
    rate = sqrt(falls * G)

    def rates(t: float, y: Array) -> list[float]:
        x, z, u, w = y
        hx, hz = curved * x, -falls * z
        push = (G + curved * u * u - falls * w * w) / (1 + hx * hx + hz * hz)
        return [u, w, -hx * push, -hz * push]

    def scene() -> Any:
        s = mb.Scene("saddle", gravity=(0, 0, -G))
        bead = s.point_mass("bead", 0.5, at=(0, 0, 0), velocity=(u0, 2 * rate * e, 0))
        s.add(Surface("surface", s.ground, bead, at=(0, 0, 0), curved=curved, falls=falls))
        return s

    return Problem("saddle", e, scene, log(0.5 / e) / rate, rates, lambda seed: [0.0, 0.0, u0, 2 * rate * seed],
                   lambda r: r["bead"].position[:, :2], lambda y: y[:, :2], lengths=True, tightest=1e-7)


def _slider(name: str, e: float, t_end: float, force: Callable[[Any, Any], Any], rates: Callable[[float, Array], Any],
            rng: np.random.Generator, **more: Any) -> Problem:
    """One mass on a straight guide under a force of position and speed."""
    beside, options = int(rng.integers(1 << 30)), _model(rng)

    def scene() -> Any:
        s = mb.Scene(name)
        body = s.rigid_body("mass", 1.0, 1.0, at=(0, 0))
        x, v = s.sensor("guide.displacement"), s.sensor("guide.rate")
        s.prismatic("guide", s.ground, body, at=(0, 0), axis=(1, 0, 0), position0=e, force=force(x, v), **options)
        _beside(np.random.default_rng(beside), s)
        return s

    return Problem(name, e, scene, t_end, rates, lambda seed: [seed, 0.0],
                   lambda r: r["guide"].displacement[:, None], lambda y: y[:, :1], lengths=True, **more)


def well(rng: np.random.Generator) -> Problem:
    """A mass between the two wells of a potential, damped or not."""
    e, k, c = _seed(rng), float(10 ** rng.uniform(-1, 2)), float(rng.choice([0.0, rng.uniform(0, 2)]))
    rate = (-c + sqrt(c * c + 4 * k)) / 2
    return _slider("well", e, log(1 / e) / rate + 3 / sqrt(k), lambda x, v: k * (x - x**3) - c * v,
                   lambda t, y: [y[1], k * (y[0] - y[0] ** 3) - c * y[1]], rng)


def self_excited(rng: np.random.Generator) -> Problem:
    """Van der Pol's and Rayleigh's oscillators let go near rest."""
    e, mu, w = _seed(rng), float(10 ** rng.uniform(-0.7, 0.5)), float(10 ** rng.uniform(-0.3, 0.7))
    rate = mu * w / 2 if mu < 2 else w * (mu - sqrt(mu**2 - 4)) / 2
    t_end = log(2 / e) / rate + 8 / w
    if rng.uniform() < 0.5:
        return _slider("van der Pol", e, t_end, lambda x, v: mu * w * (1 - x**2) * v - w * w * x,
                       lambda t, y: [y[1], mu * w * (1 - y[0] ** 2) * y[1] - w * w * y[0]], rng)
    return _slider("Rayleigh", e, t_end, lambda x, v: mu * w * (1 - (v / w) ** 2) * v - w * w * x,
                   lambda t, y: [y[1], mu * w * (1 - (y[1] / w) ** 2) * y[1] - w * w * y[0]], rng)


def ramp(rng: np.random.Generator) -> Problem:
    """A rest that becomes unstable during the run."""
    e, k, when = _seed(rng), float(10 ** rng.uniform(0, 1.5)), float(rng.uniform(1, 4))
    width = float(rng.uniform(0.1, 1))
    t_end = when + log(1 / e) / sqrt(k) + 1

    def of(t: Any, tanh: Any) -> Any:
        return k * tanh((t - when) / width)

    return _slider("ramp", e, t_end, lambda x, v: of(mb.t, sp.tanh) * x - k * x**3,
                   lambda t, y: [y[1], of(t, np.tanh) * y[0] - k * y[0] ** 3], rng)


def mathieu(rng: np.random.Generator) -> Problem:
    """A stiffness that varies in time: growth that no frozen equation shows."""
    e, w, depth = _seed(rng, 1e-11), float(10 ** rng.uniform(-0.3, 0.7)), float(rng.uniform(0.2, 0.5))
    t_end = min(log(0.3 / e) / (depth * w / 4) * float(rng.uniform(0.3, 1.1)), 400 / w)
    return _slider("Mathieu", e, t_end, lambda x, v: -w * w * (1 + depth * sp.cos(2 * w * mb.t)) * x - w * w * x**3,
                   lambda t, y: [y[1], -w * w * (1 + depth * cos(2 * w * t)) * y[0] - w * w * y[0] ** 3], rng, adaptive=True)


def top(rng: np.random.Generator) -> Problem:
    """A sleeping top that spins too slowly."""
    e, m, l, spin = _seed(rng), 0.5, 0.1, float(rng.uniform(5, 60))
    J = np.array([0.002, 0.002, 0.001])
    Jo = np.diag(J + m * l * l * np.array([1, 1, 0]))
    rate = sqrt(4 * m * G * l * Jo[0, 0] - (J[2] * spin) ** 2) / (2 * Jo[0, 0])

    def matrix(q: Array) -> Array:
        w, x, y, z = q / np.linalg.norm(q)
        return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])

    def rates(t: float, y: Array) -> Array:
        p, W = y[:4], y[4:]
        M = np.cross([0, 0, l], matrix(p).T @ [0, 0, -m * G])
        return np.r_[0.5 * np.array([-W @ p[1:], *(p[0] * W + np.cross(p[1:], W))]), np.linalg.solve(Jo, M - np.cross(W, Jo @ W))]

    def start(seed: float) -> list[float]:
        return [cos(seed / 2), sin(seed / 2), 0.0, 0.0, 0.0, 0.0, spin]

    def scene() -> Any:
        s, R = mb.Scene("top", gravity=(0, 0, -G)), matrix(np.array(start(e)[:4]))
        axis = R @ [0, 0, 1.0]
        body = s.rigid_body("top", m, R @ np.diag(J) @ R.T, at=tuple(l * axis), velocity=(0, 0, 0),
                            angular_velocity=tuple(spin * axis))
        s.spherical("tip", s.ground, body, at=(0, 0, 0))
        return s

    def known(y: Array) -> Array:
        return np.array([matrix(p)[:, 2] for p in y[:, :4]])

    return Problem("top", e, scene, log(1 / e) / rate, rates, start, lambda r: r["top"].position / l, known, tightest=1e-7)


def hilltop(rng: np.random.Generator) -> Problem:
    """A ball without friction on top of a fixed cylinder, pressed in by its weight."""
    e, big, small, m = _seed(rng, 1e-11), 0.5, 0.1, 1.0
    K = float(10 ** rng.uniform(4, 5.5))
    sunk = (m * G / K) ** (2 / 3)
    rest = big + small - sunk
    rate = sqrt(G / rest)

    def rates(t: float, y: Array) -> list[float]:
        x, z, u, w = y
        far = sqrt(x * x + z * z)
        force = K * max(big + small - far, 0.0) ** 1.5 / m
        return [u, w, force * x / far, force * z / far - G]

    def scene() -> Any:
        s = mb.Scene("hilltop", gravity=(0, -G, 0), space="planar")
        ball = s.rigid_body("ball", m, 0.4 * m * small**2, at=(rest * sin(e), rest * cos(e)))
        s.contact("drum", s.ground, ball, mb.Cylinder(at=(0, 0), radius=big, length=0.4), mb.Sphere(radius=small),
                  normal=mb.Hertz(K))
        return s

    return Problem("hilltop", e, scene, log(0.3 / e) / rate, rates, lambda seed: [rest * sin(seed), rest * cos(seed), 0.0, 0.0],
                   lambda r: r["ball"].position[:, :2], lambda y: y[:, :2], constrained=False, adaptive=True, lengths=True,
                   tightest=1e-6, atol=[1e-24, 1e-13, 1e-24, 1e-12])


PROBLEMS = (rod, rod, column, saddle, well, self_excited, self_excited, ramp, mathieu, top, hilltop)
