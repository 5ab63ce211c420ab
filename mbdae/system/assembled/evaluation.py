"""The equations of a scene as a native program: kernels, the slots that they read, and the rows or entries to which their values
are added."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.native.equations import Equations, Table
from mbdae.native.program import Operations, address_of, core
from mbdae.system.assembled.jacobian_entries import Pattern
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import Columns, Index, Workspace, narrow_order


class Scatter:
    """A list of terms of F or of its Jacobian: kernels with the rows (or entries) to which their values are added; linear
    terms."""

    def __init__(self) -> None:
        self.gathers: list[Index] = []
        self.places: list[Index] = []
        self.kernels: list[Any] = []
        self.solved: dict[int, tuple[Index, Any]] = {}
        self._linear: list[tuple[Index, Index, Array]] = [(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))]

    def kernel(self, gather: Index, places: Index, kernel: Any, solved: tuple[Index, Any] | None = None) -> None:
        """Add a kernel for all instances of a law. gather (instances, inputs): slots that it reads; places (instances, outputs):
        rows to which its values are added. solved, for trees alone: the kernel `TreePlan.rates` of the accelerations in the same
        rows, and the slots that it reads."""
        if solved is not None:
            self.solved[len(self.kernels)] = solved
        self.gathers.append(gather)
        self.places.append(places)
        self.kernels.append(kernel)

    def linear(self, rows: Index, columns: Index, weights: Array) -> None:
        """Add linear terms to rows of F: weights times the unknowns in the slots `columns`."""
        self._linear.append((rows, columns, weights))

    @property
    def linear_terms(self) -> tuple[Index, Index, Array]:
        """Rows, columns and weights of all linear terms."""
        rows, columns, weights = (np.concatenate(parts) for parts in zip(*self._linear, strict=True))
        return rows, columns, weights

    def emit_right(self, part: Operations, first: int, n: int) -> list[tuple[Index, Index, Any]]:
        """Subtract all terms that do not contain y' from the n slots from `first` on, which become right-hand sides, but not
        those of trees that have a kernel of u'. Returns for these trees the rows, the slots that the kernel reads, and the
        kernel."""
        for k, (gather, places, kernel) in enumerate(zip(self.gathers, self.places, self.kernels, strict=True)):
            if k not in self.solved:
                values, own = kernel.emit(part, gather), places < n
                part.add(first + places[own], values[own], -1.0)
        rows, columns, weights = self.linear_terms
        own = (rows < n) & (columns < n)
        part.add(first + rows[own], columns[own], -weights[own])
        return [(self.places[k], np.hstack([gather, first + self.places[k]]), kernel)
                for k, (gather, kernel) in self.solved.items()]

    def emit(self, part: Operations, first: int) -> None:
        """Append operations that add the values of the kernels to their rows; row 0 is in slot `first`."""
        for gather, places, kernel in zip(self.gathers, self.places, self.kernels, strict=True):
            part.add(first + places, kernel.emit(part, gather))


def emit_pieces(pieces: Sequence[Any], part: Operations) -> None:
    """Append kernels of trees, each given with the slots that it reads and those of its values."""
    for piece, gather, places in pieces:
        part.set(places, piece.kernel.emit(part, gather))


class EquationsOfScene(Workspace):
    """Residual, Jacobian and, where nothing is constrained, right-hand side of the equations of a scene.

    terms: those of F; offset: constant terms of the rows of F, of a spare row and of rows of loaded nodes; stages: kernels of
    trees for the motion of loaded nodes, for the rows of the trees and for their derivatives; terms_of_jacobian: kernels of
    derivatives; pattern: row and column of their values; place: position of each value among the entries of the Jacobian; c
    (2, nnz + 1): constant parts of the entries of dF/dy and dF/dy', and a spare one."""

    def __init__(self, numbering: Numbering, terms: Scatter, offset: Array, stages: tuple[Any, Scatter, Any],
                 terms_of_jacobian: Scatter, pattern: Pattern, place: Index, c: Sequence[Array]) -> None:
        super().__init__(numbering, partial(emit_pieces, stages[0]))
        self._terms, self._offset, self._stages = terms, offset, stages
        operations = self.operations
        self.rows, self.nnz = operations.slots(len(offset)), len(c[0]) - 1
        self.fy = operations.slots(2 * self.nnz)
        self.residual_part = self._residual()
        self.jacobian_part = self._jacobian(terms_of_jacobian, pattern, place, c)
        self._by_law = terms_of_jacobian, pattern
        self.rates = operations.slots(self.n)
        self.rates_part: Operations | None = None
        self._steady: tuple[Operations, slice] | None = None  # operations that factorise a constant mass matrix, its slots
        self._massless = -1  # number of a velocity for which the constant mass matrix is singular, or -1

    def _residual(self) -> Operations:
        part, first, nb = self.operations.part(self.motion), self.rows, self.numbering
        part.load(first, self._offset)
        self._terms.emit(part, first)
        rows, columns, weights = self._terms.linear_terms
        part.add(first + rows, columns, weights)
        if self._stages[0]:  # transform the forces on loaded nodes to joint coordinates
            part.set(nb.loaded_rows, first + nb.loaded_rows - self.n + 1)
            self._stages[1].emit(part, first)
        return part

    def _jacobian(self, terms: Scatter, pattern: Pattern, place: Index, c: Sequence[Array]) -> Operations:
        operations, nnz = self.operations, self.nnz
        staged = bool(self._stages[0])  # then evaluate F first: derivatives of trees need the forces on their bodies
        part = operations.part(self.residual_part) if staged else operations.part()
        none = np.zeros(0, dtype=np.intp)
        emitted = [kernel.emit(part, gather).ravel() for gather, kernel in zip(terms.gathers, terms.kernels, strict=True)]
        kernels = np.concatenate([none, *emitted])
        trees = np.concatenate([none, *(piece.kernel.emit(part, gather).ravel() for piece, gather in self._stages[2])])
        part.load(self.fy, np.concatenate([c[0][:-1], c[1][:-1]]))
        to = np.where(place < nnz, self.fy + place + np.where(pattern.dotted, nnz, 0), -1)
        single = self._single = np.concatenate([kernels, trees])
        kept = np.flatnonzero(to[: len(single)] >= 0)
        part.add(to[kept], single[kept])
        if staged:
            self._chain(part, to[len(single) :], kernels, trees, pattern)
        return part

    def _chain(self, part: Operations, to: Index, kernels: Index, trees: Index, pattern: Pattern) -> None:
        """Append the chain rule: products of derivatives of the trees (`trees`) with derivatives of laws that act on their bodies
        (`kernels`); to: slots of the entries to which they are added, -1 for none."""
        one = part.constant(np.concatenate([[1.0], pattern.chained]))
        factors = np.concatenate([[one], trees]).astype(np.intp)
        middle = np.concatenate([kernels, one + 1 + np.arange(len(pattern.chained))]).astype(np.intp)
        kept = np.flatnonzero(to >= 0)
        at = part.zeros(len(kept)) + np.arange(len(kept))
        part.multiply(at, factors[pattern.left[kept]], middle[pattern.value[kept]])
        part.multiply(to[kept], at, factors[pattern.right[kept]])

    def with_rates(self, mass: Scatter, constant: Any | None, pattern: Columns, light: bool) -> None:
        """Add operations for y' = f(t, y): F at y' = 0, then the solution of the equations of motion with the mass matrix.

        constant (nu, nu): entries of the mass matrix that do not vary, mass: kernels of those that vary; constant None: the mass
        matrix is taken from dF/dy', whose entries have the sparsity pattern `pattern`; light: no law outside of trees has
        inertia."""
        nb, operations = self.numbering, self.operations
        nu, nq, first = nb.nu, nb.nq, self.rates
        solved = np.sort(np.concatenate([np.zeros(0, np.intp), *(self._terms.places[k].ravel() for k in self._terms.solved)]))
        if nu and light and np.array_equal(solved, np.arange(nq, nq + nu)):
            self._rates_of_trees()
            return
        part = operations.part(self.residual_part if constant is not None else self.jacobian_part)
        if constant is None and not self._stages[0]:
            part = operations.part(self.residual_part, self.jacobian_part)
        part.load(first, np.zeros(self.n))
        part.add(first + np.arange(self.n), self.rows + np.arange(self.n), -1.0)
        self._solve_mass(part, mass, constant, pattern, nu, nq)
        self.rates_part = part

    def _rates_of_trees(self) -> None:
        """Add operations for y' by kernels of accelerations (`TreePlan.rates`): for scenes in which every velocity belongs to a
        tree that has such a kernel."""
        part, first, n = self.operations.part(self.motion), self.rates, self.n
        part.load(first, -self._offset[:n])
        pivots, rows = list[Index](), list[Index]()
        for own, gather, kernel in self._terms.emit_right(part, first, n):
            found = kernel.emit(part, gather).reshape(len(own), 2, own.shape[1])
            part.set(first + own, found[:, 0])
            pivots.append(found[:, 1].ravel())
            rows.append(own.ravel())
        part.positive(np.concatenate(pivots))
        self.order, self.rates_part = np.concatenate(rows) - self.numbering.nq, part

    def _solve_mass(self, part: Operations, mass: Scatter, constant: Any | None, pattern: Columns, nu: int,
                    nq: int) -> None:
        operations, first = self.operations, self.rates
        rows, columns = pattern.rows, np.repeat(np.arange(self.n), np.diff(pattern.first))
        inside = (rows >= nq) & (rows < nq + nu) & (columns >= nq) & (columns < nq + nu)
        i, j = rows[inside] - nq, columns[inside] - nq
        self.order, place = narrow_order(nu, np.concatenate([i, j]), np.concatenate([j, i]))
        width = int(np.abs(place[i] - place[j]).max(initial=0)) + 1

        def cell(a: Index, b: Index) -> Index:
            return np.asarray(place[a] * width + place[b] - place[a] + width - 1)

        values = np.zeros(nu * width)
        lower = place[i] >= place[j]
        if constant is not None:
            np.add.at(values, cell(i, j)[lower], np.asarray(constant[i[lower], j[lower]]).ravel())
        steady = constant is not None and not mass.kernels
        matrix, right = operations.constant(values) if steady else operations.slots(nu * width), operations.slots(nu)
        if not steady:
            part.load(matrix, values)
        if constant is None:
            entries = self.fy + self.nnz + np.flatnonzero(inside)
            part.add(matrix + cell(i, j)[lower], entries[lower])
        else:
            for gather, cells, kernel in zip(mass.gathers, mass.places, mass.kernels, strict=True):
                found, (a, b) = kernel.emit(part, gather), np.divmod(cells, nu)
                kept = place[a] >= place[b]
                part.add(matrix + cell(a[kept], b[kept]), found[kept])
        part.set(right + place, first + nq + np.arange(nu))
        if steady:
            self._steady = operations.part(), slice(matrix, matrix + nu * width)
            self._steady[0].cholesky(nu, width, matrix, right)
            part.solve(nu, width, matrix, right, 1)
        else:
            part.cholesky(nu, width, matrix, right)
        part.set(first + nq + np.arange(nu), right + place)

    def compile(self) -> None:
        """Allocate the array of the program, after which no operations can be added, and factorise a constant mass matrix.
        Kernels are compiled when they are first needed."""
        self.finish(self.residual_part, self.jacobian_part, self.rates_part, nnz=self.nnz, rows=self.rows, fy=self.fy,
                    fyp=self.fy + self.nnz, rates_at=self.rates)
        self._rows, self._at_rows = self.view(self.rows, self.n)
        (self._fy, self._at_fy), (self._fyp, self._at_fyp) = (self.view(self.fy + k * self.nnz, self.nnz) for k in (0, 1))
        self._c = core()
        if self._steady is not None:
            once, _kept = self._steady[0].table(len(self.W))
            if self._c.scene_part(self.address, ctypes.byref(once), np.nan, self._at_y, None):
                self._massless, self.W[self._steady[1]] = int(self.order[self.scene.bad]), np.nan
        addresses = [address_of(name) for name in ("scene_residual", "scene_jacobian", "scene_rates")]
        table = Table(self.address, self.n, self.nnz, *addresses[:2], addresses[2] if self.rates_part is not None else None, None)
        self.equations = Equations(table, self, make=self.make)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp)."""
        self.make("residual")
        self._y[:], self._yp[:] = y, yp
        self._c.scene_residual(self.address, t, self._at_y, self._at_yp, self._at_rows)
        out[:] = self._rows

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        """out[i] = F(t[i], y[i], yp[i]) for k points: t (k,), the others (k, n)."""
        self.make("residual")
        t, y, yp = (np.ascontiguousarray(x, dtype=float) for x in (t, y, yp))
        found = out if out.flags.c_contiguous else np.empty((len(t), self.n))
        self._c.scene_residuals(self.address, len(t), *(x.ctypes.data for x in (t, y, yp, found)))
        if found is not out:
            out[:] = found

    def jacobian(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """The entries (nnz,) of dF/dy and those of dF/dy', in the order of the sparsity pattern."""
        self.make("jacobian")
        self._y[:], self._yp[:] = y, yp
        self._c.scene_jacobian(self.address, t, self._at_y, self._at_yp, self._at_fy, self._at_fyp)
        return self._fy.copy(), self._fyp.copy()

    def jacobian_by_law(self, t: float, y: Array, yp: Array) -> list[Any]:
        """dF/dy (n, n), sparse, of every instance of a law by itself, its constant entries apart from those that vary; the sum is
        dF/dy. For equations without recursive joints."""
        (terms, p), n = self._by_law, self.n
        instances = [np.arange(places.size) // places.shape[1] for places in terms.places if places.size]
        first = np.cumsum([0, *(int(k[-1]) + 1 for k in instances)])
        number = np.concatenate([*(k + i for k, i in zip(instances, first, strict=False)), first[-1] + p.terms]).astype(np.intp)
        values, cells, dotted = self._terms_of_jacobian(t, y, yp)
        own = [(number == k) & (cells < n * n) & ~dotted for k in range(int(number.max(initial=-1)) + 1)]
        return [sp.csr_matrix((values[at], (cells[at] % n, cells[at] // n)), shape=(n, n)) for at in own]

    def jacobian_sizes(self, t: float, y: Array, yp: Array) -> tuple[Any, Any]:
        """Sums of the absolute values of the terms of the entries of dF/dy and dF/dy' (n, n), sparse: rounding errors are in
        proportion to them. For equations without recursive joints."""
        n, (values, cells, dotted) = self.n, self._terms_of_jacobian(t, y, yp)
        fy, fyp = (sp.csr_matrix((np.abs(values[at]), (cells[at] % n, cells[at] // n)), shape=(n, n))
                   for at in ((cells < n * n) & ~dotted, (cells < n * n) & dotted))
        return fy, fyp

    def _terms_of_jacobian(self, t: float, y: Array, yp: Array) -> tuple[Array, Index, Any]:
        """Values of the terms of all entries of the Jacobian, their cells (`Pattern`), and whether they belong to dF/dy'."""
        self.jacobian(t, y, yp)
        count, p = len(self._single), self._by_law[1]
        return (np.r_[self.W[self._single], p.fixed], np.r_[p.cells[:count], p.fixed_cells],
                np.r_[p.dotted[:count], p.fixed_dotted])

    def right_hand_side(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'. Returns the number of a velocity unknown without inertia, for which y' is not determined; -1: there is
        none."""
        bad = self.solved(t, y, out)
        return int(self.order[bad]) if bad >= 0 else self._massless
