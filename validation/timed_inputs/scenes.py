"""Small scenes under inputs of time, each with its equations of motion by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from timed_inputs import inputs
from timed_inputs.bars import cantilever
from timed_inputs.oracle import Array, Problem

import mbdae as mb

G = 9.81
Rng = np.random.Generator


def model(rng: Rng, recursive: bool = True) -> tuple[Any, bool]:
    """A model for all joints, and whether constraints remain."""
    chosen = int(rng.integers(3 if recursive else 2))
    return (mb.Kinematic(), mb.Classical(), mb.Recursive())[chosen], chosen < 2


def _speed(rng: Rng, size: float) -> float:
    """At rest, or moving."""
    return float(rng.choice([0.0, rng.normal() * size]))


def mass(rng: Rng) -> Problem:
    """A free body or a point mass under two forces."""
    T, m = float(rng.uniform(2, 20)), float(rng.uniform(0.5, 5))
    v, g = (_speed(rng, 1 / T), _speed(rng, 1 / T)), float(rng.choice([0, G / T**2]))
    push = [inputs.pushing(rng, T, 1.0, m), inputs.pushing(rng, T, 1.0, m)]
    point = bool(rng.integers(2))

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("mass", gravity=(0, -g, 0))
        b = s.point_mass("b", m, at=(0, 0), velocity=v) if point else s.rigid_body("b", m, m, at=(0, 0), velocity=v)
        s.force("F", b, (*said, 0))
        return s

    return Problem("mass", build, push, T, np.array([0, 0, *v]), lambda t, y, u: [y[2], y[3], u[0](t) / m, u[1](t) / m - g],
                   lambda t, y, u: {"b.position": [*y[:2], 0], "b.velocity": [*y[2:], 0]})


class TimedSpring(mb.Force):
    """A user's spring along the slide: energy stiffness x^2 / 2."""

    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.stiffness * (d @ d) / 2


def oscillator(rng: Rng) -> Problem:
    """A slide with spring and damper under a drive; sometimes a spring of the user's own beside it whose stiffness is timed."""
    T, m, w = float(rng.uniform(3, 15)), float(rng.uniform(0.5, 5)), float(rng.choice([0, 1, 3]))
    k, c = m * w**2, float(m * w * rng.uniform(0, 0.4))
    x0, v0 = float(rng.choice([0, 0.2])), _speed(rng, 1 / T)
    chosen, constrained = model(rng)
    timed = bool(rng.random() < 0.35)
    parts = [inputs.pushing(rng, T, 0.5, m)]
    if timed:
        stiff = inputs.load(rng, T)
        parts.append(stiff.times(m * 2 / (min(stiff.lasts, T) * T)))
        x0 = 0.2

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("oscillator")
        b = s.rigid_body("b", m, m, at=(0, 0))
        s.prismatic("p", s.ground, b, at=(0, 0), axis=(1, 0, 0), position0=x0, rate0=v0, spring=k or None, damper=c or None,
                    force=said[0], model=chosen)
        if timed:
            s.add(TimedSpring("k", s.ground, b, at=(0, 0), stiffness=said[1]))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        own = u[1](t) if timed else 0.0
        return [y[1], (u[0](t) - (k + own) * y[0] - c * y[1]) / m]

    return Problem("timed stiffness" if timed else "oscillator", build, parts, T, np.array([x0, v0]), rhs,
                   lambda t, y, u: {"p.displacement": y[0], "p.rate": y[1]}, constrained)


def pendulum(rng: Rng) -> Problem:
    """A rod that hangs, or swings, under a torque at its hinge or a force at its tip."""
    T, m, L = float(rng.uniform(2, 8)), 1.0, 1.0
    a0, w0 = float(rng.choice([0, 0.7])), _speed(rng, 0.5)
    chosen, constrained = model(rng)
    at_tip = bool(rng.integers(2))
    push = inputs.pushing(rng, T, 0.6, m * L**2 / 3)

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("pendulum", gravity=(0, -G, 0))
        rod = s.link("rod", (0, 0), (0, -L), mass=m)
        turn = None if at_tip else said[0]
        s.revolute("h", s.ground, rod, at=(0, 0), angle0=a0, rate0=w0, torque=turn, damper=0.05, model=chosen)
        if at_tip:
            s.force("F", rod, (said[0], 0, 0), at=(0, -L))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        turn = u[0](t) * (L * np.cos(y[0]) if at_tip else 1.0)
        return [y[1], (turn - m * G * L / 2 * np.sin(y[0]) - 0.05 * y[1]) * 3 / (m * L**2)]

    return Problem("pendulum", build, [push], T, np.array([a0, w0]), rhs,
                   lambda t, y, u: {"h.angle": y[0], "h.rate": y[1]}, constrained)


