"""Kernels of elements with several nodes: values and derivatives of all elements at once.

The nodes of a line element: conversion of their unknowns to the interpolated fields, and of forces on the fields to forces on
the nodes; gyroscopic moments at the nodes.

Positions and quaternions of the sections are interpolated component by component. A quaternion P changes by P' = 1/2 Q(P) Omega,
and a generalised force g on it is the moment 1/2 Q(P)^T g. Q is linear in P, so that both, and their derivatives, are products
with one constant tensor.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.laws.line_mesh import LineMesh
from mbdae.native.program import Operations, block
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Vec, rate_from_body_spin, rotation_columns

Array = NDArray[Any]

#: golden ratio less 1: the fractional parts of its multiples are spread irregularly over 0 to 1. From them the inputs are made at
#: which the entries of the Jacobian that are not 0 are found, so that none of them is 0 by chance
GOLDEN = (5**0.5 - 1) / 2


class ElementKernel(ABC):
    """A law over m elements of the same kind, for example the strains of beam elements. In native programs it is used like a
    `Kernel` that is evaluated once per element.

    inputs   columns of x: ("q", node, i), ("u", node, i), ("z", j) algebraic unknowns, ("p", name) prescribed values
    targets  columns of the outputs: ("u", node, i) terms on the left-hand side of the equations of motion, ("z", j) rows of the
             algebraic unknowns

    Nodes are numbered within the element. x is (N, inputs), where N is a multiple of m: the inputs of all elements in order for
    the first state, then for the second one, ...
    """

    elements: int
    inputs: list[Target]
    targets: list[Target]

    @abstractmethod
    def values(self, x: Array) -> Array:
        """Outputs (N, outputs) for inputs x (N, inputs)."""

    @abstractmethod
    def full_jacobian(self, x: Array) -> Array:
        """(N, outputs, inputs) derivatives of `values` by unknowns; ("p", name), the last inputs, are left out."""

    @abstractmethod
    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the evaluation of all elements to a native program, see `Kernel.emit`. gather: slots of the inputs (elements,
        inputs). Returns the slots of the values (elements, outputs)."""

    @abstractmethod
    def emit_jacobian(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives to a native program. Returns their slots (elements, len(jacobian_places))."""

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Row and column numbers (outputs, inputs) of the entries of the Jacobian that are not identically zero, found at a state
        of irregular numbers."""
        x = 0.3 + 0.6 * (np.arange(1.0, self.elements * len(self.inputs) + 1) * GOLDEN % 1).reshape(self.elements, -1)
        outputs, inputs = np.nonzero(np.any(self.full_jacobian(x) != 0, axis=0))
        return outputs, inputs

    @cached_property
    def jacobian_places(self) -> list[tuple[int, Target]]:
        """Of every derivative that `jacobian` returns the number of the output and the input by which it is differentiated."""
        return [(int(o), self.inputs[i]) for o, i in zip(*self._places, strict=True)]

    def jacobian(self, x: Array) -> Array:
        """(N, len(jacobian_places)) derivatives: the entries of `full_jacobian` that are not identically zero."""
        return self.full_jacobian(x)[:, *self._places]


class ElementJacobian:
    """The derivatives of an element kernel, with the method `emit` of a kernel, so that both are used alike."""

    def __init__(self, kernel: ElementKernel) -> None:
        self.kernel = kernel

    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives of all elements to a native program, by `ElementKernel.emit_jacobian`; returns their slots."""
        return self.kernel.emit_jacobian(part, gather)


@lru_cache(maxsize=1)
def kinematic_tensor() -> Array:
    """H (4, 3, 4) with P'_a = H_acb Omega_c P_b, derived from `rate_from_body_spin`, which all laws use."""
    P, w = se.symbols("P1:5"), se.symbols("w1:4")
    return np.array([[[float(se.diff(se.diff(e, c), b)) for b in P] for c in w] for e in rate_from_body_spin(P, Vec(*w))])


class Nodes:
    """The nodes of N elements, `count` per element. Arrays of nodal values are (N, count, components), those of derivatives
    (rows, columns, N). A section is the beam's cross-section at a node, whose axes may differ from the node's by a constant
    rotation."""

    def __init__(self, kind: NodeKind, count: int, turns: Array | None) -> None:
        """`turns`: (m, count, 4) rotations from node to section, or (m, count) angles in the plane; None: none."""
        self.flat, self.count = kind is NodeKind.PLANAR, count
        self.nq, self.nu = kind.sizes
        self.offset: Array | None = None  #: (m, count) in the plane: angle of the section less that of the node, rad; None: all 0
        self.T: Array | None = None  #: (m, count, 4, 4) in space: quaternion of the section = T times the node's; None: equal
        if turns is not None and self.flat and np.any(turns):
            self.offset = turns
        elif turns is not None and not self.flat and np.any(turns != np.eye(4)[0]):
            vector = 2 * np.einsum("acb,mnc->mnab", kinematic_tensor(), turns[..., 1:])
            self.T = vector + turns[..., :1, None] * np.eye(4)

    def _tiled(self, values: Array, N: int) -> Array:
        return np.tile(values, (N // len(values), *(1,) * (values.ndim - 1)))

    # -- values

    def turned(self, q: Array) -> Array:
        """Rates or variations (N, count, nq) of the positions of nodes, converted to those of their sections."""
        if self.T is None:
            return q
        return np.concatenate([q[..., :3], np.einsum("mnab,mnb->mna", self._tiled(self.T, len(q)), q[..., 3:])], axis=-1)

    def sections(self, q: Array) -> Array:
        """Positions (N, count, nq) of nodes, converted to those of their sections."""
        if self.offset is None:
            return self.turned(q)
        return np.concatenate([q[..., :2], q[..., 2:] + self._tiled(self.offset, len(q))[..., None]], axis=-1)

    def back(self, covector: Array) -> Array:
        """Generalised forces (N, count, nq) on positions of sections, converted to those on nodes: the transpose of `turned`."""
        if self.T is None:
            return covector
        g = np.einsum("mnab,mna->mnb", self._tiled(self.T, len(covector)), covector[..., 3:])
        return np.concatenate([covector[..., :3], g], axis=-1)

    def rates(self, q: Array, u: Array) -> Array:
        """q' (N, count, nq) from velocities u (N, count, nu)."""
        if self.flat:
            return u
        return np.concatenate([u[..., :3], np.einsum("mnac,mnc->mna", self._spin_columns(q), u[..., 3:])], axis=-1)

    def forces(self, q: Array, covector: Array) -> Array:
        """Forces and moments (N, count, nu), the moments in node axes, from the generalised forces (N, count, nq) on q."""
        if self.flat:
            return covector
        moments = np.einsum("mnac,mna->mnc", self._spin_columns(q), covector[..., 3:])
        return np.concatenate([covector[..., :3], moments], axis=-1)

    def _spin_columns(self, q: Array) -> Array:
        """Matrices Q(P) / 2 (N, count, 4, 3) of every node, with P' = Q(P) Omega / 2 for its quaternion P."""
        by_quaternion = kinematic_tensor().reshape(12, 4).T
        return np.asarray((q[..., 3:].reshape(-1, 4) @ by_quaternion).reshape(*q.shape[:2], 4, 3))

    # -- derivatives

    def turn_columns(self, K: Array) -> Array:
        """Derivatives (rows, count * nq, N) by section positions, converted to those by node positions."""
        return K if self.T is None else self._on_columns(K, self._tiled(self.T, K.shape[-1]))

    def turn_rows(self, K: Array) -> Array:
        """Derivatives (count * nq, columns, N) of generalised forces on sections, converted to those of forces on nodes."""
        return self.turn_columns(K.swapaxes(0, 1)).swapaxes(0, 1)

    def velocity_columns(self, K: Array, q: Array) -> Array:
        """Derivatives by q' (rows, count * nq, N), converted to those by velocities (rows, count * nu, N)."""
        return K if self.flat else self._on_columns(K, self._spin_columns(q))

    def position_columns(self, K: Array, u: Array) -> Array:
        """Derivatives by q' (rows, count * nq, N), converted to those by q, on which q' = H(q) u depends at constant u."""
        if self.flat:
            return np.zeros_like(K)
        moved = self._on_columns(K, np.einsum("acb,mnc->mnab", kinematic_tensor(), u[..., 3:]))
        moved.reshape(len(K), self.count, self.nq, -1)[:, :, :3] = 0.0
        return moved

    def force_rows(self, K: Array, q: Array) -> Array:
        """Derivatives (count * nq, columns, N) of generalised forces on q, converted to those (count * nu, columns, N) of forces
        and moments."""
        return self.velocity_columns(K.swapaxes(0, 1), q).swapaxes(0, 1)

    def geometric(self, covector: Array) -> Array:
        """Derivative of `forces` by q at constant generalised forces, (count * nu, count * nq, N)."""
        K = np.zeros((self.count, self.nu, self.count, self.nq, len(covector)), dtype=covector.dtype)
        if not self.flat:
            moments = np.einsum("acb,mna->ncbm", kinematic_tensor(), covector[..., 3:])
            for a in range(self.count):
                K[a, 3:, a, 3:] = moments[a]
        return K.reshape(self.count * self.nu, self.count * self.nq, -1)

    def _on_columns(self, K: Array, A: Array) -> Array:
        """Derivatives K (rows, count * nq, N) times the block-diagonal matrix of I (3, 3) and A (N, count, 4, k) per node."""
        rows, _, N = K.shape
        blocks = K.reshape(rows, self.count, self.nq, N)
        A = np.ascontiguousarray(A.transpose(2, 1, 3, 0))  # the axis of elements last, as in K, which makes the products fast
        turned = sum(blocks[:, :, 3 + a, None] * A[a] for a in range(4))
        return np.concatenate([blocks[:, :, :3], turned], axis=2).reshape(rows, -1, N)


def to_sections(mesh: LineMesh, kind: NodeKind) -> Array:
    """Matrices (m, p + 1, nu, nu) that map velocities of nodes to those of sections: the angular velocity is the same, but its
    components are in the axes of the section instead of those of the node."""
    U = np.tile(np.eye(kind.sizes[1]), (*mesh.elements.shape, 1, 1))
    if kind is NodeKind.SPATIAL:
        columns = rotation_columns(list(se.symbols("P1:5")))
        R = _numeric(list(se.symbols("P1:5")), [c for column in columns for c in column], mesh.turns)
        # R holds rotation matrices column by column, so that these blocks are their transposes
        U[..., 3:, 3:] = R.reshape(*mesh.elements.shape, 3, 3)
    return U


def _numeric(symbols: list[Any], expressions: list[Any], x: Array) -> Array:
    f = se.Lambdify(symbols, expressions, backend="lambda")
    return np.asarray(f(np.ascontiguousarray(x, dtype=float)))


@lru_cache(maxsize=1)
def _cross() -> Array:
    """Permutation symbol E (3, 3, 3), (a x b)_i = E_ijk a_j b_k, derived from the vector product `Vec.cross` of the laws."""
    a, b = Vec(*se.symbols("a1:4")), Vec(*se.symbols("b1:4"))
    return np.array([[[float(se.diff(se.diff(e, j), k)) for k in b] for j in a] for e in a.cross(b)])


class GyroscopicKernel(ElementKernel):
    """Gyroscopic moments Omega_i x (M Omega)_i at the nodes i of every element. M is the rotary part of its consistent mass
    matrix, which also couples different nodes. With moments of this form energy and angular momentum are conserved.

    Inputs: angular velocities of the nodes; outputs: moments on them, both in the axes of the node.
    """

    def __init__(self, blocks: Array, count: int) -> None:
        """`blocks` of `mass_blocks` for spatial nodes, `count` nodes per element."""
        size = blocks.shape[1] // count
        self.count, self.elements = count, len(blocks)
        self.J = blocks.reshape(-1, count, size, count, size)[:, :, 3:, :, 3:]
        self.inputs: list[Target] = [("u", a, 3 + i) for a in range(count) for i in range(3)]
        self.targets = self.inputs

    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        W, L, width = *self._spins(part, gather), 3 * self.count
        found = part.zeros(gather.size)
        at, weights = np.array(np.nonzero(_cross())), np.tile(_cross()[np.nonzero(_cross())], self.count)
        i, j, k = (at[:, None, :] + 3 * np.arange(self.count)[:, None]).reshape(3, -1)
        part.multiply(found + i, W + j, L + k, weights, len(gather), width, width, width)
        return block(found, len(gather), width)

    def emit_jacobian(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        W, L, width, E = *self._spins(part, gather), 3 * self.count, _cross()
        terms = [(int(i), int(j), int(k), float(E[i, j, k])) for i, j, k in zip(*np.nonzero(E), strict=True)]
        J, places = part.constant(self.J), list(zip(*(p.tolist() for p in self._places), strict=True))
        found = part.zeros(len(gather) * len(places))
        products, sums = [], []
        for n, (output, column) in enumerate(places):
            (a, i), (b, l) = divmod(output, 3), divmod(column, 3)
            products += [(n, 3 * a + j, (3 * a + k) * width + column, e) for row, j, k, e in terms if row == i]
            sums += [(n, 3 * a + k, e) for row, j, k, e in terms if row == i and j == l and a == b]
        to, spin, mass, weight = zip(*products, strict=True)
        part.multiply(found + np.array(to), W + np.array(spin), J + np.array(mass), np.array(weight), len(gather), len(places),
                      width, width * width)
        to, momentum, weight = zip(*sums, strict=True)
        part.add(found + np.array(to), L + np.array(momentum), np.array(weight), len(gather), len(places), width)
        return block(found, len(gather), len(places))

    def _spins(self, part: Operations, gather: NDArray[np.intp]) -> tuple[int, int]:
        """First slots of the angular velocities Omega and of the angular momenta M Omega, (elements, 3 count) each."""
        width = 3 * self.count
        W, L = part.slots(gather.size), part.zeros(gather.size)
        part.set(W + np.arange(gather.size), gather)
        rows, columns = np.divmod(np.arange(width * width), width)
        part.add(L + rows, W + columns, self.J.reshape(self.elements, -1), len(gather), width, width)
        return W, L

    def _momenta(self, x: Array) -> tuple[Array, Array, Array]:
        W = x.reshape(len(x), self.count, 3)
        J = np.tile(self.J, (len(x) // len(self.J), 1, 1, 1, 1))
        return W, J, np.einsum("maibj,mbj->mai", J, W)

    def values(self, x: Array) -> Array:
        W, _, L = self._momenta(x)
        return np.asarray(np.einsum("ijk,maj,mak->mai", _cross(), W, L).reshape(len(x), -1))

    def full_jacobian(self, x: Array) -> Array:
        W, J, L = self._momenta(x)
        K: Array = np.einsum("ijk,maj,makbl->maibl", _cross(), W, J)
        for a in range(self.count):
            K[:, a, :, a] += np.einsum("ijk,mk->mij", _cross(), L[:, a])
        return K.reshape(len(x), 3 * self.count, 3 * self.count)
