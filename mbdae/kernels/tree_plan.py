"""Kernels of a tree of recursive joints: its residual, its derivatives, the motion of its bodies."""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.disk.entries import keep, part_key, recall
from mbdae.kernels import Kernel
from mbdae.kernels.links import structure_key
from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.native.program import block
from mbdae.process import made_once
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.program import Program
from mbdae.symbolic.rebuild import substituted, symbols_of
from mbdae.symbolic.tree_motion import TreeStructure
from mbdae.symbolic.vectors import Expr

#: a kernel of derivatives with more operations is divided by columns of the Jacobian, each of which stays whole: LLVM compiles
#: 3000 operations in 0.1 to 0.2 s, but 10000 in seconds
CHUNK = 3000
#: number of operations below which LLVM optimises a kernel, in at most some hundredths of a second; that which solves for the
#: accelerations of a tree is always optimised
OPTIMISED = 1000


Entries = list[tuple[Any, Expr]]
Pairs = tuple[tuple[Place, Place], ...]


class Piece(NamedTuple):
    """A kernel of a tree, with the meaning of its inputs (see `TreeProgram.inputs`) and of its outputs."""

    inputs: tuple[tuple[Any, ...], ...]
    targets: tuple[Any, ...]
    kernel: Kernel


class Inline:
    """Operations carried out on expressions in place of numbers: an `Operations` that makes one straight-line program of all
    kernels which it is asked to run. inputs: symbol -> place of the tree that stands in its slot."""

    def __init__(self) -> None:
        self.program, self.inputs, self.size = Program(), dict[Expr, Place](), 0
        self.values: dict[int, Expr] = {}
        self._slots: dict[Place, int] = {}

    def copied(self) -> Inline:
        """The same, to which more can be added on its own."""
        made = copy(self)
        made.program, made.inputs, made.values, made._slots = (
            self.program.copied(), dict(self.inputs), dict(self.values), dict(self._slots))
        return made

    def slot(self, place: Place) -> int:
        """The slot of the input at a place."""
        if place not in self._slots:
            self._slots[place] = self.size
            self.values[self.size] = symbol = se.Symbol(re.sub(r"\W+", "_", "_".join(map(str, place)).replace("-", "c")))
            self.inputs[symbol] = place
            self.size += 1
        return self._slots[place]

    def slots(self, count: int) -> int:
        """Reserve slots; this and the other methods are those of `Operations`."""
        self.size += int(count)
        return self.size - int(count)

    def zeros(self, count: int) -> int:
        """Slots of zeros."""
        return self.constant([0] * count)

    def constant(self, values: Any) -> int:
        """Slots of constants."""
        first = self.slots(len(values))
        self.load(first, values)
        return first

    def load(self, first: int, values: Any) -> None:
        """Constants into consecutive slots."""
        self.values |= {first + i: se.Integer(int(v)) if v == int(v) else se.RealDouble(v) for i, v in enumerate(values)}

    def call(self, kernel: Any, gather: Any, first: int | None = None) -> Any:
        """A kernel at points (points, inputs)."""
        return self.hand_on(kernel, gather, np.zeros((len(gather), 0), dtype=np.intp), first)

    def hand_on(self, kernel: Any, gather: Any, to: Any, first: int | None = None) -> Any:
        """A kernel at one point after the other, with its first values added to the slots `to`."""
        first = self.slots(len(gather) * kernel.width) if first is None else first
        found, (program, outputs) = block(first, len(gather), kernel.width), kernel.straight()
        needed, let = program.needed(outputs), self.program.let
        for slots, results, sums in zip(gather.tolist(), found.tolist(), to.tolist(), strict=True):
            table = dict(zip(kernel.symbols, (self.values[slot] for slot in slots), strict=True))
            for name in needed:
                table[name] = let(substituted(program.steps[name], table))
            self.values |= {slot: let(substituted(e, table)) for slot, e in zip(results, outputs, strict=True)}
            self.add(sums, results[: len(sums)])
        return found

    def set(self, to: Any, from_: Any) -> None:
        """Copies."""
        self.values |= {a: self.values[b] for a, b in zip(np.ravel(to).tolist(), np.ravel(from_).tolist(), strict=True)}

    def add(self, to: Any, from_: Any) -> None:
        """Sums."""
        for a, b in zip(np.ravel(to).tolist(), np.ravel(from_).tolist(), strict=True):
            self.values[a] = self.program.let(self.values[a] + self.values[b])


