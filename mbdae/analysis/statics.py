"""The equations of rest in a frame, their tangent, and Newton's method on them.

Unknowns: displacements p (frame axes), internal states s, algebraic unknowns z, multipliers c. Applied loads and gravity are
multiplied by the load factor mu; forces that are unbalanced at the start without them (preload of springs, rotation) are
subtracted, times 1 - mu: at mu = 0 the start is at rest, at mu = 1 the scene is as stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.analysis.frame import motion_in_words, steady_acceleration
from mbdae.analysis.modes import softest_beam
from mbdae.analysis.pencil import Pencil, complete_system, derivatives, pencil
from mbdae.analysis.plane import DenseStiffness, SparseStiffness, Tangent, stiffness
from mbdae.analysis.reduced import free_basis
from mbdae.analysis.steady import Rest, acceleration_scale
from mbdae.deferred import as_full
from mbdae.errors import EquilibriumError
from mbdae.formulations import Index3
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, loads
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Array

DENSE = 400  #: largest number of unknowns for dense linear algebra in scenes without beams
BANDED = 120  #: largest number of unknowns for dense linear algebra with beams, whose equations are nearly banded
#: while stresses are found, a stiffness is added to all motions, which keeps those without stiffness bounded: FREE times the mass
#: matrix times the square of the lowest frequency of the softest beam
FREE = 1e-4
#: largest correction of Newton's method, in the scene's length and rad; with a larger one it counts as not convergent
LONGEST = 1.0
FRICTION_ITERATIONS = 100  #: largest number of iterations for multipliers and the friction that depends on them
#: size of the correction, relative to the scene's length and 1 rad, at which Newton's method ends: convergence is quadratic, so
#: that after this correction only rounding errors remain. Newton's method also ends where a correction is below 1e-8 and
#: corrections no longer fall
CONVERGED = 1e-10


def applied_loads(d: Derived) -> list[tuple[Target, Expr]]:
    """The loads that the load factor multiplies: gravity, applied forces and torques, motors of joints."""
    return loads(d) if d.law.loads else []


def gyroscopic(d: Derived) -> list[tuple[Target, Expr]]:
    """Inertial forces of bodies at constant velocities."""
    return loads(d) if isinstance(d.law, Element) else []


@dataclass
class Point:
    """A state at rest, or on the way there: y and y' of the system; hold: torque that holds the frame (N m)."""

    y: Array
    yp: Array
    load_factor: float = 1.0
    hold: float = 0.0
    iterations: int = 0


