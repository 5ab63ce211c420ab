"""What a form prescribes for the assembly of a scene's equations.

Entries of the Jacobian: row and column of every value of a kernel and of every constant, and the chain rule for loaded nodes
(bodies moved by joint coordinates, on which laws outside of their tree act).

The trees of a scene in its equations: the motion of bodies on which other laws act, the rows of the joint coordinates, and
their accelerations; by the passes over every tree, or by kernels in which the passes over a small tree are one function.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels.plan import Outputs
from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.kernels.tree_plan import Piece
from mbdae.native.program import Operations
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.numbering import Numbering
from mbdae.system.model.trees import Tree
from mbdae.system.motion.tree_mechanics import Inertia, own_inertia


@dataclass(frozen=True)
class FormSpec:
    """What a form prescribes for the assembly of a scene's equations.

    outputs: function that selects the expressions which a law adds to the equations; rows: head of a target -> block of rows of F
    ("q", "u", "s" or a block of multipliers) to which such an expression is added; blocks: blocks of multipliers in y
    ("lambda", "mu"); derivatives: whether the multipliers are the time derivatives of these unknowns; index: differentiation
    index of each kind of unknown; mixed: whether stresses of beams are unknowns (kind "z"); waves: whether elastic vibrations
    are resolved, so that the error test contains the velocities; loads_only: whether beams enter without elastic forces and
    inertia, only with gravity and loads; numbers: parameters of the form itself, by name, such as Baumgarte's; eliminated:
    whether the multipliers are solved for at every state, so that y = (q, u, s)."""

    label: str
    outputs: Outputs
    rows: Mapping[str, str]
    blocks: tuple[str, ...]
    derivatives: bool
    index: Mapping[str, int]
    mixed: bool = False
    waves: bool = False
    loads_only: bool = False
    numbers: Mapping[str, float] = field(default_factory=dict)
    eliminated: bool = False

    @property
    def shape(self) -> tuple[Any, ...]:
        """All but the values of its numbers."""
        maps = *self.rows.items(), *self.index.items(), *self.numbers
        return (self.label, self.outputs, self.blocks, self.derivatives, self.mixed, self.waves, self.loads_only,
                self.eliminated, *maps)

    @property
    def multipliers(self) -> int:
        """Number of multipliers that are unknowns for every constraint row."""
        return 0 if self.eliminated else len(self.blocks)

    @property
    def drifts(self) -> bool:
        """Whether constraints are imposed on velocities or accelerations only, so that joints may come apart slowly."""
        return bool(self.blocks) and "g" not in self.rows


Index = NDArray[np.intp]


class Scatter:
    """A list of terms of F or of its Jacobian: kernels with the rows (or entries) to which their values are added; linear
    terms."""

    def __init__(self) -> None:
        self.gathers: list[Index] = []
        self.places: list[Index] = []
        self.kernels: list[Any] = []
        self._linear: list[tuple[Index, Index, Array]] = [(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))]

    def kernel(self, gather: Index, places: Index, kernel: Any) -> None:
        """Add a kernel for all instances of a law. gather (instances, inputs): slots that it reads; places (instances, outputs):
        rows to which its values are added."""
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

    def emit(self, part: Operations, first: int) -> None:
        """Append operations that add the values of the kernels to their rows; row 0 is in slot `first`."""
        for gather, places, kernel in zip(self.gathers, self.places, self.kernels, strict=True):
            part.add(first + places, kernel.emit(part, gather))


class Entries:
    """Collects entries (row, column) of dF/dy and dF/dy'.

    Rows: below n those of F; n: left out; above n the forces on loaded nodes. Columns: below n those of dF/dy, below 2 n those of
    dF/dy', above that q, u and u' of loaded nodes; -1: left out. By the chain rule a derivative of a force on a loaded node is
    multiplied from the left by the derivatives of F by that force, and a derivative by the motion of a loaded node from the right
    by the derivatives of that motion by the unknowns; both are values of the kernels of trees."""

    def __init__(self, n: int) -> None:
        self.n = n
        none = np.zeros(0, np.intp)
        self._varying: list[tuple[Index, Index]] = [(none, none)]
        self._fixed: list[tuple[Index, Index, Array]] = [(none, none, np.zeros(0))]
        self._instances, self._terms = 0, [none]  # of every constant the number of the instance of a law that it belongs to
        #: (row, column) of every value of the kernels of trees; (n, -1) for a value that only is a factor in the chain rule
        self._tree_cells: list[tuple[int, int]] = []
        #: row of a loaded node (a force on it) -> rows of F that contain this force, each with the number of its factor among the
        #: values of the trees' kernels
        self._left: dict[int, list[tuple[int, int]]] = defaultdict(list)
        #: slot of q, u or u' of a loaded node -> unknowns on which it depends, each with the number of the derivative among the
        #: values of the trees' kernels
        self._right: dict[int, list[tuple[int, int]]] = defaultdict(list)

    def varying(self, rows: Index, columns: Index) -> None:
        """Add entries of the Jacobian whose values a kernel of a law returns, in the order of its outputs."""
        self._varying.append((rows.ravel(), columns.ravel()))

    def constant(self, rows: Index, columns: Index, values: Array) -> None:
        """Add entries of the Jacobian with constant values; every row of the arrays is one instance of a law."""
        self._fixed.append((rows.ravel(), columns.ravel(), values.ravel()))
        self._terms.append(self._instances + np.repeat(np.arange(len(rows)), rows.shape[1]))
        self._instances += len(rows)

    def reads(self, slots: set[int]) -> bool:
        """Whether a constant entry is a derivative by one of these columns."""
        return any(not slots.isdisjoint(columns.tolist()) for _, columns, _ in self._fixed)

    def chain(self, piece: Piece, trees: int, slot: Callable[[int, tuple[object, ...]], int]) -> None:
        """Add the values of a kernel of derivatives for this number of trees of one structure; slot(tree, place): slot of a row,
        of a node's motion or of an input of the kernel."""
        for tree in range(trees):
            for target, place in piece.targets:
                factor = len(self._tree_cells)
                row, column = slot(tree, target), slot(tree, place)
                self._tree_cells.append((self.n, -1))
                if target[1] > 0:
                    self._right[row].append((column, factor))
                elif place[0] in ("wu", "wq"):
                    self._left[column - self.n + 1].append((row, factor))
                else:
                    self._tree_cells[-1] = row, column

    def finish(self) -> Pattern:
        """All entries collected, with the products of the chain rule, as arrays."""
        n = self.n
        rows, columns = (np.concatenate(parts) for parts in zip(*self._varying, strict=True))
        fixed_rows, fixed_columns, values = (np.concatenate(parts) for parts in zip(*self._fixed, strict=True))
        chained = (fixed_rows > n) | (fixed_columns >= 2 * n)
        all_rows, all_columns = np.r_[rows, fixed_rows[chained]], np.r_[columns, fixed_columns[chained]]
        products = self._products(all_rows, all_columns)
        direct = (rows <= n) & (columns < 2 * n)
        cells = np.array(self._tree_cells, dtype=np.intp).reshape(-1, 2)
        placed = np.array(products, dtype=np.intp).reshape(-1, 5)
        return Pattern(
            n, np.r_[np.where(direct, rows, n), cells[:, 0], placed[:, 0]], np.r_[columns, cells[:, 1], placed[:, 1]],
            placed[:, 2:].T.copy(), values, chained, fixed_rows[~chained], fixed_columns[~chained],
            np.concatenate(self._terms)[~chained],
        )

    def _products(self, rows: Index, columns: Index) -> list[tuple[int, int, int, int, int]]:
        """Every product of the chain rule as (row, column, left factor, value, right factor): value is the number of an entry of
        rows and columns; a factor 0 stands for the number 1, a factor f + 1 for value f of the trees."""
        found = []
        for v in np.flatnonzero(((rows > self.n) | (columns >= 2 * self.n)) & (rows != self.n) & (columns >= 0)):
            row, column = int(rows[v]), int(columns[v])
            left = [(r, f + 1) for r, f in self._left[row]] if row > self.n else [(row, 0)]
            right = [(c, f + 1) for c, f in self._right[column]] if column >= 2 * self.n else [(column, 0)]
            found += [(r, c, a, int(v), b) for r, a in left for c, b in right]
        return found


