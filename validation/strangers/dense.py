"""The reference: Newton and Euler for every body, joints by multipliers, all dense in NumPy, steps by SciPy between the instants
at which anything jumps. Nothing of mbdae is used but the pose and the velocities with which its run starts, which are checked."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import qr
from strangers.bodies import Array, NotStatedError, World, option, world_of
from strangers.loads import Loads
from strangers.story import Input, Story

RANK = 1e-8  #: rows of constraints that depend on others to this part are left out
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
Values = dict[str, Array]


def cross(a: Array, b: Array) -> Array:
    """Row by row; faster than np.cross."""
    return np.asarray(a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1))


def dot(a: Array, b: Array) -> Array:
    """Row by row."""
    return np.einsum("...i,...i->...", a, b)


def matrices(P: Array) -> Array:
    """Of quaternions (n, 4) of any length."""
    w, x, y, z = (P / np.linalg.norm(P, axis=1)[:, None]).T
    return np.moveaxis(np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                                 [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                                 [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]), 2, 0)


class Motion:
    """Everything that is known in a state: poses and velocities of the bodies, the ground last, and of every functional its
    value, rate, row over velocities (nf, 6 (n + 1)) and the part of its acceleration that velocities cause."""

    def __init__(self, w: World, tables: Any, x: Array, R: Array, v: Array, o: Array) -> None:
        self.x, self.R, self.v, self.o = x, R, v, o
        kind, k, l, a0, b0, r0, s0 = tables
        nf, nb = len(kind), len(x)
        a, b = np.einsum("nij,nj->ni", R[k], a0), np.einsum("nij,nj->ni", R[l], b0)
        r, s = np.einsum("nij,nj->ni", R[k], r0), np.einsum("nij,nj->ni", R[l], s0)
        wk, wl = o[k], o[l]
        d = x[l] + s - x[k] - r
        cs, cr = cross(wl, s), cross(wk, r)
        dv, da = v[l] + cs - v[k] - cr, cross(wl, cs) - cross(wk, cr)  # da: without accelerations of the bodies
        at, turn = cross(wk, a), wl - wk
        u = np.where((kind == 3)[:, None], d, a)  # direction along which points are looked at
        J = np.zeros((nf, nb, 6))
        i, linear, product, angle = np.arange(nf), (kind == 0) | (kind == 3), kind == 1, kind == 2
        lin = linear[:, None]
        c = cross(a, b)
        J[i, l, :3] = np.where(lin, u, 0.0)
        J[i, k, :3] -= np.where(lin, u, 0.0)
        J[i, l, 3:] = np.where(lin, cross(s, u), np.where(product[:, None], -c, a))
        change = np.where((kind == 0)[:, None], cross(a, d), 0.0)
        J[i, k, 3:] -= np.where(lin, cross(r, u) - change, np.where(product[:, None], -c, a))
        self.J = J.reshape(nf, -1)
        self.value = np.where(kind == 0, dot(a, d), np.where(product, dot(a, b), np.where(angle, 0.0, dot(d, d) / 2)))
        self.rate = self.J @ np.concatenate([v, o], axis=1).ravel()
        along = dot(a, da) + 2 * dot(at, dv) + dot(cross(wk, at), d)
        both = dot(wk - wl, cross(at, b) + cross(a, cross(wl, b)))
        self.bias = np.where(kind == 0, along, np.where(product, both, np.where(angle, dot(at, turn), dot(d, da) + dot(dv, dv))))


class Reference:
    """Equations of a story; y holds positions, quaternions, velocities, angular velocities, coordinates of joints."""

    def __init__(self, story: Story) -> None:
        self.story, self.w = story, world_of(story)
        w = self.w
        self.n = len(w.names)
        self.tracked = list(w.coordinates)
        self.loads = Loads(story, w, self.tracked)
        rows = w.scalars.rows or [(0, self.n, self.n, *[np.zeros(3)] * 4)]
        self.tables = tuple(np.array(c) for c in zip(*rows, strict=True))
        self.A = np.zeros((len(w.constraints), len(rows)))
        for i, (weights, _) in enumerate(w.constraints):
            for j, weight in weights.items():
                self.A[i, j] += weight
        self.drives = [drive for _, drive in w.constraints]
        self.watched = np.array([w.coordinates[name] for name in self.tracked], dtype=int)
        self.kept: Array | None = None
        self.now: list[Any] = []

    # -- state

    def start(self, r: Any) -> Array:
        """The state in which a result starts; ArithmeticError where it does not fit the story's joints and statements."""
        x, v, o = ([getattr(r[name], what)[0] for name in self.w.names] for what in ("position", "velocity", "angular_velocity"))
        R = [r[name].rotation[0] for name in self.w.names]
        points = {a.name for a in self.story.of("point_mass")}
        o = [np.zeros(3) if name in points else w for name, w in zip(self.w.names, o, strict=True)]
        R = [np.eye(3) if name in points else m for name, m in zip(self.w.names, R, strict=True)]
        y = np.concatenate([np.ravel(x), np.ravel([quaternion(m) for m in R]), np.ravel(v), np.ravel(o)])
        return np.concatenate([y, self._coordinates(self.moved(y))])

    def _coordinates(self, m: Motion) -> Array:
        """Of joints, from poses: displacements are functionals, angles those of the relative rotation, within half a turn."""
        kind, k, l, a, *_ = self.tables
        found = []
        for n in self.watched:
            i, j = k[n], l[n]
            turn = m.R[i].T @ m.R[j] @ (self.w.turned[i].T @ self.w.turned[j]).T
            axial = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            found.append(np.arctan2(axial @ a[n], np.trace(turn) - 1) if kind[n] == 2 else m.value[n])
        return np.array(found)

    def moved(self, y: Array) -> Motion:
        """What the state says."""
        n = self.n
        x = np.vstack([y[: 3 * n].reshape(n, 3), np.zeros(3)])
        R = np.concatenate([matrices(y[3 * n : 7 * n].reshape(n, 4)), np.eye(3)[None]])
        v, o = (np.vstack([y[i : i + 3 * n].reshape(n, 3), np.zeros(3)]) for i in (7 * n, 10 * n))
        return Motion(self.w, self.tables, x, R, v, o)

    # -- equations

    def between(self, a: float, b: float) -> None:
        """Take the smooth pieces that hold between two instants."""
        middle = (a + b) / 2
        self.now = [None if d is None else [d.derivative(middle, k) for k in range(3)] for d in self.drives]
        self.loads.between(middle)

    def accelerations(self, t: float, m: Motion, c: Array) -> tuple[Array, Array]:
        """(6 n,) of all bodies, and the multipliers of the rows `kept`."""
        n = self.n
        Q = self.loads.forces(t, m, c)
        R = m.R[:n]
        turning = R @ self.w.inertia @ R.transpose(0, 2, 1)
        spin = np.einsum("nij,nj->ni", turning, m.o[:n])
        Q[:n, 3:] -= cross(m.o[:n], spin)
        Q[:n, :3] += self.w.mass[:, None] * np.array(self.story.gravity)
        inverse = np.zeros((n, 6, 6))
        inverse[:, [0, 1, 2], [0, 1, 2]] = 1 / self.w.mass[:, None]
        inverse[:, 3:, 3:] = np.linalg.inv(turning)
        free = np.einsum("nij,nj->ni", inverse, Q[:n]).ravel()
        if not len(self.A):
            return np.asarray(free), np.zeros(0)
        G = self.A @ m.J[:, : 6 * n]
        if self.kept is None:
            self.kept = independent(G)
        G, A = G[self.kept], self.A[self.kept]
        wanted = np.array([0.0 if d is None else d[2](t) for d in self.now])[self.kept] - A @ m.bias
        MG = np.einsum("nij,rnj->rni", inverse, G.reshape(len(G), n, 6)).reshape(len(G), -1)
        multipliers = np.linalg.solve(G @ MG.T, wanted - G @ free)
        return np.asarray(free + MG.T @ multipliers), multipliers

    def rhs(self, t: float, y: Array) -> Array:
        """Rates of the state."""
        n = self.n
        m = self.moved(y)
        a = self.accelerations(t, m, y[13 * n :])[0].reshape(n, 6)
        P, o = y[3 * n : 7 * n].reshape(n, 4), m.o[:n]
        turned = np.concatenate([-dot(P[:, 1:], o)[:, None], P[:, :1] * o + cross(o, P[:, 1:])], axis=1) / 2
        found = np.concatenate([m.v[:n].ravel(), turned.ravel(), a[:, :3].ravel(), a[:, 3:].ravel(), m.rate[self.watched]])
        if not np.isfinite(found).all():
            raise ArithmeticError(f"the reference is not finite at {t:.6g} s")
        return np.asarray(found)

    # -- runs

    def wrong_start(self, y: Array) -> float:
        """How far the start violates joints, prescribed rates and stated rates: the largest of all."""
        self.between(0.0, min([b for b in self.instants() if b > 0]))
        m = self.moved(y)
        drives = np.array([0.0 if d is None else d[1](0.0) for d in self.now])
        values = np.array([0.0 if d is None else d[0](0.0) for d in self.now])
        where = m.value.copy()
        where[self.watched] = y[13 * self.n :]  # angles and displacements, as the run counts them
        where -= np.where(self.tables[0] == 3, dot(self._drawn_d(), self._drawn_d()) / 2, 0.0)
        gaps = [self.A @ where - values, self.A @ m.rate - drives, self._held(m)]
        return float(np.max(np.abs(np.concatenate(gaps)), initial=0.0))

    def _drawn_d(self) -> Array:
        w, (_, k, l, _, _, r, s) = self.w, self.tables
        return np.asarray(w.at[l] + np.einsum("nij,nj->ni", w.turned[l], s) - w.at[k] - np.einsum("nij,nj->ni", w.turned[k], r))

    def _held(self, m: Motion) -> Array:
        """Rates stated of joints, less those of the start."""
        gaps = []
        for a in self.story.statements:
            for name in [c for c in self.tracked if c.split(".")[0] == a.name]:
                rate = a.args.get("rate0", (a.args.get("start_rate") or {}).get(name.split(".")[1]))
                gaps += [] if rate is None else [m.rate[self.w.coordinates[name]] - rate]
        return np.array(gaps, dtype=float)

    def instants(self) -> list[float]:
        """Ends of the pieces, s."""
        T = self.story.t_end
        inputs: list[Input] = self.story.inputs
        edges = {0.0, T, *(b for i in inputs for b in i.breaks), *(e for i in inputs for p in i.narrow for e in p[:2]),
                 *self.loads.instants(T)}
        inside = sorted(e for e in edges if 0 <= e <= T)
        kept = [0.0]
        kept += [b for a, b in itertools.pairwise(inside) if b - a > 1e-14 * T]
        return kept

    def solve(self, y: Array, times: Array, rtol: float) -> list[Array]:
        """States at times (nt,); ArithmeticError where SciPy gives up."""
        found, narrow = [], [p for i in self.story.inputs for p in i.narrow]
        ends = self.instants()
        if len(ends) > 3000:
            raise NotStatedError("too many pieces for the reference")
        for a, b in itertools.pairwise(ends):
            self.between(a, b)
            self.loads.sample(a, self.moved(y), y[13 * self.n :])
            longest = min([self.loads.longest, *(h for low, high, h in narrow if low < (a + b) / 2 < high)])
            s = solve_ivp(self.rhs, (a, b), y, self.loads.method, dense_output=True, rtol=rtol, atol=rtol * 1e-2,
                          max_step=longest)
            if not s.success:
                raise ArithmeticError(f"the reference failed: {s.message}")
            found += [s.sol(t) for t in times[(times >= a) & (times < b)]]
            y = s.y[:, -1]
        return [*found, *[y for _ in times[times >= ends[-1]]]]

    def shown(self, states: list[Array]) -> Values:
        """Sensors by name over the times."""
        n, found = self.n, {}
        Y = np.array(states)
        points = {a.name for a in self.story.of("point_mass")}
        for i, name in enumerate(self.w.names):
            found[f"{name}.position"] = Y[:, 3 * i : 3 * i + 3]
            found[f"{name}.velocity"] = Y[:, 7 * n + 3 * i : 7 * n + 3 * i + 3]
            if name not in points:
                found[f"{name}.rotation"] = matrices(Y[:, 3 * n + 4 * i : 3 * n + 4 * i + 4])
                found[f"{name}.angular_velocity"] = Y[:, 10 * n + 3 * i : 10 * n + 3 * i + 3]
        return found


def quaternion(R: Array) -> Array:
    """Of a rotation matrix: the eigenvector for 1 of Bar-Itzhack's matrix, without cases."""
    K = np.zeros((4, 4))
    K[0] = np.trace(R), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    K[1:, 0] = K[0, 1:]
    return np.asarray(np.linalg.eigh(K / 3)[1][:, -1])


def independent(G: Array) -> Array:
    """Numbers of rows that do not depend on others."""
    size = np.linalg.norm(G, axis=1)
    scaled = G / np.where(size > 0, size, 1.0)[:, None]
    _, R, order = qr(scaled.T, mode="economic", pivoting=True)
    d = np.abs(np.diag(R))
    return np.sort(order[: int(np.sum(d > RANK * max(1.0, d[0] if len(d) else 1.0)))])


__all__ = ["NotStatedError", "Reference", "option"]
