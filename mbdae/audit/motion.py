"""Random states of motion of two bodies k and l, in which the symbols of a printed formula are evaluated.

Three kinds: "free" (two independent bodies), "revolute" (l turns about k's third axis, its motion follows
from k's and the relative angle) and "clearance" (the same, the centres apart in the plane normal to that axis).
"""

from __future__ import annotations

from copy import copy
from typing import Any
from zlib import crc32

import numpy as np

from mbdae.audit.evaluate import STEP, SizeError, Value, cross
from mbdae.symbolic.functions import complex_atan2

KINDS = ("free", "revolute", "clearance")
_E3 = np.array([[0.0], [0.0], [1.0]])
#: independent vectors of each body: position, velocity, acceleration, angular velocity, angular acceleration
VECTORS = ("x", "v", "a", "w", "alpha")


def turned(vector: Value) -> Value:
    """Rotation matrix of a real rotation vector, rad."""
    angle = float(np.linalg.norm(np.real(vector)))
    n = cross(np.asarray(vector) / angle)
    return np.eye(3) + np.sin(angle) * n + (1 - np.cos(angle)) * n @ n


def about_axis(phi: Value) -> Value:
    """Rotation by a (complex) angle about the third axis."""
    c, s = np.cos(phi), np.sin(phi)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def axial(m: Value) -> Value:
    """The vector of the skew part of a matrix."""
    return 0.5 * np.array([[m[2, 1] - m[1, 2]], [m[0, 2] - m[2, 0]], [m[1, 0] - m[0, 1]]])


