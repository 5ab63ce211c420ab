"""What the pages of joints and forces share: a law with its formulas, and the values that its printed equations must have."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table, numbered
from mbdae.documents.document import Document
from mbdae.errors import LawError
from mbdae.kernels.plan import Outputs, plan
from mbdae.reports.calculus import Pair
from mbdae.reports.common import LawFormulas
from mbdae.reports.letters import results
from mbdae.reports.printed import Check, Printed, Wanted, checks_table
from mbdae.reports.statement import Statement, derived
from mbdae.reports.states import POINTS, STEP, State
from mbdae.reports.vectors import Base, Vector
from mbdae.reports.writer import subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import weighted
from mbdae.symbolic.vectors import Expr

KERNEL, DERIVED, MOVED = "the compiled kernel", "the derived equations", "a complex step along a motion of the bodies"


BOTH = Wanted(None, "both sides")  #: of an equation between formulas


class LawPage:
    """One law stated with vectors, its formulas in LaTeX, and the values its equations must have at random states."""

    stated = True  #: whether its left-hand sides are those of `letters.RESULTS`
    s: Statement
    formulas: LawFormulas
    d: Derived
    state: State
    wanted: dict[str, Wanted]

    def want(self, latex: str, values: Any, source: str) -> None:
        """The values that a printed symbol must have."""
        values = np.asarray(values)
        shape = (POINTS, 3) if values.ndim == 2 else (POINTS,)
        self.wanted[latex] = Wanted(np.broadcast_to(values, shape), source)

    def compiled(self, outputs: Outputs) -> dict[Any, Any]:
        """Outputs of the compiled kernel (LLVM) at the states, by target."""
        p = plan(self.d, outputs)
        if not p.all_inputs.symbols:
            return {t: np.full(POINTS, float(e)) for t, e in zip(p.targets, p.inserted, strict=True)}
        x = np.stack([self.state.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
        return dict(zip(p.targets, p.kernel.values(x).T, strict=True))

    def at_point(self, side: str, kernel: dict[Any, Any]) -> tuple[Any, Any]:
        """Force and moment about the point of a side, inertial, of the compiled rows of its node (moment about the centre, body
        axes)."""
        f, count = self.state.frame(side), self.state.frame(side).kind.translations
        rows = [np.broadcast_to(kernel.get(("u", side, i), 0.0), (POINTS,)) for i in range(count + 3)]
        force = np.stack(rows[:3], -1) if count else np.zeros((POINTS, 3))
        moment = sum(self.state.vector(column) * m[:, None] for column, m in zip(f.body, rows[count:], strict=True))
        return force, moment - np.cross(self.state.vector(f.arm), force)

    def moved(self, kinds: tuple[str, str], symbols: dict[str, Any]) -> State:
        """The states after a complex step along displacements and rotations of all frames."""
        atom, (move, turn) = self.state.atom, kinds
        motion = {side: (atom(Base(move, side)), atom(Base(turn, side))) for side in self.s.record.sides}
        return self.state.changed(1j * STEP, motion, {name: v for name, v in symbols.items() if name in self.state.given})

    @cached_property
    def varied(self) -> State:
        """The states after a virtual displacement of bodies and coordinates."""
        return self.moved(("du", "dpsi"), {str(c): self.state.given[str(dc)] for c, dc in self.s.virtual.items()})

    @property
    def changes(self) -> dict[str, Expr]:
        """Symbols of the virtual changes of the coordinates that are unknowns, by name."""
        return {name: self.s.virtual[symbol] for name, symbol in self.s.coordinates.items()}

    @cached_property
    def stated_pairs(self) -> dict[str, Pair] | None:
        """The force and torque that the law states, and those of its thrust, on all bodies, left-hand side, at their points."""
        if self.s.wrench is None and self.s.thrust is None:
            return None
        zero, record = self.s.record.zero(), self.s.record
        out = dict.fromkeys(record.sides, (zero, zero))
        if self.s.wrench is not None:
            force, torque = self.s.wrench
            d = record.single(record.atom("r", "l") - record.atom("r", "k"))
            out |= {"k": (force, torque + d.cross(force)), "l": (-force, -torque)}
        if self.s.thrust is not None:
            along, push = self.s.thrust
            for side, (move, turn) in self.s.gradient(along)[0].items():
                out[side] = (out[side][0] + move * -push, out[side][1] + turn * -push)
        return out

    @cached_property
    def stated_partials(self) -> dict[Expr, Expr]:
        """What the thrust of the law adds to the equations of the coordinates that are unknowns, left-hand side."""
        zero = dict.fromkeys(self.s.coordinates.values(), se.Integer(0))
        if self.s.thrust is None:
            return zero
        along, push = self.s.thrust
        return zero | {symbol: -push * p for symbol, p in self.s.gradient(along)[1].items()}

    def totals(self) -> dict[str, Pair]:
        """G^T lambda: force and moment on the bodies, at their points, by side."""
        zero = self.s.record.zero()
        out = dict.fromkeys(self.s.record.sides, (zero, zero))
        for row, (pairs, _) in self.s.gradients.items():
            weight = se.Symbol(f"lambda_{row}")
            out = {side: (out[side][0] + pairs[side][0] * weight, out[side][1] + pairs[side][1] * weight) for side in out}
        return out

    def all_pairs(self) -> dict[str, Pair]:
        """Forces and moments on the bodies at their points, as they stand on the left-hand side."""
        zero = self.s.record.zero()
        parts = [self.totals(), self.stated_pairs or dict.fromkeys(self.s.record.sides, (zero, zero))]
        if isinstance(self.s.law, Force):
            parts += [self.s.gradient(self.s.energy)[0], self.s.drag[0]]
        both = {side: [sum((p[side][i] for p in parts), zero) for i in (0, 1)] for side in self.s.record.sides}
        return {side: (force, moment) for side, (force, moment) in both.items()}

    def letters(self, mark: str = "") -> list[tuple[str, str, int]]:
        """Names of force and moment of every frame: LaTeX, side, 0 or 1; a free rotation has a moment alone."""
        found = []
        for side in self.s.record.sides:
            both = [(0, "f"), (1, "m")] if side in self.s.sides else [(1, "m")]
            found += [(rf"\mathbf{{{letter}}}{mark}_{subscript(side)}", side, i) for i, letter in both]
        return [entry for entry in found if entry[1] not in self.s.still]

    def balance(self, pairs: dict[str, Pair], must: bool = False) -> tuple[list[Block], bool]:
        """The sums of the forces and of the moments about the point of the first body, and whether both vanish at all states.

        must: they are said to vanish, whatever they are."""
        record, w, (first, *others) = self.s.record, self.formulas.writer, self.s.sides
        force, moment = record.zero(), pairs[first][1]
        turning = rf"\mathbf{{m}}_{subscript(first)}"
        for side in others:
            d = record.single(record.atom("r", side) - record.atom("r", first))
            moment = moment + pairs[side][1]
            moment = sum((d.cross(Vector(record, {a: c})) for a, c in pairs[side][0].terms.items()), moment)
            turning += rf" + \mathbf{{m}}_{subscript(side)}"
            turning += rf" + {w.vector(d)}\times\mathbf{{f}}_{subscript(side)}" if pairs[side][0].terms else ""
        n = self.formulas.numbers(self.state)
        force = sum((pairs[side][0] for side in self.s.sides), force)
        force, moment = (record.zero() if must else settled(a, n) for a in (force, moment))
        total = " + ".join(rf"\mathbf{{f}}_{subscript(i)}" for i in self.s.sides)
        self.wanted |= dict.fromkeys((total, turning), BOTH)
        lines = self.formulas.lines(f"{total} = {w.vector(force)}", f"{turning} = {w.vector(moment)}")
        return lines, not (force.terms or moment.terms)

    def covector(self, state: State, side: str) -> tuple[Any, Any]:
        """G^T lambda of a frame as derived: force, and moment about its point (points, 3)."""
        force, moment = (state.vector(part) for part in weighted(self.d, self.d.multipliers, side))
        return force, moment - np.cross(state.vector(state.frame(side).arm), force)

    def printed(self, blocks: list[Block]) -> list[Check]:
        """The equations of numbered blocks, read back."""
        known = {latex: value for latex, value in self.formulas.known_at(self.state).items() if latex not in self.wanted}
        return Printed(known, self.wanted).read(blocks)


def settled(a: Vector, n: Any) -> Vector:
    """The vector, or zero where it vanishes at all states."""
    return a if a.terms and float(np.max(np.abs(n.vector(a)))) > 1e-12 else a.record.zero()


def planar_of(s: Statement) -> Derived | None:
    """The law in the plane, where it has a planar form."""
    try:
        return derived(s.cls, s.structure, planar=True)
    except LawError:
        return None


def document(title: str, head: list[Block], pages: list[tuple[Any, list[Block]]], convention: str, tail: list[Block]) -> Document:
    """A document whose pages are numbered and read back; head: blocks without equations, behind it the symbols of all pages."""
    blocks = [part.blocks for part in numbered([Section("", part) for _, part in pages])]  # type: ignore[union-attr]
    rows = dict.fromkeys(tuple(row) for page, _ in pages for row in page.formulas.symbols().rows)
    checks = [c for (page, _), part in zip(pages, blocks, strict=True) for c in page.printed(list(part))]
    stated = [[k for k, w in page.wanted.items() if w.values is not None] for page, _ in pages if hasattr(page, "stated")]
    further = [row for written in stated for row in results(written)]
    letters = [row[0] for row in rows] + [name for page, _ in pages for name in page.formulas.own]
    checks += [Check(f"{symbol} has one meaning", float("inf")) for symbol in twice(letters)]
    told = [Paragraph(convention)] if convention else []
    symbols = Section("Symbols", [Table(["symbol", "unit", "meaning"], [*map(list, rows), *further]), *told])
    body = [b for part in blocks for b in part]
    return Document(title, [*head, symbols, *body, Section("Numeric check", checks_table(checks)), *tail])


def twice(names: list[str]) -> list[str]:
    """Names that appear more than once."""
    return [name for name in dict.fromkeys(names) if names.count(name) > 1]


def told(text: str, *lines: str) -> list[Block]:
    """A sentence and equations."""
    return [Paragraph(text), *map(Equation, lines)]
