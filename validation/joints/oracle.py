"""Chains of rigid bodies from the ground by hand, in NumPy and SciPy alone: accelerations, joint forces and runs.

Bodies are followed from the ground outwards with positions, velocities and accelerations; these are linear in the second
derivatives of the coordinates, so that the columns of the Jacobian are the accelerations of unit second derivatives. Then

    sum over bodies of J^T (inertial - applied forces) = forces on the coordinates,

and joint forces follow from the equilibrium of all bodies further out. Nothing here is shared with the package.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from joints.kinematics import KINDS, Kind, Relative
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Wave:
    """constant + slope t + height sin(frequency t + 1), with its two derivatives."""

    constant: float = 0.0
    slope: float = 0.0
    height: float = 0.0
    frequency: float = 1.0

    def __call__(self, t: float) -> np.ndarray:
        w, s, c = self.frequency, np.sin(self.frequency * t + 1), np.cos(self.frequency * t + 1)
        value = self.constant + self.slope * t + self.height * s
        return np.array([value, self.slope + self.height * w * c, -self.height * w * w * s])


@dataclass(frozen=True)
class Link:
    """A body with the joint that carries it. Drawn, inertial frame: joint at `at` (3,) with `axes` (3, 3) in columns, centre of
    mass (3,), rotation (3, 3). inertia (3, 3) in body axes. outer: name of the joint's side k or l that is this body. By angle or
    displacement: spring, damper, load; drives: number of the coordinate -> its prescribed value."""

    kind: str
    outer: str
    at: np.ndarray
    axes: np.ndarray
    mass: float
    inertia: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    spring: np.ndarray
    damper: np.ndarray
    load: np.ndarray
    drives: dict[int, Wave] = field(default_factory=dict)

    @property
    def joint(self) -> Kind:
        """The kind of its joint."""
        return KINDS[self.kind]

    def outwards(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Relative:
        """Motion of this body's side relative to the inner side."""
        found = self.joint.motion(q, v, a)
        return found if self.outer == "l" else found.inverse


