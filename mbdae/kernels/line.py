"""A law on a line (a beam) as one kernel over its elements: nodal values are interpolated at the integration points, the law is
evaluated there, and its forces are distributed to the nodes by the transpose of the interpolation.

All elements share one table of shape functions; the parameters of an element are stored for every integration point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.disk.entries import code_key, keep, part_key, recall
from mbdae.errors import LawError, OptionError, internal
from mbdae.kernels import Kernel, numpy_function
from mbdae.kernels.line_nodes import Array, ElementKernel, Nodes, to_sections
from mbdae.kernels.line_program import LineProgram
from mbdae.laws.beam import Beam, LineLoad, ShapeTable, mass_points, strain_points
from mbdae.laws.line_mesh import LineMesh
from mbdae.native.program import Operations, block
from mbdae.process import made_once
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import Field, LineDerived, derive_line
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr

#: about the number of products (entry of a `Spread` times derivative) that are formed at once, which bounds the memory
TOGETHER = 1_000_000


class Spread(NamedTuple):
    """Constant sparse matrix that maps the derivatives at the integration points of an element to those of the whole element.

    shape: that of the element's derivatives, which are numbered row by row; rows (ascending), columns and factors (k,): places
    and values of the k entries of the sparse matrix."""

    shape: tuple[int, int]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    factors: Array

    @property
    def size(self) -> int:
        """Number of rows of the sparse matrix."""
        return self.shape[0] * self.shape[1]

    def of(self, values: Array) -> Array:
        """Product (*shape, N) of the sparse matrix with the derivatives (D, N) at the points of N elements."""
        found = np.zeros((self.size, values.shape[1]), values.dtype)
        rows, first = np.unique(self.rows, return_index=True)
        size = TOGETHER // max(len(self.rows), 1) + 1
        for some in (slice(i, i + size) for i in range(0, values.shape[1] if len(rows) else 0, size)):
            found[rows, some] = np.add.reduceat(self.factors[:, None] * values[self.columns, some], first)
        return found.reshape(*self.shape, -1)


class LineKernel(ElementKernel):
    """A law on a line over m elements. Inputs: positions q of the nodes, with damping also their velocities u, then the stresses
    point by point, then the parameters `given`.

    at: shape functions at the integration points; constants: parameter -> number, (m,) or (m, points); turns: constant rotations
    from nodes to sections, see `Nodes`; given: parameters that are prescribed in time and so are inputs, one number per element.
    """

    def __init__(self, derived: LineDerived, at: ShapeTable, constants: Mapping[str, Any], turns: Array | None = None,
                 given: Sequence[str] = ()) -> None:
        self.derived, self.at, self.given = derived, at, tuple(given)
        self.points, self.turns = len(at.xi), turns
        self.nodes = Nodes(derived.kind, at.values.shape[1], turns)
        names = [name for name in derived.parameters if name not in self.given]
        self.numbers = _per_point([constants[name] for name in names], self.points)
        self.parameters = (*self.given, *names)
        self.elements = len(self.numbers)
        self.fields = self._table(derived.fields)
        self.duals = self._table([f for f, _ in derived.duals])
        #: names of the stress unknowns of an element, such as N1[0] at the first integration point
        self.names = [f"{name}[{g}]" for g in range(self.points) for name in derived.stresses]
        n, stresses = self.nodes, [("z", j) for j in range(len(self.names))]
        positions = [("q", a, i) for a in range(n.count) for i in range(n.nq)]
        velocities = [("u", a, i) for a in range(n.count) for i in range(n.nu)]
        rates = velocities if derived.damped else []
        self.inputs: list[Target] = [*positions, *rates, *stresses, *(("p", name) for name in self.given)]
        self.targets: list[Target] = [*velocities, *stresses]
        self._splits = np.cumsum([len(positions), len(rates), len(stresses)])
        self._buffers: dict[tuple[int, bool], Array] = {}

    def _table(self, fields: Sequence[Field]) -> Array:
        """(count * nq, points * fields) interpolation matrix of nodal values; its transpose distributes forces to the nodes."""
        T = np.zeros((self.nodes.count, self.nodes.nq, self.points, len(fields)))
        for i, f in enumerate(fields):
            T[:, f.component, :, i] = (self.at.slopes if f.slope else self.at.values).T
        return T.reshape(self.nodes.count * self.nodes.nq, -1)

    # -- values

    @property
    def point(self) -> Kernel:
        """Kernel of the law at one integration point: its duals (the generalised forces on the interpolated fields), then its
        rows of the stress unknowns."""
        return _point(self.derived, self.parameters)

    def values(self, x: Array) -> Array:
        q, _, X = self._gather(x)
        duals, rows = self._split(_evaluated(self.point, X), len(x))
        return np.concatenate([self.nodes.forces(q, self._covector(duals)).reshape(len(x), -1), rows], axis=1)

    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        return block(LineProgram(self, part, gather).values(), len(gather), len(self.targets))

    def emit_jacobian(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        return block(LineProgram(self, part, gather).jacobian(), len(gather), len(self.jacobian_places))

    def at_points(self, x: Array, expressions: Sequence[Expr]) -> Array:
        """(N, points, expressions) values of other expressions of the law, such as `derived.energy`.

        Compliance 0 is read as infinite here: a rigid strain stores no energy (its stress is an unknown).
        """
        X = self._gather(x)[2].copy()
        compliances = [i for i, s in enumerate(self.point.symbols) if str(s).startswith("compliance_")]
        X[:, compliances] = np.where(X[:, compliances] == 0, np.inf, X[:, compliances])
        with np.errstate(all="ignore"):
            found = _by_numpy(tuple(self.point.symbols), tuple(expressions))(X)
        return found.reshape(len(x), self.points, -1)

    def _gather(self, x: Array) -> tuple[Array, Array, Array]:
        """Nodal q (N, count, nq) and u (N, count, nu), and the inputs (N * points, inputs) of the law."""
        N, n = len(x), self.nodes
        a, b, c = self._splits
        q, u = x[:, :a].reshape(N, n.count, n.nq), x[:, a:b].reshape(N, -1, n.nu)
        parts = [n.sections(q).reshape(N, -1) @ self.fields]
        if self.derived.damped:
            parts.append(n.turned(n.rates(q, u)).reshape(N, -1) @ self.fields)
        X, column = self._buffer(N, np.iscomplexobj(x)), 0
        for part in (*parts, x[:, b:c]):
            width = part.shape[1] // self.points
            X[:, :, column : column + width] = part.reshape(N, self.points, width)
            column += width
        X[:, :, column : column + len(self.given)] = x[:, None, c:]
        return q, u, X.reshape(N * self.points, -1)

    def _buffer(self, N: int, is_complex: bool) -> Array:
        """Array (N, points, inputs) for the inputs of the law, with its constant parameters filled in; reused by all calls."""
        if (N, is_complex) not in self._buffers:
            X = np.empty((N, self.points, len(self.point.symbols)), dtype=complex if is_complex else float)
            X[:, :, X.shape[2] - self.numbers.shape[2] :] = np.tile(self.numbers, (N // len(self.numbers), 1, 1))
            self._buffers[N, is_complex] = X
        return self._buffers[N, is_complex]

    def _split(self, values: Array, N: int) -> tuple[Array, Array]:
        """The outputs of `point`, split into duals (N, points * duals) and rows (N, points * stresses)."""
        values = values.reshape(N, self.points, -1)
        n = len(self.derived.duals)
        return values[:, :, :n].reshape(N, -1), values[:, :, n:].reshape(N, -1)

    def _covector(self, duals: Array) -> Array:
        """Generalised forces (N, count, nq) on the positions of the nodes, from those on the fields at the points (`duals`)."""
        return self.nodes.back((duals @ self.duals.T).reshape(len(duals), self.nodes.count, self.nodes.nq))

    # -- derivatives

    @property
    def point_jacobian(self) -> Kernel:
        """Kernel of the duals (see `point`), then of the derivatives of duals and rows by the variables of the law, at one
        integration point."""
        return _point_jacobian(self.derived, self.parameters)[0]

    @cached_property
    def _spread(self) -> Spread:
        """The matrix that maps the derivatives at the integration points to those of an element."""
        d, points = self.derived, range(self.points)
        outputs = _with_identity(self.duals, self.points, len(d.duals), len(d.rows))
        columns = _with_identity(self.fields, self.points, len(d.fields), len(d.stresses), 1 + d.damped)
        o, i = np.array(_point_jacobian(d, self.parameters)[1], dtype=int).reshape(-1, 2).T
        left = outputs[:, [g * len(d.outputs) + k for g in points for k in o]]
        right = columns[:, [g * len(d.variables) + k for g in points for k in i]]
        products = left[:, None, :] * right[None, :, :]  # the last axis is empty where no output depends on a variable
        flat = products.reshape(len(left) * len(right), left.shape[1])
        at = np.nonzero(flat)
        return Spread((len(left), len(right)), at[0], at[1], flat[at])

    def full_jacobian(self, x: Array) -> Array:
        q, u, X = self._gather(x)
        return self._assembled(_evaluated(self.point_jacobian, X).reshape(len(x), self.points, -1), q, u)

    def _assembled(self, values: Array, q: Array, u: Array) -> Array:
        """Derivatives (N, outputs, inputs) of the elements, from the values (N, points, width) of `point_jacobian`."""
        N, n, D = len(values), self.nodes, len(self.derived.duals)
        covector = self._covector(values[:, :, :D].reshape(N, -1))
        K = self._spread.of(values[:, :, D:].reshape(N, -1).T)
        a, z = n.count * n.nq, len(self.names)
        blocks = [n.turn_columns(K[:, :a])]
        if self.derived.damped:
            by_rate = n.turn_columns(K[:, a : 2 * a])
            blocks = [blocks[0] + n.position_columns(by_rate, u), n.velocity_columns(by_rate, q)]
        K = np.concatenate([*blocks, K[:, K.shape[1] - z :]], axis=1)
        forces = n.force_rows(n.turn_rows(K[:a]), q)
        forces[:, :a] += n.geometric(covector)
        return np.concatenate([forces, K[a:]]).transpose(2, 0, 1)


def merged(kernels: Sequence[LineKernel]) -> LineKernel:
    """One kernel for the elements of several lines, one line after the other; their laws, orders and kinds of nodes have to be
    equal."""
    first = kernels[0]
    if len({(k.derived, k.at, k.given, k.turns is None) for k in kernels}) > 1:
        raise internal("beams of different laws, orders or kinds of nodes were to share one compiled function; they need one "
                       "each", LawError)
    names = first.parameters[len(first.given) :]
    numbers = np.concatenate([k.numbers for k in kernels])
    turns = None if first.turns is None else np.concatenate([k.turns for k in kernels])
    return LineKernel(first.derived, first.at, {n: numbers[..., i] for i, n in enumerate(names)}, turns, first.given)


@made_once("derive", 64)
def _point(derived: LineDerived, parameters: tuple[str, ...]) -> Kernel:
    """The kernel of a law at one integration point; made once per process."""
    symbols = [*derived.variables, *map(se.Symbol, parameters)]
    return Kernel(symbols, derived.outputs, key=code_key(symbols, derived.outputs, None))


@made_once("derive", 64)
def _by_numpy(symbols: tuple[Expr, ...], expressions: tuple[Expr, ...]) -> Callable[[Array], Array]:
    """Further expressions at many points, where compiling does not pay."""
    return numpy_function(symbols, expressions)


@made_once("derive", 64)
def _point_jacobian(derived: LineDerived, parameters: tuple[str, ...]) -> tuple[Kernel, list[tuple[int, int]]]:
    """The kernel of duals and derivatives at one point, and which (output, variable) each derivative is."""
    point, duals = _point(derived, parameters), [e for _, e in derived.duals]
    key = part_key(point.key, "jacobian", str(len(duals)), str(len(derived.variables)))
    places = recall(part_key(key, "places"))
    if places is None:
        keep(part_key(key, "places"), places := list(derived.derivatives))
    made = Kernel(point.symbols, lambda: [*duals, *derived.derivatives.values()], None, len(duals) + len(places), key)
    return made, places


def _per_point(values: Sequence[Any], points: int) -> Array:
    """The parameters as one array (m, points, parameters); each is given as a number, as (m,) or as (m, points)."""
    arrays = [np.asarray(v, dtype=float) for v in values]
    arrays = [a[:, None] if a.ndim == 1 else a for a in arrays]
    shape = np.broadcast_shapes(*(a.shape for a in arrays), (1, points))
    return np.stack([np.broadcast_to(a, shape) for a in arrays], axis=-1) if arrays else np.zeros((*shape, 0))


def _evaluated(kernel: Kernel, X: Array) -> Array:
    """Values of a kernel at X: compiled for real numbers, by NumPy for complex ones (derivatives by the complex step)."""
    return kernel.oracle(X) if np.iscomplexobj(X) else kernel.values(X)


def _with_identity(table: Array, points: int, fields: int, extra: int, copies: int = 1) -> Array:
    """Matrix that maps values at the integration points to an element: `fields` numbers per point, `copies` times (positions and
    rates), by the table of shape functions to nodal values; `extra` further numbers per point (stresses) unchanged."""
    nodal = table.reshape(len(table), points, fields)
    width = copies * fields + extra
    rows = len(table)
    out = np.zeros((copies * rows + points * extra, points, width))
    for k in range(copies):
        out[k * rows : (k + 1) * rows, :, k * fields : (k + 1) * fields] = nodal
    own = np.arange(points * extra).reshape(points, extra)
    for g in range(points):
        out[copies * rows + own[g], g, copies * fields + np.arange(extra)] = 1.0
    return out.reshape(len(out), -1)


# -- Kernels of a meshed beam: internal forces, distributed loads, constant masses


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


def mass_blocks(mesh: LineMesh, numbers: Mapping[str, float], kind: NodeKind, d: LineDerived | None = None) -> Array:
    """(m, (p + 1) nu, (p + 1) nu) consistent mass of every element in the velocities of its nodes, constant. d: the law, by
    default that of beams."""
    density = np.zeros((kind.sizes[1], kind.sizes[1]))
    for place, e in (d or derived_beam(numbers, kind)).mass.items():
        density[place] = float(e.subs({se.Symbol(name): value for name, value in numbers.items()}))
    U = to_sections(mesh, kind)
    M = np.einsum("mab,maik,ij,mbjl->makbl", mesh.shared(mass_points(mesh.order)), U, density, U, optimize=True)
    size = M.shape[1] * M.shape[2]
    return np.asarray(M.reshape(len(M), size, size))
