"""Rigid bodies and joints in space by hand: geometric Jacobians and dense equations of motion, in NumPy and SciPy alone.

A reference for mechanisms with loops that shares nothing with the package. Every body has its centre of mass r, its rotation
matrix R, its velocity v and its angular velocity w, all in the inertial frame. A joint is a number of rows g; with u = (v, w)
of all bodies

    dg/dt = J u - speed        d2g/dt2 = J a + bias

where speed and bias hold what prescribed motions and velocities add. The equations M a + J^T lambda = f, J a = -bias are solved
by the rank of J, so that rows that follow from others do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import svd

from oracles.bodies import GROUND, cross, perpendicular, skew

RANK = 1e-7  #: singular values of rows of unit length below this count as zero


class Sides:
    """Where a joint or a spring is in a state: its points, arms and axes on both bodies, and their motion."""

    def __init__(self, mechanism, state, item):
        self.k, self.l = item.k, item.l
        drawn = mechanism.drawn
        self.turn = {side: state.R[b] @ drawn.R[b].T for side, b in (("k", item.k), ("l", item.l))}
        at_l = item.at if item.at_l is None else item.at_l
        self.arm_k = self.turn["k"] @ (item.at - drawn.r[item.k])
        self.arm_l = self.turn["l"] @ (at_l - drawn.r[item.l])
        self.wk, self.wl = state.w[item.k], state.w[item.l]
        self.d = state.r[item.l] + self.arm_l - state.r[item.k] - self.arm_k
        self.speed = (state.v[item.l] + cross(self.wl, self.arm_l)) - (state.v[item.k] + cross(self.wk, self.arm_k))
        #: relative acceleration of the points without the accelerations of the bodies
        self.centripetal = cross(self.wl, cross(self.wl, self.arm_l)) - cross(self.wk, cross(self.wk, self.arm_k))

    def on_k(self, direction):
        """A direction fixed to k, given as drawn."""
        return self.turn["k"] @ direction

    def on_l(self, direction):
        """A direction fixed to l, given as drawn."""
        return self.turn["l"] @ direction

    def along(self, c):
        """Row of c.d for c fixed in space: g, the row's parts of k and of l, bias."""
        return c @ self.d, np.r_[-c, -cross(self.arm_k, c)], np.r_[c, cross(self.arm_l, c)], c @ self.centripetal

    def along_of_k(self, c):
        """Row of c.d for c fixed to k."""
        g, k, l, bias = self.along(c)
        rate = cross(self.wk, c)
        k = k + np.r_[np.zeros(3), cross(c, self.d)]
        return g, k, l, bias + cross(self.wk, rate) @ self.d + 2 * rate @ self.speed

    def square(self, a, b):
        """Row of a.b for a fixed to k and b fixed to l."""
        n = cross(a, b)
        change = cross(cross(self.wk, a), b) + cross(a, cross(self.wl, b))
        return a @ b, np.r_[np.zeros(3), n], np.r_[np.zeros(3), -n], change @ (self.wk - self.wl)

    def apart(self, length):
        """Row of |d| - length."""
        size = np.linalg.norm(self.d)
        e = self.d / size
        _, k, l, bias = self.along(e)
        return size - length, k, l, bias + (self.speed @ self.speed - (e @ self.speed) ** 2) / size

    def about(self, z, x, y, angle):
        """Row of the angle of l about z, which is fixed to k; right where the axes of k and l are together."""
        xk, yk, xl = self.on_k(x), self.on_k(y), self.on_l(x)
        g = np.remainder(np.arctan2(yk @ xl, xk @ xl) - angle + np.pi, 2 * np.pi) - np.pi
        return g, np.r_[np.zeros(3), -z], np.r_[np.zeros(3), z], cross(self.wk, z) @ (self.wl - self.wk)


