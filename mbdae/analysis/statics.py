"""The equations of rest in a frame, their tangent, and Newton's method on them.

Unknowns: displacements p (frame axes), internal states s, algebraic unknowns z, multipliers c. Applied loads and gravity
carry the load factor mu, and what the scene as drawn leaves unbalanced without them (preload of springs, rotation) the
factor 1 - mu on the other side: at mu = 0 the start is at rest, at mu = 1 the scene is as stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.analysis.frame import motion_in_words, steady_acceleration
from mbdae.analysis.pencil import Pencil, derivatives, free_basis, pencil
from mbdae.analysis.steady import Rest, acceleration_scale
from mbdae.errors import EquilibriumError
from mbdae.forces import Gravity, JointForce, JointTorque
from mbdae.formulations.index3 import Index3
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, loads
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.start import Starter

SOFT = 1e-11  #: relative to the largest stiffness: no stiffness at all
ROUND_OFF = 1e-14  #: relative to the largest entry of the tangent
DENSE = 400  #: unknowns up to which dense linear algebra is used
CONVERGED = 1e-10  #: last correction, relative to the scene's length and 1 rad; convergence is quadratic


def applied_loads(d: Derived) -> list[tuple[Target, Expr]]:
    """What carries the load factor: gravity, applied forces and torques, motors of joints."""
    scaled = getattr(d.law, "external", False) or isinstance(d.law, Gravity | JointTorque | JointForce)
    return loads(d) if scaled else []


def gyroscopic(d: Derived) -> list[tuple[Target, Expr]]:
    """Inertial forces of bodies at constant velocities."""
    return loads(d) if isinstance(d.law, Element) else []


@dataclass
class Point:
    """A state at rest, or on the way there: q, y and y' of the system, what holds the frame (N m), iterations so far."""

    y: Array
    yp: Array
    load_factor: float = 1.0
    hold: float = 0.0
    iterations: int = 0


@dataclass(frozen=True)
class Tangent:
    """The linearised equations at a point: K x = right, with the displacements the constraints leave."""

    p: Pencil
    K: Any
    right: Array
    N: Array