@dataclass(frozen=True)
class Moving:
    """A body in motion: turn (3, 3) from its drawn attitude, r, v, w, a, w1 (3,) of its centre of mass; inner, point: places (3,)
    of the joint's points on the body before and on this one."""

    turn: np.ndarray
    r: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    w1: np.ndarray
    inner: np.ndarray
    point: np.ndarray

    def at(self, arm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place, velocity and acceleration of a point fixed to it, arm from the centre of mass as drawn."""
        x = self.turn @ arm
        return self.r + x, self.v + np.cross(self.w, x), self.a + np.cross(self.w1, x) + np.cross(self.w, np.cross(self.w, x))


@dataclass(frozen=True)
class Chain:
    """Links from the ground outwards. gravity (3,); push: force (inertial axes) at the point `tip` of the last body as drawn;
    twist: torque on the first body along its own axes."""

    links: tuple[Link, ...]
    gravity: np.ndarray
    push: tuple[Wave, Wave, Wave]
    tip: np.ndarray
    twist: tuple[Wave, Wave, Wave]

    @cached_property
    def parts(self) -> list[tuple[slice, slice]]:
        """Of every joint: which of the positions and of the rates of the chain are its own."""
        ends = np.cumsum([link.joint.sizes for link in self.links], axis=0)
        return [tuple(slice(e - n, e) for e, n in zip(end, link.joint.sizes, strict=True))
                for end, link in zip(ends.tolist(), self.links, strict=True)]

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of positions and rates."""
        return self.parts[-1][0].stop, self.parts[-1][1].stop

    @cached_property
    def scalars(self) -> list[tuple[int, int, float, float, float]]:
        """Of every angle and displacement: number of its position and of its rate, spring, damper, load."""
        return [(at.start + i, rate.start + i, link.spring[i], link.damper[i], link.load[i])
                for link, (at, rate) in zip(self.links, self.parts, strict=True)
                for i in range(len(link.joint.scalars))]

    @cached_property
    def driven(self) -> dict[tuple[int, int], Wave]:
        """Prescribed coordinates by the numbers of their position and rate."""
        return {(at.start + i, rate.start + i): wave
                for link, (at, rate) in zip(self.links, self.parts, strict=True) for i, wave in link.drives.items()}

    def motion(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[Moving]:
        """All bodies."""
        zero = np.zeros(3)
        before, centre, found = Moving(np.eye(3), zero, zero, zero, zero, zero, zero, zero), zero, []
        for link, (at, rate) in zip(self.links, self.parts, strict=True):
            rel = link.outwards(q[at], v[rate], a[rate])
            E = before.turn @ link.axes
            place, speed, acceleration = before.at(link.at - centre)
            d, d1, d2, w, w1 = (E @ x for x in (rel.d, rel.d1, rel.d2, rel.w, rel.w1))
            wp = before.w
            turn, spin, spun = E @ rel.R @ link.axes.T, wp + w, before.w1 + np.cross(wp, w) + w1
            x = turn @ (link.centre - link.at)
            point = place + d
            velocity = speed + np.cross(wp, d) + d1
            second = acceleration + np.cross(before.w1, d) + np.cross(wp, np.cross(wp, d)) + 2 * np.cross(wp, d1) + d2
            before = Moving(turn, point + x, velocity + np.cross(spin, x), spin,
                            second + np.cross(spun, x) + np.cross(spin, np.cross(spin, x)), spun, place, point)
            centre = link.centre
            found.append(before)
        return found

    def needed(self, t: float, bodies: list[Moving]) -> np.ndarray:
        """(n, 6) force and torque about its centre of mass that a body needs beside those applied to it."""
        found = np.zeros((len(bodies), 6))
        for row, link, b in zip(found, self.links, bodies, strict=True):
            R = b.turn @ link.rotation
            J = R @ link.inertia @ R.T
            row[:3] = link.mass * (b.a - self.gravity)
            row[3:] = J @ b.w1 + np.cross(b.w, J @ b.w)
        force = np.array([wave(t)[0] for wave in self.push])
        found[-1, :3] -= force
        found[-1, 3:] -= np.cross(bodies[-1].turn @ (self.tip - self.links[-1].centre), force)
        found[0, 3:] -= bodies[0].turn @ self.links[0].rotation @ np.array([wave(t)[0] for wave in self.twist])
        return found

    def second(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Derivatives of all rates."""
        n = self.sizes[1]
        still = self.motion(q, v, np.zeros(n))
        J, rest, bias = np.zeros((n, 6 * len(self.links))), self.needed(t, still), accelerations(still)
        M, force = np.zeros_like(J), np.zeros(n)
        for i, e in enumerate(np.eye(n)):
            one = self.motion(q, v, e)
            J[i], M[i] = (accelerations(one) - bias).ravel(), (self.needed(t, one) - rest).ravel()
        for at, rate, spring, damper, load in self.scalars:
            force[rate] = load - spring * q[at] - damper * v[rate]
        mass, force, a, free = M @ J.T, force - J @ rest.ravel(), np.zeros(n), np.ones(n, dtype=bool)
        for (_, rate), wave in self.driven.items():
            a[rate], free[rate] = wave(t)[2], False
        a[free] = np.linalg.solve(mass[np.ix_(free, free)], (force - mass @ a)[free])
        return a

    def wrenches(self, t: float, bodies: list[Moving]) -> np.ndarray:
        """(n, 6) force and torque of every joint on its side l, about the point of that side."""
        found, force, needed = np.zeros((len(bodies), 6)), np.zeros(6), self.needed(t, bodies)
        for i in reversed(range(len(bodies))):  # force: on body i and those further out, torque about the origin
            b = bodies[i]
            force = force + np.r_[needed[i, :3], needed[i, 3:] + np.cross(b.r, needed[i, :3])]
            sign, point = (1, b.point) if self.links[i].outer == "l" else (-1, b.inner)
            found[i] = sign * np.r_[force[:3], force[3:] - np.cross(point, force[:3])]
        return found

    def prescribed(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q and v with the prescribed coordinates at their values."""
        q, v = q.copy(), v.copy()
        for (at, rate), wave in self.driven.items():
            q[at], v[rate] = wave(t)[:2]
        return q, v

    def run(self, q: np.ndarray, v: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and rates (nt, n) at times from the first on, by DOP853."""
        n = len(q)

        def rhs(t: float, y: np.ndarray) -> np.ndarray:
            q, v = self.prescribed(t, y[:n], y[n:])
            rates = [link.joint.rates(q[at], v[rate]) for link, (at, rate) in zip(self.links, self.parts, strict=True)]
            return np.concatenate([*rates, self.second(t, q, v)])

        found = solve_ivp(rhs, (times[0], times[-1]), np.r_[q, v], "DOP853", times, rtol=1e-11, atol=1e-12)
        return found.y[:n].T, found.y[n:].T


def accelerations(bodies: list[Moving]) -> np.ndarray:
    """(n, 6) of the centres of mass, and angular."""
    return np.array([np.r_[b.a, b.w1] for b in bodies])
