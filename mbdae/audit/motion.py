"""Random motions of two bodies k and l and of a section of a line, in which the symbols of a printed formula are evaluated.

Kinds of states: "free" (two independent bodies), "clearance" (l turns about k's third axis, the centres apart in the plane normal
to it) and the name of any joint with coordinates ("revolute", "prismatic", ...), where the compiled recursion moves l.
Every state belongs to a motion with constant accelerations, so that all time derivatives exist.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import lru_cache
from math import factorial
from types import MappingProxyType
from typing import Any, TypeVar
from zlib import crc32

import numpy as np

from mbdae.audit.carried import Carried, joint_class
from mbdae.audit.evaluate import STEP, NestedError, SizeError, Value, cross
from mbdae.symbolic.rebuild import complex_atan2

_E3 = np.array([[0.0], [0.0], [1.0]])
#: independent vectors of each body: position, velocity, acceleration, angular velocity, angular acceleration
VECTORS = ("x", "v", "a", "w", "alpha")
T = TypeVar("T")
WIDE = 256  #: from this seed on numbers are drawn from 0.03 to 30, for formulas that are real only where numbers differ much
_TERMS = 24  #: number of terms of the series of a rotation: round-off for the angles drawn, at most 2.1 rad


def turned(vector: Value) -> Value:
    """Rotation matrix of a (complex) rotation vector, rad, by the exponential series, which keeps tiny imaginary parts exact."""
    total, term, n = np.eye(3) + 0j, np.eye(3) + 0j, cross(np.asarray(vector) + 0j)
    for i in range(1, _TERMS):
        term = term @ n / i
        total = total + term
    return total


def carried_on(Q: Value, w: Value, alpha: Value, dt: complex) -> Value:
    """Attitude after the time dt at angular velocity w + alpha t: series solution of Q' = ~(w + alpha t) Q."""
    W, A = cross(w), cross(alpha)
    terms = [Q, dt * W @ Q]
    for i in range(2, _TERMS):
        terms.append((dt * W @ terms[-1] + dt * dt * A @ terms[-2]) / i)
    return sum(terms)


def quaternion(Q: Value) -> Value:
    """Euler parameters (4, 1) of a rotation matrix, scalar part first and positive."""
    e0 = np.sqrt(1 + np.trace(Q) + 0j) / 2
    return np.vstack([[[e0]], axial(Q) / (2 * e0)])


def axial(m: Value) -> Value:
    """Axial vector (3, 1) of the skew-symmetric part of a matrix."""
    return 0.5 * np.array([[m[2, 1] - m[1, 2]], [m[0, 2] - m[2, 0]], [m[1, 0] - m[0, 1]]])


@lru_cache(maxsize=4096)
def _drawn(seed: int, name: str, kind: str, shape: tuple[int, ...] = ()) -> Value:
    """A random value, reproducible: equal seeds and names give equal values. kind: "uniform" (entries in -1.2 to 1.2), "number"
    (0.3 to 1.5, either sign) or "positive" (0.3 to 1.5); see `WIDE`."""
    rng = np.random.default_rng([seed, crc32(name.encode())])
    if kind == "uniform":
        return rng.uniform(-1.2, 1.2, shape)
    size = rng.uniform(0.3, 1.5) if seed < WIDE else np.exp(rng.uniform(np.log(0.03), np.log(30)))
    return size * (rng.choice([-1, 1]) if kind == "number" else 1)


