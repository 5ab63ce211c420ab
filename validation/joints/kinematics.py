"""Motion of l relative to k in every kind of joint by hand: position, velocity and acceleration, components along the axes of k.

Written as a textbook does it: the axis of a rate in its place, and the products of rates (centripetal, Coriolis) beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

X, Y, Z = np.eye(3)
LEAD, STROKE = 0.3, 0.25  #: m a turn of the screw; m, largest travel of the cam


@dataclass(frozen=True)
class Relative:
    """d, R: point and axes of l; d1, w: their rates; d2, w1: their accelerations. All (3,) along the axes of k, R (3, 3)."""

    d: np.ndarray
    R: np.ndarray
    d1: np.ndarray
    w: np.ndarray
    d2: np.ndarray
    w1: np.ndarray

    @property
    def inverse(self) -> Relative:
        """The motion of k relative to l, along the axes of l."""
        B, w, d = self.R.T, self.w, self.d
        turning = np.cross(w, np.cross(w, d) - self.d1)
        return Relative(-B @ d, B, B @ (np.cross(w, d) - self.d1), -B @ w,
                        B @ (np.cross(self.w1, d) + np.cross(w, self.d1) - self.d2 - turning), -B @ self.w1)


def about(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about x, y or z."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def revolute(q, v, a):
    return Relative(0 * X, about(2, q[0]), 0 * X, Z * v[0], 0 * X, Z * a[0])


def prismatic(q, v, a):
    return Relative(Z * q[0], np.eye(3), Z * v[0], 0 * X, Z * a[0], 0 * X)


def cylindrical(q, v, a):
    return Relative(Z * q[0], about(2, q[1]), Z * v[0], Z * v[1], Z * a[0], Z * a[1])


def screw(q, v, a):
    h = LEAD / (2 * np.pi)
    return Relative(Z * h * q[0], about(2, q[0]), Z * h * v[0], Z * v[0], Z * h * a[0], Z * a[0])


def universal(q, v, a):
    """First about x of k, then about the pin y, which the first rotation has turned."""
    A = about(0, q[0])
    pin = A @ Y
    return Relative(0 * X, A @ about(1, q[1]), 0 * X, X * v[0] + pin * v[1], 0 * X,
                    X * a[0] + pin * a[1] + np.cross(X, pin) * v[0] * v[1])


def planar(q, v, a):
    return Relative(np.r_[q[:2], 0], about(2, q[2]), np.r_[v[:2], 0], Z * v[2], np.r_[a[:2], 0], Z * a[2])


def cam(q, v, a):
    """A slide along the turning x axis that a cam moves: STROKE sin(2 angle)."""
    R = about(2, q[0])
    out, across = R @ X, R @ Y
    r, r1, r2 = STROKE * np.sin(2 * q[0]), 2 * STROKE * np.cos(2 * q[0]), -4 * STROKE * np.sin(2 * q[0])
    d1 = (out * r1 + across * r) * v[0]
    d2 = out * (r1 * a[0] + (r2 - r) * v[0] ** 2) + across * (r * a[0] + 2 * r1 * v[0] ** 2)
    return Relative(out * r, R, d1, Z * v[0], d2, Z * a[0])


def boom(q, v, a):
    """An arm that swings about y and reaches out along its own z."""
    R = about(1, q[0])
    out, up = R @ Z, R @ X
    d2 = out * (a[1] - q[1] * v[0] ** 2) + up * (q[1] * a[0] + 2 * v[1] * v[0])
    return Relative(out * q[1], R, out * v[1] + up * q[1] * v[0], Y * v[0], d2, Y * a[0])


def matrix(P: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion, scalar first: R x = (e0^2 - e.e) x + 2 e (e.x) + 2 e0 e x x."""
    e0, e = P[0], P[1:]
    return (e0**2 - e @ e) * np.eye(3) + 2 * np.outer(e, e) + 2 * e0 * np.cross(e, np.eye(3)).T


def spherical(q, v, a):
    """Rates: the angular velocity along the axes of l."""
    R = matrix(q)
    return Relative(0 * X, R, 0 * X, R @ v, 0 * X, R @ a)


def free(q, v, a):
    R = matrix(q[3:])
    return Relative(q[:3], R, v[:3], R @ v[3:], a[:3], R @ a[3:])


def point_on_line(q, v, a):
    R = matrix(q[1:])
    return Relative(Z * q[0], R, Z * v[0], R @ v[1:], Z * a[0], R @ a[1:])


def point_on_plane(q, v, a):
    R = matrix(q[2:])
    return Relative(np.r_[q[:2], 0], R, np.r_[v[:2], 0], R @ v[2:], np.r_[a[:2], 0], R @ a[2:])


def fixed_orientation(q, v, a):
    return Relative(q, np.eye(3), v, 0 * X, a, 0 * X)


@dataclass(frozen=True)
class Kind:
    """A kind of joint: names and units of its coordinates, its motion. A rotation, which comes last, is a quaternion with the
    angular velocity along the axes of l as its rates."""

    coordinates: dict[str, str]
    motion: Callable[..., Relative]

    @property
    def rotates(self) -> bool:
        """Whether it has a rotation."""
        return "rotation" in self.coordinates.values()

    @property
    def scalars(self) -> list[str]:
        """Names of its angles and displacements."""
        return [name for name, unit in self.coordinates.items() if unit != "rotation"]

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of its positions and of its rates."""
        n = len(self.scalars)
        return n + 4 * self.rotates, n + 3 * self.rotates

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Derivatives of its positions."""
        if not self.rotates:
            return v
        P, W = q[-4:], v[-3:]
        return np.r_[v[:-3], np.r_[-P[1:] @ W, P[0] * W + np.cross(P[1:], W)] / 2]


KINDS = {
    "revolute": Kind({"angle": "rad"}, revolute),
    "prismatic": Kind({"displacement": "m"}, prismatic),
    "cylindrical": Kind({"displacement": "m", "angle": "rad"}, cylindrical),
    "screw": Kind({"angle": "rad"}, screw),
    "universal": Kind({"angle_k": "rad", "angle_l": "rad"}, universal),
    "planar": Kind({"x": "m", "y": "m", "angle": "rad"}, planar),
    "spherical": Kind({"rotation": "rotation"}, spherical),
    "free": Kind({"x": "m", "y": "m", "z": "m", "rotation": "rotation"}, free),
    "point_on_line": Kind({"displacement": "m", "rotation": "rotation"}, point_on_line),
    "point_on_plane": Kind({"x": "m", "y": "m", "rotation": "rotation"}, point_on_plane),
    "fixed_orientation": Kind({"x": "m", "y": "m", "z": "m"}, fixed_orientation),
    "cam": Kind({"turn": "rad"}, cam),
    "boom": Kind({"swing": "rad", "reach": "m"}, boom),
}
