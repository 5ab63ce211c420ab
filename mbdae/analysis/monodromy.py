"""Small departures from a motion over one period, by the exact derivatives of its Radau steps.

With the stages Y_i of a step, F_y dY_i + F_y' sum_j A^-1_ij (dY_j - dy_0) / h = 0: the exact derivative of the step. The
departures are those that the constraints allow, of positions (as virtual displacements), velocities and internal states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.analysis.orbit import Orbit, Return
from mbdae.analysis.pencil import derivatives
from mbdae.analysis.reduced import free_basis
from mbdae.errors import OptionError
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem


@dataclass(frozen=True)
class Departures:
    """Departures of the unknowns that the constraints allow at the start: dy = map x, x = units * Q a.

    map (n, nx): unknowns from p (virtual displacements), w (velocities), s (internal states); back (nx, n): those from the
    unknowns after the period, where quaternions may have changed sign; units (nx,): size of each; Q (nx, k)
    orthonormal; velocities: number of entries of p, and of w.
    """

    map: Array
    back: Array
    units: Array
    Q: Array
    velocities: int

    @property
    def start(self) -> Array:
        """dy (n, k): column i is the departure of the unknowns for the i-th unit vector a."""
        return np.asarray(self.map @ (self.units[:, None] * self.Q))

    def read(self, dy: Array) -> Array:
        """a (k, columns): the coordinates of departures dy (n, columns) after the period."""
        return np.asarray(self.Q.T @ ((self.back @ dy) / self.units[:, None]))


def departures(prepared: Prepared, system: SceneSystem, returned: Return, period: float) -> Departures:
    """The departures at the start of a system whose motion returns to it."""
    m, nb, y = prepared.mechanics, system.numbering, system.y0
    nq, nu, acting = nb.nq, nb.nu, returned.acting
    Fy = derivatives(system, system.t0, y, system.yp0)[0].tocsr()
    _refuse_rigid(system, Fy)
    q = prepared.states(np.array([system.t0]), y[None])[0][0]
    H = np.array([m.rates(q, e)[nb.of_positions] for e in np.eye(m.nu)[nb.of_velocities]]).T
    length = m.velocity_units[nb.of_velocities]
    nx = 2 * nu + len(acting)
    T, back = np.zeros((system.n, nx)), np.zeros((nx, system.n))
    T[:nq, :nu], back[:nu, :nq] = H, H.T / np.sum(H * H, axis=0)[:, None]
    for first, at in ((nu, np.arange(nq, nq + nu)), (2 * nu, acting)):
        own = first + np.arange(len(at))
        T[at, own] = back[own, at] = 1.0
    units = np.concatenate([length, length * (2 * np.pi / period), system.scale[acting]])
    rows = [nb.start[block] + i for block in ("mu", "lambda") if "mu" in system.kinds for i in range(nb.m)]
    C = Fy[rows] @ T if rows else np.zeros((0, nx))
    Q = free_basis(C, units) / units[:, None]
    expected = nx - 2 * nb.m
    if Q.shape[1] != expected:
        raise OptionError(f"floquet: the constraints allow {Q.shape[1]} independent changes of positions, velocities and states "
                          f"at the start, where {expected} are expected: the position is singular; start at another instant "
                          f"of the motion (at=(result, t))")  # fmt: skip
    return Departures(T, back * returned.sign, units, Q, nu)


def _refuse_rigid(system: SceneSystem, Fy: sp.csr_matrix) -> None:
    z = np.flatnonzero(np.array(system.kinds) == "z")
    rigid = z[np.asarray(abs(Fy[z][:, z]).sum(axis=1)).ravel() == 0] if len(z) else z
    if len(rigid):
        raise OptionError(f"floquet needs finite stiffnesses of all beams, and the one that belongs to {system.names[rigid[0]]} "
                          f"is infinite; give that beam a section with finite ones")  # fmt: skip


def propagated(system: SceneSystem, orbit: Orbit, dy: Array) -> Array:
    """dy (n, k) at the end of the orbit, from that at its start."""
    solve = _sparse_step if system.sparse else _dense_step
    for i, (stages, own) in enumerate(zip(orbit.t, orbit.systems, strict=True)):
        with own.within(float(np.mean(stages))):
            dy = dy + solve(own, orbit, i, dy)
    return dy


def _dense_step(system: SceneSystem, orbit: Orbit, i: int, dy: Array) -> Array:
    """Change of dy over step i; dense."""
    s, n = orbit.t.shape[1], system.n
    K, right, A = np.zeros((s, n, s, n)), np.empty((s, n, dy.shape[1])), orbit.table.A_inv / orbit.h[i]
    for j in range(s):
        fy, fyp = system.jacobian_parts(orbit.t[i, j], orbit.y[i, j], orbit.yp[i, j])
        K[j] = A[j, None, :, None] * fyp[:, None, :]
        K[j, :, j] += fy
        right[j] = -fy @ dy
    M = K.reshape(s * n, s * n)
    columns = 1 / np.max(np.abs(M), axis=0)
    M *= columns
    rows = 1 / np.max(np.abs(M), axis=1)
    M *= rows[:, None]
    Z = np.linalg.solve(M, rows[:, None] * right.reshape(s * n, -1))
    return np.asarray(columns[-n:, None] * Z[-n:])


def _sparse_step(system: SceneSystem, orbit: Orbit, i: int, dy: Array) -> Array:
    """Change of dy over step i, with sparse matrices."""
    s, A = orbit.t.shape[1], orbit.table.A_inv / orbit.h[i]
    parts = [derivatives(system, orbit.t[i, j], orbit.y[i, j], orbit.yp[i, j]) for j in range(s)]
    K = sp.bmat([[A[j, l] * parts[j][1] + (parts[j][0] if j == l else 0 * parts[j][0]) for l in range(s)] for j in range(s)])
    columns = 1 / abs(K).max(axis=0).toarray().ravel()
    K = K @ sp.diags(columns)
    rows = 1 / abs(K).max(axis=1).toarray().ravel()
    right = -np.concatenate([fy @ dy for fy, _ in parts]) * rows[:, None]
    Z = splu((sp.diags(rows) @ K).tocsc()).solve(right)
    return np.asarray(columns[-system.n :, None] * Z[-system.n :])
