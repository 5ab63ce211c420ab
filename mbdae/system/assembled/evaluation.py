"""The equations of a scene as a native program: kernels, the slots that they read, and the rows or entries to which their values
are added.

The derivative of a list of operations along a direction, as operations on the same array.

The derivative (differential) of the number in slot k is put into slot k + distance, where distance is the number of slots that
the list had; that of a constant is 0. The operations of the derivative run after those of the list and read their slots again: a
slot that a kernel has read must not be overwritten later in the list.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from mbdae.deferred import sp
from mbdae.errors import internal
from mbdae.native import address
from mbdae.native.equations import CEquations, Equations
from mbdae.native.program import (
    ADD,
    CALL,
    CHOLESKY,
    LOAD,
    MULTIPLY,
    PASS,
    POSITIVE,
    SET,
    SOLVE,
    Columns,
    Operations,
    Step,
    address_of,
    core,
)
from mbdae.system.assembled.jacobian_entries import Pattern, Scatter, TreeTerms
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import Index, Workspace
from mbdae.system.motion.tree_mechanics import Inertia, entries_among, solve_mass


class Tangent:
    """The differentials of all slots of a list of operations. Their slots are reserved when this object is made, their operations
    are made when `part` is first read.

    distance: number of slots from a number to its differential."""

    def __init__(self, of: Operations) -> None:
        self.distance, self._of = of.size, of
        of.slots(of.size)

    @cached_property
    def part(self) -> Operations:
        """The operations that compute the differentials; they have to be run after the list of operations they belong to."""
        part = self._of.part()
        for step in self._of.steps:
            self._add(part, step)
        return part

    def _add(self, part: Operations, step: Step) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        kind, first = fields["kind"], fields.get("first", 0) + by
        if kind in (CALL, PASS):
            self._call(part, step, first)
        elif kind == LOAD:
            part.load(first, 0 * tables["weight"])
        elif kind in (SET, ADD, MULTIPLY):
            self._map(part, step)
        elif kind in (CHOLESKY, SOLVE):
            part.solve(fields["count"], fields["inputs"], fields["first"], fields["outputs"] + by, fields["times"])
        elif kind != POSITIVE:
            raise internal(f"the derivative of the compiled equations is not known for their operation number {kind}")

    def _call(self, part: Operations, step: Step, first: int) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        gather = np.hstack([tables["from_"], tables["from_"] + by])
        if fields["kind"] == PASS:
            part.hand_on(fields["kernel"].tangent, gather, tables["to"] + by, first)
        else:
            part.call(fields["kernel"].tangent, gather, first)

    def _map(self, part: Operations, step: Step) -> None:
        fields, tables, by = step.fields, step.tables, self.distance
        steps = {name: fields.get(name, 0) for name in ("to_step", "from_step")}
        to, from_, times = tables["to"] + by, tables["from_"], fields["times"]
        if fields["kind"] == SET:
            part.set(to, from_ + by, times, **steps)
            return
        weight = tables["weight"].reshape(times, -1) if fields["weight_step"] else tables["weight"]
        if fields["kind"] == ADD:
            part.add(to, from_ + by, weight, times, **steps)
            return
        for a, b in ((from_ + by, tables["by"]), (from_, tables["by"] + by)):
            part.multiply(to, a, b, weight, times, by_step=fields.get("by_step", 0), **steps)


class JacobianTerms(NamedTuple):
    """laws: kernels of derivatives of laws; trees: of trees on whose bodies other laws act, each with the slots that it reads;
    pattern: row and column of their values; place: position of each value among the entries of the Jacobian; c (2, nnz + 1):
    constant parts of the entries of dF/dy and dF/dy', and a spare one."""

    laws: Scatter
    trees: Sequence[tuple[Any, Index]]
    pattern: Pattern
    place: Index
    c: Array