def driven(rng: Rng) -> Problem:
    """A joint whose motion is prescribed: the motion itself is known."""
    T, turns = float(rng.uniform(2, 12)), bool(rng.integers(2))
    move = inputs.motion(rng, T).times(float(rng.uniform(0.05, 0.5)))
    chosen = model(rng, recursive=False)[0]

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("driven joint", gravity=(0, -G, 0))
        b = s.link("b", (0, 0), (1, 0), mass=1.0)
        if turns:
            s.revolute("j", s.ground, b, at=(0, 0), angle=said[0], model=chosen)
        else:
            s.prismatic("j", s.ground, b, at=(0, 0), axis=(1, 0, 0), position=said[0], model=chosen)
        return s

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        # measured from the drawn position, where the joint's value is 0
        return {"j.angle" if turns else "j.displacement": u[0](t), "j.rate": u[0].rate(t)}

    return Problem("driven joint", build, [move], T, np.zeros(0), lambda t, y, u: [], read, True)


def moved_pivot(rng: Rng) -> Problem:
    """A pendulum on a cart whose position is prescribed."""
    T, L, a0 = float(rng.uniform(2, 6)), 1.0, float(rng.choice([0, 0.5]))
    move = inputs.motion(rng, T)
    move = move.times(float(rng.uniform(0.1, 0.5)) * min(1.0, 20 * move.width / T))
    chosen = model(rng, recursive=False)[0]

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("moved pivot", gravity=(0, -G, 0))
        cart, bob = s.rigid_body("cart", 1.0, 1.0, at=(0, 0)), s.link("bob", (0, 0), (0, -L), mass=1.0)
        s.prismatic("c", s.ground, cart, at=(0, 0), axis=(1, 0, 0), position=said[0], model=chosen)
        s.revolute("h", cart, bob, at=(0, 0), angle0=a0, rate0=0.0, damper=0.02, model=chosen)
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        pull = -G * np.sin(y[0]) - u[0].second(t) * np.cos(y[0])
        return [y[1], (pull * L / 2 - 0.02 * y[1]) * 3 / L**2]

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        return {"c.displacement": u[0](t), "c.rate": u[0].rate(t), "h.angle": y[0], "h.rate": y[1]}

    return Problem("moved pivot", build, [move], T, np.array([a0, 0.0]), rhs, read, True)


def double_pendulum(rng: Rng) -> Problem:
    """Two rods for a short time, a torque between them or at the hinge."""
    T, m, L = float(rng.uniform(0.8, 1.6)), 1.0, 0.5
    a = np.array(rng.choice([0, 1])) * rng.uniform(-0.8, 0.8, 2)
    chosen, constrained = model(rng)
    elbow = bool(rng.integers(2))
    push = inputs.pushing(rng, T, 0.5, m * L**2 / 3)

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("double pendulum", gravity=(0, -G, 0))
        upper, lower = s.link("upper", (0, 0), (0, -L), mass=m), s.link("lower", (0, -L), (0, -2 * L), mass=m)
        s.revolute("A", s.ground, upper, at=(0, 0), angle0=a[0], rate0=0.0, torque=None if elbow else said[0], model=chosen)
        s.revolute("B", upper, lower, at=(0, -L), angle0=a[1] - a[0], rate0=0.0, torque=said[0] if elbow else None, model=chosen)
        return s

    def rhs(t: float, y: Array, u: Any) -> Any:
        p, q, wp, wq = y  # angles of the rods to the vertical, and their rates
        c, s, drive = np.cos(p - q), np.sin(p - q), u[0](t)
        M = m * L**2 * np.array([[4 / 3, c / 2], [c / 2, 1 / 3]])
        f = m * L * np.array([-1.5 * G * np.sin(p) - L / 2 * s * wq**2, -0.5 * G * np.sin(q) + L / 2 * s * wp**2])
        return [wp, wq, *np.linalg.solve(M, f + drive * np.array([-1, 1] if elbow else [1, 0]))]

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        return {"A.angle": y[0], "B.angle": y[1] - y[0], "A.rate": y[2], "B.rate": y[3] - y[2]}

    return Problem("double pendulum", build, [push], T, np.array([*a, 0, 0]), rhs, read, constrained)


