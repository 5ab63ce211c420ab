"""Programs of the pieces of a tree: one joint with the body it carries, a root, a law between bodies, loads from outside.

Every piece is a `TreeProgram` of its own whose other bodies are given by numbers: the same statements of motion and laws as in
the program of a whole tree. What the passes need follows by derivatives: of the body's acceleration by that of its parent (X)
and by those of the joint's coordinates (S), and of the forces of its laws by its acceleration (M).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import symengine as se

from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.links.state import along, directions, motion_names, numbers_of, state_of
from mbdae.symbolic.program import Program
from mbdae.symbolic.tree import TreeProgram, Wrench
from mbdae.symbolic.tree_motion import Link, Member, State, TreeStructure
from mbdae.symbolic.vectors import ZERO, Expr

Place = tuple[Any, ...]
Entries = list[tuple[Place, Expr]]


class PieceProgram(TreeProgram):
    """A piece of a tree. Inputs besides those of `TreeProgram`: ("x", node, name) a number of a node's motion, ("a", node, name)
    its acceleration in one of its directions."""

    wrenches: dict[int, Wrench]

    def _given(self, node: int, kind: NodeKind) -> State:
        accelerations = set(directions(kind))
        return state_of(kind, lambda name: self._input("a" if name in accelerations else "x", node, name))

    def _projected(self, role: str, wrenches: dict[int, Wrench]) -> dict[tuple[int, int], Expr]:
        self.wrenches = wrenches
        return {}

    def _symbols(self, head: str, node: int | None = None) -> list[Expr]:
        return [s for s, place in self.inputs.items() if place[0] == head and node in (None, place[1])]

    def slopes(self, name: str, values: Sequence[Expr], by: Sequence[Expr], order: Any = None) -> Entries:
        """Derivatives of values i by symbols j as entries at (name, i, j), also where they are 0."""
        found = self.program.derivatives([se.sympify(v) for v in values], by)
        return [((name, i, j), row.get(symbol, se.Integer(0))) for i, row in enumerate(found) for j, symbol in enumerate(by)]

    def still(self, entries: Entries) -> tuple[Program, list[Expr]]:
        """A program of some entries with all accelerations set to 0, and the entries in it."""
        nothing = {s: se.Integer(0) for s, place in self.inputs.items() if place[0] in ("a", "up")}
        return self.program.at(nothing, [e for _, e in entries])


class LinkProgram(PieceProgram):
    """A joint (link 1) and the body that it carries (node 1) with that body's own laws; node 0 is the body that carries the
    joint."""

    def __init__(self, parent: NodeKind, link: Link, members: tuple[Member, ...]) -> None:
        super().__init__(TreeStructure(parent, (replace(link, parent=0, first=1),), members))

    def _root(self, kind: NodeKind) -> State:
        return self._given(0, kind)

    def _carried(self, j: int, link: Link) -> State:
        child = super()._carried(j, link)
        self.reached = along(link.kind, child.a, child.al)
        given = self._given(1, link.kind)
        child.a, child.al = given.a, given.al
        return child

    def outward(self, quaternion: bool) -> Entries:
        """Motion of the body; X, S and c of its acceleration X a0 + S q'' + c; inertia M (lower triangle) and force p of its
        laws."""
        child = self.nodes[1]
        found: Entries = [(("x", name), e) for name, e in zip(motion_names(child.kind, quaternion), numbers_of(child, quaternion),
                                                     strict=True)]  # fmt: skip
        found += self.slopes("X", self.reached, self._accelerations(0)) + self.slopes("S", self.reached, self.freedoms)
        found += [(("c", i), e) for i, e in enumerate(self.reached)]
        return found + self._inertia(child)

    def _inertia(self, child: State) -> Entries:
        F = along(child.kind, *self.wrenches.get(1, (ZERO, ZERO)))
        slopes = [(place, e) for place, e in self.slopes("M", F, self._accelerations(1)) if place[2] <= place[1]]
        return slopes + [(("p", i), e) for i, e in enumerate(F)]

    def _accelerations(self, node: int) -> list[Expr]:
        known = {place[2]: s for s, place in self.inputs.items() if place[:2] == ("a", node)}
        return [known[name] for name in directions(self.nodes[node].kind)]

    @property
    def freedoms(self) -> list[Expr]:
        """Second rates of the joint's free coordinates, in their order."""
        return self._symbols("up")


class RootProgram(PieceProgram):
    """A body that moves by unknowns of its own (node 0), which may carry others."""

    def __init__(self, kind: NodeKind) -> None:
        super().__init__(TreeStructure(kind, (), ()))

    def outward(self, quaternion: bool) -> Entries:
        """Motion of the body; S and c of its acceleration S u' + c; zeros for inertia M and force p, which laws on it add."""
        root = self.nodes[0]
        reached = along(root.kind, root.a, root.al)
        found: Entries = [(("x", name), e) for name, e in zip(motion_names(root.kind, quaternion), numbers_of(root, quaternion),
                                                     strict=True)]  # fmt: skip
        found += self.slopes("S", reached, self._symbols("up")) + [(("c", i), e) for i, e in enumerate(reached)]
        n, zero = len(reached), se.Integer(0)
        return [*found, *((("M", i, j), zero) for i in range(n) for j in range(i + 1)), *((("p", i), zero) for i in range(n))]


class MemberProgram(PieceProgram):
    """A law between several bodies whose motions are given; `nodes` has their places in `member`."""

    def __init__(self, kinds: Sequence[NodeKind], member: Member) -> None:
        self.structure, self.program = TreeStructure(NodeKind.GROUND, (), (member,)), self._program()
        self.inputs = {}
        self.nodes = [self._given(i, kind) for i, kind in enumerate(kinds)]
        self.wrenches = self._members()

    def forces(self) -> Entries:
        """Components i of force and moment of the law on every body j, entries ("p", j, i)."""
        return [(("p", j, i), e) for j, F in self.wrenches.items() for i, e in enumerate(along(self.nodes[j].kind, *F))]


class NodeProgram(PieceProgram):
    """A body whose motion is given: its unknowns q, u, u', as laws outside of the tree read them, and the forces of these
    laws."""

    def __init__(self, kind: NodeKind) -> None:
        self.structure, self.program = TreeStructure(NodeKind.GROUND, (), ()), self._program()
        self.inputs = {}
        self.nodes = [self._given(0, kind)]

    def motion(self, heads: Sequence[str]) -> Entries:
        """q, u and u' ("up") of the body, as far as `heads` names them."""
        return [((t[0], t[2]), e) for t, e in self.states((0,)) if t[0] in heads]

    def load(self, role: str) -> Entries:
        """Force and moment from inputs (role, 0, i), what laws outside of the tree add to the body's rows: to its equations of
        motion (role "wu"), or to its kinematic equations ("wq")."""
        return [(("p", i), e) for i, e in enumerate(along(self.nodes[0].kind, *self._load(role, 0)))]
