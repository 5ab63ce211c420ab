"""Kernels of a tree of recursive joints: its residual, its derivatives, the motion of its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property, partial
from typing import Any, NamedTuple

import symengine as se

from mbdae.disk import store
from mbdae.disk.entries import Digests, keep, key_of, part_key, recall
from mbdae.kernels import Kernel
from mbdae.process import made_once
from mbdae.symbolic.motion import symbolic_steps
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.rebuild import symbols_of
from mbdae.symbolic.tree import OPERATIONS, tree_program
from mbdae.symbolic.tree_motion import Link, TreeStructure
from mbdae.symbolic.vectors import Expr

#: a kernel of derivatives with more operations is divided by columns of the Jacobian, each of which stays whole: LLVM compiles
#: 3000 operations in 0.1 to 0.2 s, but 10000 in seconds
CHUNK = 3000
#: number of operations below which LLVM optimises a kernel, in at most some hundredths of a second; that which solves for the
#: accelerations of a tree is always optimised
OPTIMISED = 1000
#: largest number of accelerations of a tree, and of operations of the kernel that solves for them, with which that kernel is
#: used. Without beams and constraint rows, trees are evaluated joint by joint where one of them has more than MOST_SOLVED
#: velocities
MOST_SOLVED, LONGEST_SOLVED = 16, 2000


class Piece(NamedTuple):
    """A kernel of a tree, with the meaning of its inputs (see `TreeProgram.inputs`) and of its outputs."""

    inputs: tuple[tuple[Any, ...], ...]
    targets: tuple[Any, ...]
    kernel: Kernel


class ProgrammedTree:
    """The straight-line program of a whole tree with its derivatives, and kernels that contain parts of it. Raises OverflowError
    where the Jacobian takes more than `OPERATIONS` operations."""

    def __init__(self, structure: TreeStructure) -> None:
        self.structure, self.tree = structure, tree_program(structure)
        self.places = self.tree.inputs
        seeds = [s for s, place in self.places.items() if place[0] in ("q", "u", "up", "wu", "wq")]
        self.rows = self.tree.rows()
        self.motion = self.tree.states(structure.loaded)
        outputs = [*self.rows, *self.motion]
        found = self.tree.program.derivatives([e for _, e in outputs], seeds, limit=OPERATIONS)
        self.derivatives: list[tuple[Target, Target, Expr]] = [
            (target, self.places[seed], e) for (target, _), row in zip(outputs, found, strict=True) for seed, e in row.items()
        ]
        self.operations = len(self.tree.program.steps)

    def _piece(self, entries: Sequence[tuple[Any, Expr]]) -> Piece:
        program = self.tree.program
        outputs = program.closed([e for _, e in entries])
        used = symbols_of(outputs)
        symbols = [s for s in self.places if s in used]
        level = 2 if len(program.needed([e for _, e in entries])) < OPTIMISED else 0
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

    def mass(self) -> list[Piece]:
        """Kernels of the mass matrix: derivatives of the equations of motion by accelerations."""
        return self._chunks([((t, p), e) for t, p, e in self.derivatives if p[0] == "up" and t[0] == "u" and t[1] <= 0])

    def rates(self) -> list[Piece]:
        """Kernel of the accelerations, see `TreePlan.rates`; an empty list where there is none."""
        rows = {t: e for t, e in self.rows if t[0] == "u"}
        number = {t[1:]: i for i, t in enumerate(rows)}
        entries = {(number[t[1:]], number[p[1:]]): e for t, p, e in self.derivatives
                   if p[0] == "up" and t in rows and p[1:] in number and number[p[1:]] <= number[t[1:]]}
        still = {s: se.Integer(0) for s, place in self.places.items() if place[0] == "up"}
        forces = [se.Symbol(f"force{i}") for i in range(len(rows))]
        if self.structure.loaded or self.structure.root.moves or len(rows) > MOST_SOLVED:
            return []
        program, found = self.tree.program.at(still, [*rows.values(), *entries.values()])
        right = [f - e for f, e in zip(forces, found, strict=False)]
        x, pivots = program.solved(dict(zip(entries, found[len(rows) :], strict=True)), right)
        needed, outputs = program.needed([*x, *pivots]), program.closed([*x, *pivots])
        if len(needed) > LONGEST_SOLVED:
            return []
        used = symbols_of(outputs)
        symbols = [s for s in self.places if s in used]
        return [Piece(tuple(self.places[s] for s in symbols), tuple(rows), Kernel([*symbols, *forces], outputs, 2))]

    def motion_of_all(self) -> list[Piece]:
        """Kernel of q, u and u' of every body that the joints of the tree carry."""
        return [self._piece(self.tree.states(carried_nodes(self.structure)))]

    def velocities(self) -> list[Piece]:
        """Kernels of the derivatives of the velocities of all carried bodies by the velocity unknowns of the tree."""
        nodes = carried_nodes(self.structure)
        motion = [(t, e) for t, e in self.tree.states(nodes, accelerations=False) if t[0] == "u"]
        seeds = [s for s, place in self.places.items() if place[0] == "u"]
        found = self.tree.program.derivatives([e for _, e in motion], seeds)
        entries = [((t, self.places[s]), e) for (t, _), row in zip(motion, found, strict=True) for s, e in row.items()]
        return self._chunks(entries)

    def _chunks(self, entries: list[tuple[Any, Expr]]) -> list[Piece]:
        """One kernel for all entries, or several by columns of the Jacobian where one would be slow to compile."""
        program = self.tree.program
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
    """The kernels of a tree, read from disk where an earlier process stored them. Raises OverflowError where the Jacobian takes
    more than `OPERATIONS` operations. operations: number of operations of the whole program."""

    def __init__(self, structure: TreeStructure) -> None:
        self.structure, self.key = structure, structure_key(structure)
        self._pieces: dict[str, list[Piece]] = {}
        found = recall(self.key)
        if found is None:
            keep(self.key, found := self._size())
        self.operations, fits = found
        if not fits:
            raise OverflowError(self.operations)

    def _size(self) -> tuple[int, bool]:
        try:
            return self.programmed.operations, True
        except OverflowError as large:
            return int(large.args[0]), False

    @cached_property
    def programmed(self) -> ProgrammedTree:
        """The program of the tree, derived when it is first needed."""
        return ProgrammedTree(self.structure)

    def _cut(self, what: str, n: int) -> Kernel:
        """Kernel n of those that the method `what` of `ProgrammedTree` returns."""
        if what not in self._pieces:
            self._pieces[what] = getattr(self.programmed, what)()
        return self._pieces[what][n].kernel

    def _known(self, what: str) -> list[Piece]:
        """The kernels that the method `what` of `ProgrammedTree` returns, made from tables on disk where these exist; expressions
        are then derived only when something asks for them."""
        key = part_key(self.key, what)
        tables = recall(key)
        if tables is None:
            self._pieces[what] = getattr(self.programmed, what)()
            tables = [(p.inputs, p.targets, tuple(map(str, p.kernel.symbols)), p.kernel.level, p.kernel.width)
                      for p in self._pieces[what]]
            keep(key, tables)
        return [Piece(inputs, targets, Kernel(tuple(map(se.Symbol, symbols)), partial(self._expressions, what, n), level, width,
                                              part_key(key, str(n))))
                for n, (inputs, targets, symbols, level, width) in enumerate(tables)]

    def _expressions(self, what: str, n: int) -> list[Expr]:
        return self._cut(what, n).expressions

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

    @cached_property
    def mass(self) -> list[Piece]:
        """Kernels of the mass matrix: derivatives of the equations of motion by accelerations."""
        return self._known("mass")

    @cached_property
    def rates(self) -> Piece | None:
        """Kernel of the accelerations of a tree on whose bodies no law outside of it acts, and of the pivots of its mass matrix;
        targets: the equations of motion. After the inputs of the tree it reads one number per equation: what other laws (on the
        joint coordinates) add to its right-hand side. None where bodies are loaded, the root is free, or the kernel would be
        larger than MOST_SOLVED or LONGEST_SOLVED allow."""
        return next(iter(self._known("rates")), None)

    @cached_property
    def motion_of_all(self) -> Piece:
        """Kernel of q, u and u' of every body that the joints of the tree carry."""
        return self._known("motion_of_all")[0]

    @cached_property
    def velocities(self) -> list[Piece]:
        """Kernels of the derivatives of the velocities of all carried bodies by those of the joint coordinates and of the
        root."""
        return self._known("velocities")