class Statics:
    """Equations of rest of a scene in a frame."""

    def __init__(self, rest: Rest) -> None:
        self.rest, m = rest, rest.mechanics
        self.mechanics, self.t = m, float(rest.t[0])
        spec = Index3().spec()
        self.system = SceneSystem(m.model, m.rows, spec)
        self.loads = SceneSystem(m.model, m.rows, replace(spec, outputs=applied_loads), self.system.sparsity is not None)
        self.units = m.velocity_units
        self.kinds = np.array(self.system.kinds)
        y = np.zeros(self.system.n)
        y[: m.nq], y[self.kinds == "s"] = rest.start.q, rest.start.s
        self.begin = self.carried(self.at_rest(Point(y, np.zeros(self.system.n), 0.0)))
        self.unbalanced = self._unloaded(self.begin)

    def q(self, point: Point) -> Array:
        """Positions (nq,) of a point."""
        return point.y[: self.mechanics.nq]

    def u(self, point: Point) -> Array:
        """Velocities (nu,) of a point."""
        return point.y[self.mechanics.nq : self.mechanics.nq + self.mechanics.nu]

    def s(self, point: Point) -> Array:
        """Internal states (ns,) of a point."""
        return np.asarray(point.y[self.kinds == "s"])

    def at_rest(self, point: Point) -> Point:
        """The point with the velocities and accelerations of rest in the frame."""
        m, q = self.mechanics, self.q(point)
        u = self.rest.velocities(q)
        y, yp = point.y.copy(), np.zeros(self.system.n)
        y[m.nq : m.nq + m.nu] = u
        yp[: m.nq] = m.rates(q, u)
        yp[m.nq : m.nq + m.nu] = steady_acceleration(m.model, self.rest.axes(q), q, u)
        return replace(point, y=y, yp=yp)

    def _residual(self, system: SceneSystem, point: Point) -> Array:
        out = np.empty(system.n)
        system.residual(self.t, point.y, point.yp, out)
        return out

    def _unloaded(self, point: Point) -> Array:
        """F (n,) without the applied loads, constraints left out."""
        out = self._residual(self.system, point) - self._residual(self.loads, point)
        out[self.kinds == "lambda"] = 0.0
        return out

    def _inertia(self, point: Point) -> Array:
        """(nu,) inertial forces of rest in the frame, left-hand side."""
        m = self.mechanics
        out = np.asarray(m.mass @ point.yp[m.nq : m.nq + m.nu])
        for g, p, values in m.evaluate(gyroscopic, self.rest.t, self.q(point)[None], self.u(point)[None]):
            for o, target in enumerate(p.targets):
                for i in range(values.shape[1]):
                    out[m.numbering.velocity(target, g, i)] += values[0, i, o]
        return out

    def carried(self, point: Point) -> Point:
        """The point with the multipliers that carry what constraints can carry: of all forces, or below load factor 1 of
        inertia alone (the pull of a rotation, which gives a rotor its stiffness). Preload stays where it acts: a couple that
        turned into forces would lose its lever as the body turns."""
        m = self.mechanics
        if not m.m:
            return point
        G = m.constraint_jacobian(self.rest.t, self.q(point)[None])[0]
        y = point.y.copy()
        y[self.kinds == "lambda"] = 0.0
        point = replace(point, y=y)
        r = self._residual(self.system, point)[m.nq : m.nq + m.nu] if point.load_factor == 1 else self._inertia(point)
        mobile = np.linalg.solve(m.weight, np.column_stack([G.T, r]))
        multipliers = -np.linalg.lstsq(G @ mobile[:, :-1], G @ mobile[:, -1], rcond=1e-12)[0]
        y[self.kinds == "lambda"] = multipliers / self.system.numbering.scaling()
        return point

    def residual(self, point: Point) -> Array:
        """F (n,) under the loads of the point's load factor."""
        less = 1 - point.load_factor
        full = self._residual(self.system, point)
        return full - less * (self._residual(self.loads, point) + self.unbalanced) if less else full

    def balance(self, point: Point) -> float:
        """Largest unbalanced force over the largest applied or inertial one."""
        m = self.mechanics
        r = self.residual(point)[m.nq : m.nq + m.nu] / m.velocity_units
        r = r + self.hold(self.q(point)).sum(axis=0) * point.hold
        loads = m.load(self.rest.t, self.q(point)[None], self.u(point)[None], self.s(point)[None])[0]
        size = np.abs(loads) + np.abs(m.mass @ point.yp[m.nq : m.nq + m.nu])
        return float(np.max(np.abs(r), initial=0.0) / max(float(np.max(size / m.velocity_units, initial=0.0)), 1e-300))

    # -- the tangent

    def tangent(self, point: Point) -> Tangent:
        """The equations linearised at a point, in displacements that are constant in the frame."""
        fy, fyp = derivatives(self.system, self.t, point.y, point.yp)
        if point.load_factor != 1:
            ly, lyp = derivatives(self.loads, self.t, point.y, point.yp)
            fy, fyp = fy - (1 - point.load_factor) * ly, fyp - (1 - point.load_factor) * lyp
        p = pencil(self.system, self.mechanics, self.rest.axes(self.q(point)), self.t, point.y, point.yp, (fy, fyp))
        hold = self.hold(self.q(point))
        rows = [[p.static(r, c) for c in ("p", "s", "z", "c")] for r in ("w", "s", "z", "c")]
        self._follow(p, rows)
        K = sp.bmat([[*row, side] for row, side in zip(rows, (hold.T, None, None, None), strict=True)]
                    + [[hold, None, None, None, sp.csr_matrix((len(hold), len(hold)))]], format="csr")  # fmt: skip
        N = free_basis(np.vstack([p.constraints, hold]), self.units)
        return Tangent(p, K, self._right(p, point, rows[1][1], len(hold)), N)

    def _right(self, p: Pencil, point: Point, own: Any, held: int) -> Array:
        """Minus the residual, row for row of the tangent; states that follow the motion have none."""
        m, F = self.mechanics, self.residual(point)
        shift = m.nq - m.nu
        parts = [p.C.T @ F[m.nq : m.nq + m.nu], *(F[p.places[k] + shift] for k in "szc")]
        parts[0] = parts[0] + self.hold(self.q(point)).sum(axis=0) * point.hold
        parts[1] = np.where(self._following, 0.0, parts[1]) if own.shape[0] else parts[1]
        return -np.concatenate([*parts, np.zeros(held)])

    def _follow(self, p: Pencil, rows: list[list[Any]]) -> None:
        """States whose rate vanishes at rest whatever they are follow the displacements: ds = d(rate)/dw dp."""
        own = np.asarray(abs(rows[1][1]).sum(axis=1)).ravel()
        moved = np.asarray(abs(rows[1][0]).sum(axis=1)).ravel()
        rate = p.part(p.A, "s", "w")
        following = (own == 0) & (moved <= 1e-9 * (1 + np.asarray(abs(rate).sum(axis=1)).ravel()))
        self._following = following
        if len(following):
            choose = sp.diags(following.astype(float))
            rows[1][0] = rows[1][0] + choose @ rate
            rows[1][1] = rows[1][1] + choose

    # -- the angle of a frame that turns freely

    @cached_property
    def held(self) -> bool:
        """Whether the frame turns freely: its angle about its axis is then held, which must take no torque."""
        if self.rest.frame.node is None or not self.rest.frame.turns:
            return False
        G = self.mechanics.constraint_jacobian(self.rest.t, self.rest.start.q[None])[0]
        return bool(np.max(np.abs(self._angle(self.rest.start.q) @ free_basis(G, self.units)), initial=0.0) > 1e-9)

    def hold(self, q: Array) -> Array:
        """(1, nu) row of the frame's angle where it is held, else (0, nu)."""
        return self._angle(q)[None] if self.held else np.zeros((0, self.mechanics.nu))

    def _angle(self, q: Array) -> Array:
        """(nu,) rotation of the frame's body about its axis, along the frame's axes, which are those of the body."""
        node, row = self.rest.frame.node, np.zeros(self.mechanics.nu)
        assert node is not None
        axis, n = self.rest.frame.rate / np.linalg.norm(self.rest.frame.rate), node.kind.translations
        spatial = node.kind.sizes[1] == 6
        row[node.u + n : node.u + node.kind.sizes[1]] = self.rest.axes(q).rotation.T @ axis if spatial else axis[2:]
        return row

    # -- Newton

    def solve(self, K: Any, right: Array) -> Array:
        """x of K x = right; not finite where K is singular."""
        try:
            if K.shape[0] <= DENSE:
                return np.linalg.solve(K.toarray(), right)
            return np.asarray(splu(K.tocsc()).solve(right))
        except (np.linalg.LinAlgError, RuntimeError):
            return np.full(len(right), np.nan)

    def moved(self, point: Point, p: Pencil, x: Array) -> Point:
        """The point after a correction x of the tangent's unknowns."""
        m, y = self.mechanics, point.y.copy()
        y[: m.nq] = m.integrate_positions(self.q(point), p.C @ x[: m.nu])
        at = m.nu
        for kind in "szc":
            places = p.places[kind] + m.nq - m.nu
            y[places] += x[at : at + len(places)]
            at += len(places)
        hold = point.hold + float(np.sum(x[at:]))
        return self.at_rest(replace(point, y=y, hold=hold, iterations=point.iterations + 1))

    def closed(self, point: Point) -> Point:
        """The point with its joints closed again; raises StartError where they are too far apart."""
        y = point.y.copy()
        y[: self.mechanics.nq] = self._closer.close(self.q(point))
        return self.at_rest(replace(point, y=y))

    @cached_property
    def _closer(self) -> Starter:
        return Starter(self.mechanics, self.t, holding=False, changes=[])

    def size(self, x: Array) -> float:
        """Largest displacement of a correction, in the scene's length and rad."""
        return float(np.max(np.abs(x[: self.mechanics.nu]) / self.units, initial=0.0))

    def newton(self, point: Point, limit: int = 25) -> tuple[Point, Array] | None:
        """The point at rest near a given one, and the displacement (nu,) to it; None without convergence."""
        way, last = np.zeros(self.mechanics.nu), np.inf
        for i in range(limit):
            T = self.tangent(point)
            x = self.solve(T.K, T.right)
            size = self.size(x)
            if not np.isfinite(size) or size > 1.0 or (i > 2 and size > 2 * last):
                return None
            point, way = self.moved(point, T.p, x), way + x[: self.mechanics.nu]
            if size <= CONVERGED or (i > 3 and size <= 1e-8 and size > 0.9 * last):
                return point, way
            last = size
        return None

    # -- stiffness

    def stiffness(self, T: Tangent) -> tuple[Array, Array]:
        """The tangent on the displacements left by the constraints (f, f), unknowns other than displacements solved for."""
        nu = self.mechanics.nu
        others = np.r_[nu + np.arange(len(T.p.places["s"]) + len(T.p.places["z"]))].astype(int)
        K = T.K[:nu][:, :nu].toarray()
        if len(others):
            own, below, beside = (m.toarray() for m in (T.K[others][:, others], T.K[others][:, :nu], T.K[:nu][:, others]))
            K = K - beside @ np.linalg.solve(own, below)
        return T.N.T @ K @ T.N, K

    def soft_motions(self, T: Tangent) -> list[str]:
        """Motions left by the constraints that meet no stiffness, in words."""
        reduced, full = self.stiffness(T)
        if not len(reduced):
            return []
        _, sizes, right = np.linalg.svd(reduced)
        floor = SOFT * sizes[0] + ROUND_OFF * float(np.max(np.abs(full * self.units * self.units[:, None])))
        soft = np.flatnonzero(sizes <= max(floor, 1e-300))
        return [motion_in_words(self.mechanics.model, T.N @ right[i], self.units) for i in soft[::-1]]

    def unstable(self, T: Tangent) -> int:
        """Number of directions in which the symmetric part of the stiffness is negative."""
        K, _ = self.stiffness(T)
        values = np.linalg.eigvalsh((K + K.T) / 2) if len(K) else np.zeros(0)
        return int(np.sum(values < -SOFT * np.max(np.abs(values), initial=0.0)))

    def check_steady(self, point: Point) -> None:
        """Refuse a state that is not at rest in the frame by its velocities, or needs a torque to keep the frame turning."""
        q, u, name = self.q(point), self.u(point), self.rest.frame.name
        reason = self.rest.departs(q, u)
        if reason is None and self.held:
            m = self.mechanics
            scale = float(np.max((acceleration_scale(m, self.rest.t, q, u, self.s(point)) * m.weight.diagonal())[m.rotational]))
            if abs(point.hold) > 1e-8 * scale:
                reason = f"'{name}' turns freely and needs a torque of {abs(point.hold):.4g} N m to keep its rate"
        if reason is not None:
            raise EquilibriumError(f"no state is at rest in the frame of '{name}': {reason}; take another frame, or prescribe "
                                   f"a steady motion")  # fmt: skip