def four_bar(rng: Rng) -> Problem:
    """Crank, coupler and rocker of slender rods: a torque or a prescribed angle at the crank."""
    A, B, C, D = np.array([[0, 0], [0, 0.3], [0.5, 0.7], [0.7, 0.0]])
    prescribed = bool(rng.integers(2))
    T = float(rng.uniform(1, 3))
    lengths = np.array([np.linalg.norm(B - A), np.linalg.norm(C - B), np.linalg.norm(C - D)])
    drawn = np.array([np.arctan2(*(q - p)[::-1]) for p, q in ((A, B), (B, C), (D, C))])
    m = 2 * lengths
    spin = 0.0 if prescribed else _speed(rng, 1.0)
    drive = inputs.motion(rng, T).times(float(rng.uniform(0.05, 0.4))) if prescribed else inputs.pushing(rng, T, 0.4, 0.2)

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("four-bar")
        ends = {"crank": (A, B), "coupler": (B, C), "rocker": (D, C)}
        rods = [s.link(n, *points, mass=float(mass)) for (n, points), mass in zip(ends.items(), m, strict=True)]
        own: dict[str, Any] = {"angle": said[0]} if prescribed else {"torque": said[0], "rate0": spin}
        s.revolute("A", s.ground, rods[0], at=A, **own)
        s.revolute("B", rods[0], rods[1], at=B)
        s.revolute("C", rods[1], rods[2], at=C)
        s.revolute("D", s.ground, rods[2], at=D, spring=None if prescribed else 1.0)
        return s

    bar = FourBar(lengths, m, drawn, D - A)
    if prescribed:
        def read(t: float, y: Array, u: Any) -> dict[str, Any]:
            first, rate = drawn[0] + u[0](t), u[0].rate(t)
            a = bar.closed(first)
            w = bar.rates(a, rate)
            return {"A.angle": u[0](t), "D.angle": a[2] - drawn[2], "A.rate": rate, "D.rate": w[2]}

        return Problem("four-bar, driven", build, [drive], T, np.zeros(0), lambda t, y, u: [], read, True)

    start = np.r_[drawn, bar.rates(drawn, spin)]
    return Problem("four-bar", build, [drive], T, start, lambda t, y, u: bar.rhs(y, u[0](t)),
                   lambda t, y, u: {"A.angle": y[0] - drawn[0], "D.angle": y[2] - drawn[2], "A.rate": y[3], "D.rate": y[5]}, True)