def carried_nodes(structure: TreeStructure) -> tuple[int, ...]:
    """Numbers in the tree of all nodes that its joints carry: all but the root, which has number 0."""
    return tuple(range(1, len(structure.links) + 1))


def structure_key(structure: TreeStructure) -> str | None:
    """The key of a tree on disk, from its shape, the motions of its joints and the statements of its laws; None where a law has
    no key."""
    if not store().used:
        return None
    try:
        laws = [member.law.key for member in structure.members]
        if None in laws:
            return None
        shape = [structure.root, structure.loaded, [(m.nodes, m.numbers) for m in structure.members]]
        return key_of("tree", Digests().of([shape, laws, list(map(_link, structure.links))]))
    except Exception:  # a law that cannot be derived (derivation reports it), or one that has no key
        return None


def _link(link: Link) -> list[Any]:
    law = link.law.symbolic(link.structure)
    stated = {f.name: getattr(link, f.name) for f in fields(link) if f.name not in ("law", "structure", "motion")}
    units = [(name, entry.unit) for name, entry in link.law.coordinates.items()]
    return [stated, units, list(link.law.params), symbolic_steps(law)]


@made_once("derive", 64)
def tree_plan(structure: TreeStructure) -> TreePlan:
    """The plan of a tree; made once per process and structure."""
    return TreePlan(structure)
