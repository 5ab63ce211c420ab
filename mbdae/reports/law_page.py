"""The page of a law: its statement with vectors, its formulas in LaTeX with a letter for every symbol, and the values that its
equations must have at random states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.errors import LawError
from mbdae.kernels.plan import Outputs, plan
from mbdae.notation import together
from mbdae.reports.calculus import ForwardDerivative, Pair, summed, times
from mbdae.reports.letters import Letter, letters, multiplier, name_scalars, name_vectors, rate_of, unit_text
from mbdae.reports.page import BOTH, Check, Page
from mbdae.reports.statement import ReportedLaw, derived
from mbdae.reports.states import POINTS, STEP, FormulaValues, SymbolValues, random_state
from mbdae.reports.units import Dimensions, dimensions, law_faults, unit, unit_in
from mbdae.reports.vectors import Base, Vector
from mbdae.reports.writer import Writer, subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import dynamics, weighted
from mbdae.symbolic.vectors import Expr

_BASES = {
    "r": ("position of the point of the {what} on body ${side}$", "m"),
    "c": ("centre of body ${side}$", "m"),
    "s": ("arm from the centre of body ${side}$ to the point of the {what}", "m"),
    "x": ("first axis of the {what} on body ${side}$, a unit vector", "1"),
    "y": ("second axis on body ${side}$", "1"),
    "z": ("third axis on body ${side}$: the axis of the {what}", "1"),
    "v": ("velocity of the point on body ${side}$", "m/s"),
    "w": ("angular velocity of body ${side}$", "rad/s"),
    "du": ("virtual displacement of the point on body ${side}$", "m"),
    "dpsi": ("virtual rotation of body ${side}$", "rad"),
    "vc": ("velocity of the centre of body ${side}$", "m/s"),
    "ac": ("acceleration of the centre of body ${side}$", "m/s^2"),
    "al": ("angular acceleration of body ${side}$", "rad/s^2"),
    "F": ("all forces on body ${side}$ without those of the joint, left-hand side", "N"),
    "M": ("all moments on body ${side}$ about its centre without those of the joint, left-hand side", "N m"),
    "bx": ("first axis of body ${side}$", "1"),
    "by": ("second axis of body ${side}$", "1"),
    "bz": ("third axis of body ${side}$", "1"),
}
_TURNED = {
    "bx": ("first axis of the free rotation: its components along $\\mathbf{i}_x, \\mathbf{i}_y, \\mathbf{i}_z$ are those of the"
           " turned first axis along the axes reached before", "1"),
    "by": ("second axis of the free rotation, with components as for the first", "1"),
    "bz": ("third axis of the free rotation, with components as for the first", "1"),
    "w": ("angular velocity of the free rotation, with components as for its axes", "rad/s"),
    "dpsi": ("virtual rotation of the free rotation, with components as for its axes", "rad"),
}


class Shown(NamedTuple):
    """A force, moment or generalised force that a page prints: letter, unit, formula, and its values at states."""

    latex: str
    unit: str
    formula: Any
    values: Callable[[SymbolValues], Any]


COMPLEX = "the derived equations, by a complex step of the parameter"


class LawPage(Page):
    """One law stated with vectors, evaluated at random states.

    what: noun for the law in texts; rows: whether its rows are printed; others: letters used on other pages of the document."""

    stated = True

    def __init__(self, s: ReportedLaw, what: str = "joint", rows: bool = True, others: frozenset[str] = frozenset(),
                 state: SymbolValues | None = None) -> None:
        self.s, self.d, self.what, self.others = s, s.derived, what, others
        self.defined: set[tuple[str, str]] = set()  #: intermediate quantities that printed equations define
        self.state, self.wanted = state if state is not None else random_state(self.d), {}
        self.known = letters(s.cls, s.structure, s.law, (*s.rows, *s.speeds))
        for row, e in (s.rows | s.speeds).items() if rows else ():
            of = "W" if row in s.speeds else "J"
            self.known[f"lambda_{row}"] = Letter(multiplier(row), self.effort(e, of), f"multiplier of row {row}")
        self.known |= {name: replace(self.known[name], unit="1") for name in s.turning}
        for side in s.headings:
            self.known |= {f"{side}_h": Letter(f"\\theta_{side}", "rad", f"rotation of body ${side}$ from the drawn position"),
                           f"{side}_w3": Letter(f"\\omega_{side}", "rad/s", f"angular velocity of body ${side}$ in the plane"),
                           f"dpsi_{side}": Letter(f"\\delta\\theta_{side}", "rad", f"virtual rotation of {side}")}
        for name, symbol in s.coordinates.items():
            letter = self.known[name]
            self.known[str(symbol)] = letter
            self.known[str(s.clock[symbol])] = rate_of(letter)
            self.known[str(s.virtual[symbol])] = Letter(f"\\delta {letter.latex}", letter.unit,
                                                        f"virtual change of ${letter.latex}$")
        self.writer = Writer(s.record, {})
        self.writer.renew = self.refresh
        self.refresh()

    # -- units

    @cached_property
    def cases(self) -> list[Dimensions]:
        """Units of the quantities that the law states; see `dimensions`."""
        return dimensions(self.d)

    def unit(self, e: Expr, times: str = "1") -> str:
        """Unit of a scalar, times another one, or units joined by "or" where several are possible."""
        return " or ".join(str(u * unit(times)) for u in unit_in(self.cases, e, self._number))

    def effort(self, e: Expr, of: str = "J") -> str:
        """Unit of the generalised force on a scalar: N m for an angle or a cosine, N for a length; of="W": on a velocity."""
        return " or ".join((unit(of) / u).of_force for u in unit_in(self.cases, e, self._number))

    def units(self) -> list[Check]:
        faults = law_faults(self.d)
        agree = [Check("units of all rows, energies and forces", 0.0)] if self.cases and not faults else []
        return [Check(fault, float("inf")) for fault in faults] or agree

    def _number(self, state: SymbolValues, e: Expr) -> Any:
        return np.broadcast_to(self.numbers(state).scalar(e), (state.points,))

    # -- letters and definitions

    def refresh(self) -> None:
        """Give letters to the intermediate quantities named since the last call."""
        known = {name: letter.latex for name, letter in self.known.items()}
        others = self.others.union(known.values())
        self.writer.names = name_vectors(self.s.record, others)
        self.writer.letters = name_scalars(self.s.record, others) | known

    @property
    def taken(self) -> frozenset[str]:
        """Letters given to intermediate quantities, on this page and on others."""
        return self.others | {*self.own}

    @property
    def own(self) -> Sequence[str]:  # type: ignore[override]
        return sorted(self._letter(*key) for key in self.defined)

    def _letter(self, kind: str, name: str) -> str:
        return self.writer.names[int(name)] if kind == "v" else self.writer.letters[name]

    def lines(self, *lines: str, note: str = "") -> list[Block]:
        """Equations, one a line, followed by the definitions of quantities that they name for the first time."""
        return super().lines(*lines, note=note) + self.definitions()

    def definitions(self) -> list[Block]:
        """Definitions of intermediate quantities that printed formulas contain and no equation has defined yet."""
        record, w = self.s.record, self.writer
        found: list[Block] = []
        while True:
            self.refresh()
            written = {("v", str(n)): record.vectors[n] for n in sorted(w.vectors)}
            written |= {("s", str(symbol)): e for symbol, e in record.scalars.items() if str(symbol) in w.used}
            todo = {key: e for key, e in written.items() if key not in self.defined}
            if not todo:
                return [Paragraph("with"), *found] if found else []
            for (kind, name), e in todo.items():
                self.defined.add((kind, name))
                found.append(Equation(self.line(self._letter(kind, name), e)))

    def symbols(self) -> list[list[str]]:
        kinds = [*_BASES, "E"]
        ordered = sorted(self.writer.bases, key=lambda b: (kinds.index(b.kind), b.side))
        return [*map(list, dict.fromkeys(map(self._vector_row, ordered))), *super().symbols()]

    def _vector_row(self, base: Base) -> tuple[str, ...]:
        if base.kind == "E":
            return (r"$\mathbf{i}_x,\ \mathbf{i}_y,\ \mathbf{i}_z$", "1", "inertial axes")
        meaning, unit = (_TURNED if base.side in self.s.turning.values() else _BASES)[base.kind]
        side = subscript(base.side)
        return (f"${self.writer.plain(base)}$", unit_text(unit), meaning.replace("{side}", side).replace("{what}", self.what))

    # -- values at the random states

    def numbers(self, state: SymbolValues | None = None) -> FormulaValues:
        """Evaluator of the law's formulas at given states, by default those of the page."""
        state = self.state if state is None else state
        return FormulaValues(self.s.record, state.atom, state.symbol)

    def given(self) -> dict[str, Any]:
        state, found = self.state, inertial_axes(self.state.points)
        found |= {letter.latex: (lambda name=name: state.symbol(name)) for name, letter in self.known.items()}
        bases = [Base(kind, side) for side in self.s.record.sides for kind in _BASES]
        return found | {self.writer.plain(base): (lambda base=base: state.atom(base)) for base in bases}

    def compiled(self, outputs: Outputs) -> dict[Any, Any]:
        """Outputs of the compiled kernel (LLVM) at the states, by target."""
        p = plan(self.d, outputs)
        if not p.all_inputs.symbols:
            return {t: np.full(POINTS, float(e)) for t, e in zip(p.targets, p.inserted, strict=True)}
        x = np.stack([self.state.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
        return dict(zip(p.targets, p.kernel.values(x).T, strict=True))

    def at_point(self, side: str, kernel: dict[Any, Any]) -> tuple[Any, Any]:
        """Force and moment about the point of a side (points, 3), inertial, from the compiled rows of its node (moment about
        the centre in body axes)."""
        f, count = self.state.frame(side), self.state.frame(side).kind.translations
        rows = [np.broadcast_to(kernel.get(("u", side, i), 0.0), (POINTS,)) for i in range(count + 3)]
        force = np.stack(rows[:3], -1) if count else np.zeros((POINTS, 3))
        moment = sum(self.state.vector(column) * m[:, None] for column, m in zip(f.body, rows[count:], strict=True))
        return force, moment - np.cross(self.state.vector(f.arm), force)

    @cached_property
    def varied(self) -> SymbolValues:
        """The states after a complex step along a virtual displacement of bodies and coordinates."""
        atom, given = self.state.atom, self.state.given
        motion = {side: (atom(Base("du", side)), atom(Base("dpsi", side))) for side in self.s.record.sides}
        changes = {str(c): given[str(dc)] for c, dc in self.s.virtual.items() if str(c) in given}
        return self.state.changed(1j * STEP, motion, changes)

    @cached_property
    def stated_pairs(self) -> dict[str, Pair]:
        """Force and torque that the law states, and those of its generalised force, by side, on the left-hand side."""
        record, parts = self.s.record, []
        if self.s.wrench is not None:
            force, torque = self.s.wrench
            d = record.single(record.atom("r", "l") - record.atom("r", "k"))
            parts.append({"k": (force, torque + d.cross(force)), "l": (-force, -torque)})
        if self.s.thrust is not None:
            along, push = self.s.thrust
            parts.append(times(self.s.gradient(along)[0], -push))
        return summed(record, parts)

    @cached_property
    def stated_partials(self) -> dict[Expr, Expr]:
        """Terms of the law's generalised force in the equations of the coordinates that are unknowns, left-hand side."""
        zero = dict.fromkeys(self.s.coordinates.values(), se.Integer(0))
        if self.s.thrust is None:
            return zero
        along, push = self.s.thrust
        return zero | {symbol: -push * p for symbol, p in self.s.gradient(along)[1].items()}

    def totals(self) -> dict[str, Pair]:
        """G^T lambda: force and moment on the bodies, at their points, by side."""
        gradients = ((row, pairs) for row, (pairs, _) in self.s.gradients.items() if row in self.d.rows)
        return summed(self.s.record, [times(pairs, se.Symbol(f"lambda_{row}")) for row, pairs in gradients])

    def all_pairs(self) -> dict[str, Pair]:
        """Forces and moments on the bodies at their points, signed as on the left-hand side."""
        parts = [self.totals(), self.stated_pairs]
        if isinstance(self.s.law, Force):
            parts += [self.s.gradient(self.s.energy)[0], self.s.drag[0]]
        return summed(self.s.record, parts)

    def letters(self, mark: str = "") -> list[tuple[str, str, int]]:
        """Letters of the force (0) and moment (1) of every frame that moves: (LaTeX, side, 0 or 1); a free rotation has a moment
        only. mark: LaTeX after the letter."""
        sides = [side for side in self.s.record.sides if side not in self.s.still]
        return [(rf"\mathbf{{{letter}}}{mark}_{subscript(side)}", side, i) for side in sides
                for i, letter in enumerate("fm") if i or side in self.s.sides]

    def by_parameters(self, parts: Sequence[Shown], own: str = "") -> list[Section]:
        """Section with the derivatives of forces, moments and generalised forces by the parameters of the law, at the same motion
        and multipliers; none where none depends on one. own: with what the names of the parameters begin."""
        lines, without, timed = list[str](), list[str](), self.s.structure.timed
        for name, letter in self.known.items():
            if name not in self.d.law.params or name not in self.state.given or name in timed or not name.startswith(own):
                continue
            by, changed = self.changing(name, letter.latex), self.state.changed(1j * STEP, {}, {name: 1.0})
            changes = [(part, by.vector(part.formula) if isinstance(part.formula, Vector) else by.scalar(part.formula))
                       for part in parts]
            found = [(part, e) for part, e in changes if (e.terms if isinstance(e, Vector) else e != 0)]
            for part, e in found:
                share = (f"({part.unit})/({letter.unit})" if " or " in part.unit + letter.unit else
                         str(unit(part.unit) / unit(letter.unit)))
                lines.append(self.line(rf"\frac{{\partial {part.latex}}}{{\partial {letter.latex}}}", e,
                                       np.imag(part.values(changed)) / STEP, COMPLEX, share))
            without += [] if found else [f"${letter.latex}$"]
        held = ["motion"] + ["multipliers"] * bool(self.d.rows) + ["internal states"] * bool(self.d.states)
        text = f"At the same {together(held)}; what {'these add' if held[1:] else 'it adds'} in a run has `r.sensitivity(...)`."
        text += f" No force depends on {', '.join(without)}." if without else ""
        return [self.section("Derivatives by the parameters", text, *lines)] if lines else []

    def changing(self, name: str, latex: str) -> ForwardDerivative:
        """The derivative by a parameter, at fixed frames."""
        return ForwardDerivative(self.s.record, lambda _: None, {se.Symbol(name): se.Integer(1)}, rf"\partial_{{{latex}}}",
                                 lettered=True)

    def effort_at(self, state: SymbolValues, name: str) -> Any:
        """What the derived law adds to the left-hand side of the equation of a coordinate, at states."""
        place = "u", self.s.places[name], 0
        return next((state.scalar(e) for target, e in dynamics(self.d) if target == place), np.zeros(POINTS))

    def balance(self, pairs: dict[str, Pair], must: bool = False) -> tuple[list[Block], bool]:
        """Equations for the sums of the forces and of the moments about the point of the first body, and whether both sums vanish
        at all states. must: print both as zero whatever their values; the check of the printed equations compares these."""
        record, w, (first, *others) = self.s.record, self.writer, self.s.sides
        force, moment = record.zero(), pairs[first][1]
        turning = rf"\mathbf{{m}}_{subscript(first)}"
        for side in others:
            d = record.single(record.atom("r", side) - record.atom("r", first))
            moment = moment + pairs[side][1]
            moment = sum((d.cross(Vector(record, {a: c})) for a, c in pairs[side][0].terms.items()), moment)
            turning += rf" + \mathbf{{m}}_{subscript(side)}"
            turning += rf" + {w.vector(d)}\times\mathbf{{f}}_{subscript(side)}" if pairs[side][0].terms else ""
        n = self.numbers()
        force = sum((pairs[side][0] for side in self.s.sides), force)
        force, moment = (record.zero() if must else settled(a, n) for a in (force, moment))
        total = " + ".join(rf"\mathbf{{f}}_{subscript(i)}" for i in self.s.sides)
        self.wanted |= dict.fromkeys((total, turning), BOTH)
        lines = self.lines(f"{total} = {w.vector(force)}", f"{turning} = {w.vector(moment)}")
        return lines, not (force.terms or moment.terms)

    def covector(self, state: SymbolValues, side: str, weights: list[Expr] | None = None) -> tuple[Any, Any]:
        """G^T lambda of a frame by the derived law: force, and moment about its point (points, 3). weights: instead of lambda."""
        force, moment = (state.vector(part) for part in weighted(self.d, weights or self.d.multipliers, side))
        return force, moment - np.cross(state.vector(state.frame(side).arm), force)


def inertial_axes(points: int) -> dict[str, Any]:
    """Values (points, 3) of the inertial axes by their LaTeX."""
    return {rf"\mathbf{{i}}_{a}": np.broadcast_to(e, (points, 3)) for a, e in zip("xyz", np.eye(3), strict=True)}


def settled(a: Vector, n: Any) -> Vector:
    """The vector, or a zero vector where its value vanishes at all states."""
    return a if a.terms and float(np.max(np.abs(n.vector(a)))) > 1e-12 else a.record.zero()


def planar_of(s: ReportedLaw) -> Derived | None:
    """The law in the plane; None where it has no planar form."""
    try:
        return derived(s.cls, s.structure, planar=True)
    except LawError:
        return None
