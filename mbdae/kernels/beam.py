"""Kernels of a meshed beam: internal forces, gyroscopic moments and distributed loads of its elements, and their constant
masses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import OptionError, internal
from mbdae.kernels.line import LineKernel
from mbdae.kernels.line_nodes import Array, ElementKernel
from mbdae.laws.beam import Beam, LineLoad, ShapeTable, mass_points, strain_points
from mbdae.laws.line_mesh import LineMesh
from mbdae.native.program import Operations, block
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LineDerived, derive_line
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Vec, rotation_columns


def derived_beam(numbers: Mapping[str, float], kind: NodeKind, mixed: bool = True) -> LineDerived:
    """The derived beam law for the parameters of a section; without damping terms where the damping is 0."""
    return derive_line(Beam, Structure(frozenset() if numbers.get("damping") else frozenset({"damping"})), kind, mixed)


def strain_kernel(mesh: LineMesh, numbers: Mapping[str, float], kind: NodeKind, mixed: bool = True) -> LineKernel:
    """Kernel of the internal forces and, where `mixed`, of the rows of the stress unknowns.

    numbers: parameters of `Beam` (see `Section.numbers`), without the reference strains. These are the strains of the beam as
    drawn, computed here from its interpolated curve, so that the beam as drawn is free of stress.
    """
    zero_compliance = [name for name, value in numbers.items() if name.startswith("compliance_") and value == 0]
    if zero_compliance and not mixed:
        raise internal(f"{zero_compliance[0]} = 0, an infinite stiffness of the section, came to a beam whose stresses are no "
                       "unknowns: no stress follows from a strain that stays 0", OptionError)
    d, at = derived_beam(numbers, kind, mixed), strain_points(mesh.order)
    return LineKernel(d, at, {**numbers, **_measures(mesh, at), **_reference_strains(mesh, kind)}, turns(mesh, kind))


def load_kernel(mesh: LineMesh, law: LineLoad, kind: NodeKind, given: tuple[str, ...] = ()) -> LineKernel:
    """Kernel of a distributed load on a beam. given: names of its components that depend on time and so are inputs of the kernel.
    Loads of constant value and direction (dead loads) need no kernel: their nodal forces are `mesh.lumped` times the value."""
    at = mass_points(mesh.order)
    constants = {name: getattr(law, name) for name in law.params if name not in given}
    d = derive_line(LineLoad, law.structure(frozenset(given)), kind)
    return LineKernel(d, at, {**constants, **_measures(mesh, at)}, turns(mesh, kind), given)


def turns(mesh: LineMesh, kind: NodeKind) -> Array:
    """Constant rotations from the axes of nodes to those of the sections there, of m elements of order p: quaternions
    (m, p + 1, 4), or angles (m, p + 1), rad, in the plane. They are not 0 at corners, where two sections share a node."""
    return mesh.offsets if kind is NodeKind.PLANAR else mesh.turns


def reference_positions(mesh: LineMesh, kind: NodeKind) -> Array:
    """Positions q (n, nq) of the n nodes of a beam as drawn."""
    if kind is NodeKind.PLANAR:
        return np.column_stack([mesh.positions[:, :2], mesh.headings])
    return np.hstack([mesh.positions, mesh.quaternions])


def _measures(mesh: LineMesh, at: ShapeTable) -> dict[str, Array]:
    ds = mesh.measure(at)
    return {"ds": ds, "weight": ds * at.weights}


def _reference_strains(mesh: LineMesh, kind: NodeKind) -> dict[str, Array]:
    """Strains (m, points) of the curve as drawn, by their parameter names: the values of the law's rows (strain less reference
    strain less compliance times stress) where stresses and reference strains are set to 0."""
    d, at = derived_beam({}, kind), strain_points(mesh.order)
    constants = dict.fromkeys(d.parameters, 0.0) | {"ds": mesh.measure(at), "weight": 1.0}
    kernel = LineKernel(d, at, constants, turns(mesh, kind))
    q = reference_positions(mesh, kind)[mesh.elements].reshape(len(mesh.elements), -1)
    strains = kernel.values(np.hstack([q, np.zeros((len(q), len(kernel.names)))]))[:, -len(kernel.names) :]
    strains = strains.reshape(len(q), len(at.xi), -1)
    return {f"reference_{name}": strains[:, :, i] for i, name in enumerate(d.stresses)}


def mass_blocks(mesh: LineMesh, numbers: Mapping[str, float], kind: NodeKind) -> Array:
    """(m, (p + 1) nu, (p + 1) nu) consistent mass of every element in the velocities of its nodes, constant."""
    density = np.zeros((kind.sizes[1], kind.sizes[1]))
    for place, e in derived_beam(numbers, kind).mass.items():
        density[place] = float(e.subs({se.Symbol(name): value for name, value in numbers.items()}))
    U = _to_sections(mesh, kind)
    M = np.einsum("mab,maik,ij,mbjl->makbl", mesh.shared(mass_points(mesh.order)), U, density, U, optimize=True)
    size = M.shape[1] * M.shape[2]
    return np.asarray(M.reshape(len(M), size, size))


def _to_sections(mesh: LineMesh, kind: NodeKind) -> Array:
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