class Pattern:
    """The entries of the Jacobian as arrays. cells: number of the matrix entry (see `_cells`) of every value of kernels of laws,
    then of kernels of trees, then of products left * value * right; dotted: which belong to dF/dy'. fixed_cells, fixed_dotted,
    fixed: the same of constants, with their values; terms: the instances of laws, numbered, that these belong to; chained:
    constants that are values of products."""

    def __init__(self, n: int, rows: Index, columns: Index, factors: Index, values: Array, chained: Any, fixed_rows: Index,
                 fixed_columns: Index, terms: Index) -> None:
        self.cells, self.dotted = _cells(n, rows, columns), columns >= n
        self.left, self.value, self.right = factors
        self.terms, self._chained = terms, chained
        self.fixed_cells, self.fixed_dotted = _cells(n, fixed_rows, fixed_columns), fixed_columns >= n
        self.chained, self.fixed = values[chained], values[~chained]

    def again(self, values: Array) -> Pattern:
        """The same with the constants that another model has, in the order in which they were added."""
        made = copy(self)
        made.chained, made.fixed = values[self._chained], values[~self._chained]
        return made


def _cells(n: int, rows: Index, columns: Index) -> Index:
    """The number column * n + row of every entry, in the order of CSC; n * n where it is left out."""
    return np.where((rows >= n) | (columns < 0), n * n, columns % max(n, 1) * n + rows)