class Motion:
    """One random state, SI units, inertial components. Imaginary parts of its quantities are increments of a complex step."""

    def __init__(self, seed: int, kind: str = "free") -> None:
        self.seed, self.kind, self.absent = seed, kind, frozenset[str]()
        self.stepped, self.origin = False, None  # type: tuple[bool, Motion | None]
        self.memory: dict[Any, Any] = {}
        self.symbolic = False  #: whether its quantities are symbols
        self.Q = {s: turned(self.vector(f"attitude {s}")) + 0j for s in "kl"}
        self.R0 = turned(self.vector("reference attitude"))
        self.x0 = {s: self.vector(f"reference place {s}") for s in "kl"}
        self.vectors: dict[str, dict[str, Value]] = {n: {s: self.vector(f"{n} {s}") + 0j for s in "kl"} for n in VECTORS}
        self.phi, self.phidot, self.phiddot = (self.number(n) + 0j for n in ("phi", "phidot", "phiddot"))
        if kind != "free":
            self._join()

    def _join(self) -> None:
        shift = 0.0 * _E3 if self.kind == "revolute" else self.vector("shift") * np.array([[1.0], [1.0], [0.0]])
        self.vectors["x"]["l"] = self.vectors["x"]["k"] + self.Q["k"] @ shift

    # -- random quantities, the same for the same name and state

    def _rng(self, name: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, crc32(name.encode())])

    def number(self, name: str) -> float:
        """A number between 0.3 and 1.5 of either sign."""
        rng = self._rng(name)
        return float(rng.uniform(0.3, 1.5) * rng.choice([-1, 1]))

    def positive(self, name: str) -> float:
        """A number between 0.3 and 1.5."""
        return float(self._rng(name).uniform(0.3, 1.5))

    def vector(self, name: str) -> Value:
        """A vector."""
        return self._rng(name).uniform(-1.2, 1.2, (3, 1))

    def matrix(self, name: str, symmetric: bool = False) -> Value:
        """A 3 x 3 matrix; symmetric: positive definite."""
        m = self._rng(name).uniform(-1.0, 1.0, (3, 3))
        return m @ m.T + np.eye(3) if symmetric else m

    def ingredient(self, name: str) -> Value:
        """A vector that a derivation contains and the text may not name; zero in a state made by `without`."""
        return self.vector(name) * (name not in self.absent)

    @property
    def base(self) -> Motion:
        """The state before the complex step."""
        return self.origin or self

    def without(self, name: str) -> Motion:
        """The same state with that vector zero."""
        other = copy(self)
        other.absent, other.memory = self.absent | {name}, {}
        return other

    # -- quantities of motion

    @property
    def joined(self) -> bool:
        """Whether the rotation of l follows from that of k and the relative angle."""
        return self.kind != "free"

    def rotation(self, side: str) -> Value:
        """Attitude of a body's axes."""
        return self.Q["k"] @ about_axis(self.phi) if side == "l" and self.joined else self.Q[side]

    def _turning(self) -> tuple[Value, Value]:
        """First and second time derivative of l's attitude, by the product rule."""
        w, alpha, Q = cross(self.vectors["w"]["k"]), cross(self.vectors["alpha"]["k"]), self.Q["k"]
        e, P = cross(_E3), about_axis(self.phi)
        dP, ddP = self.phidot * e @ P, (self.phiddot * e + self.phidot**2 * e @ e) @ P
        dQ, ddQ = w @ Q, (alpha + w @ w) @ Q
        return dQ @ P + Q @ dP, ddQ @ P + 2 * dQ @ dP + Q @ ddP

    def angular_velocity(self, side: str) -> Value:
        """Angular velocity, inertial."""
        if side == "k" or not self.joined:
            return self.vectors["w"][side]
        return axial(self._turning()[0] @ self.rotation("l").T)

    def angular_acceleration(self, side: str) -> Value:
        """Angular acceleration, inertial."""
        if side == "k" or not self.joined:
            return self.vectors["alpha"][side]
        first, second = self._turning()
        return axial(second @ self.rotation("l").T + first @ first.T)

    def relative_angle(self) -> Value:
        """Angle of l relative to k: the twist about the third axes of free bodies, or the joint's coordinate, rad."""
        if self.joined:
            return self.phi
        A = self.rotation("k").T @ self.rotation("l")
        return complex_atan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])

    def relative_rate(self) -> Value:
        """Rate of the relative angle, rad/s."""
        return self.phidot if self.joined else np.imag(self.moved("time").relative_angle()) / STEP + 0j

    # -- increments

    def moved(self, how: str) -> Motion:
        """The state after an imaginary step: "virtual" displacement, "time", or "linear" (all quantities independently)."""
        return self.stepped_by(self._increments(how), how)

    def _increments(self, how: str) -> dict[str, Value]:
        if how == "time":
            known = {f"turn {s}": self.vectors["w"][s] for s in "kl"} | {f"x {s}": self.vectors["v"][s] for s in "kl"}
            return known | {"phi": self.phidot, "phidot": self.phiddot, "w k": self.vectors["alpha"]["k"]}
        known = {f"turn {s}": self.vector(f"{how} turn {s}") for s in "kl"}
        known |= {f"x {s}": self.vector(f"{how} x {s}") for s in "kl"} | {"phi": self.number(f"{how} phi")}
        if how == "linear":
            known |= {f"{n} {s}": self.vector(f"linear {n} {s}") for n in ("w", "alpha") for s in "kl"}
            known |= {n: self.number(f"linear {n}") for n in ("phidot", "phiddot")}
        return known

    def stepped_by(self, increments: dict[str, Value], key: Any = None) -> Motion:
        """The state after i STEP times the increments of "turn k" (rotation), "x k", "w k", "alpha k", "phi", ..."""
        if self.stepped:
            raise SizeError("a derivative of a derivative is not a complex step")
        if key is not None and ("moved", key) in self.memory:
            return self.memory["moved", key]  # type: ignore[no-any-return]
        other = copy(self)
        other.stepped, other.origin, other.memory = True, self, {}
        other.Q, other.vectors = dict(self.Q), {n: dict(by_side) for n, by_side in self.vectors.items()}
        for name, increment in increments.items():
            what, _, side = name.partition(" ")
            step = 1j * STEP * np.real(increment)
            if what == "turn":
                other.Q[side] = other.Q[side] + cross(step) @ self.Q[side]
            elif side:
                other.vectors[what][side] = other.vectors[what][side] + step
            else:
                setattr(other, what, getattr(self, what) + step)
        if key is not None:
            self.memory["moved", key] = other
        return other

    def turn_between(self, other: Motion, side: str) -> Value:
        """Rotation of a body from this state to a state moved by a complex step."""
        return axial(np.imag(other.rotation(side)) / STEP @ np.real(self.rotation(side)).T) + 0j