class Statics:
    """Equations of rest of a scene in a frame."""

    def __init__(self, rest: Rest) -> None:
        self.rest, m = rest, rest.mechanics
        self.mechanics, self.t = m, float(rest.t[0])
        spec = Index3().spec()
        self.elastic = bool(m.model.lines)
        self.system = complete_system(m, spec)
        self.loads = complete_system(m, replace(spec, outputs=applied_loads, loads_only=True), self.system.sparse)
        self.units = m.velocity_units
        self.kinds = np.array(self.system.kinds)
        y = np.zeros(self.system.n)
        y[: m.nq], y[self.kinds == "s"] = rest.start.q, rest.start.s
        self.unbalanced = np.zeros(self.system.n)
        self.begin = self.with_reactions(self.at_rest(Point(y, np.zeros(self.system.n), 0.0)))
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

    def _residual(self, system: Assembly, point: Point) -> Array:
        out = np.empty(system.n)
        system.residual(self.t, point.y, point.yp, out)
        return out

    def _unloaded(self, point: Point) -> Array:
        """F (n,) without the applied loads, constraints left out."""
        out = self._residual(self.system, point) - self._residual(self.loads, point)
        out[self.kinds == "lambda"] = 0.0
        return out

    def _inertia(self, point: Point) -> Array:
        """(nu,) inertial and gyroscopic forces of rest in the frame, as on the left-hand side of the equations."""
        m = self.mechanics
        gyrating = m.forces(gyroscopic, self.rest.t, self.q(point)[None], self.u(point)[None])[0]
        return np.asarray(m.mass @ point.yp[m.nq : m.nq + m.nu] + gyrating)

    def with_reactions(self, point: Point) -> Point:
        """The point with the multipliers that balance all forces, as far as constraints can; below load factor 1 they balance
        only the inertial forces (centrifugal forces give a rotor its stiffness). There the preload of springs is one of the
        unbalanced terms (see the module): reactions that balance its torques would lose their lever arms as bodies turn."""
        m = self.mechanics
        if not m.m:
            return point
        if self.elastic:
            return self._with_stresses(point)
        G = as_full(m.constraint_jacobian(self.rest.t, self.q(point)[None])[0])
        divided = splu(sp.csc_matrix(m.weight)).solve if m.large else partial(np.linalg.solve, m.weight)
        y = point.y.copy()
        y[self.kinds == "lambda"] = 0.0
        point, multipliers = replace(point, y=y), np.zeros(m.m)
        for _ in range(FRICTION_ITERATIONS if m.reactive else 1):  # friction depends on the multipliers, which it changes
            r = self._residual(self.system, point)[m.nq : m.nq + m.nu] if point.load_factor == 1 else self._inertia(point)
            less = r - G.T @ multipliers if point.load_factor == 1 else r
            mobile, before = divided(np.column_stack([G.T, less])), multipliers
            multipliers = -np.linalg.lstsq(G @ mobile[:, :-1], G @ mobile[:, -1], rcond=1e-12)[0]
            y[self.kinds == "lambda"] = multipliers / self.system.numbering.scaling()
            if np.max(np.abs(multipliers - before)) <= 1e-14 * np.max(np.abs(multipliers)):
                break
        return point

    def _with_stresses(self, point: Point) -> Point:
        """The point with the multipliers and stresses of beams that balance its forces, by linear theory. These stresses do not
        fit the strains at the point; below load factor 1 this misfit is part of the unbalanced terms (see the module), so that
        the strains develop as the loads are raised."""
        m, nu, n = self.mechanics, self.mechanics.nu, self.system.n
        still = replace(point, y=np.r_[point.y[: m.nq], np.zeros(n - m.nq)], yp=np.zeros(n))
        still.y[self.kinds == "s"] = self.s(point)
        force = self._inertia(point)
        if point.load_factor == 1:
            force = force + self._residual(self.system, still)[m.nq : m.nq + nu]
        if not np.any(force):
            return point
        T = self.tangent(still, full=True)
        # forces that no stress can balance act on this added inertia, as if they accelerated the scene
        W = T.p.C.T @ (T.p.C.T @ sp.csc_matrix(m.weight)).T
        inertia = sp.block_diag([FREE * softest_beam(m.model) ** 2 * W, sp.csr_matrix((T.K.shape[0] - nu,) * 2)])
        x = self.solve(T.K + inertia, -np.r_[T.p.C.T @ force, np.zeros(T.K.shape[0] - nu)])
        y, at = point.y.copy(), nu + len(T.p.places["s"])
        for kind in "zc" if np.all(np.isfinite(x)) else "":
            places = T.p.places[kind] + m.nq - nu
            y[places] = x[at : at + len(places)]
            at += len(places)
        return replace(point, y=y)

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

    def tangent(self, point: Point, full: bool = False) -> Tangent:
        """The equations linearised at a point, in displacements that are constant in the frame; `full`: under full loads."""
        fy, fyp = derivatives(self.system, self.t, point.y, point.yp)
        if point.load_factor != 1 and not full:
            ly, lyp = derivatives(self.loads, self.t, point.y, point.yp)
            fy, fyp = fy - (1 - point.load_factor) * ly, fyp - (1 - point.load_factor) * lyp
        p = pencil(self.system, self.mechanics, self.rest.axes(self.q(point)), self.t, point.y, point.yp, (fy, fyp))
        hold = self.hold(self.q(point))
        K = self._followed(p, p.static)
        if len(hold):
            side = sp.csr_matrix(np.hstack([hold, np.zeros((len(hold), K.shape[1] - hold.shape[1]))]))
            K = sp.bmat([[K, side.T], [side, None]], format="csr")
        return Tangent(p, K, self._right(p, point, len(hold)), hold, self.units)

    def _right(self, p: Pencil, point: Point, held: int) -> Array:
        """Right-hand side (rows of the tangent): minus the residual, 0 for states that follow the motion."""
        m, F = self.mechanics, self.residual(point)
        shift = m.nq - m.nu
        parts = [p.C.T @ F[m.nq : m.nq + m.nu], *(F[p.places[k] + shift] for k in "szc")]
        parts[0] = parts[0] + self.hold(self.q(point)).sum(axis=0) * point.hold
        parts[1] = np.where(self._following, 0.0, parts[1]) if len(parts[1]) else parts[1]
        return -np.concatenate([*parts, np.zeros(held)])

    def _followed(self, p: Pencil, K: Any) -> Any:
        """Internal states whose rate vanishes at rest for any value follow the displacements: ds = d(rate)/dw dp."""
        nu, count = self.mechanics.nu, len(p.places["s"])
        self._following = np.zeros(count, dtype=bool)
        if not count:
            return K
        own, moved, rate = K[nu : nu + count, nu : nu + count], K[nu : nu + count, :nu], p.part(p.A, "s", "w")
        own_size, moved_size, rate_size = (np.asarray(abs(part).sum(axis=1)).ravel() for part in (own, moved, rate))
        self._following = (own_size == 0) & (moved_size <= 1e-9 * (1 + rate_size))
        choose = sp.diags(self._following.astype(float))
        rest = K.shape[0] - nu - count
        added = sp.hstack([choose @ rate, choose, sp.csr_matrix((count, rest))])
        return (K + sp.vstack([sp.csr_matrix((nu, K.shape[1])), added, sp.csr_matrix((rest, K.shape[1]))])).tocsr()

    # -- the angle of a frame that turns freely

    @cached_property
    def held(self) -> bool:
        """Whether no constraint determines the angle of a turning frame about its axis: an extra row then holds that angle, and
        `check_steady` refuses a state in which this takes a torque."""
        if self.rest.frame.node is None or not self.rest.frame.turns:
            return False
        G = self.mechanics.constraint_jacobian(self.rest.t, self.rest.start.q[None])[0]
        angle = self._angle(self.rest.start.q)
        if self.elastic:  # with many displacements and few rows, test only whether the rows determine the angle
            rows, wanted = (G * self.units).T, angle * self.units
            return bool(np.linalg.norm(wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]) > 1e-9)
        return bool(np.max(np.abs(angle @ free_basis(G, self.units)), initial=0.0) > 1e-9)

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
            if K.shape[0] <= (BANDED if self.elastic else DENSE):
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
        """The point with its joints closed again; raises StartError where they are too far apart. With beams the point is
        returned unchanged: its joints cannot be closed by rigid motions of deformed bodies; the next correction closes them."""
        if self.elastic:
            return point
        y = point.y.copy()
        y[: self.mechanics.nq] = self.rest.starter.close(self.q(point))
        return self.at_rest(replace(point, y=y))

    def size(self, x: Array) -> float:
        """Largest displacement of a correction, in the scene's length and rad."""
        return float(np.max(np.abs(x[: self.mechanics.nu]) / self.units, initial=0.0))

    def newton(self, point: Point, T: Tangent | None = None, limit: int = 25) -> tuple[Point, Array] | None:
        """The point at rest near a given one, and the displacement (nu,) to it; None without convergence. T: its tangent."""
        way, last = np.zeros(self.mechanics.nu), np.inf
        for i in range(limit):
            T = T if T is not None and i == 0 else self.tangent(point)
            x = self.solve(T.K, T.right)
            size = self.size(x)
            if not np.isfinite(size) or size > LONGEST or (i > 2 and size > 2 * last):
                return None
            point, way = self.moved(point, T.p, x), way + x[: self.mechanics.nu]
            if size <= CONVERGED or (i > 3 and size <= 1e-8 and size > 0.9 * last):
                return point, way
            last = size
        return None

    # -- stiffness

    def stiffness(self, T: Tangent) -> DenseStiffness | SparseStiffness:
        """The stiffness of the motions that the constraints allow."""
        return stiffness(T, self.elastic)

    def soft_motions(self, T: Tangent) -> list[str]:
        """Motions that the constraints allow and that meet no stiffness, in words."""
        return [motion_in_words(self.mechanics.model, motion, self.units) for motion in self.free_motions(T).T]

    def free_motions(self, T: Tangent) -> Array:
        """(nu, k) motions that the constraints allow and that meet no stiffness."""
        sizes, motions, floor = self.stiffness(T).softest()
        return motions[:, : int(np.sum(sizes <= floor))]

    def unstable(self, T: Tangent) -> int:
        """Number of directions in which the symmetric part of the stiffness is negative."""
        return self.stiffness(T).negative()

    def check_steady(self, point: Point) -> None:
        """Refuse a state that is not at rest in the frame by its velocities, or needs a torque to keep the frame turning."""
        q, u, name = self.q(point), self.u(point), self.rest.frame.name
        motion = self.rest.departs(q, u)
        if motion is None and self.held:
            m = self.mechanics
            scale = float(np.max((acceleration_scale(m, self.rest.t, q, u, self.s(point)) * m.weight.diagonal())[m.rotational]))
            if abs(point.hold) > 1e-8 * scale:
                motion = f"'{name}' turns freely, and loads of {abs(point.hold):.4g} N m about its axis change its rate"
        if motion is not None:
            raise EquilibriumError(f"no state is at rest in the frame of '{name}': {motion}; give another frame=, or prescribe "
                                   f"a steady motion")
