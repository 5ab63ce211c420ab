"""The mechanics behind every form: M, f, G, g and their rates at any states, many at once."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbdae.kernels import linearised_plan, plan
from mbdae.kernels.plan import Outputs
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import acceleration, dynamics, jacobian_G, loads, position, velocity
from mbdae.system.base import Array
from mbdae.system.model import Model
from mbdae.system.numbering import Numbering, Row
from mbdae.threads import one_thread


def _inertia(d: Derived) -> Any:
    return dynamics(d) if isinstance(d.law, Element) else []


def _loads(d: Derived) -> Any:
    return loads(d)


class Mechanics:
    """Evaluates a model at states t (nt,), q (nt, nq), u (nt, nu), s (nt, ns); rows: the constraint rows in force."""

    def __init__(self, model: Model, rows: list[Row]) -> None:
        self.model, self.rows = model, rows
        self.numbering = Numbering(model, rows, ("lambda",))
        self.nq, self.nu, self.m = model.nq, model.nu, len(rows)

    def evaluate(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None,
                 multipliers: Array | None = None) -> list[tuple[int, Any, Array]]:  # fmt: skip
        """(group, plan, values (nt, instances, outputs)) of every group that has such outputs."""
        W = self.workspace(t, q, u, s, multipliers)
        out = []
        for g, group in enumerate(self.model.groups):
            p = plan(group.derived, outputs)
            if p.targets:
                out.append((g, p, p.kernel.values(W[:, self.numbering.gather(g, p.all_inputs)])))
        return out

    def workspace(self, t: Array, q: Array, u: Array, s: Array | None, multipliers: Array | None) -> Array:
        """(nt, width) rows every kernel reads from."""
        nb = self.numbering
        W = nb.workspace(len(t))
        W[:, : self.nq], W[:, self.nq : self.nq + self.nu] = q, u
        if s is not None:
            W[:, nb.start["s"] : nb.start["s"] + len(nb.states)] = s
        if multipliers is not None:
            W[:, nb.start["lambda"] : nb.start["lambda"] + self.m] = multipliers
        nb.fill_clock(W, t)
        return W

    @cached_property
    def mass(self) -> Array:
        """(nu, nu), constant: bodies carry their node at the centre of mass, spin in the body frame."""
        M = np.zeros((self.nu, self.nu))
        for g, group in enumerate(self.model.groups):
            p = linearised_plan(group.derived, _inertia)
            values = p.constants.once(self.numbering.numbers(g, p.constant_inputs))
            for i in range(len(group.instances)):
                for (row, target), value in zip(p.constant_places, values[i], strict=False):
                    if target[0] == "up":
                        a = self.numbering.unknown(p.targets[row], g, i)[0] - self.nq
                        M[a, self.numbering.unknown(target, g, i)[0] - self.nq] += value
        return M

    @cached_property
    def weight(self) -> Array:
        """The mass matrix made positive definite by a millionth of its largest entries: the metric of projections."""
        M, rotational = self.mass, self.rotational
        d = np.diag(M)
        floor = np.where(rotational, _largest(d[rotational], self.model.length**2), _largest(d[~rotational], 1.0))
        return M + np.diag(1e-6 * floor)

    @cached_property
    def rotational(self) -> Any:
        """(nu,) bool: which velocities are angular."""
        mask = np.zeros(self.nu, dtype=bool)
        for node in self.model.nodes:
            if node.kind is NodeKind.COORDINATE:
                mask[node.u] = True
            elif node.kind.turns:
                mask[node.u + (2 if node.kind is NodeKind.PLANAR else 3) : node.u + node.kind.sizes[1]] = True
        return mask

    @cached_property
    def velocity_units(self) -> Array:
        """(nu,) size of each virtual displacement: the scene's length, or 1 rad."""
        return np.where(self.rotational, 1.0, self.model.length)

    def load(self, t: Array, q: Array, u: Array, s: Array | None = None) -> Array:
        """f (nt, nu): all forces but those of constraints; M u' + G^T lambda = f."""
        f = np.zeros((len(t), self.nu))
        for g, p, values in self.evaluate(_loads, t, q, u, s):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    f[:, self.numbering.unknown(target, g, i)[0] - self.nq] -= values[:, i, o]
        return f

    def constraint_jacobian(self, t: Array, q: Array) -> Array:
        """G (nt, m, nu)."""
        G = np.zeros((len(t), self.m, self.nu))
        for g, p, values in self.evaluate(jacobian_G, t, q, np.zeros((len(t), self.nu))):
            for i in range(values.shape[1]):
                for o, (_, r, side, column) in enumerate(p.targets):
                    row = self.numbering.row(g, i, r)
                    if row is not None:
                        G[:, row, self.numbering.unknown(("u", side, column), g, i)[0] - self.nq] += values[:, i, o]
        return G

    def _rows(self, outputs: Outputs, t: Array, q: Array, u: Array) -> Array:
        out = np.zeros((len(t), self.m))
        for g, p, values in self.evaluate(outputs, t, q, u):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    row = self.numbering.row(g, i, target[1])
                    if row is not None:
                        out[:, row] = values[:, i, o]
        return out

    def of_states(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None) -> Array:
        """(nt, ns) outputs that belong to internal states: their start values, or their rates."""
        nb = self.numbering
        out = np.zeros((len(t), len(nb.states)))
        for g, p, values in self.evaluate(outputs, t, q, u, s):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    out[:, nb.unknown(target, g, i)[0] - nb.start["s"]] = values[:, i, o]
        return out

    def position_residual(self, t: Array, q: Array) -> Array:
        """g (nt, m)."""
        return self._rows(position, t, q, np.zeros((len(t), self.nu)))

    def velocity_residual(self, t: Array, q: Array, u: Array) -> Array:
        """G u + g_t (nt, m)."""
        return self._rows(velocity, t, q, u)

    def acceleration_bias(self, t: Array, q: Array, u: Array) -> Array:
        """gamma (nt, m): d2g/dt2 = G u' + gamma."""
        return self._rows(acceleration, t, q, u)

    def accelerations(self, t: Array, q: Array, u: Array, s: Array | None = None) -> tuple[Array, Array]:
        """u' (nt, nu) and lambda (nt, m) from M u' + G^T lambda = f, G u' = -gamma; least norm where not unique."""
        f = self.load(t, q, u, s)
        if not self.m:
            return np.asarray(np.linalg.lstsq(self.mass, f.T, rcond=1e-13)[0].T, dtype=float), np.zeros((len(t), 0))
        G, gamma = self.constraint_jacobian(t, q), self.acceleration_bias(t, q, u)
        n = self.nu + self.m
        scale = np.r_[1 / self.velocity_units, np.ones(self.m)]
        out = np.empty((len(t), n))
        K = np.zeros((n, n))
        K[: self.nu, : self.nu] = self.mass
        with one_thread():
            for i in range(len(t)):
                K[: self.nu, self.nu :], K[self.nu :, : self.nu] = G[i].T, G[i]
                out[i] = _solve(K, np.r_[f[i], -gamma[i]], scale)
        return out[:, : self.nu], out[:, self.nu :]

    def integrate_positions(self, q: Array, displacement: Array) -> Array:
        """q (nq,) moved by virtual displacements (nu,): translations add, rotations in body axes compose."""
        q = q.copy()
        for node in self.model.nodes:
            d = displacement[node.u : node.u + node.kind.sizes[1]]
            n = node.kind.translations
            q[node.q : node.q + n] += d[:n]
            if node.kind is NodeKind.PLANAR:
                q[node.q + 2] += d[2]
            elif node.kind is NodeKind.SPATIAL:
                q[node.q + 3 : node.q + 7] = turned(q[node.q + 3 : node.q + 7], d[3:])
        return q

    def rates(self, q: Array, u: Array) -> Array:
        """q' (nq,) of velocities u (nu,)."""
        qp = np.zeros(self.nq)
        for node in self.model.nodes:
            d = u[node.u : node.u + node.kind.sizes[1]]
            n = node.kind.translations
            qp[node.q : node.q + n] = d[:n]
            if node.kind is NodeKind.PLANAR:
                qp[node.q + 2] = d[2]
            elif node.kind is NodeKind.SPATIAL:
                qp[node.q + 3 : node.q + 7] = quaternion_product(q[node.q + 3 : node.q + 7], np.r_[0.0, d[3:]]) / 2
        return qp