class EquationsOfScene(Workspace):
    """Residual, Jacobian and, where nothing is constrained, right-hand side of the equations of a scene.

    moved: the bodies that trees move; terms: of F, by laws outside of the trees; offset: constant terms of the rows of F, of a
    spare row and of rows of loaded nodes; inertia: (row, column) -> constant entry of the mass matrix by laws outside of the
    trees; jacobian: the terms of the Jacobian, None where it is full and made column by column; source: the `Assembly` that has
    the numbers of all these."""

    def __init__(self, numbering: Numbering, moved: MovedBodies, terms: Scatter, offset: Array, inertia: Inertia,
                 jacobian: JacobianTerms | None, source: Any) -> None:
        super().__init__(numbering, source=source)
        self._terms = terms
        self.trees, operations = TreeTerms(moved, numbering, self.operations, inertia), self.operations
        self.rows, self.nnz = operations.slots(len(offset)), self.n**2 if jacobian is None else len(jacobian.c[0]) - 1
        self.rates, self.rates_part = operations.slots(self.n), operations.part()
        self._steady: tuple[Operations, slice] | None = None  # operations that factorise a constant mass matrix, its slots
        self._massless = -1  # number of a velocity for which the constant mass matrix is singular, or -1
        #: F = y' - f(t, y), where large trees are evaluated joint by joint and nothing constrains them
        self.explicit = jacobian is None and not numbering.m
        self.fy, self.residual_part, self.jacobian_part = 0, operations.part(), operations.part()
        if self.explicit:
            self.with_rates(inertia, None)
        else:
            self.trees.motion(self.motion)
            self.residual_part = self._residual()
        self.change = Tangent(self.rates_part if self.explicit else self.residual_part) if jacobian is None else None
        if jacobian is not None:
            self.fy = operations.slots(2 * self.nnz)
            self.jacobian_part = self._jacobian(jacobian)
            self._by_law = jacobian

    def _residual(self) -> Operations:
        part = self.operations.part(self.motion)
        self._laws(part, self.rows, True)
        self.trees.rows(part, self.rows)
        return part

    def _laws(self, part: Operations, first: int, dotted: bool) -> None:
        """Append the rows of F by laws outside of the trees, from slot `first` on. dotted: with linear terms that contain y'."""
        nb = self.numbering
        part.load(first, lambda of: of.offset)
        self._terms.emit(part, first)
        rows, columns, _ = self._terms.linear_terms
        kept = dotted | ~np.isin(columns, nb.rate_slots)
        part.add(first + rows[kept], columns[kept], lambda of: of.weights[kept])
        part.set(nb.loaded_rows, first + nb.loaded_rows - self.n + 1)  # forces on loaded nodes, which the trees read

    def _jacobian(self, terms: JacobianTerms) -> Operations:
        operations, nnz, place, pattern = self.operations, self.nnz, terms.place, terms.pattern
        staged = bool(terms.trees)  # then evaluate F first: derivatives of trees need the forces on their bodies
        part = operations.part(self.residual_part if staged else self.motion)  # of bodies whose motion is given, too
        none = np.zeros(0, dtype=np.intp)
        emitted = [kernel.emit(part, gather).ravel()
                   for gather, kernel in zip(terms.laws.gathers, terms.laws.kernels, strict=True)]
        kernels = np.concatenate([none, *emitted])
        trees = np.concatenate([none, *(piece.kernel.emit(part, gather).ravel() for piece, gather in terms.trees)])
        part.load(self.fy, lambda of: of.constant_entries[:, :-1])
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
        one = part.constant(lambda of: [1.0, *of.chained])
        factors = np.concatenate([[one], trees]).astype(np.intp)
        middle = np.concatenate([kernels, one + 1 + np.arange(len(pattern.chained))]).astype(np.intp)
        kept = np.flatnonzero(to >= 0)
        at = part.zeros(len(kept)) + np.arange(len(kept))
        part.multiply(at, factors[pattern.left[kept]], middle[pattern.value[kept]])
        part.multiply(to[kept], at, factors[pattern.right[kept]])

    def with_rates(self, inertia: Inertia | None, pattern: Columns | None) -> None:
        """Add operations for y' = f(t, y): of trees by their passes, of other velocities by a constant mass matrix.

        inertia: (row, column) -> entry of that matrix; None where it varies, or where laws outside of trees add inertia to bodies
        of trees: then the whole mass matrix is taken from dF/dy', which has the sparsity pattern `pattern`."""
        nb, first, every = self.numbering, self.rates, np.arange(self.n)
        if inertia is None:
            first_of_all = [] if self._by_law.trees else [self.residual_part]  # else those of the Jacobian contain it
            part = self.operations.part(*first_of_all, self.jacobian_part)
        else:
            part = self.operations.part()
            self.trees.motion(part, still=True)
            self._laws(part, self.rows, False)
        part.load(first, np.zeros(self.n))
        part.add(first + every, self.rows + every, -1.0)
        pivots = [] if inertia is None else self.trees.rates(part, first)
        solved = {k for _, k in pivots}
        rest = np.array([k for k in range(nb.nu) if k not in solved], dtype=np.intp)
        self.order = np.zeros(0, dtype=np.intp)
        if len(rest):
            self._solve_mass(part, rest, inertia, pattern)
        if pivots:
            # a constant before the pivots for each of the other velocities: `bad` then counts in `order`
            part.positive([*[part.constant([1.0])] * len(self.order), *(slot for slot, _ in pivots)])
            self.order = np.r_[self.order, [k for _, k in pivots]].astype(np.intp)
        self.rates_part = part

    def _solve_mass(self, part: Operations, rest: Index, inertia: Inertia | None, pattern: Columns | None) -> None:
        """Append the accelerations of the velocity unknowns `rest` by Cholesky of their mass matrix."""
        nu, nq, slots = self.numbering.nu, self.numbering.nq, self.rates + self.numbering.nq + rest
        if inertia is not None:
            once = self.operations.part()
            order, factors = solve_mass(part, entries_among(inertia, rest)[0], lambda of: entries_among(of.inertia, rest)[1],
                                        slots, once)
            self._steady = once, factors
        else:
            assert pattern is not None
            rows, columns = pattern.rows - nq, np.repeat(np.arange(self.n), np.diff(pattern.first)) - nq
            inside = np.flatnonzero((rows >= 0) & (rows < nu) & (columns >= 0) & (columns < nu))
            places = rows[inside], columns[inside]
            order, _ = solve_mass(part, places, np.zeros(len(inside)), slots, None, self.fy + self.nnz + inside)
        self.order = rest[order]

    def compile(self) -> None:
        """Allocate the array of the program, after which no operations can be added, and factorise a constant mass matrix.
        Kernels are compiled when they are first needed."""
        self.finish(self.residual_part, self.jacobian_part, self.rates_part, self.change, nnz=self.nnz, rows=self.rows,
                    fy=self.fy, fyp=self.fy + self.nnz, rates_at=self.rates, explicit=self.explicit)
        self._completed()

    def again(self, numbering: Numbering, source: Any = None) -> Self:
        made = super().again(numbering, source)
        made.trees = None  # type: ignore[assignment]  # it has appended its operations
        made.residual_part, made.jacobian_part = made._all_parts["residual"], made._all_parts["jacobian"]
        made.rates_part = made.of_rates or made.rates_part
        made._by_law = made._by_law._replace(pattern=source.entries, c=source.constant_entries)
        if made._steady is not None:
            made._steady = made._steady[0].again(source), made._steady[1]
        made._completed()
        return made

    def _completed(self) -> None:
        # where F = y' - f(t, y) the slots of the rows are used on the way to f
        self._rows = np.zeros(self.n) if self.explicit else self.view(self.rows, self.n)[0]
        self._at_rows = self._rows.ctypes.data
        self._c = core()
        self._massless = -1
        if self._steady is not None:
            once, _kept = self._steady[0].table(len(self.W))
            if self._c.scene_part(self.address, ctypes.byref(once), np.nan, self._at_y, None):
                self._massless, self.W[self._steady[1]] = int(self.order[self.scene.bad]), np.nan
        addresses = [address_of(name) for name in ("scene_residual", "scene_jacobian", "scene_rates")]
        table = CEquations(self.address, self.n, self.nnz, *addresses[:2], addresses[2] if self.rates_part.steps else None, None)
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
        self._c.scene_residuals(self.address, len(t), *map(address, (t, y, yp, found)))
        if found is not out:
            out[:] = found

    def jacobian(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """The entries (nnz,) of dF/dy and those of dF/dy', in the order of the sparsity pattern; column by column where the
        Jacobian is full."""
        self.make("jacobian")
        self._y[:], self._yp[:] = y, yp
        (fy, at_fy), (fyp, at_fyp) = self._entries
        self._c.scene_jacobian(self.address, t, self._at_y, self._at_yp, at_fy, at_fyp)
        return fy.copy(), fyp.copy()

    def jacobians(self, t: Array, y: Array, yp: Array) -> tuple[Array, Array]:
        """As `jacobian` at k points, t (k,), y and yp (k, n): (k, nnz) each, NaN from the first point without values on."""
        self.make("jacobian")
        given, found = [np.ascontiguousarray(x, dtype=float) for x in (t, y, yp)], np.full((2, len(t), self.nnz), np.nan)
        self._c.scene_jacobians(self.address, len(t), *map(address, (*given, found[0], found[1])))
        return found[0], found[1]

    @cached_property
    def _entries(self) -> list[tuple[Array, int]]:
        """Arrays for the entries of dF/dy and dF/dy', with their addresses."""
        return [(found, found.ctypes.data) for found in np.empty((2, self.nnz))]

    def products(self, t: float, y: Array, directions: Array) -> Array:
        """Products (k, n) of dy'/dy with k directions (k, n) in y, of equations F = y' - f(t, y)."""
        self.make("jacobian")
        self.solved(t, y, np.empty(self.n))
        by, out = self.scene.distance, np.empty((len(directions), self.n))
        seeds, found = self.W[by : by + self.n], self.W[by + self.rates : by + self.rates + self.n]
        for i, direction in enumerate(directions):
            seeds[:] = direction
            self._c.scene_part(self.address, ctypes.byref(self.scene.changes), t, self._at_y, None)
            out[i] = found
        seeds[:] = 0.0
        return out

    def jacobian_by_law(self, t: float, y: Array, yp: Array) -> list[Any]:
        """dF/dy (n, n), sparse, of every instance of a law by itself, its constant entries apart from those that vary; the sum is
        dF/dy. For equations without recursive joints."""
        terms, p, n = self._by_law.laws, self._by_law.pattern, self.n
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
        count, p = len(self._single), self._by_law.pattern
        return (np.r_[self.W[self._single], p.fixed], np.r_[p.cells[:count], p.fixed_cells],
                np.r_[p.dotted[:count], p.fixed_dotted])

    def right_hand_side(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'. Returns the number of a velocity unknown without inertia, for which y' is not determined; -1: there is
        none."""
        bad = self.solved(t, y, out)
        return int(self.order[bad]) if bad >= 0 else self._massless
