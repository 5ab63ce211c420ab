"""The equations of a scene whose trees are evaluated joint by joint by the articulated-body recursion: y' = f(t, y) without
further constraints, F(t, y, y') = 0 with them."""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.native.equations import Equations, Table
from mbdae.native.program import Operations, Part, Tangent, address_of, core
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.evaluation import Scatter
from mbdae.system.assembled.jacobian_entries import Pattern
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.numbering import Numbering
from mbdae.system.model.trees import Tree
from mbdae.system.motion.constrained import Workspace
from mbdae.system.motion.tree_mechanics import own_inertia, solve_alone

Inertia = dict[tuple[int, int], float]


class OrderedEquations(Workspace):
    """The equations of a scene whose trees are evaluated joint by joint: outwards the motion of the bodies, then the laws outside
    of the trees, inwards the sums of inertia and forces, outwards the accelerations.

    terms: of F, by laws outside of the trees; offset: constant terms of the rows of F, of a spare row and of rows of loaded
    nodes; inertia: (row, column) -> entry of the mass matrix by laws outside of the trees. The operations `part` write their
    result into n slots from `result` on."""

    result: int

    def __init__(self, numbering: Numbering, moved: MovedBodies, terms: Scatter, offset: Array, inertia: Inertia) -> None:
        super().__init__(numbering)
        self.part = part = self.operations.part()
        loaded = [[j for j in tree.structure.loaded if j] for tree in moved.trees]
        self._trees = [(moved.passes(numbering, tree, bool(at), own_inertia(numbering, part, tree, inertia)), at, tree)
                       for tree, at in zip(moved.trees, loaded, strict=True)]
        for passes, _, _ in self._trees:
            passes.outwards(part)
        self._terms, self._inertia, self._rest = terms, inertia, list[int]()
        self.F = self.operations.slots(len(offset))
        self._equations(part, offset)
        self.change = Tangent(part)

    def _equations(self, part: Operations, offset: Array) -> None:
        raise NotImplementedError

    def _write_motion(self, part: Operations, heads: tuple[str, ...]) -> None:
        for passes, at, tree in self._trees:
            passes.write_motion(part, at, lambda j, head, i, of=tree: self.numbering.node_place(head, of.node(j), i), heads)  # type: ignore[misc]

    def _row(self, tree: Tree, role: str, j: int, i: int) -> int:
        """Slot of what laws outside of the tree add to component i of body j, a loaded node: role "wu" its equations of motion,
        "wq" the rates of its positions."""
        return self.F + self.numbering.node_place(role, tree.node(j), i) - self.n + 1

    def _laws(self, part: Operations, offset: Array, kept: Any) -> None:
        """Append the rows of F by laws outside of the trees; kept: function (rows, columns) of the linear terms that selects
        those to be added."""
        part.load(self.F, offset)
        self._terms.emit(part, self.F)
        rows, columns, weights = self._terms.linear_terms
        some = kept(rows, columns)
        part.add(self.F + rows[some], columns[some], weights[some])

    def _passes(self, part: Operations, force: int, rates: int) -> None:
        """Append the inward and outward passes, which compute the second rates of the trees' coordinates (slots from `rates` on)
        from the forces on them (slots from `force` on) and on their bodies."""
        pivots: list[tuple[int, int]] = []
        for passes, at, tree in self._trees:
            passes.loads(part, at, lambda j, i, of=tree: self._row(of, "wu", j, i))  # type: ignore[misc]
            found = passes.inwards(part, lambda place, of=tree: force + self._unknown(of, place))  # type: ignore[misc]
            pivots += [(slot, self._unknown(tree, place)) for slot, place in found]
        part.positive([slot for slot, _ in pivots])
        self.order = np.array([k for _, k in pivots], dtype=np.intp)
        for passes, _, tree in self._trees:
            passes.accelerations(part, lambda place, of=tree: rates + self._unknown(of, place))  # type: ignore[misc]

    def _unknown(self, tree: Tree, place: Place) -> int:
        """Number of a velocity of a tree among the velocity unknowns."""
        return slot_of(self.numbering, tree, place) - self.numbering.nq

    def ready(self, **parts: Any) -> None:
        """Allocate the array of the program; no operations can be added afterwards."""
        self.finish(**parts)
        self._c = core()

    @cached_property
    def _changes(self) -> Part:
        """The operations that compute the derivative along a direction, compiled when they are first needed."""
        part = self.change.part
        if part.widest >= len(self._x):
            self._x = np.zeros(part.widest + 1)
            self.scene.x = self._x.ctypes.data
        table, kept = part.table(len(self.W))
        self._kept.append(kept)
        return table

    def derivatives(self, t: float, first: int, directions: Array) -> Array:
        """Derivatives (k, n) of the result along k directions (k, m) in the m slots from `first` on, at the state evaluated
        last."""
        changes, by = ctypes.byref(self._changes), self.change.distance
        seeds, found = self.W[by + first : by + first + directions.shape[1]], self.W[by + self.result : by + self.result + self.n]
        out, yp = np.empty((len(directions), self.n)), self.view(self.n, self.n)[1]
        for i, direction in enumerate(directions):
            seeds[:] = direction
            self._c.scene_part(self.address, changes, t, self._at_y, yp)
            out[i] = found
        seeds[:] = 0.0
        return out