def rows_of(mechanism, state, joint):
    """Rows (g, part of k, part of l, bias, speed) of a joint."""
    s = Sides(mechanism, state, joint)
    z = joint.axis / np.linalg.norm(joint.axis)
    x, y = perpendicular(z)
    xk, yk, zk = s.on_k(x), s.on_k(y), s.on_k(z)
    rows = []
    if joint.kind == "distance":
        rows.append(s.apart(np.linalg.norm(joint.at_l - joint.at)))
    elif joint.kind == "prismatic":
        rows += [s.along_of_k(xk), s.along_of_k(yk)]
    elif joint.kind != "fixed_orientation":
        rows += [s.along(e) for e in np.eye(3)]
    if not (mechanism.is_point(joint.k) or mechanism.is_point(joint.l)):
        if joint.kind in ("revolute", "prismatic", "weld", "fixed_orientation"):
            rows += [s.square(zk, s.on_l(x)), s.square(zk, s.on_l(y))]
        if joint.kind in ("prismatic", "weld", "fixed_orientation"):
            rows.append(s.square(xk, s.on_l(y)))
        if joint.kind == "universal":
            rows.append(s.square(zk, s.on_l(joint.pin)))
    rows = [(*row, 0.0) for row in rows]
    if joint.drive is not None:
        value, rate, second = joint.drive(state.t)
        g, k, l, bias = s.about(zk, x, y, value) if joint.kind == "revolute" else s.along_of_k(zk)
        rows.append((g if joint.kind == "revolute" else g - value, k, l, bias - second, rate))
    return rows


def coordinate(mechanism, state, joint, a=None):
    """Angle or displacement of a joint, its rate, and, of accelerations a (n, 6), its acceleration."""
    s = Sides(mechanism, state, joint)
    z = joint.axis / np.linalg.norm(joint.axis)
    row = s.about(s.on_k(z), *perpendicular(z), 0.0) if joint.kind == "revolute" else s.along_of_k(s.on_k(z))
    return followed(mechanism, state, joint, row, a)


def displacement(mechanism, state, joint, direction, a=None):
    """The same of the way of l's point along a direction fixed to k, given as drawn."""
    s = Sides(mechanism, state, joint)
    return followed(mechanism, state, joint, s.along_of_k(s.on_k(direction)), a)


def followed(mechanism, state, joint, row, a):
    """Value of a row without its inputs, its rate, and, of accelerations a (n, 6), its second derivative."""
    g, k, l, bias = row
    u, ud = np.hstack([state.v, state.w]), np.zeros((len(mechanism.bodies) + 1, 6))
    ud[:-1] = 0.0 if a is None else a
    return g, k @ u[joint.k] + l @ u[joint.l], k @ ud[joint.k] + l @ ud[joint.l] + bias


@dataclass(frozen=True)
class Constraints:
    """g, bias and speed (m,), J (m, 6 n) of all joints; owner (m,): number of the joint of every row; driven (m,): prescribed."""

    g: np.ndarray
    J: np.ndarray
    bias: np.ndarray
    speed: np.ndarray
    owner: np.ndarray
    driven: np.ndarray


def constraints(mechanism, state):
    """All rows of a mechanism."""
    n = len(mechanism.bodies)
    found = [(i, joint, row) for i, joint in enumerate(mechanism.joints) for row in rows_of(mechanism, state, joint)]
    J = np.zeros((len(found), n + 1, 6))
    for line, (_, joint, (_, k, l, _, _)) in zip(J, found, strict=True):
        line[joint.k] += k
        line[joint.l] += l
    J = J[:, :n].reshape(len(found), 6 * n) * mechanism.moving
    g, bias, speed = (np.array([row[i] for *_, row in found], dtype=float) for i in (0, 3, 4))
    owner = np.array([i for i, *_ in found], dtype=int)
    last = np.r_[owner[1:] != owner[:-1], True][: len(owner)]
    return Constraints(g, J, bias, speed, owner, last & np.array([joint.drive is not None for _, joint, _ in found], dtype=bool))


