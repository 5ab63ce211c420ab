"""Kernels of a tree of recursive joints: its residual, its derivatives, the motion of its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import symengine as se

from mbdae.costs import made_once
from mbdae.kernels.compile import Kernel
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.tree import OPERATIONS, tree_program
from mbdae.symbolic.tree_structure import TreeStructure
from mbdae.symbolic.vectors import Expr

CHUNK = 3000  #: steps of one kernel: LLVM compiles 3000 in 0.1 to 0.2 s, 10000 in seconds
OPTIMISED = 1000  #: steps up to which LLVM optimises in a few hundredths of a second
MOST_SOLVED, LONGEST_SOLVED = 16, 2000  #: accelerations, and steps, of one kernel that solves for them


class Piece(NamedTuple):
    """A kernel with the meaning of its inputs (see `TreeProgram`) and the targets of its outputs."""

    inputs: tuple[tuple[Any, ...], ...]
    targets: tuple[Any, ...]
    kernel: Kernel


class TreePlan:
    """The kernels of a tree. Raises OverflowError where its Jacobian takes more than `OPERATIONS` steps."""

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

    @property
    def operations(self) -> int:
        """Steps of the whole program."""
        return len(self.tree.program.steps)

    def _piece(self, entries: Sequence[tuple[Any, Expr]]) -> Piece:
        program = self.tree.program
        outputs = program.closed([e for _, e in entries])
        used = set().union(*(e.free_symbols for e in outputs)) if outputs else set()
        symbols = [s for s in self.places if s in used]
        level = 2 if len(program.needed([e for _, e in entries])) < OPTIMISED else 0
        return Piece(tuple(self.places[s] for s in symbols), tuple(t for t, _ in entries), Kernel(symbols, outputs, level))

    @cached_property
    def residual(self) -> Piece:
        """The rows of the tree."""
        return self._piece(self.rows)

    @cached_property
    def forward(self) -> Piece:
        """q, u and u' of the loaded nodes."""
        return self._piece(self.motion)

    @cached_property
    def jacobian(self) -> list[Piece]:
        """Derivatives; targets (row or state, input)."""
        return self._chunks([((target, place), e) for target, place, e in self.derivatives])

    @cached_property
    def mass(self) -> list[Piece]:
        """Derivatives of the rows by accelerations."""
        return self._chunks([((t, p), e) for t, p, e in self.derivatives if p[0] == "up" and t[0] == "u" and t[1] <= 0])

    @cached_property
    def rates(self) -> Piece | None:
        """Accelerations of a tree on which no law outside acts, and then the pivots of its mass matrix, of the rows that are its
        targets. The kernel reads behind its inputs what all other laws add to these rows, with a minus sign. None where the
        program is long."""
        rows = {t: e for t, e in self.rows if t[0] == "u"}
        number = {t[1:]: i for i, t in enumerate(rows)}
        entries = {(number[t[1:]], number[p[1:]]): e for t, p, e in self.derivatives
                   if p[0] == "up" and t in rows and p[1:] in number and number[p[1:]] <= number[t[1:]]}  # fmt: skip
        still = {s: se.Integer(0) for s, place in self.places.items() if place[0] == "up"}
        forces = [se.Symbol(f"force{i}") for i in range(len(rows))]
        if self.structure.loaded or self.structure.root.moves or len(rows) > MOST_SOLVED:
            return None
        program, found = self.tree.program.at(still, [*rows.values(), *entries.values()])
        right = [f - e for f, e in zip(forces, found, strict=False)]
        x, pivots = program.solved(dict(zip(entries, found[len(rows) :], strict=True)), right)
        needed, outputs = program.needed([*x, *pivots]), program.closed([*x, *pivots])
        if len(needed) > LONGEST_SOLVED:
            return None
        used = set().union(*(e.free_symbols for e in outputs))
        symbols = [s for s in self.places if s in used]
        return Piece(tuple(self.places[s] for s in symbols), tuple(rows), Kernel([*symbols, *forces], outputs, 2))

    @cached_property
    def motion_of_all(self) -> Piece:
        """q, u and u' of every carried node."""
        return self._piece(self.tree.states(self.all_nodes))

    @cached_property
    def velocities(self) -> list[Piece]:
        """Derivatives of the velocities of all carried nodes by those of the coordinates and the root."""
        motion = [(t, e) for t, e in self.tree.states(self.all_nodes, accelerations=False) if t[0] == "u"]
        seeds = [s for s, place in self.places.items() if place[0] == "u"]
        found = self.tree.program.derivatives([e for _, e in motion], seeds)
        entries = [((t, self.places[s]), e) for (t, _), row in zip(motion, found, strict=True) for s, e in row.items()]
        return self._chunks(entries)

    @property
    def all_nodes(self) -> tuple[int, ...]:
        """Every carried node."""
        return tuple(range(1, len(self.structure.links) + 1))

    def _chunks(self, entries: list[tuple[Any, Expr]]) -> list[Piece]:
        """One kernel, or several by columns where one would be slow to compile."""
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


@made_once("derive", 64)
def tree_plan(structure: TreeStructure) -> TreePlan:
    """The plan of a tree; made once per process and structure."""
    return TreePlan(structure)
