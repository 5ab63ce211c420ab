"""The equations linearised about a motion, in coordinates along the axes of a moving frame: E x' + A x = 0.

y = y0(t) + T(t) x with x = (p, w, rest): p virtual displacements and w velocity changes (nu each, components of
translation and rotation in the frame's axes), the rest (multipliers, internal states, algebraic unknowns) as they are.
With F_y Y + F_y' Y' = 0 and rows resolved by L(t): E = L F_y' T, A = L (F_y T + F_y' T'). In a frame in which the
motion is steady both are constant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from mbdae.analysis.frame import RotatingFrame, skew
from mbdae.symbolic.frames import NodeKind
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.jacobian_entries import FormSpec
from mbdae.system.base import Array, System
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Node, rotation_matrices
from mbdae.system.model.shared_nodes import Sharing
from mbdae.system.motion.mechanics import Mechanics

#: bound of the rounding error of an entry, relative to the sum of the absolute values of its terms: a kernel, the turn into the
#: frame's axes and the basis of the free motions round about ten times each, seldom all in one direction
ROUNDED = 8 * float(np.finfo(float).eps)


class _Blocks:
    """A sparse matrix from stacks of dense blocks."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        self.rows: list[Any] = []
        self.columns: list[Any] = []
        self.values: list[Any] = []

    def add(self, row: Any, column: Any, blocks: Array) -> None:
        """Put blocks (k, a, b) with their first entries at (row[i], column[i])."""
        _, i, j = np.indices(blocks.shape)
        self.rows.append((np.reshape(row, (-1, 1, 1)) + i).ravel())
        self.columns.append((np.reshape(column, (-1, 1, 1)) + j).ravel())
        self.values.append(blocks.ravel())

    def matrix(self) -> Any:
        """The matrix, CSR."""
        if not self.values:
            return sp.csr_matrix(self.shape)
        values, rows, columns = (np.concatenate(p) for p in (self.values, self.rows, self.columns))
        return sp.csr_matrix((values, (rows, columns)), shape=self.shape)


def complete_system(mechanics: Mechanics, spec: FormSpec, sparse: bool | None = None) -> Assembly:
    """The equations with absolute coordinates of all nodes and all constraint rows, so that every reaction is an unknown; also
    rows that runs replace by fewer unknowns (recursive joints, nodes of beams that share displacements at a joint)."""
    bodies = MovedBodies(mechanics.model, [])
    bodies.sharing = Sharing()
    return Assembly(mechanics.model, mechanics.rows, spec, sparse, bodies)


@dataclass(frozen=True)
class Basis:
    """The matrices of y = y0 + T x: T (n, nx), its rate T', the transformation L (nx, n) of the rows, and C (nu, nu), with
    u = C w for velocities w along the frame's axes."""

    T: Any
    rate: Any
    L: Any
    C: Any


def basis(system: Assembly, mechanics: Mechanics, frame: RotatingFrame, q: Array, u: Array) -> Basis:
    """The tangent basis along the frame's axes at positions q (nq,) and velocities u (nu,)."""
    nq, nu, rest = mechanics.nq, mechanics.nu, system.n - mechanics.nq - mechanics.nu
    T, rate, L = _Blocks((system.n, 2 * nu + rest)), _Blocks((system.n, 2 * nu + rest)), _Blocks((2 * nu + rest, system.n))
    C = _Blocks((nu, nu))
    for kind, places in _by_kind(mechanics):
        for (B, dB, inverse), (D, dD), kq, ku in _node_blocks(kind, places, frame, q, u):
            at, by = places[0] + kq, places[1] + ku
            T.add(at, by, B)
            rate.add(at, by, dB)
            L.add(by, at, inverse)
            T.add(nq + by, nu + by, D)
            rate.add(nq + by, nu + by, dD)
            L.add(nu + by, nq + by, D.transpose(0, 2, 1))
            C.add(by, by, D)
    own = np.arange(rest)
    T.add(nq + nu + own, 2 * nu + own, np.ones((rest, 1, 1)))
    L.add(2 * nu + own, nq + nu + own, np.ones((rest, 1, 1)))
    return Basis(T.matrix(), rate.matrix(), L.matrix(), C.matrix())


def _by_kind(mechanics: Mechanics) -> list[tuple[NodeKind, tuple[Array, Array]]]:
    """Kinds of nodes with the places of their nodes in q and u."""
    found: dict[NodeKind, list[Node]] = {}
    for node in mechanics.model.nodes:
        found.setdefault(node.kind, []).append(node)
    return [(kind, (np.array([n.q for n in nodes]), np.array([n.u for n in nodes]))) for kind, nodes in found.items()]