class ProgrammedTree:
    """The passes over a tree as one straight-line program, with its derivatives, and kernels that contain parts of it.

    rows: rows of the equations of motion ("u"), and corrections of q' ("q") where laws outside act on bodies of the tree; motion:
    q, u and u' of the loaded nodes, the bodies on which laws outside of the tree act."""

    def __init__(self, structure: TreeStructure) -> None:
        self.structure, self.made = structure, Inline()
        self.program, self.places = self.made.program, self.made.inputs
        self._tree = TreePasses(structure, self.made.slot, quaternion=True)
        self._tree.outwards(self.made)  # type: ignore[arg-type]
        self._tree.accelerations(self.made, self._rate, given=True)  # type: ignore[arg-type]
        self._before = dict(self.made.values)  # the passes inwards add to these
        self.rows, self.motion = self._rows(), self._motion(structure.loaded)

    def alone(self) -> ProgrammedTree:
        """The same with steps of its own: a kernel then does not hang on which others have been asked for before, and thus not
        on which are on disk."""
        made = copy(self)
        made.made, made._tree = self.made.copied(), copy(self._tree)
        made._tree.slot, made.program, made.places = made.made.slot, made.made.program, made.made.inputs
        return made

    def _rate(self, place: Place) -> int:
        return self.made.slot(("up", *place[1:]))

    def _loaded(self) -> TreePasses:
        """The passes after those outwards, with the forces of laws outside of the tree."""
        self.made.values |= self._before
        self._tree.loads(self.made, self.structure.loaded, lambda j, i: self.made.slot(("wu", j, i)))  # type: ignore[arg-type]
        return self._tree

    def _motion(self, nodes: Sequence[int]) -> Entries:
        to: dict[Place, int] = {}
        self._tree.write_motion(self.made, nodes, lambda j, head, i: to.setdefault((head, j, i), self.made.slots(1)))  # type: ignore[arg-type]
        return [(place, self.made.values[slot]) for place, slot in to.items()]

    def _rows(self) -> Entries:
        """Rows of the equations of motion ("u"), and corrections of q' ("q") where laws outside act on bodies of the tree."""
        made, at, to, tree = self.made, self.structure.loaded, dict[Place, int](), self._loaded()

        def row(place: Place) -> int:
            return to[place] if place in to else to.setdefault(place, made.zeros(1))

        if at:
            tree.corrections(made, at, lambda j, i: made.slot(("wq", j, i)), row)  # type: ignore[arg-type]
        tree.balance(made, row)  # type: ignore[arg-type]
        return [(place, made.values[slot]) for place, slot in to.items() if made.values[slot] != 0]

    @cached_property
    def derivatives(self) -> list[tuple[Target, Target, Expr]]:
        """Derivatives of `rows` and `motion`: output, input, derivative."""
        outputs = [*self.rows, *self.motion]
        seeds = [s for s, place in self.places.items() if place[0] in ("q", "u", "up", "wu", "wq")]
        found = self.program.derivatives([e for _, e in outputs], seeds)
        return [(target, self.places[seed], e)
                for (target, _), row in zip(outputs, found, strict=True) for seed, e in row.items()]

    def _piece(self, entries: Sequence[tuple[Any, Expr]], level: int | None = None) -> Piece:
        outputs = self.program.closed([e for _, e in entries])
        used = symbols_of(outputs)
        symbols = [s for s in self.places if s in used]
        if level is None:
            level = 2 if len(self.program.needed([e for _, e in entries])) < OPTIMISED else 0
        return Piece(tuple(self.places[s] for s in symbols), tuple(t for t, _ in entries), Kernel(symbols, outputs, level))

    def residual(self) -> list[Piece]:
        """Kernel of the equations of motion of the tree."""
        return [self._piece(self.rows)]

    def forward(self) -> list[Piece]:
        """Kernel of q, u and u' of the loaded nodes: the bodies of the tree on which laws outside of it act."""
        return [self._piece(self.motion)]

    def jacobian(self) -> list[Piece]:
        """Kernels of the derivatives of `residual` and `forward`."""
        return self._chunks([((target, place), e) for target, place, e in self.derivatives])

    def rates(self, pairs: Pairs = ()) -> list[Piece]:
        """Kernel of the accelerations, see `TreePlan.rates`."""
        made, up = self.made, dict[Place, int]()
        tree = self._loaded().copied({(a, b): made.slot(("own", a, b)) for a, b in pairs})
        pivots = tree.inwards(made, lambda place: made.slot(("force", *place[1:])))  # type: ignore[arg-type]
        tree.accelerations(made, lambda place: up.setdefault(place, made.slots(1)))  # type: ignore[arg-type]
        number = {place: slot for slot, place in pivots}
        return [self._piece([(place, made.values[slot]) for of in (up, {place: number[place] for place in up})
                             for place, slot in of.items()], 2)]

    def motion_of_all(self) -> list[Piece]:
        """Kernel of q, u and u' of every body that the joints of the tree carry."""
        return [self._piece(self._motion(carried_nodes(self.structure)))]

    def _chunks(self, entries: list[tuple[Any, Expr]]) -> list[Piece]:
        """One kernel for all entries, or several by columns of the Jacobian where one would be slow to compile."""
        program = self.program
        if len(program.needed([e for _, e in entries])) <= CHUNK:
            return [self._piece(entries)] if entries else []
        by_column: dict[Any, list[tuple[Any, Expr]]] = {}
        for entry in entries:
            by_column.setdefault(entry[0][1], []).append(entry)
        pieces: list[list[tuple[Any, Expr]]] = [[]]
        for column in by_column.values():
            if pieces[-1] and len(program.needed([e for _, e in pieces[-1] + column])) > CHUNK:
                pieces.append([])
            pieces[-1] += column
        return [self._piece(piece) for piece in pieces]