def inertia(mechanism, state):
    """M (6 n, 6 n); rotations of mass points, which do not exist, have 1."""
    M = np.eye(6 * len(mechanism.bodies))
    for i, b in enumerate(mechanism.bodies):
        M[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] *= b.mass
        if b.inertia is not None:
            M[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = state.R[i] @ b.inertia @ state.R[i].T
    return M


def on_coordinate(mechanism, state, joint):
    """Force (6,) on l at its point, of spring, damper and load of a joint: force and torque about that point."""
    c, rate, _ = coordinate(mechanism, state, joint)
    z = state.R[joint.k] @ mechanism.drawn.R[joint.k].T @ joint.axis / np.linalg.norm(joint.axis)
    size = joint.load - joint.spring * c - joint.damper * rate
    return np.r_[np.zeros(3), size * z] if joint.kind == "revolute" else np.r_[size * z, np.zeros(3)]


def forces(mechanism, state):
    """f (6 n,): applied forces and torques about the centres of mass, and gyroscopic torques."""
    f = np.zeros((len(mechanism.bodies) + 1, 6))

    def act(body, force, torque, point):
        f[body] += np.r_[force, torque + cross(point - state.r[body], force)]

    for i, b in enumerate(mechanism.bodies):
        f[i, :3] += b.mass * mechanism.gravity
        if b.inertia is not None:
            f[i, 3:] -= cross(state.w[i], state.R[i] @ b.inertia @ state.R[i].T @ state.w[i])
    for joint in mechanism.joints:
        if joint.spring or joint.damper or joint.load:
            wrench = on_coordinate(mechanism, state, joint)
            point = state.r[joint.l] + Sides(mechanism, state, joint).arm_l
            act(joint.l, wrench[:3], wrench[3:], point)
            act(joint.k, -wrench[:3], -wrench[3:], point)
    for spring in mechanism.springs:
        s = Sides(mechanism, state, spring)
        size = np.linalg.norm(s.d)
        e = s.d / size
        pull = -(spring.stiffness * (size - spring.length) + spring.damping * (s.speed @ e)) * e
        act(spring.l, pull, np.zeros(3), state.r[spring.l] + s.arm_l)
        act(spring.k, -pull, np.zeros(3), state.r[spring.k] + s.arm_k)
    for load in mechanism.loads:
        value = np.array([part(state.t)[0] for part in load.value])
        value = state.R[load.body] @ value if load.following else value
        if load.at is None:
            f[load.body, 3:] += value
        else:
            turn = state.R[load.body] @ mechanism.drawn.R[load.body].T
            act(load.body, value, np.zeros(3), state.r[load.body] + turn @ (load.at - mechanism.drawn.r[load.body]))
    return f[:-1].ravel() * mechanism.moving


def decomposed(J):
    """Left and right singular vectors of the rows, each of unit length, their rank, their lengths and all singular values."""
    lengths = np.linalg.norm(J, axis=1)
    lengths[lengths == 0] = 1.0
    left, sizes, right = svd(J / lengths[:, None]) if len(J) else (np.eye(0), np.zeros(0), np.eye(J.shape[1]))
    return left, right, int(np.sum(sizes > RANK)), lengths, sizes


@dataclass(frozen=True)
class Motion:
    """a (n, 6); wrench (joints, 6): force and torque of every joint on its body l about its point there, with what acts on its
    coordinate; unique (joints, 6) bool: whether redundant rows leave that component of it open; rank and number of the rows;
    smallest: singular value that counts; contradiction: by how much dependent rows contradict each other."""

    a: np.ndarray
    wrench: np.ndarray
    unique: np.ndarray
    rank: int
    rows: int
    smallest: float
    contradiction: float


def solve(mechanism, state):
    """Accelerations and reactions in a state that satisfies the constraints."""
    c, M, f = constraints(mechanism, state), inertia(mechanism, state), forces(mechanism, state)
    left, right, rank, lengths, sizes = decomposed(c.J)
    B, bias = c.J / lengths[:, None], c.bias / lengths
    span, free, null = right[:rank], right[rank:], left[:, rank:]
    particular = -span.T @ ((left[:, :rank].T @ bias) / sizes[:rank])
    a = particular + free.T @ np.linalg.solve(free @ M @ free.T, free @ (f - M @ particular))
    multipliers = left[:, :rank] @ ((span @ (f - M @ a)) / sizes[:rank])
    wrench, unique = np.zeros((len(mechanism.joints), 6)), np.zeros((len(mechanism.joints), 6), dtype=bool)
    for i, joint in enumerate(mechanism.joints):
        own, side, sign = c.owner == i, joint.l, -1.0
        if side == GROUND:
            side, sign = joint.k, 1.0
        s = Sides(mechanism, state, joint)
        point = state.r[joint.l] + s.arm_l - state.r[side]
        to_point = sign * np.block([[np.eye(3), np.zeros((3, 3))], [-skew(point), np.eye(3)]])
        on_l = to_point @ B[own][:, 6 * side : 6 * side + 6].T
        wrench[i], unique[i] = on_l @ multipliers[own], np.max(np.abs(on_l @ null[own]), axis=1, initial=0.0) < 1e-6
        if joint.spring or joint.damper or joint.load:
            wrench[i] += on_coordinate(mechanism, state, joint)
    contradiction = float(np.max(np.abs(null.T @ bias), initial=0.0))
    return Motion(a.reshape(-1, 6), wrench, unique, rank, len(B), float(sizes[rank - 1]) if rank else 1.0, contradiction)


def closed(mechanism, state, driven=True):
    """The state with its positions moved until every joint closes; driven: also those prescribed."""
    for _ in range(50):
        c = constraints(mechanism, state)
        kept = driven | ~c.driven
        if np.max(np.abs(c.g[kept]), initial=0.0) < 1e-13:
            break
        state = state.moved(np.linalg.lstsq(c.J[kept], -c.g[kept], rcond=RANK)[0].reshape(-1, 6))
    return state


def projected(mechanism, state):
    """The state with the nearest velocities that satisfy the joints."""
    c, u = constraints(mechanism, state), np.hstack([state.v, state.w])
    u[:-1] += np.linalg.lstsq(c.J, c.speed - c.J @ u[:-1].ravel(), rcond=RANK)[0].reshape(-1, 6)
    return replace(state, v=u[:, :3], w=u[:, 3:])


def freedoms(mechanism, state, rng, samples=3):
    """Degrees of freedom and number of redundant rows: by the largest rank of all rows at a consistent position and at others,
    which are reached with the drives let go."""
    here = constraints(mechanism, state)
    ranks = [decomposed(here.J)[2]]
    _, right, rank, _, _ = decomposed(here.J[~here.driven])
    for _ in range(samples if rank < np.sum(mechanism.moving) else 0):
        direction = (right[rank:] * mechanism.moving).T @ rng.normal(size=right.shape[1] - rank)
        away = closed(mechanism, state.moved(0.1 * direction.reshape(-1, 6) / np.max(np.abs(direction))), driven=False)
        c = constraints(mechanism, away)
        if np.max(np.abs(c.g[~c.driven]), initial=0.0) < 1e-10:
            ranks.append(decomposed(c.J)[2])
    return int(np.sum(mechanism.moving)) - max(ranks), len(here.J) - max(ranks)


def energy(mechanism, state):
    """Kinetic and potential energy, J."""
    u = np.hstack([state.v, state.w])[:-1].ravel() * mechanism.moving
    total = u @ inertia(mechanism, state) @ u / 2
    total -= sum(b.mass * mechanism.gravity @ state.r[i] for i, b in enumerate(mechanism.bodies))
    total += sum(j.spring * coordinate(mechanism, state, j)[0] ** 2 / 2 for j in mechanism.joints if j.spring)
    for spring in mechanism.springs:
        total += spring.stiffness * (np.linalg.norm(Sides(mechanism, state, spring).d) - spring.length) ** 2 / 2
    return total
