"""Bodies, joints and forces as drawn, and states of them: the data of the hand-written reference (`loops.py`)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm

GROUND = -1  #: number of the ground among the bodies: arrays over bodies have it at their end


@dataclass(frozen=True)
class Body:
    """inertia (3, 3) about the centre of mass in body axes, None of a mass point; at, rotation: as drawn."""

    name: str
    mass: float
    inertia: np.ndarray | None
    at: np.ndarray
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Input:
    """constant + slope t + height sin(frequency t + 1)."""

    constant: float = 0.0
    slope: float = 0.0
    height: float = 0.0
    frequency: float = 1.0

    def moved(self, by):
        """The same with another constant."""
        return replace(self, constant=self.constant + by)

    def __call__(self, t):
        """Value, rate and second derivative at t."""
        s, c, w = np.sin(self.frequency * t + 1), np.cos(self.frequency * t + 1), self.frequency
        return np.array([self.constant + self.slope * t + self.height * s, self.slope + self.height * w * c,
                         -self.height * w * w * s])


@dataclass(frozen=True)
class Joint:
    """A joint between bodies k and l as drawn, with what acts on its coordinate (of l relative to k about or along the axis).

    at: point of both, of distances that of k; at_l: of distances that of l; pin: of universal joints, the direction fixed to l
    that stays perpendicular to the axis, which is fixed to k."""

    kind: str
    name: str
    k: int
    l: int
    at: np.ndarray
    axis: np.ndarray
    at_l: np.ndarray | None = None
    pin: np.ndarray | None = None
    drive: Input | None = None
    spring: float = 0.0
    damper: float = 0.0
    load: float = 0.0


@dataclass(frozen=True)
class Spring:
    """Spring and damper between a point of k and a point of l."""

    name: str
    k: int
    l: int
    at: np.ndarray
    at_l: np.ndarray
    stiffness: float
    damping: float
    length: float


@dataclass(frozen=True)
class Load:
    """Force at a point of a body, or torque on it where `at` is None; following: along the body's axes."""

    name: str
    body: int
    value: tuple[Input, Input, Input]
    at: np.ndarray | None = None
    following: bool = False


@dataclass(frozen=True)
class State:
    """t; r, v, w (n + 1, 3) and R (n + 1, 3, 3) of the bodies and of the ground."""

    t: float
    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray

    def moved(self, step):
        """Displaced by (n, 6) small translations and rotations, at the same velocities."""
        r, R = self.r.copy(), self.R.copy()
        for b, d in enumerate(step):
            r[b] += d[:3]
            R[b] = expm(skew(d[3:])) @ R[b]
        return replace(self, r=r, R=R)

    def later(self, h, a):
        """The state after a time h, to the second order in positions, of accelerations a (n, 6)."""
        u = np.hstack([self.v, self.w])[:-1]
        after = np.zeros_like(np.hstack([self.v, self.w]))
        after[:-1] = u + h * a
        return replace(self.moved(h * u + h * h / 2 * a), t=self.t + h, v=after[:, :3], w=after[:, 3:])


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and forces; gravity (3,)."""

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...] = ()
    loads: tuple[Load, ...] = ()
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def drawn(self):
        """Bodies as drawn, at rest, with the ground at the end."""
        r = np.vstack([*(b.at for b in self.bodies), np.zeros(3)])
        still = np.zeros_like(r)
        return State(0.0, r, np.stack([*(b.rotation for b in self.bodies), np.eye(3)]), still, still)

    def is_point(self, b):
        """Whether a body has no orientation."""
        return b != GROUND and self.bodies[b].inertia is None

    @property
    def moving(self):
        """(6 n,) bool: which components of a velocity of all bodies exist."""
        return np.concatenate([[True] * 3 + [b.inertia is not None] * 3 for b in self.bodies])


def cross(a, b):
    """a x b, (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(a):
    """Matrix of the cross product a x."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def perpendicular(z):
    """Two unit vectors perpendicular to z and to each other."""
    x = cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return x, cross(z, x)
