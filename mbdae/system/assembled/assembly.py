"""Residual and Jacobian of a whole model in a given form, by compiled kernels.

The residual is the sum of constants, linear terms and values of kernels. The entries of dF/dy and of dF/dy' are constants c plus
values of kernels. Here the tables of all these terms are made; `evaluation.py` turns them into a native program.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import as_full, distinct, later, sp
from mbdae.errors import internal
from mbdae.kernels.plan import LinearisedPlan, linearised_plan
from mbdae.native.program import Columns
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.tree_motion import Open
from mbdae.system.assembled.acceleration_kernel import inverse_of
from mbdae.system.assembled.evaluation import EquationsOfScene, JacobianTerms
from mbdae.system.assembled.jacobian_entries import Entries, FormSpec, Pattern, Scatter, TreeTerms, add_derivatives
from mbdae.system.base import Array, Places
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.motion.constrained import Emitted
from mbdae.system.motion.mechanics import LARGE, inputs_of
from mbdae.threads import check

if TYPE_CHECKING:
    from mbdae.system.model.beams import add_elements, add_inertia, batches
else:
    add_elements, add_inertia, batches = later("mbdae.system.model.beams", "add_elements", "add_inertia", "batches")

#: index of some kinds of unknowns, in place of that of the form, in scenes with elastic bodies ("z": stresses of beams). ELASTIC:
#: steps may pass over elastic vibrations; with nearly rigid strains velocities and stresses then behave like unknowns of index 2
#: and 3, and the error test weighs them so. RESOLVED: elastic vibrations are resolved (option `waves`)
ELASTIC = {"v": 2, "z": 3, "lambda": 3, "mu": 2}
RESOLVED = {"z": 3}
#: number of unknowns above which the Jacobian is sparse unless stated otherwise; with fewer, dense linear algebra is faster
#: (measured: up to 150 to 200)
SPARSE_FROM = 150
NUMBERS = ("offset", "weights", "entries", "constant_entries")  #: what contains numbers of the laws
LAZY = (*NUMBERS, "evaluation", "constant_mass", "inverse_mass", "_constants_of_mass", "inertia")  #: made when it is needed


class Assembly:
    """The equations of a model in a form, F(t, y, y') = 0 with their exact Jacobian, at any state; members as in `System`.

    rows: constraint rows in force; spec: options of the form; sparse: whether the Jacobian is, None: by the number of unknowns;
    moved: the bodies that trees move, and which parameters are inputs of kernels."""

    def __init__(self, model: Model, rows: list[Row], spec: FormSpec, sparse: bool | None = None,
                 moved: MovedBodies | None = None) -> None:
        self.moved = moved = moved if moved is not None else MovedBodies(model, [])
        rows = [row for row in rows if moved.keeps(row)]
        self.key = key = (Assembly, tuple(rows), sparse, spec.shape, moved.shape)
        self.model, self.spec, self.label = model, spec, spec.label
        self.numbering: Numbering
        self.entries: Pattern
        self._first: Assembly | None = model.shape.kept.get(key)
        if self._first is not None:
            vars(self).update({name: value for name, value in vars(self._first).items() if name not in (*vars(self), *LAZY)})
            self.numbering = self._first.numbering.again(model, moved.constants, spec.numbers)
            return
        blocks = (*spec.blocks, "z") if spec.mixed else spec.blocks
        self.numbering = moved.numbering(model, rows, blocks, spec.derivatives, numbers=spec.numbers)
        nb = self.numbering
        self.n, self.names = nb.n, nb.names()
        self.kinds = self._kinds()
        self.passes = model.elastic and spec.mixed and not spec.waves  #: whether steps may pass over elastic vibrations
        index = dict(spec.index) | (ELASTIC if self.passes else RESOLVED if nb.stresses else {})
        self.index = np.array([index[k] for k in self.kinds], dtype=int)
        self.equations = self._equations()
        self.offset = np.zeros(1 + nb.first_input - self.n)  #: constants in the rows of F, a spare row and rows of loaded nodes
        self._constants: list[tuple[Any, ...]] = []  # of every group of laws what tells the places of its constants
        self._residual, self._jacobian = Scatter(), Scatter()
        self._inert = False  #: whether laws have inertia that varies (kernels that read u'), or act so on bodies of trees
        #: whether the Jacobian has a sparsity pattern; False: it is full, and made column by column
        self.has_pattern = not moved.ordered
        entries = Entries(self.n)
        live = {(row.group, row.instance) for row in rows}
        for g, group in enumerate(model.groups):
            d = group.derived
            # idle: a law of this group is left out where shared unknowns or joint coordinates satisfy all of its rows
            idle = d.rows and not (d.forced or getattr(d.law, "penalty", None))
            active = [i for i in range(len(group.instances))
                      if (g, i) not in moved.replaced and not (idle and (g, i) not in live)]
            if active:
                self._add(g, active, self.plan(d), entries)
        for batch in batches(model.lines, spec.mixed) if model.lines else ():
            if batch.is_load or not spec.loads_only:
                add_elements(self, batch, inputs_of(batch, nb), entries)
        for line in model.lines:
            add_inertia(self, line, entries)
        #: kernels of derivatives of trees with loaded nodes (bodies on which other laws act), with the slots that they read
        self._trees = add_derivatives(moved, nb, entries, self._jacobian)
        up = {nb.node_place("up", n, i) for n in moved.loaded for i in range(n.kind.sizes[1])}
        self._inert |= bool(up) and entries.reads(up)
        self._finish(entries.finish(), self.has_pattern and (sparse if sparse is not None else self.n > SPARSE_FROM))
        self.weights = self._residual.linear_terms[2]
        if self.has_pattern and not model.lines:
            model.shape.kept[key] = self

    if not TYPE_CHECKING:  # a type checker would take every attribute to exist

        def __getattr__(self, name: str) -> Any:
            if name not in NUMBERS or vars(self).get("_first") is None:
                raise AttributeError(f"{type(self).__name__} has no attribute {name}")
            self._numbered(self._first)
            return vars(self)[name]

    def _numbered(self, first: Assembly) -> None:
        """Put the numbers of the laws in the places that another model of the same shape has for them."""
        self.offset, weights, values = np.zeros(len(first.offset)), [np.zeros(0)], [np.zeros(0)]
        for g, active, plan, rows, split, live, keep in self._constants:
            constants = self.numbering.constants(g, plan)[active]
            np.add.at(self.offset, rows, constants[:, split:])
            weights.append(constants[:, keep][live])
            values.append(constants[:, :split].ravel())
        self.weights, self.entries = np.concatenate(weights), first.entries.again(np.concatenate(values))
        self._add_constant_entries()

    # -- construction

    def plan(self, d: Derived) -> LinearisedPlan:
        """The outputs of a law with their derivatives, sorted for this assembly."""
        return linearised_plan(d, self.spec.outputs, self.moved.open)

    def _kinds(self) -> tuple[str, ...]:
        nb = self.numbering
        sizes = {"q": nb.nq, "v": nb.nu, "s": len(nb.states), "z": len(nb.stresses)} | dict.fromkeys(self.spec.blocks, nb.m)
        return tuple(kind for kind, size in sizes.items() for _ in range(size))

    def _equations(self) -> tuple[str, ...]:
        """Name of every row of F."""
        nb, meaning = self.numbering, {"g": "position", "gd": "velocity", "gdd": "acceleration"}
        names = [f"kinematics of {n}" for n in self.names[: nb.nq]]
        names += [f"momentum of {n}" for n in self.names[nb.nq : nb.nq + nb.nu]]
        names += [f"state {n}" for n in nb.states.values()] + [f"strain of {n}" for n in nb.stresses]
        by_block = {block: head for head, block in self.spec.rows.items()}
        for block in self.spec.blocks:
            names += [f"{row.name} ({meaning[by_block[block]]} constraint)" for row in nb.rows]
        return tuple(names)

    def row_of(self, target: Target, g: int, i: int) -> int:
        """Row of F to which the output with this target of instance i in group g is added; n, a spare row that nothing reads,
        where it is left out; above n the rows of loaded nodes."""
        block, nb = self.spec.rows[target[0]], self.numbering
        if block in ("q", "u"):
            # a component of q that is fixed, or that of another node, has no row q' = u here
            own = isinstance(self.model.groups[g].instances[i].law, Element)
            if own and block == "q" and nb.shares(nb.node_of(target, g, i), target[2], "q"):
                return self.n
            return self.row_at(block, nb.node_of(target, g, i), target[2])
        if block == "s":
            return nb.place(target, g, i)
        row = nb.row(g, i, target[1])
        return self.n if row is None else nb.start[block] + row

    def row_at(self, block: str, node: Node, component: int) -> int:
        """Row of F of a component of "q" or "u" (block) of a node; a loaded node has rows of its own after n; n: no row."""
        place = self.numbering.node_place(block if node not in self.moved.nodes else "w" + block, node, component)
        if place < self.n:
            return place
        return place - self.n + 1 if place < self.numbering.first_input else self.n

    def _add(self, g: int, active: list[int], plan: LinearisedPlan, entries: Entries) -> None:
        check("the equations were put together")
        nb, count = self.numbering, len(active)
        rows = np.array([[self.row_of(t, g, i) for t in plan.targets] for i in active], dtype=np.intp).reshape(count, -1)
        constants = nb.constants(g, plan)[active]
        split = len(plan.constant_places)
        np.add.at(self.offset, rows[:, plan.offset_places], constants[:, split:])
        linear = set(plan.offset_places)
        at = [(j, *place) for j, place in enumerate(plan.constant_places)]
        columns = self._columns(g, active, [p[2] for p in at])
        out = rows[:, [p[1] for p in at]] if at else np.zeros((count, 0), dtype=np.intp)
        entries.constant(out, columns, constants[:, :split])
        keep = [j for j, o, _ in at if o in linear]
        live = columns[:, keep] >= 0
        self._residual.linear(out[:, keep][live], columns[:, keep][live], constants[:, keep][live])
        self._constants.append((g, active, plan, rows[:, plan.offset_places], split, live, keep))
        if plan.nonlinear:
            self._residual.kernel(nb.gather(g, plan.residual_inputs, active), rows[:, plan.nonlinear], plan.residual)
        if plan.jacobian_places:
            rows = rows[:, [o for o, _ in plan.jacobian_places]]
            self._jacobian.kernel(nb.gather(g, plan.jacobian_inputs, active), rows, plan.jacobian)
            entries.varying(rows, self._columns(g, active, [t for _, t in plan.jacobian_places]))
            self._inert |= any(t[0] == "up" for _, t in plan.jacobian_places)

    def _columns(self, g: int, active: list[int], targets: list[Target]) -> NDArray[np.intp]:
        """(instances, targets) slots of unknowns as columns of the Jacobian: of dF/dy below n, of dF/dy' below 2 n, above that
        the motion of loaded nodes."""
        found = [self.numbering.places(t, g, active) for t in targets]
        return np.stack(found, axis=1) if found else np.zeros((len(active), 0), dtype=np.intp)

    def _finish(self, pattern: Pattern, sparse: bool) -> None:
        n, self.entries, self.sparse = self.n, pattern, sparse
        if not self.has_pattern:
            return
        used = distinct(np.concatenate([pattern.cells, pattern.fixed_cells]))
        used = used[used < n * n]
        indptr = np.searchsorted(used, np.arange(n + 1) * n)
        self.columns = Columns(indptr, used % max(n, 1))
        self._dense = used % max(n, 1) * n + used // max(n, 1)

        def position(cells: NDArray[np.intp]) -> NDArray[np.intp]:
            return np.where(cells < n * n, np.searchsorted(used, cells), used.size)

        self._place, self._fixed = position(pattern.cells), position(pattern.fixed_cells)
        self._add_constant_entries()

    def _add_constant_entries(self) -> None:
        pattern = self.entries
        self.constant_entries: Array = np.zeros((2, len(self.columns.rows) + 1))
        for part, mask in zip(self.constant_entries, (~pattern.fixed_dotted, pattern.fixed_dotted), strict=True):
            np.add.at(part, self._fixed[mask], pattern.fixed[mask])

    @cached_property
    def sparsity(self) -> Any:
        """Sparsity pattern of the Jacobian as a CSC matrix (n, n); None where the Jacobian is full."""
        if not self.sparse:
            return None
        return sp.csc_matrix((np.ones(len(self.columns.rows)), self.columns.rows, self.columns.first), shape=(self.n, self.n))

    @cached_property
    def pattern(self) -> Places | None:
        """Sparsity pattern of the Jacobian (n, n), also where `sparse` is False; None where it is full (`has_pattern`)."""
        return Places(self.columns.first, self.columns.rows) if self.has_pattern else None

    # -- evaluation

    @cached_property
    def evaluation(self) -> EquationsOfScene:
        """The evaluation of these equations in C; kernels are compiled when they are first needed."""
        if self._first is not None:
            return self._first.evaluation.again(self.numbering, self)
        made = self.operations()
        made.compile()
        return made

    def operations(self) -> EquationsOfScene:
        """The native evaluation before it is compiled, so that a caller can append further operations."""
        terms = None
        if self.has_pattern:
            terms = JacobianTerms(self._jacobian, self._trees, self.entries, self._place, self.constant_entries)
        elif self._inert and self.explicit:  # no law of the library does, and inertia belongs to single bodies
            raise internal("a law outside of a tree that is evaluated joint by joint adds inertia to its bodies")
        made = EquationsOfScene(self.numbering, self.moved, self._residual, self.offset, self.inertia, terms, self)
        if not self.numbering.m and terms is not None:
            varying = self._inert or (self.moved.open is not Open.FEWEST and bool(self.inertia))
            made.with_rates(None if varying else self.inertia, self.columns)
        return made

    def __getstate__(self) -> dict[str, Any]:
        """State for copies and pickles, without the native tables: they contain addresses of arrays, so that a copy makes its
        own."""
        assert self.offset is not None  # the numbers are in their places
        return {name: value for name, value in self.__dict__.items() if name != "evaluation"} | {"_first": None}

    def motion(self) -> Emitted | None:
        """Function that appends the motion of loaded nodes, bodies of trees on which other laws act; None: there are none."""
        if not self.moved.loaded:
            return None
        return lambda part: TreeTerms(self.moved, self.numbering, part, {}).motion(part)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp), all arrays (n,)."""
        self.evaluation.residual(t, y, yp, out)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        """out[i] = F(t[i], y[i], yp[i]) for s points at once: t (s,), the others (s, n)."""
        self.evaluation.residual_stages(t, y, yp, out)

    @cached_property
    def constant_mass(self) -> Any:
        """Mass matrix (nu, nu) of the velocity unknowns, its constant entries only; sparse for many unknowns."""
        nu, (i, j, values) = self.numbering.nu, self._constants_of_mass
        if nu > LARGE:
            return sp.csr_matrix((values, (i, j)), shape=(nu, nu))
        M = np.zeros((nu, nu))
        np.add.at(M, (i, j), values)
        return M

    @cached_property
    def inverse_mass(self) -> Array:
        """Inverse of `constant_mass`, block by block, so that its entries outside of the diagonal blocks are exactly 0."""
        return inverse_of(as_full(self.constant_mass))

    @cached_property
    def _constants_of_mass(self) -> tuple[Any, Any, Array]:
        """Rows and columns among the velocity unknowns, and values, of the constant entries of the mass matrix."""
        nq, nu, p, n = self.numbering.nq, self.numbering.nu, self.entries, self.n
        rows, columns = p.fixed_cells % max(n, 1) - nq, p.fixed_cells // max(n, 1) - nq
        inside = p.fixed_dotted & (p.fixed_cells < n * n)
        inside &= (rows >= 0) & (rows < nu) & (columns >= 0) & (columns < nu)
        return rows[inside], columns[inside], p.fixed[inside]

    @cached_property
    def inertia(self) -> dict[tuple[int, int], float]:
        """The constant entries of the mass matrix by row and column; those of trees are in their passes."""
        found: dict[tuple[int, int], float] = {}
        for a, b, m in zip(*(part.tolist() for part in self._constants_of_mass), strict=True):
            found[a, b] = found.get((a, b), 0.0) + m
        return found

    @property
    def chained(self) -> Array:
        """Constants that are values of products of the chain rule."""
        return np.asarray(self.entries.chained)

    @property
    def explicit(self) -> bool:
        """Whether F = y' - f(t, y), for which `evaluation.products` exists."""
        return not self.has_pattern and not self.numbering.m

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        """out = dF/dy + cj dF/dy': (n, n) where `sparsity` is None, else (nnz,) CSC data."""
        fy, fyp = self.jacobian_values(t, y, yp)
        out[:] = fy + cj * fyp if self.sparse else self._full(fy + cj * fyp)

    def jacobian_values(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """The entries (nnz,) of dF/dy and those of dF/dy', in the order of `pattern`, by columns where the Jacobian is full."""
        return self.evaluation.jacobian(t, y, yp)

    def dense_stages(self, t: Array, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as full matrices (k, n, n) at k states, t (k,), y and yp (k, n)."""
        fy, fyp = self.evaluation.jacobians(t, y, yp)
        return self._full(fy), self._full(fyp)

    def _full(self, data: Array) -> Array:
        """The full matrices (..., n, n) with these entries (..., nnz)."""
        shape = *data.shape[:-1], self.n, self.n
        if not self.has_pattern:
            return np.asarray(data.reshape(shape).swapaxes(-1, -2))
        dense: Array = np.zeros((*data.shape[:-1], self.n * self.n))
        dense[..., self._dense] = data
        return dense.reshape(shape)

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as two arrays, each (n, n) or (nnz,) as in `jacobian`."""
        fy, fyp = self.jacobian_values(t, y, yp)
        return (fy, fyp) if self.sparse else (self._full(fy), self._full(fyp))
