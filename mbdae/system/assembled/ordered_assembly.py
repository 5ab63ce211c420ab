"""The equations y' = f(t, y) of a scene whose trees are evaluated joint by joint."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from mbdae.native.equations import Equations, Table
from mbdae.native.program import address_of, core
from mbdae.native.tangent import Tangent
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.evaluation import Scatter
from mbdae.system.assembled.jacobian_entries import Pattern
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.ordered_motion import solve_alone
from mbdae.system.motion.ordered_tree import OrderedTree
from mbdae.system.motion.workspace import Workspace


class OrderedRates(Workspace):
    """y' of a scene with such trees: the motion of the bodies on which other laws act, those laws, and the passes.

    terms: of F by other laws; offset: constants of the rows of F, of a spare one and of rows of loaded nodes; inertia: what
    other laws give the unknowns, by row and column."""

    def __init__(self, numbering: Numbering, moved: MovedBodies, terms: Scatter, offset: Array,
                 inertia: dict[tuple[int, int], float]) -> None:  # fmt: skip
        super().__init__(numbering)
        nb, part, n = numbering, self.operations.part(), self.n
        loaded = [[j for j in tree.structure.loaded if j] for tree in moved.trees]
        trees = [OrderedTree(moved, nb, tree, bool(at), inertia) for tree, at in zip(moved.trees, loaded, strict=True)]
        for tree, at in zip(trees, loaded, strict=True):
            tree.outwards(part)
            tree.write_motion(part, at, lambda j, head, i, own=tree.tree: nb.node_place(head, own.node(j), i))  # type: ignore[misc]
        F, self.rates = self.operations.slots(len(offset)), self.operations.slots(n)
        part.load(F, offset)
        terms.emit(part, F)
        rows, columns, weights = terms.linear_terms
        own = columns < n
        part.add(F + rows[own], columns[own], weights[own])
        part.load(self.rates, np.zeros(n))
        part.add(self.rates + np.arange(n), F + np.arange(n), -1.0)
        self._force = part.slots(nb.nu)
        part.set(self._force + np.arange(nb.nu), self.rates + nb.nq + np.arange(nb.nu))
        pivots: list[tuple[int, int]] = []
        for tree, at in zip(trees, loaded, strict=True):
            tree.loads(part, at, lambda j, i, own=tree.tree: F + nb.node_place("wu", own.node(j), i) - n + 1)  # type: ignore[misc]
            pivots += tree.inwards(part, lambda k: self._force + k)
        part.positive([slot for slot, _ in pivots])
        self.order = np.array([k for _, k in pivots], dtype=np.intp)
        for tree in trees:
            tree.accelerations(part, self._rate)
        solve_alone(part, inertia, self._rate, sorted(set(range(nb.nu)) - {k for _, k in pivots}))
        self.part, self._tangent = part, Tangent(part)

    def _rate(self, k: int) -> int:
        return self.rates + self.numbering.nq + k

    def compile(self) -> None:
        """Make the workspace; nothing is added afterwards."""
        self.finish(rates=self.part, rates_at=self.rates)
        self._c, self._derived = core(), False
        table = Table(self.address, self.n, 0, None, None, address_of("scene_rates"), None)
        self.equations = Equations(table, self, make=self.make)

    def products(self, t: float, y: Array, directions: Array) -> Array:
        """(k, n) changes of y' for changes of y in directions (k, n)."""
        self._ready()
        out, n, by = np.empty((len(directions), self.n)), self.n, self._tangent.distance
        self.solved(t, y, np.empty(n))
        for i, direction in enumerate(directions):
            self.W[by : by + n] = direction
            self._c.scene_part(self.address, ctypes.byref(self.scene.residual), t, self._at_y, None)
            out[i] = self.W[by + self.rates : by + self.rates + n]
        return out

    def _ready(self) -> None:
        """Compile the operations of the derivative, which explicit methods do not need."""
        if not self._derived:
            self._parts["residual"], self._derived = self._tangent.part, True
            self._x = np.zeros(self._tangent.part.widest + 1)
            self.scene.x = self._x.ctypes.data
            self.make("residual")

    def right_hand_side(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'; the number of a velocity without inertia, or -1."""
        bad = self.solved(t, y, out)
        return int(self.order[bad]) if 0 <= bad < len(self.order) else -1


class OrderedAssembly(Assembly):
    """F = y' - f(t, y), with its Jacobian."""

    def _finish(self, pattern: Pattern, sparse: bool) -> None:
        nb, n = self.numbering, self.n
        self.pattern = self.sparsity = None
        rows, columns = pattern.fixed_cells % n - nb.nq, pattern.fixed_cells // n - nb.nq
        inside = pattern.fixed_dotted & (pattern.fixed_cells < n * n)
        inside &= (rows >= 0) & (rows < nb.nu) & (columns >= 0) & (columns < nb.nu)
        self._inertia: dict[tuple[int, int], float] = {}
        for a, b, m in zip(rows[inside].tolist(), columns[inside].tolist(), pattern.fixed[inside].tolist(), strict=True):
            self._inertia[a, b] = self._inertia.get((a, b), 0.0) + m

    def operations(self) -> Any:
        """As `Assembly.operations`."""
        return OrderedRates(self.numbering, self.moved, self._residual, self._offset, self._inertia)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        self.evaluation.right_hand_side(t, y, out)
        np.subtract(yp, out, out=out)

    def rate_jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy (n, n)."""
        return self.products(t, y, np.eye(self.n)).T

    def products(self, t: float, y: Array, directions: Array) -> Array:
        """(k, n) changes of y' for changes of y in directions (k, n)."""
        found: Any = self.evaluation
        return np.asarray(found.products(t, y, directions))

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        return -self.rate_jacobian(t, y), np.eye(self.n)

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        out[...] = cj * np.eye(self.n) - self.rate_jacobian(t, y)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        for i in range(len(t)):
            self.residual(t[i], y[i], yp[i], out[i])