def _node_blocks(kind: NodeKind, places: tuple[Array, Array], frame: RotatingFrame, q: Array, u: Array) -> list[Any]:
    """((dq/dp, its rate, its inverse), (du/dw, its rate), offsets in q and u) for translations and rotations of nodes."""
    count = len(places[0])
    one, zero = np.ones((count, 1, 1)), np.zeros((count, 1, 1))
    if kind is NodeKind.COORDINATE:
        return [((one, zero, one), (one, zero), 0, 0)]
    if kind is NodeKind.ROTATION:  # relative to the body that carries the joint: in its axes, whatever the frame
        P, Omega = q[places[0][:, None] + np.arange(4)], u[places[1][:, None] + np.arange(3)]
        return [(*_rotation_blocks(P, Omega, replace(frame, rotation=np.eye(3)), np.zeros((3, 3))), 0, 0)]
    n, W = kind.translations, skew(frame.rate)
    R, dR = (np.tile(a[:n, :n], (count, 1, 1)) for a in (frame.rotation, W @ frame.rotation))
    out: list[Any] = [((R, dR, R.transpose(0, 2, 1)), (R, dR), 0, 0)]
    if kind is NodeKind.PLANAR:
        out.append(((one, zero, one), (one, zero), 2, 2))
    elif kind is NodeKind.SPATIAL:
        P, Omega = q[places[0][:, None] + np.arange(3, 7)], u[places[1][:, None] + np.arange(3, 6)]
        out.append((*_rotation_blocks(P, Omega, frame, W), 3, 3))
    return out


def _rotation_blocks(P: Array, Omega: Array, frame: RotatingFrame, W: Array) -> tuple[Any, Any]:
    """Blocks of nodes (k, ...) with quaternions P and angular velocities Omega in body axes: delta P = 1/2 (0, R_F psi) o P and
    delta Omega = R^T R_F w, with psi and w along the axes R_F of the frame, o the quaternion product, W the skew matrix of the
    frame's rate."""
    B = _times_quaternion(P) @ frame.rotation / 2
    scalar = -np.einsum("ki,ki->k", P[:, 1:], Omega)
    rate = np.column_stack([scalar, P[:, :1] * Omega + np.cross(P[:, 1:], Omega)]) / 2
    dB = (_times_quaternion(P) @ W @ frame.rotation + _times_quaternion(rate) @ frame.rotation) / 2
    R = rotation_matrices(P)
    RT, spin = R.transpose(0, 2, 1), np.einsum("kij,kj->ki", R, Omega)
    D, dD = RT @ frame.rotation, RT @ (W - _skews(spin)) @ frame.rotation
    return (B, dB, 4 * B.transpose(0, 2, 1) / np.einsum("ki,ki->k", P, P)[:, None, None]), (D, dD)


def _skews(a: Array) -> Array:
    """a~ (k, 3, 3) of vectors (k, 3)."""
    zero = np.zeros(len(a))
    x, y, z = a.T
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _times_quaternion(P: Array) -> Array:
    """(k, 4, 3) matrices of the map a -> (0, a) o P, a (3,), o the product of quaternions, P (k, 4)."""
    return np.concatenate([-P[:, None, 1:], P[:, :1, None] * np.eye(3) - _skews(P[:, 1:])], axis=1)


@dataclass(frozen=True)
class Pencil:
    """E x' + A x = 0 with the places of each kind in x and in the rows.

    Kinds: p displacements, w velocities, s internal states, z algebraic unknowns, c multipliers (rows: constraints), of these r
    those of rows of velocities."""

    E: Any
    A: Any
    places: dict[str, Array]
    C: Any
    errors: Pencil | None = None  #: bounds of the errors of the entries that rounding causes, where they were asked for

    def part(self, matrix: Any, rows: str, columns: str) -> Any:
        """The block of E or A between two kinds, sparse."""
        return matrix[self.places[rows]][:, self.places[columns]]

    @cached_property
    def kinematics(self) -> Any:
        """Kp (nu, nu) with w = p' + Kp p."""
        return self.part(self.A, "p", "p")

    @cached_property
    def constraints(self) -> Array:
        """Constraint Jacobian G (m, nu): derivatives by the displacements p, of rows of velocities by the velocities w."""
        return np.asarray(self._restrict(self.part(self.A, "c", "p")).toarray())

    def _restrict(self, rows: Any) -> Any:
        """Rows c by displacements, those of velocities replaced by their derivatives by w: displacements follow them."""
        if not len(self.places.get("r", ())):
            return rows
        by_rates = sp.diags(np.isin(self.places["c"], self.places.get("r", ())).astype(float))
        return rows - by_rates @ rows + by_rates @ self.part(self.A, "c", "w")

    @cached_property
    def closing(self) -> Array:
        """Those rows of `constraints` that restrict positions."""
        return self.constraints[~np.isin(self.places["c"], self.places.get("r", ()))]

    @cached_property
    def static(self) -> Any:
        """The equations (w, s, z, c) for displacements that are constant in the frame (p' = 0), columns (p, s, z, c), CSR. Those
        of velocities have the displacements follow them: of all positions at rest they give the one that is reached so."""
        A = self.A[np.concatenate([self.places[k] for k in "wszc"])].tocsc()
        others = np.concatenate([self.places[k] for k in "szc"])
        displaced = A[:, self.places["p"]] + A[:, self.places["w"]] @ self.kinematics
        if len(self.places.get("r", ())):
            displaced = sp.vstack([displaced[: -len(self.places["c"])], self._restrict(self.part(self.A, "c", "p"))])
        return sp.hstack([displaced, A[:, others]], format="csr")