class RandomMotion:
    """One random state in SI units, components in inertial axes. Imaginary parts are increments of a complex step."""

    symbolic = False  #: whether the quantities are symbols instead of numbers
    neutral: Mapping[str, float] = MappingProxyType({})  #: prescribed values of positive numbers, by name
    bounds: Mapping[str, tuple[float, float]] = MappingProxyType({})  #: bounds of numbers and functions of time, by name

    def __init__(self, seed: int, kind: str = "free", own: Any = (), section: str = "") -> None:
        self.seed, self.kind, self.absent = seed, kind, frozenset[str]()
        self.stepped, self.origin = False, None  # type: tuple[bool, RandomMotion | None]
        #: time (s) and arc length (m) by which this state was moved from the random one, factor of its virtual displacement
        self.clock, self.arc, self.virtual = 0j, 0j, 0j
        self.memory: dict[Any, Any] = {}
        self.link = None if kind in ("free", "clearance") else Carried(kind, own)
        self.Q = {s: turned(self.vector(f"attitude {s}")) for s in "kl"}
        self.R0 = turned(self.vector("reference attitude"))
        self.x0 = {s: self.vector(f"reference place {s}") for s in "kl"}
        self.vectors: dict[str, dict[str, Value]] = {n: {s: self.vector(f"{n} {s}") + 0j for s in "kl"} for n in VECTORS}
        #: value, first and second time derivative of every joint coordinate; free bodies have random numbers of the same names
        names = self.link.coordinates if self.link is not None else free_coordinates(section, own)
        self.coordinates: dict[str, list[Value]] = {
            name: [self.number(n + ("" if i == 0 else f" of {name}")) + 0j for n in ("phi", "phidot", "phiddot")]
            for i, name in enumerate(names)
        }

    # -- random quantities, reproducible by name and state

    def number(self, name: str) -> float:
        """A random number with absolute value between 0.3 and 1.5 and either sign, or between its bounds."""
        return self._between(name) if name in self.bounds else float(_drawn(self.seed, name, "number"))

    def positive(self, name: str) -> float:
        """A random number between 0.3 and 1.5, or between its bounds, or the value prescribed for it."""
        if name in self.neutral:
            return self.neutral[name]
        return self._between(name) if name in self.bounds else float(_drawn(self.seed, name, "positive"))

    def _between(self, name: str) -> float:
        """A random number between the bounds of a name; beyond one bound, where the other is infinite."""
        low, high = self.bounds[name]
        part = 0.5 + float(_drawn(self.seed, name, "uniform")) / 2.5  # 0.02 to 0.98
        width = 2 * max(1.0, abs(low) if np.isfinite(low) else abs(high))
        if not np.isfinite(high):
            return low + width * part
        return low + (high - low) * part if np.isfinite(low) else high - width * part

    def vector(self, name: str) -> Value:
        """A random vector (3, 1)."""
        return _drawn(self.seed, name, "uniform", (3, 1))

    def matrix(self, name: str, symmetric: bool = False) -> Value:
        """A random matrix (3, 3); symmetric ones are positive definite."""
        m = _drawn(self.seed, name, "uniform", (3, 3))
        return m @ m.T + np.eye(3) if symmetric else m

    def polynomial(self, name: str, x: complex, shape: tuple[int, ...] = (), order: int = 0) -> Value:
        """A random function of x whose first three derivatives at 0 differ from 0, or its derivative of an order; a virtual
        displacement adds another one."""
        c = _drawn(self.seed, name, "uniform", (4, *shape))
        first = self._between(name) if name in self.bounds else c[0]
        kept = [first, *c[1:]][order:]
        found = sum((x**n * k / factorial(n) for n, k in enumerate(kept)), 0 * c[0]) + 0j
        if not self.virtual or name.startswith("virtual "):
            return found
        return found + self.virtual * self.polynomial(f"virtual {name}", x, shape, order)

    def ingredient(self, name: str) -> Value:
        """A random vector (3, 1) that the derivation contains and a text may leave out: zero in states made by `without`."""
        return self.vector(name) * (name not in self.absent)

    @property
    def base(self) -> RandomMotion:
        """The state from which the complex step started."""
        return self.origin or self

    def without(self, name: str) -> RandomMotion:
        """A copy of this state in which the vector `name` is zero, one of those drawn by `ingredient`."""
        other = copy(self)
        other.absent, other.memory = self.absent | {name}, {}
        return other

    def taking(self, values: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]) -> RandomMotion:
        """A copy of this state with prescribed values of some positive numbers, and bounds of some numbers."""
        other = copy(self)
        other.neutral, other.bounds, other.memory = values, bounds, {}
        return other

    def once(self, key: Any, compute: Callable[[], T]) -> T:
        """A value of this state, computed when it is first asked for."""
        if key not in self.memory:
            self.memory[key] = compute()
        found: T = self.memory[key]
        return found

    # -- quantities of motion

    @property
    def joined(self) -> bool:
        """Whether the motion of l follows from that of k and the coordinates."""
        return self.kind != "free"

    def _l(self) -> dict[str, Value]:
        """Motion of l where the bodies are joined: "Q" and the vectors."""
        def carried() -> dict[str, Value]:
            k = {n: self.vectors[n]["k"] for n in VECTORS} | {"Q": self.Q["k"], "P": quaternion(self.Q["k"])}
            return self.link.motion(k, self) if self.link else self._apart(k)

        return self.once("l", carried)

    def _apart(self, k: dict[str, Value]) -> dict[str, Value]:
        """Motion of l turned about k's third axis, with its centre displaced in the plane normal to that axis."""
        q, u, up = (np.array([[c[i]] for c in self.coordinates.values()]) for i in range(3))
        W, A = cross(k["w"]), cross(k["alpha"])
        s = [k["Q"] @ np.vstack([p[1:], [[0]]]) for p in (q, u, up)]
        b = k["Q"] @ _E3
        return {
            "Q": k["Q"] @ turned(q[0, 0] * _E3), "x": k["x"] + s[0], "v": k["v"] + W @ s[0] + s[1],
            "a": k["a"] + (A + W @ W) @ s[0] + 2 * W @ s[1] + s[2], "w": k["w"] + u[0, 0] * b,
            "alpha": k["alpha"] + up[0, 0] * b + u[0, 0] * W @ b,
        }

    def of(self, name: str, side: str) -> Value:
        """A motion vector of a body (3, 1) by its name in VECTORS."""
        return self._l()[name] if side == "l" and self.joined else self.vectors[name][side]

    def rotation(self, side: str) -> Value:
        """Rotation matrix of a body's axes (3, 3)."""
        return self._l()["Q"] if side == "l" and self.joined else self.Q[side]

    def euler_parameters(self, side: str) -> Value:
        """Euler parameters (4, 1), continuous in time."""
        return self._l()["P"] if side == "l" and self.link else quaternion(self.rotation(side))

    @property
    def first(self) -> list[Value]:
        """The first coordinate of the joint with its first and second time derivative."""
        return next(iter(self.coordinates.values()))

    def relative_angle(self) -> Value:
        """Angle of l relative to k, rad: the joint's coordinate, or the twist about the third axes of free bodies."""
        if self.joined and "angle" in self.coordinates:
            return self.coordinates["angle"][0]
        A = self.rotation("k").T @ self.rotation("l")
        return complex_atan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])

    # -- the section of a line, at the arc length s along it

    def section(self) -> tuple[Value, Value]:
        """Position (3, 1) and attitude (3, 3) of a section, as functions of time and of arc length along the line."""
        return self.once("section", self._section)

    def _section(self) -> tuple[Value, Value]:
        r, angles = (self._field(n) for n in ("place", "angles"))
        Q = turned(self.virtual * self._field("virtual turn")) @ turned(angles[:1] * np.eye(3)[:, [0]])
        Q = Q @ turned(angles[1:2] * np.eye(3)[:, [1]]) @ turned(angles[2:] * np.eye(3)[:, [2]])
        return r + self.virtual * self._field("virtual place"), Q

    def _field(self, name: str) -> Value:
        c = [self.vector(f"section {name} {i}") for i in range(6)]
        s, t = self.arc, self.clock
        return c[0] + s * c[1] + t * c[2] + s * t * c[3] + s * s * c[4] / 2 + t * t * c[5] / 2

    # -- states reached by a step

    def moved(self, how: str, amount: complex = 1j * STEP) -> RandomMotion:
        """The state after a step. how: "virtual" displacement, "time", "line" (arc length), or "linear": every position,
        rotation, velocity and acceleration by a random increment of its own."""
        return self.once(("moved", how, amount), lambda: self._moved(how, amount))

    def _moved(self, how: str, amount: complex) -> RandomMotion:
        other = self._copy(amount)
        if how == "time":
            other._advance(amount)
        elif how == "line":
            other.arc = self.arc + amount
        else:
            other._step(self._increments(how), amount)
            other.virtual = self.virtual + amount * (how == "virtual")
        return other

    def _copy(self, amount: complex) -> RandomMotion:
        if self.stepped and np.imag(amount):
            raise NestedError("no mistake of the user: a derivative by a complex step stands inside of another, so that the "
                              "outer one is taken by finite differences")
        other = copy(self)
        other.memory = {}
        if np.imag(amount):
            other.stepped, other.origin = True, self
        other.Q, other.vectors = dict(self.Q), {n: dict(by_side) for n, by_side in self.vectors.items()}
        other.coordinates = {name: list(c) for name, c in self.coordinates.items()}
        return other

    def _advance(self, dt: complex) -> None:
        self.clock = self.clock + dt
        for s in "kl":
            x, v, a, w, alpha = (self.vectors[n][s] for n in VECTORS)
            self.Q[s] = carried_on(self.Q[s], w, alpha, dt)
            self.vectors["x"][s], self.vectors["v"][s] = x + v * dt + a * dt * dt / 2, v + a * dt
            self.vectors["w"][s] = w + alpha * dt
        for c in self.coordinates.values():
            c[0], c[1] = c[0] + c[1] * dt + c[2] * dt * dt / 2, c[1] + c[2] * dt

    def _increments(self, how: str) -> dict[str, Value]:
        known = {f"{n} {s}": self.vector(f"{how} {n} {s}") for n in ("turn", "x") for s in "kl"}
        known |= {f"coordinate {name}": self.number(f"{how} phi" + (f" of {name}" if i else ""))
                  for i, name in enumerate(self.coordinates)}
        if how == "linear":
            known |= {f"{n} {s}": self.vector(f"linear {n} {s}") for n in ("w", "alpha") for s in "kl"}
            known |= {n: self.number(f"linear {n}") for n in ("phidot", "phiddot")}
        return known

    def stepped_by(self, increments: dict[str, Value]) -> RandomMotion:
        """The state after a complex step along the increments of "turn k" (rotation), "x k", "w k", "alpha k", "phi", ..."""
        other = self._copy(1j * STEP)
        other._step(increments, 1j * STEP)
        return other

    def _step(self, increments: dict[str, Value], amount: complex) -> None:
        for name, increment in increments.items():
            what, _, side = name.partition(" ")
            step = amount * np.real(increment)
            if what == "turn":
                self.Q[side] = turned(step) @ self.Q[side]
            elif what == "coordinate":
                self.coordinates[side][0] += step
            elif side:
                self.vectors[what][side] = self.vectors[what][side] + step
            else:
                self.first[("phi", "phidot", "phiddot").index(what)] += step

    def turn_between(self, other: RandomMotion, side: str) -> Value:
        """Rotation vector (3, 1) of a body from this state to a state moved by a complex step, divided by the step."""
        return axial(np.imag(other.rotation(side)) / STEP @ np.real(self.rotation(side)).T) + 0j

    def still(self, w: Value, phidot: Value) -> RandomMotion:
        """A copy of this state with the given angular velocity of k and rate of the first coordinate, and no other motion."""
        other = self._copy(0j)
        other.vectors["w"]["k"] = w
        other.first[1] = phidot
        return other


def free_coordinates(section: str, own: Any) -> tuple[str, ...]:
    """Names of the random numbers that free bodies have in place of joint coordinates: first the coordinates of the joint that
    the section of the text names. own: the user's laws."""
    stated = tuple(getattr(joint_class(section, own), "coordinates", ()))
    return (*stated, *(name for name in ("angle", "first shift", "second shift") if name not in stated))


def checked_kind(kind: str, own: Any = ()) -> str:
    """Why a word of the text names no kind of states; empty where it names one. own: the user's laws."""
    try:
        RandomMotion(0, kind, own)
    except (SizeError, KeyError) as error:
        return str(error)
    return ""