class TreePlan:
    """The kernels of a tree, read from disk where an earlier process stored them."""

    def __init__(self, structure: TreeStructure) -> None:
        self.structure, self.key = structure, structure_key(structure)
        self._pieces: dict[str, list[Piece]] = {}
        self._rates: dict[Pairs, Piece] = {}

    @cached_property
    def programmed(self) -> ProgrammedTree:
        """The program of the tree, derived when it is first needed."""
        return ProgrammedTree(self.structure)

    def _cut(self, what: str, n: int, *args: Any) -> Kernel:
        """Kernel n of those that the method `what` of `ProgrammedTree` returns."""
        name = f"{what}{args or ''}"
        if name not in self._pieces:
            self._pieces[name] = getattr(self.programmed.alone(), what)(*args)
        return self._pieces[name][n].kernel

    def _known(self, what: str, *args: Any) -> list[Piece]:
        """The kernels that the method `what` of `ProgrammedTree` returns, made from tables on disk where these exist; expressions
        are then derived only when something asks for them."""
        name = f"{what}{args or ''}"
        key = part_key(self.key, name)
        tables = recall(key)
        if tables is None:
            self._pieces[name] = getattr(self.programmed.alone(), what)(*args)
            tables = [(p.inputs, p.targets, tuple(map(str, p.kernel.symbols)), p.kernel.level, p.kernel.width)
                      for p in self._pieces[name]]
            keep(key, tables)
        return [Piece(inputs, targets, Kernel(tuple(map(se.Symbol, symbols)), partial(self._expressions, what, n, *args), level,
                                              width, part_key(key, str(n))))
                for n, (inputs, targets, symbols, level, width) in enumerate(tables)]

    def _expressions(self, what: str, n: int, *args: Any) -> list[Expr]:
        return self._cut(what, n, *args).expressions

    @cached_property
    def residual(self) -> Piece:
        """Kernel of the equations of motion of the tree."""
        return self._known("residual")[0]

    @cached_property
    def forward(self) -> Piece:
        """Kernel of q, u and u' of the loaded nodes: the bodies of the tree on which laws outside of it act."""
        return self._known("forward")[0]

    @cached_property
    def jacobian(self) -> list[Piece]:
        """Kernels of the derivatives of `residual` and `forward`; a target is the pair of an output of these and an input."""
        return self._known("jacobian")

    def rates(self, pairs: Pairs = ()) -> Piece:
        """Kernel of the accelerations of a tree, by velocities, then of the pivots of its mass matrix, in the same order. It
        reads the forces on the velocities, ("force", node, i), and inertia by laws outside of the tree, ("own", a, b) for the
        pairs of velocities a, b."""
        if pairs not in self._rates:
            self._rates[pairs] = self._known("rates", pairs)[0]
        return self._rates[pairs]

    @cached_property
    def motion_of_all(self) -> Piece:
        """Kernel of q, u and u' of every body that the joints of the tree carry."""
        return self._known("motion_of_all")[0]


def carried_nodes(structure: TreeStructure) -> tuple[int, ...]:
    """Numbers in the tree of all nodes that its joints carry: all but the root, which has number 0."""
    return tuple(range(1, len(structure.links) + 1))


@made_once("derive", 64)
def tree_plan(structure: TreeStructure) -> TreePlan:
    """The plan of a tree; made once per process and structure."""
    return TreePlan(structure)