def pencil(system: Assembly, mechanics: Mechanics, frame: RotatingFrame, t: float, y: Array, yp: Array,
           parts: tuple[Any, Any] | None = None) -> Pencil:
    """The linearisation of a system at (t, y, y'); `parts`: dF/dy and dF/dy' where they are known."""
    nq, nu = mechanics.nq, mechanics.nu
    b = basis(system, mechanics, frame, y[:nq], y[nq : nq + nu])
    Fy, Fyp = parts if parts is not None else derivatives(system, t, y, yp)
    E, A = b.L @ Fyp @ b.T, b.L @ (Fy @ b.T + Fyp @ b.rate)
    return Pencil(E.tocsr(), A.tocsr(), _places(system, mechanics, A.tocsr()), b.C)


def with_errors(system: Assembly, mechanics: Mechanics, frame: RotatingFrame, t: float, y: Array, yp: Array,
                beside: list[Pencil]) -> Pencil:
    """`pencil` with bounds of the errors of its entries: `ROUNDED` times the sums of the absolute values of their terms, and
    twice the largest difference from pencils `beside` it, made from numbers that differ by rounding."""
    p = pencil(system, mechanics, frame, t, y, yp)
    b = basis(system, mechanics, frame, y[: mechanics.nq], y[mechanics.nq : mechanics.nq + mechanics.nu])
    (Fy, Fyp), (T, rate, L) = system.evaluation.jacobian_sizes(t, y, yp), map(abs, (b.T, b.rate, b.L))
    E, A = ROUNDED * (L @ Fyp @ T), ROUNDED * (L @ (Fy @ T + Fyp @ rate))
    for other in beside:
        E, A = E.maximum(2 * abs(other.E - p.E)), A.maximum(2 * abs(other.A - p.A))
    return replace(p, errors=Pencil(E.tocsr(), A.tocsr(), p.places, b.C))


def derivatives(system: Assembly | System, t: float, y: Array, yp: Array) -> tuple[Any, Any]:
    """dF/dy and dF/dy' (n, n), sparse."""
    pattern = system.sparsity
    fy, fyp = system.jacobian_parts(t, y, yp)
    if pattern is None:
        return sp.csr_matrix(fy), sp.csr_matrix(fyp)
    fy, fyp = (sp.csc_matrix((d, pattern.indices, pattern.indptr), shape=pattern.shape).tocsr() for d in (fy, fyp))
    return fy, fyp


def _places(system: Assembly, mechanics: Mechanics, A: Any) -> dict[str, Array]:
    """Indices of each kind of unknowns in x; algebraic unknowns without compliance are multipliers."""
    nu, shift = mechanics.nu, mechanics.nu - mechanics.nq
    kinds = np.array(system.kinds)
    at = {k: np.flatnonzero(kinds == k) + shift for k in ("s", "z", "lambda")}
    z = at["z"]
    own = abs(A[z][:, z]) if len(z) else None
    rigid = np.zeros(len(z), dtype=bool) if own is None else np.asarray(own.sum(axis=1)).ravel() == 0
    by_rates = np.array([row.by_rates for row in system.numbering.rows], dtype=bool)
    return {"p": np.arange(nu), "w": nu + np.arange(nu), "s": at["s"], "z": z[~rigid], "r": at["lambda"][by_rates],
            "c": np.r_[at["lambda"], z[rigid]]}


def acting_states(p: Pencil) -> Array:
    """Internal states that other equations depend on; each of the others would add an eigenvalue 0."""
    return acting(abs(p.A), np.concatenate([p.places["w"], p.places["z"]]), p.places["s"])


def acting(size: Any, rows: NDArray[Any], states: NDArray[Any]) -> NDArray[Any]:
    """Those of the states (columns of `size`, sparse) that the given rows depend on, directly or through other states."""
    while len(states):
        acts = np.asarray(size[np.concatenate([rows, states])][:, states].sum(axis=0)).ravel() > 0
        if acts.all():
            break
        states = states[acts]
    return states
