"""Scenes at random with discs, balls and blades on the ground or on a table that turns, and their motion by own equations.

They are those of Newton and Euler for every body, with rows of velocities at the points that touch, solved for accelerations and
forces together, by DOP853 of SciPy. A scene may be stated turned and moved as a whole, and backwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rolling.own import TIGHT
from scipy.integrate import solve_ivp

import mbdae as mb

Array = NDArray[Any]
T_END, COUNT = 1.0, 21
KINDS = ("disc", "ball", "blade")
STEP = 1e-30  #: of the complex step along the motion by which rows are differentiated


def direction(rng: Any) -> Array:
    """A unit vector (3,) at random."""
    a = rng.normal(size=3)
    return np.asarray(a / np.linalg.norm(a))


def skew(a: Array) -> Array:
    """a~ (3, 3)."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


class Drawn:
    """A scene drawn by a seed: numbers of its bodies and of what rolls, with consistent velocities."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([47, seed])
        self.g = 9.81 * direction(rng)
        self.table = seed % 3 == 0
        self.axis, self.pivot, rate = direction(rng), rng.uniform(-0.2, 0.2, 3), rng.uniform(-2, 2)
        self.bodies: list[dict[str, Any]] = []
        if self.table:
            at = rng.uniform(-0.3, 0.3, 3)
            w = rate * self.axis
            self._body(rng, "table", 5.0, at, np.cross(w, at - self.pivot), w)
        self.rollers = []
        for i in range(1 + seed % 2):
            kind, n, at, spin = KINDS[int(rng.integers(3))], direction(rng), rng.uniform(-1, 1, 3), rng.uniform(-4, 4, 3)
            a = direction(rng)
            a = a if abs(a @ n) < 0.8 else np.cross(n, direction(rng))
            a = a - (a @ n) * n if kind == "blade" else a  # a blade is drawn along its plane
            a = a / np.linalg.norm(a)
            one = {"name": f"roller {i}", "kind": kind, "n": n, "a": a, "radius": float(rng.uniform(0.1, 0.3)),
                   "l": len(self.bodies)}
            self._body(rng, f"body {i}", float(rng.uniform(0.5, 2)), at, np.zeros(3), spin)
            self.rollers.append(one)
            self._let_roll(one, rng)
        self.springs = [(None, one["l"], rng.uniform(-1.5, 1.5, 3), *rng.uniform((5, 0), (20, 0.5))) for one in self.rollers]
        if len(self.rollers) == 2:
            self.springs.append((*(one["l"] for one in self.rollers), None, *rng.uniform((5, 0), (20, 0.5))))
        self.push = 5 * direction(rng)

    def _body(self, rng: Any, name: str, mass: float, at: Array, v: Array, w: Array) -> None:
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        R = R * np.sign(np.linalg.det(R))
        J = mass * 0.02 * np.array([1.0, 1.0, 1.0]) * rng.uniform(0.7, 1.2, 3)
        self.bodies.append({"name": name, "mass": mass, "J": np.diag(J), "at": at, "R": R, "v": v, "w": w})

    def _let_roll(self, one: dict[str, Any], rng: Any) -> None:
        """A velocity of the roller that satisfies its rows."""
        b, k = self.bodies[one["l"]], self.bodies[0] if self.table else None
        carried = k["v"] + np.cross(k["w"], b["at"] - k["at"]) if k else np.zeros(3)
        if one["kind"] == "blade":
            across = np.cross(one["n"], one["a"])
            v = rng.uniform(-1, 1, 3)
            b["v"] = carried + v - across * (across @ v) / (across @ across)
            return
        arm = self.arm(one, one["n"], one["a"])
        w = k["w"] if k else np.zeros(3)
        b["v"] = carried + np.cross(w, arm) - np.cross(b["w"], arm)

    @staticmethod
    def arm(one: dict[str, Any], n: Array, a: Array) -> Array:
        """From the centre to the point that touches."""
        if one["kind"] == "ball":
            return np.asarray(-one["radius"] * n)
        s = np.sum(n * a)
        return np.asarray((a * s - n) * one["radius"] / np.sqrt(1 - s * s))

    # -- as a scene

    def scene(self, Q: Array | None = None, by: Any = (0, 0, 0), backwards: bool = False, model: Any = None) -> Any:
        """The scene, turned by Q (3, 3) and moved by `by` (m); backwards: bodies, then forces, then joints, each in reverse."""
        Q, by = np.eye(3) if Q is None else Q, np.asarray(by)
        s = mb.Scene("drawn", gravity=Q @ self.g)
        made: dict[str, Any] = {}

        def body(b: dict[str, Any]) -> None:
            made[b["name"]] = s.rigid_body(b["name"], b["mass"], b["J"], at=Q @ b["at"] + by, rotation=Q @ b["R"],
                                           velocity=Q @ b["v"], angular_velocity=Q @ b["w"])

        def of(i: int | None) -> Any:
            return s.ground if i is None else made[self.bodies[i]["name"]]

        def roll(one: dict[str, Any]) -> None:
            k, l, at = s.ground if not self.table else of(0), of(one["l"]), Q @ self.bodies[one["l"]]["at"] + by
            if one["kind"] == "blade":
                s.knife_edge(one["name"], k, l, at=at, along=Q @ one["a"], normal=Q @ one["n"])
            else:
                axis = Q @ one["a"] if one["kind"] == "disc" else None
                s.rolling(one["name"], k, l, at=at, axis=axis, radius=one["radius"], normal=Q @ one["n"])

        def spring(i: int, one: Any) -> None:
            k, l, at, stiffness, damping = one
            at_k = at if k is None else self.bodies[k]["at"]
            s.spring(f"spring {i}", of(k), of(l), Q @ at_k + by, Q @ self.bodies[l]["at"] + by, stiffness, damping=damping)

        every: list[Callable[[], Any]] = [lambda i=i, one=one: spring(i, one) for i, one in enumerate(self.springs)]
        every.append(lambda: s.force("push", of(self.rollers[0]["l"]), tuple(Q @ self.push * mb.t)))
        every += [lambda one=one: roll(one) for one in self.rollers]
        if self.table:
            every.append(lambda: s.revolute("shaft", s.ground, of(0), at=Q @ self.pivot + by, axis=Q @ self.axis, spring=3.0,
                                            damper=0.1, model=model))
        for b in reversed(self.bodies) if backwards else self.bodies:
            body(b)
        for state in reversed(every) if backwards else every:
            state()
        return s

    # -- by equations of one's own

    def rows(self, r: Array, R: Array) -> Array:
        """A (rows, 6 bodies) of A u = 0; r (bodies, 3), R (bodies, 3, 3), real or complex; u: v and w of every body."""
        n, found = len(self.bodies), []

        def row(*parts: tuple[int, Array, Array]) -> Array:
            A = np.zeros((3, 6 * n), dtype=R.dtype)
            for i, V, W in parts:
                A[:, 6 * i : 6 * i + 6] += np.hstack([V, W])
            return A

        for one in self.rollers:
            i, turn = one["l"], R[0] @ self.bodies[0]["R"].T if self.table else np.eye(3)
            nz, a = turn @ one["n"], R[i] @ self.bodies[i]["R"].T @ one["a"]
            arm = np.zeros(3) if one["kind"] == "blade" else self.arm(one, nz, a)
            parts = [(i, np.eye(3), -skew(arm))]
            if self.table:
                parts.append((0, -np.eye(3), skew(r[i] + arm - r[0])))
            A = row(*parts)
            found.append((np.cross(nz, a)[None] @ A) if one["kind"] == "blade" else A)
        if self.table:
            s = r[0] - self.pivot
            found.append(row((0, np.eye(3), skew(s))))
            e = np.linalg.svd(self.axis[None])[2][1:]
            found.append(np.hstack([np.zeros((2, 3)), e, np.zeros((2, 6 * n - 6))]).astype(R.dtype))
        return np.vstack(found)

    def loads(self, t: float, r: Array, R: Array, v: Array, w: Array) -> Array:
        """Forces and torques (bodies, 6) of gravity, springs, the push and gyroscopic moments."""
        f = np.zeros((len(self.bodies), 6))
        for i, b in enumerate(self.bodies):
            f[i, :3] = b["mass"] * self.g
            J = R[i] @ b["J"] @ R[i].T
            f[i, 3:] = -np.cross(w[i], J @ w[i])
        f[self.rollers[0]["l"], :3] += self.push * t
        for k, l, at, stiffness, damping in self.springs:
            a, va, a0 = (at, np.zeros(3), at) if k is None else (r[k], v[k], self.bodies[k]["at"])
            d, rest = r[l] - a, np.linalg.norm(self.bodies[l]["at"] - a0)
            e = d / np.linalg.norm(d)
            force = -(stiffness * (np.linalg.norm(d) - rest) + damping * e @ (v[l] - va)) * e
            f[l, :3] += force
            if k is not None:
                f[k, :3] -= force
        if self.table:
            e0 = np.linalg.svd(self.axis[None])[2][1]
            e, e1 = R[0] @ self.bodies[0]["R"].T @ e0, np.cross(self.axis, e0)
            f[0, 3:] -= (3.0 * np.arctan2(e @ e1, e @ e0) + 0.1 * self.axis @ w[0]) * self.axis
        return f

    def moved(self) -> Array:
        """Positions (times, bodies, 3) of all centres."""
        n = len(self.bodies)

        def parts(y: Array) -> Any:
            r, R, v, w = np.split(y, np.array([3, 12, 15]) * n)
            return r.reshape(n, 3), R.reshape(n, 3, 3), v.reshape(n, 3), w.reshape(n, 3)

        def rates(t: float, y: Array) -> Array:
            r, R, v, w = parts(y)
            dR = np.array([skew(x) @ one for x, one in zip(w, R, strict=True)])
            A, u = self.rows(r, R), np.hstack([v, w]).ravel()
            bias = np.imag(self.rows(r + 1j * STEP * v, R + 1j * STEP * dR)) / STEP @ u
            M = np.zeros((6 * n, 6 * n))
            for i, b in enumerate(self.bodies):
                M[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = b["mass"] * np.eye(3)
                M[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = R[i] @ b["J"] @ R[i].T
            K = np.block([[M, A.T], [A, np.zeros((len(A),) * 2)]])
            a = np.linalg.solve(K, np.r_[self.loads(t, r, R, v, w).ravel(), -bias])[: 6 * n].reshape(n, 6)
            return np.r_[v.ravel(), dR.ravel(), a[:, :3].ravel(), a[:, 3:].ravel()]

        y = np.concatenate([np.array([b[key] for b in self.bodies]).ravel() for key in ("at", "R", "v", "w")])
        found = solve_ivp(rates, (0, T_END), y, t_eval=np.linspace(0, T_END, COUNT), **TIGHT)
        return np.asarray(found.y[: 3 * n].T.reshape(-1, n, 3))
