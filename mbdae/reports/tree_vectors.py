"""The recursion program of a tree executed with vectors instead of components, which gives the formulas of a recursive joint."""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.reports.calculus import distributed
from mbdae.reports.statement import ReportedLaw
from mbdae.reports.vectors import Base, NamedQuantities, NamedVector, Product, Vector
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import Step
from mbdae.symbolic.program import Program
from mbdae.symbolic.tree import TreeProgram, Wrench
from mbdae.symbolic.tree_motion import Link, LinkWay, Moved, NodeMotion, TreeStructure
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec


def link_of(law: Any, structure: Structure, derived: frozenset[str]) -> Link:
    """The joint as the only link of a tree of two bodies in space with root k."""
    of_side = [*("p1", "p2", "p3"), *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)), *(f"P{i}" for i in range(4))]
    numbers = [f"{side}_{name}" for side in "kl" for name in of_side]
    numbers += [name for name in law.params if name not in derived and name not in structure.absent]
    names = tuple(law.coordinates)
    return Link(law, structure, 0, "k", NodeKind.SPATIAL, (Axes.GENERAL, Axes.GENERAL), tuple((n, None) for n in numbers), True,
                names, (False,) * len(names), 1)


def tree_of(link: Link) -> TreeStructure:
    """The tree of that link, with loads on body l."""
    return TreeStructure(NodeKind.SPATIAL, (link,), (), (1,))


class _Vectors(Program):
    """A recursion program that keeps results as formulas, without symbols for intermediate results. Axes after the last rotation
    are replaced by the axes of l; those after earlier rotations get letters."""

    def __init__(self) -> None:
        super().__init__()
        self.turns, self.last, self.record = 0, 0, NamedQuantities()
        self.reached: tuple[Vec, ...] = ()

    def let(self, e: Any) -> Expr:
        return se.sympify(e)

    def vec(self, v: Vec) -> Vec:
        return v

    def axes(self, axes: tuple[Vec, Vec, Vec]) -> tuple[Vec, Vec, Vec]:
        self.turns += 1
        if self.turns < self.last:
            x, y, z = (a.named() for a in axes)
            return x, y, z
        self.reached = axes
        x, y, z = (self.record.atom(name, "l") for name in "xyz")
        return x, y, z


class VectorTree(TreeProgram):
    """Motion and forces of a joint from k to l, as vectors of its statement's record.

    reached: axes of l; spins: angular velocity and acceleration of l by those of k and the coordinates; l: its motion;
    root: force and moment that the joint passes on to k."""

    def __init__(self, s: ReportedLaw, link: Link) -> None:
        self.s, self.link = s, link
        self.atom = s.record.atom
        super().__init__(tree_of(link))
        assert isinstance(self.program, _Vectors)
        self.reached: Any = self.program.reached
        self.way: Any = self._ways[0]
        self.l: Any = self.nodes[1]
        self.force = self._along((self.atom("F", "l"), self.atom("M", "l")))
        self._label()

    def _label(self) -> None:
        """Give letters to angular velocities and accelerations between k and l."""
        for number, value in self.s.record.vectors.items():
            for kind, letter in (("w", r"\boldsymbol{\omega}"), ("al", r"\dot{\boldsymbol{\omega}}")):
                if Base(kind, "k") in value.terms and number not in self.s.record.labels:
                    count = sum(label.startswith(letter) for label in self.s.record.labels.values())
                    self.s.record.labels[number] = f"{letter}_{{{count + 1}}}"

    @staticmethod
    def _program() -> Program:
        return _Vectors()

    def second(self, name: str) -> Expr:
        """The symbol of the second time derivative of a coordinate."""
        return se.Symbol(f"{name}_second")

    def _input(self, *place: Any) -> Expr:
        head, owner, i = place
        if head == "number":
            return se.Symbol(i)
        name = self.link.coordinates[-owner - self.link.first]
        q = self.s.coordinates[name]
        return {"q": q, "u": self.s.clock[q], "up": self.second(name)}[head]

    def _root(self, kind: NodeKind) -> NodeMotion:
        r, v, w, a, al = (self.atom(name, "k") for name in ("c", "vc", "w", "ac", "al"))
        return NodeMotion(kind, r, UNIT, se.Integer(0), v, w, a, al)

    def _frame(self, j: int, link: Link, side: str, node: NodeMotion, axes: Axes) -> tuple[Vec, tuple[Vec, ...]]:
        return self.atom("s", side), tuple(self.atom(name, side) for name in "xyz")

    def _motion(self, j: int, link: Link) -> list[Moved]:
        found = super()._motion(j, link)
        assert isinstance(self.program, _Vectors)
        self.program.last, self.program.record = sum(m.step.turns for m in found), self.s.record
        return found

    def _rotation(self, c: int) -> Any:
        name = self.link.coordinates[c - self.link.first]
        side = self.s.turning[name]
        spin, change = (Vec(*(se.Symbol(f"{side}_{letter}{i}") for i in "123")) for letter in ("W", "Wp"))
        rotation = self.s.values[name]
        return rotation, Moved(Step(True, ZERO, se.Integer(0), rotation), number=c, spin=spin, change=change)

    def _spins(self, found: LinkWay) -> tuple[Vec, Vec]:
        self.spins: Any = (found.w, found.al)
        return self.atom("w", "l"), self.atom("al", "l")

    def _orient(self, child: NodeMotion, k: NodeMotion, place: tuple[int, Link, str], found: LinkWay) -> None:
        pass

    def _arm(self, j: int, link: Link, side: str, node: NodeMotion) -> Vec:
        return self.atom("s", side)

    def _along(self, wrench: Wrench) -> dict[tuple[int, int], Expr]:
        """Rows of the joint's coordinates for a force and a moment on l, by virtual power; they pass on `root` to k."""
        found, F = self.way, wrench[0]
        M = wrench[1] - found.back.cross(F)  # about the end of the joint's motion
        self.root: Any = (F, M + found.total.cross(F))
        rows, left = dict[tuple[int, int], Expr](), found.total  # from the parent's node to the place of the motion
        for part in reversed(found.parts):
            m = part.moved
            moment = M if left is found.total else M + (found.total - left).cross(F)
            for c, slope in m.slopes.items():
                work = part.direction @ (moment if m.step.turns else F)
                rows[-c, 0] = rows.get((-c, 0), se.Integer(0)) + slope * work
            if m.step.rotation is not None:
                rows |= {(-m.number, i): axis @ moment for i, axis in enumerate(part.axes)}
            left = left if part.displacement is ZERO else left - part.displacement
        return rows

def inserted(a: Vector, atoms: dict[Base, Vector], symbols: dict[Expr, Expr]) -> Vector:
    """A vector with atoms and symbols replaced and products expanded; named vectors without any of them are kept."""
    record, total = a.record, a.record.zero()
    for atom, c in a.terms.items():
        total = total + _replaced(record, atom, atoms, symbols) * se.sympify(c).subs(symbols)
    return total


def _replaced(record: NamedQuantities, atom: Any, atoms: dict[Base, Vector], symbols: dict[Expr, Expr]) -> Vector:
    plain = Vector(record, {atom: se.Integer(1)})
    if isinstance(atom, Product):
        left, right = (_replaced(record, part, atoms, symbols) for part in (atom.left, atom.right))
        return sum((distributed(left, b) * c for b, c in right.terms.items()), record.zero())
    if isinstance(atom, NamedVector):
        value = inserted(record.vectors[atom.number], atoms, symbols)
        return plain if value.terms == record.vectors[atom.number].terms else value
    return atoms.get(atom, plain)