class FourBar:
    """Angles a of three rods, l1 e(a1) + l2 e(a2) = d + l3 e(a3): by Lagrange's multipliers, or in closed form."""

    def __init__(self, lengths: Array, masses: Array, drawn: Array, ground: Array) -> None:
        self.l, self.m, self.drawn, self.d = lengths, masses, drawn, ground

    def jacobian(self, a: Array) -> Array:
        """(2, 3) of the closing condition."""
        return self.l * np.array([1, 1, -1]) * np.array([-np.sin(a), np.cos(a)])

    def rates(self, a: Array, first: float) -> Array:
        """Rates of all rods from the crank's."""
        J = self.jacobian(a)
        return np.r_[first, np.linalg.solve(J[:, 1:], -J[:, 0] * first)]

    def closed(self, first: float) -> Array:
        """Angles of all rods from the crank's, on the branch drawn."""
        x, y = self.d - self.l[0] * np.array([np.cos(first), np.sin(first)])  # coupler - rocker
        r, phi = np.hypot(x, y), np.arctan2(y, x)
        _, l2, l3 = self.l
        second = phi + np.arccos((l2**2 + r**2 - l3**2) / (2 * l2 * r))  # coupler against the line to D
        tip = self.l[0] * np.array([np.cos(first), np.sin(first)]) + l2 * np.array([np.cos(second), np.sin(second)]) - self.d
        third = np.arctan2(tip[1], tip[0])
        a = np.array([first, second, third])
        return np.asarray(self.drawn + (a - self.drawn + np.pi) % (2 * np.pi) - np.pi)

    def rhs(self, y: Array, torque: float) -> Any:
        """M a'' + J^T pull = f, J a'' = -J' a'."""
        a, w = y[:3], y[3:]
        l1, l2, l3 = self.l
        m1, m2, m3 = self.m
        c, s = np.cos(a[0] - a[1]), np.sin(a[0] - a[1])
        M = np.diag([m1 * l1**2 / 3 + m2 * l1**2, m2 * l2**2 / 3, m3 * l3**2 / 3])
        M[0, 1] = M[1, 0] = m2 * l1 * l2 / 2 * c
        f = np.array([torque - m2 * l1 * l2 / 2 * s * w[1] ** 2, m2 * l1 * l2 / 2 * s * w[0] ** 2, -1.0 * (a[2] - self.drawn[2])])
        J = self.jacobian(a)
        bias = -(self.l * np.array([1, 1, -1]) * np.array([-np.cos(a), -np.sin(a)])) @ w**2
        K = np.block([[M, J.T], [J, np.zeros((2, 2))]])
        return [*w, *np.linalg.solve(K, np.r_[f, bias])[:3]]


def quarter_car(rng: Rng) -> Problem:
    """Body on a spring and damper over a wheel on a tyre, over a road that moves; at rest before."""
    T = float(rng.uniform(4, 12))
    m, w, k, c, tyre = 300.0, 40.0, 18e3, 1500.0, 150e3
    road = inputs.motion(rng, T).times(float(rng.uniform(0.02, 0.1)))

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("quarter car")
        names = ("road", "wheel", "body")
        for i, (name, size) in enumerate(zip(names, (1.0, w, m), strict=True)):
            s.rigid_body(name, size, 1.0, at=(0, 0.5 * i))
            s.prismatic(f"{name} guide", s.ground, name, at=(0, 0.5 * i), axis=(0, 1, 0), position=said[0] if i == 0 else None)
        s.spring("tyre", "road", "wheel", (0, 0), (0, 0.5), stiffness=tyre, damping=100.0)
        s.spring("strut", "wheel", "body", (0, 0.5), (0, 1.0), stiffness=k, damping=c)
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        z, zt = u[0](t), u[0].rate(t)
        strut = k * (y[1] - y[0]) + c * (y[3] - y[2])
        return [y[2], y[3], (tyre * (z - y[0]) + 100.0 * (zt - y[2]) + strut) / w, -strut / m]

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        return {"road guide.displacement": u[0](t), "wheel guide.displacement": y[0], "body guide.displacement": y[1],
                "wheel guide.rate": y[2], "body guide.rate": y[3]}

    return Problem("quarter car", build, [road], T, np.zeros(4), rhs, read, True)


def spinning_body(rng: Rng) -> Problem:
    """A body in space under a torque in its own or inertial axes and a force through its centre of mass."""
    T, J, m = float(rng.uniform(2, 6)), np.array([1.0, 1.6, 2.2]), 2.0
    w0 = float(rng.choice([0, 1])) * rng.normal(size=3) * 0.5
    own = bool(rng.integers(2))
    turn, push = inputs.pushing(rng, T, 1.0, 1.5), inputs.pushing(rng, T, 0.5, m)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("spinning body", space="spatial")
        b = s.rigid_body("b", m, J, at=(0, 0, 0), angular_velocity=w0)
        s.torque("M", b, tuple(float(c) * said[0] for c in axis), frame="body" if own else "inertial")
        s.force("F", b, (0, said[1], 0))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        P, w, R = y[:4], y[4:7], rotation(y[:4])  # w in body axes
        M = axis * u[0](t)
        wt = ((M if own else R.T @ M) - cross(w, J * w)) / J
        Pt = 0.5 * np.array([-P[1:] @ w, *(P[0] * w + cross(P[1:], w))])
        return [*Pt, *wt, y[8], u[1](t) / m]

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        R = rotation(y[:4])
        return {"b.rotation": R, "b.angular_velocity": R @ y[4:7], "b.position": [0, y[7], 0], "b.velocity": [0, y[8], 0]}

    return Problem("spinning body", build, [turn, push], T, np.array([1, 0, 0, 0, *w0, 0, 0]), rhs, read)


