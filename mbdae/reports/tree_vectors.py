"""The recursion program of a tree executed with vectors instead of components, which gives the formulas of a recursive joint.

The order in which the rows of a scene are solved for the multipliers, force balances first.

A row in which one multiplier is left with the coefficient 1 or -1 gives it without a division: force balances, in trees from
the leaves to the root. Where there is none, a row with a coefficient 1 or -1 is put into the others. What remains is split into
the smallest blocks that can be solved one after the other by determinants: single rows, and two rows per dyad. Further rows with
the same multipliers join their block, so that it is solved wherever any of its determinants differs from 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
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

LARGEST_BLOCK = 3  #: largest number of multipliers that are solved for together by determinants
FURTHER = 2  #: largest number of rows that join a block
NOTHING = se.Integer(0)
Coefficients = dict[Any, Expr]  #: coefficients by multiplier; the constant term under None


class SolvedTogether(NamedTuple):
    """Multipliers that are solved for together, the rows that determine them, and the places of these in u. A row of a force
    balance is solved already: it holds the value of its multiplier, which is no longer in it."""

    unknowns: list[Any]
    rows: list[Coefficients]
    places: list[int]


def solved(rows: Mapping[int, Coefficients], number: Callable[[Expr], float], efforts: Mapping[int, str]) -> list[SolvedTogether]:
    """The steps of the solution in their order. number: value of a coefficient at the start; efforts: units of the rows.
    ValueError where too many multipliers must be solved for together."""
    left, later = {at: dict(row) for at, row in rows.items()}, list[SolvedTogether]()
    while (found := _pivot(left)) is not None:
        at, unknown = found
        row = left.pop(at)
        c = row.pop(unknown)
        value = {key: -e * c for key, e in row.items()}  # c is 1 or -1, so that dividing by c is multiplying by it
        later.insert(0, SolvedTogether([unknown], [value], [at]))
        left = {a: _inserted(r, unknown, value) for a, r in left.items()}
    open_, steps, known = {a: r for a, r in left.items() if len(r) > 1}, list[SolvedTogether](), set[Any]()
    while open_:
        block = _block(open_, known, number)
        if block is None:
            raise ValueError(f"more than {LARGEST_BLOCK} constraint rows must be solved together (no mistake in the scene)")
        places, unknowns = block
        places += _further(open_, places, unknowns, known, efforts)
        steps.append(SolvedTogether(unknowns, [open_.pop(at) for at in places], places))
        known |= set(unknowns)
        open_ = {a: r for a, r in open_.items() if _unsolved(r, known)}
    return steps + later


def _pivot(left: dict[int, Coefficients]) -> tuple[int, Any] | None:
    """A row and a multiplier in it with coefficient 1 or -1: of the row with the fewest multipliers, one that appears in the
    fewest rows."""
    counts = Counter(key for row in left.values() for key in row)
    found = [(len(row), counts[key], at, str(key), key) for at, row in left.items() for key, e in row.items()
             if key is not None and e in (1, -1) and len(row) > 1]
    best = min(found, key=lambda entry: entry[:4], default=None)
    return None if best is None else (best[2], best[4])


def _unsolved(row: Coefficients, known: set[Any]) -> list[Any]:
    return sorted((key for key in row if key is not None and key not in known), key=str)


def _block(rows: dict[int, Coefficients], known: set[Any], number: Callable[[Expr], float]) -> tuple[list[int], list[Any]] | None:
    """Fewest rows with as many multipliers not in `known`: their places in u, and these; by determinant if several."""
    for size in range(1, LARGEST_BLOCK + 1):
        found = []
        for places in combinations(sorted(rows), size):
            unknowns = sorted({key for at in places for key in _unsolved(rows[at], known)}, key=str)
            if len(unknowns) == size:
                A = [[number(rows[at].get(unknown, NOTHING)) for unknown in unknowns] for at in places]
                found.append((-abs(float(np.linalg.det(A))), list(places), unknowns))
        if found:
            return min(found, key=lambda entry: (round(entry[0], 9), entry[1]))[1:]
    return None


def _further(rows: dict[int, Coefficients], places: list[int], unknowns: list[Any], known: set[Any],
             efforts: Mapping[int, str]) -> list[int]:
    """Places of further rows of the same unit that have no multipliers but those of a block."""
    found = [at for at in sorted(rows) if at not in places and efforts[at] == efforts[places[0]]
             and {*_unsolved(rows[at], known)} <= {*unknowns}]
    return found[:FURTHER] if len({efforts[at] for at in places}) == 1 else []


def _inserted(row: Coefficients, unknown: Any, value: Coefficients) -> Coefficients:
    """A row with a multiplier replaced by its expression."""
    if unknown not in row:
        return row
    c, out = row[unknown], {key: e for key, e in row.items() if key != unknown}
    for key, e in value.items():
        out[key] = se.expand(out.get(key, NOTHING) + c * e)
    return {key: e for key, e in out.items() if key is None or e != 0}


def total(row: Coefficients) -> Expr:
    """The sum of a row's terms."""
    return sum((e if key is None else e * key for key, e in row.items()), NOTHING)


def determinant(A: list[list[Expr]]) -> Expr:
    """Determinant of a square matrix, by expansion in minors."""
    if len(A) == 1:
        return A[0][0]
    minors = [[row[:j] + row[j + 1 :] for row in A[1:]] for j in range(len(A))]
    return sum(((-1) ** j * A[0][j] * determinant(minor) for j, minor in enumerate(minors)), NOTHING)


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