class OrderedRates(OrderedEquations):
    """y' = f(t, y) of a scene without constraints besides the joints of its trees."""

    def _equations(self, part: Operations, offset: Array) -> None:
        nb, n = self.numbering, self.n
        self._write_motion(part, ("q", "u"))
        self._laws(part, offset, lambda _, columns: columns < n)
        self.result = self.rates = part.slots(n)
        part.load(self.rates, np.zeros(n))
        part.add(self.rates + np.arange(n), self.F + np.arange(n), -1.0)
        force, first = part.slots(nb.nu), self.rates + nb.nq
        part.set(force + np.arange(nb.nu), first + np.arange(nb.nu))
        self._passes(part, force, first)
        solve_alone(part, self._inertia, lambda k: first + k, sorted(set(range(nb.nu)) - set(self.order.tolist())))

    def compile(self) -> None:
        """Allocate the array of the program and make the table by which C calls y' = f(t, y)."""
        self.ready(rates=self.part, rates_at=self.rates)
        table = Table(self.address, self.n, 0, None, None, address_of("scene_rates"), None)
        self.equations = Equations(table, self, make=self.make)

    def products(self, t: float, y: Array, directions: Array) -> Array:
        """Products (k, n) of dy'/dy with k directions (k, n) in y."""
        self.solved(t, y, np.empty(self.n))
        return self.derivatives(t, 0, directions)

    def right_hand_side(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'. Returns the number of a velocity unknown without inertia, so that y' is not determined; -1 for none."""
        bad = self.solved(t, y, out)
        return int(self.order[bad]) if 0 <= bad < len(self.order) else -1


class OrderedResidual(OrderedEquations):
    """F(t, y, y') where constraint rows remain. In the rows of the trees' velocities F is u' less the accelerations that the
    passes give; other rows are as in `Assembly`."""

    equations = None  #: no table for C, because the Jacobian is full: native methods evaluate the equations by Python callbacks

    def _equations(self, part: Operations, offset: Array) -> None:
        nb, n = self.numbering, self.n
        dotted = n + nb.nq
        own = np.array([self._unknown(tree, place) for passes, _, tree in self._trees for place in passes.unknowns], dtype=np.intp)
        for passes, _, tree in self._trees:
            passes.accelerations(part, lambda place, of=tree: dotted + self._unknown(of, place), given=True)  # type: ignore[misc]
        self._write_motion(part, ("q", "u", "up"))
        self._laws(part, offset, lambda rows, _: rows >= 0)
        force, rates = part.zeros(nb.nu), part.slots(nb.nu)
        part.add(force + np.arange(nb.nu), self.F + nb.nq + np.arange(nb.nu), -1.0)
        alone = set(own.tolist())
        for (a, b), m in self._inertia.items():  # of the trees' own velocities; the passes contain that of their bodies
            if a in alone:
                part.add([force + a], [dotted + b], m)
        self._correct(part)
        self._passes(part, force, rates)
        part.set(self.F + nb.nq + own, dotted + own)
        part.add(self.F + nb.nq + own, rates + own, -1.0)
        self.result = self.F

    def _correct(self, part: Operations) -> None:
        """Append corrections G^T mu of the rates of positions (form GGL) that laws on loaded bodies cause, projected on the
        freedoms of their trees and added to the rows of q'."""
        for passes, at, tree in self._trees:
            passes.corrections(part, at, lambda j, i, of=tree: self._row(of, "wq", j, i),  # type: ignore[misc]
                               lambda place, of=tree: self.F + slot_of(self.numbering, of, place))  # type: ignore[misc]

    def compile(self) -> None:
        """Allocate the array of the program, whose results are the rows of F; no operations can be added afterwards."""
        self.ready(residual=self.part, rows=self.F)
        self._rows, self._at_rows = self.view(self.F, self.n)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp)."""
        self.make("residual")
        self._y[:], self._yp[:] = y, yp
        self._c.scene_residual(self.address, t, self._at_y, self._at_yp, self._at_rows)
        out[:] = self._rows

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' (n, n)."""
        one = np.eye(self.n)
        self.residual(t, y, yp, np.empty(self.n))
        return self.derivatives(t, 0, one).T, self.derivatives(t, self.n, one).T


class OrderedAssembly(Assembly):
    """F = y' - f(t, y), or F(t, y, y') where there are constraints, with a full Jacobian."""

    has_pattern = False

    def _finish(self, pattern: Pattern, sparse: bool) -> None:
        nb, n = self.numbering, self.n
        self.pattern = self.sparsity = None
        self.sparse = False
        rows, columns = pattern.fixed_cells % n - nb.nq, pattern.fixed_cells // n - nb.nq
        inside = pattern.fixed_dotted & (pattern.fixed_cells < n * n)
        inside &= (rows >= 0) & (rows < nb.nu) & (columns >= 0) & (columns < nb.nu)
        self._inertia: Inertia = {}
        for a, b, m in zip(rows[inside].tolist(), columns[inside].tolist(), pattern.fixed[inside].tolist(), strict=True):
            self._inertia[a, b] = self._inertia.get((a, b), 0.0) + m

    @cached_property
    def constant_mass(self) -> Array:
        """Mass matrix (nu, nu) by the laws outside of the trees; the inertia of trees is in the passes alone."""
        M = np.zeros((self.numbering.nu,) * 2)
        for place, m in self._inertia.items():
            M[place] = m
        return M

    @property
    def explicit(self) -> bool:
        """Whether nothing constrains the scene."""
        return not self.numbering.m

    def operations(self) -> Any:
        """The native evaluation before it is compiled: of y' = f(t, y) without constraints, else of F(t, y, y')."""
        kind = OrderedRates if self.explicit else OrderedResidual
        return kind(self.numbering, self.moved, self._residual, self._offset, self._inertia)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        if not self.explicit:
            self.evaluation.residual(t, y, yp, out)
            return
        self.evaluation.right_hand_side(t, y, out)
        np.subtract(yp, out, out=out)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        for i in range(len(t)):
            self.residual(t[i], y[i], yp[i], out[i])

    def rate_jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy (n, n)."""
        return self.products(t, y, np.eye(self.n)).T

    def products(self, t: float, y: Array, directions: Array) -> Array:
        """Products (k, n) of dy'/dy with k directions (k, n) in y."""
        found: Any = self.evaluation
        return np.asarray(found.products(t, y, directions))

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        if self.explicit:
            return -self.rate_jacobian(t, y), np.eye(self.n)
        found: Any = self.evaluation
        fy, fyp = found.jacobian_parts(t, y, yp)
        return fy, fyp

    def dense_jacobian(self, t: float, y: Array, yp: Array) -> Array:
        return np.stack(self.jacobian_parts(t, y, yp))

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        fy, fyp = self.jacobian_parts(t, y, yp)
        out[...] = fy + cj * fyp


def assembly_of(moved: MovedBodies) -> type[Assembly]:
    """The class of assembly for a scene: `OrderedAssembly` where its trees are evaluated joint by joint, else `Assembly`, with
    kernels of whole trees."""
    return OrderedAssembly if moved.ordered else Assembly