def cross(a: Array, b: Array) -> Array:
    """What np.cross does, ten times faster for one pair."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def rotation(P: Array) -> Array:
    """Matrix of a quaternion of any length."""
    w, x, y, z = (P / np.sqrt(P @ P)).tolist()
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def beam(rng: Rng) -> Problem:
    """A cantilever under a load at its tip or along it: along its axis (linear exactly), or across it by a hundredth."""
    EA, GA, EI, line, J, L, n = 100.0, 40.0, 1.0, 1.0, 1e-2, 1.0, 2
    axial, spread = bool(rng.integers(2)), bool(rng.integers(2))
    damping = float(rng.choice([0.01, 0.05]))
    bar = cantilever(EA, line, L, n, damping) if axial else cantilever(EI, line, L, n, damping, GA, J)
    T = float(rng.uniform(3, 6)) * 2 * np.pi / bar.slowest
    push = inputs.load(rng, T)
    force = bar.largest(0.1 if axial else 0.01, spread) / min(1.0, min(push.lasts, T) * bar.slowest)
    push = push.times(force * float(rng.uniform(0.3, 1)))

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("beam")
        section = mb.Section(EA, GA, GA, 1.0, EI, EI, mass_per_length=line, rotary_inertia=J, damping=damping)
        b = s.beam("b", (0, 0), (L, 0), section=section, elements=n, order=2)
        s.weld("w", s.ground, b.at(0))
        value = (said[0], 0, 0) if axial else (0, said[0], 0)
        if spread:
            b.load(value)
        else:
            s.force("F", b.at(1), value)
        return s

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        tip = bar.tip @ y[: len(bar.tip)]
        return {"b.at(1).position": [L + tip, 0, 0] if axial else [np.nan, tip, 0]}  # bending shortens by a square

    return Problem("beam, axial" if axial else "beam, bent", build, [push], T, np.zeros(2 * len(bar.tip)), 
                   lambda t, y, u: bar.rhs(y, u[0](t), spread), read, True, tightest=1e-6 if axial else 1e-4, positions_only=True)


def loose_pin(rng: Rng) -> Problem:
    """A pin in a race with play, Hertz contact that loses energy, no friction, pushed about."""
    T, m, play, K, d = float(rng.uniform(0.3, 0.8)), 0.5, 2e-2, 1e5, 0.3
    push = [inputs.pushing(rng, T, 3 * play, m), inputs.pushing(rng, T, 3 * play, m)]

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("loose pin")
        b = s.rigid_body("b", m, 0.01, at=(0, 0))
        s.revolute("j", s.ground, b, at=(0, 0), model=mb.Clearance(0.05 + play, 0.05, normal=mb.Hertz(K, d), friction=None))
        s.force("F", b, (*said, 0))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        r = float(np.hypot(y[0], y[1]))
        deep = r - play
        f = 0.0
        if deep > 0:
            f = max(0.0, K * deep**1.5 * (1 + d * (y[0] * y[2] + y[1] * y[3]) / r))
        away = f / r if r > 0 else 0.0
        return [y[2], y[3], (u[0](t) - away * y[0]) / m, (u[1](t) - away * y[1]) / m]

    return Problem("loose pin", build, push, T, np.zeros(4), rhs, lambda t, y, u: {"b.position": [*y[:2], 0]},
                   largest_step=T / 1000, rtol=1e-10, tightest=1e-5, positions_only=True)


SCENES = (mass, oscillator, oscillator, pendulum, pendulum, driven, driven, moved_pivot, double_pendulum, four_bar, quarter_car,
          spinning_body, beam, loose_pin)