def _largest(values: Array, otherwise: float) -> float:
    largest = float(np.max(values, initial=0.0))
    return largest if largest > 0 else otherwise


def _solve(K: Array, right: Array, scale: Array) -> Array:
    """Solution of K x = right; least norm in scaled unknowns where K is singular."""
    try:
        x = np.asarray(np.linalg.solve(K, right), dtype=float)
        if np.all(np.isfinite(x)) and np.linalg.norm(K @ x - right) <= 1e-8 * (np.linalg.norm(right) + 1e-300):
            return x
    except np.linalg.LinAlgError:
        pass
    return np.asarray(scale * np.linalg.lstsq(K * scale, right, rcond=1e-12)[0], dtype=float)


def quaternion_product(a: Array, b: Array) -> Array:
    """a o b for arrays (4,)."""
    product: Array = np.r_[a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])]
    return product


def turned(P: Array, rotation: Array) -> Array:
    """P turned by a rotation vector in body axes, rad."""
    angle = float(np.linalg.norm(rotation))
    half = np.sinc(angle / (2 * np.pi)) / 2
    return quaternion_product(P, np.r_[np.cos(angle / 2), half * rotation])


def rotation_matrices(P: Array) -> Array:
    """R (..., 3, 3) of quaternions (..., 4) of any length."""
    p = P / np.linalg.norm(P, axis=-1, keepdims=True)
    w, x, y, z = np.moveaxis(p, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion(R: Array) -> Array:
    """Unit quaternion (4,) of a rotation matrix."""
    K = np.array([
        [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
        [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
        [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1]],
    ])  # fmt: skip
    P = np.linalg.eigh(K)[1][:, -1]
    return P if P[0] >= 0 else -P