Pivots = list[tuple[int, int]]  #: slots of the pivots of the mass matrix, each with the number of its velocity unknown


class TreeTerms:
    """Appends the trees of a scene to lists of operations. inertia: (row, column) -> entry of the mass matrix by laws outside of
    the trees."""

    def __init__(self, moved: MovedBodies, numbering: Numbering, operations: Operations, inertia: Inertia) -> None:
        self.moved, self.nb, self._operations = moved, numbering, operations
        self._own = [{pair: operations.constant(partial(_entry, tree, pair)) for pair in own_inertia(numbering, tree, inertia)}
                     for tree in moved.trees]
        self._passes = [(moved.passes(numbering, tree, bool(tree.structure.loaded), own), tree)
                        for tree, own in zip(moved.trees, self._own, strict=True) if moved.ordered]
        self._plans = [plan for plan in moved.plans() if plan[0].structure.loaded]

    def motion(self, part: Operations, still: bool = False) -> None:
        """Append the motion of loaded nodes, and what the other methods read. still: without accelerations."""
        for plan, trees in self._plans:
            values = plan.forward.kernel.emit(part, self.moved.gather(self.nb, plan.forward, trees))
            part.set([[slot_of(self.nb, tree, t) for t in plan.forward.targets] for tree in trees], values)
        for passes, tree in self._passes:
            passes.outwards(part)
            if not still:
                passes.accelerations(part, self._at(tree, "up"), given=True)
            passes.write_motion(part, tree.structure.loaded, lambda j, head, i, of=tree: slot_of(self.nb, of, (head, j, i)),  # type: ignore[misc]
                                ("q", "u") if still else ("q", "u", "up"))

    def rows(self, part: Operations, first: int) -> None:
        """Append the rows of the trees' equations of motion, and corrections of the rates of their positions (form GGL); row 0 is
        in slot `first`."""
        for plan, trees in self.moved.plans():
            places = np.array([[slot_of(self.nb, tree, t) for t in plan.residual.targets] for tree in trees], dtype=np.intp)
            part.add(first + places, plan.residual.kernel.emit(part, self.moved.gather(self.nb, plan.residual, trees)))
        for passes, tree in self._passes:
            self._loads(part, passes, tree)
            passes.corrections(part, tree.structure.loaded, self._on_body(tree, "wq"), self._at(tree, "q", first))
            passes.balance(part, self._at(tree, "u", first))

    def rates(self, part: Operations, first: int) -> Pivots:
        """Append the accelerations of the trees' velocities: slots from `first` on, one for each unknown, hold the forces on the
        velocities before, and the accelerations after."""
        pivots: Pivots = []
        forces = part.slots(self.nb.nu)  # a copy, because slots that a kernel has read are read again by its derivative
        part.set(forces + np.arange(self.nb.nu), first + self.nb.nq + np.arange(self.nb.nu))
        for passes, tree in self._passes:
            rate, force = self._at(tree, "u", first), self._at(tree, "u", forces - self.nb.nq)
            self._loads(part, passes, tree)
            pivots += [(slot, force(place) - forces) for slot, place in passes.inwards(part, force)]
            passes.accelerations(part, rate)
        own = dict(zip(map(id, self.moved.trees), self._own, strict=True))
        for plan, trees in self.moved.plans():
            alike: dict[tuple[Any, ...], list[Tree]] = {}
            for tree in trees:
                alike.setdefault(tuple(own[id(tree)]), []).append(tree)
            for pairs, some in alike.items():
                piece = plan.rates(pairs)
                gather = [[self._read(tree, place, forces - self.nb.nq, own[id(tree)]) for place in piece.inputs]
                          for tree in some]
                values = piece.kernel.emit(part, np.array(gather, dtype=np.intp).reshape(len(some), -1))
                half = values.shape[1] // 2
                to = np.array([[self._at(tree, "u", first)(t) for t in piece.targets[:half]] for tree in some], dtype=np.intp)
                part.set(to, values[:, :half])
                pivots += zip(values[:, half:].ravel().tolist(), (to - first - self.nb.nq).ravel().tolist(), strict=True)
        return pivots

    def _read(self, tree: Tree, place: Place, first: int, own: Mapping[tuple[Place, Place], int]) -> int:
        if place[0] == "own":
            return own[place[1:]]
        return self._at(tree, "u", first)(place) if place[0] == "force" else self.moved.slot(self.nb, tree, place)

    def _at(self, tree: Tree, head: str, first: int = 0) -> Callable[[Place], int]:
        return lambda place: first + slot_of(self.nb, tree, (head, *place[1:]))

    def _on_body(self, tree: Tree, role: str) -> Callable[[int, int], int]:
        return lambda j, i: slot_of(self.nb, tree, (role, j, i))

    def _loads(self, part: Operations, passes: TreePasses, tree: Tree) -> None:
        passes.loads(part, tree.structure.loaded, self._on_body(tree, "wu"))


def _entry(tree: Tree, pair: tuple[Place, Place], of: Any) -> list[float]:
    """The entry of the mass matrix of the equations `of` by a pair of a tree's velocities."""
    return [own_inertia(of.numbering, tree, of.inertia)[pair]]


def add_derivatives(moved: MovedBodies, nb: Numbering, entries: Entries, single: Scatter) -> list[tuple[Piece, Any]]:
    """Add the entries of the Jacobian of trees whose passes are one function. Returns the kernels of trees with loaded nodes,
    with the slots that they read, for the chain rule; those of other trees are added to `single` like the kernels of any law."""
    found: list[tuple[Piece, Any]] = []
    for plan, trees in moved.plans():
        for piece in plan.jacobian:
            gather = moved.gather(nb, piece, trees)
            if plan.structure.loaded:
                found.append((piece, gather))
                entries.chain(piece, len(trees), lambda i, place, of=trees: slot_of(nb, of[i], place))  # type: ignore[misc]
                continue
            rows, columns = (np.array([[slot_of(nb, tree, pair[k]) for pair in piece.targets] for tree in trees], dtype=np.intp)
                             for k in (0, 1))
            single.kernel(gather, rows, piece.kernel)
            entries.varying(rows, columns)
    return found
