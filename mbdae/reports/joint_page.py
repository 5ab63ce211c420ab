"""Report of a law stated by constraint rows: forces, rates and geometric stiffness derived from them, each line read back."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.errors import LawError
from mbdae.notation import counted
from mbdae.reports.law_page import LawPage, Shown
from mbdae.reports.letters import effort_unit
from mbdae.reports.page import BOTH, DERIVED, KERNEL, MOVED, below, described, document, effort, provenance
from mbdae.reports.recursive_page import RecursivePage, matrix, origin, recursive_pages
from mbdae.reports.sections import (
    coordinates_section,
    figure_of,
    other_statements,
    planar_pages,
    plus,
    resistance_section,
    solution_set,
    title_of_joint,
)
from mbdae.reports.statement import ReportedLaw
from mbdae.reports.states import STEP, SymbolValues
from mbdae.reports.vectors import Base
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.outputs import acceleration, dynamics, position, velocity
from mbdae.symbolic.vectors import Expr

FRAMES = ("The axes $\\mathbf{x}_k, \\mathbf{y}_k, \\mathbf{z}_k$ are fixed to body k, $\\mathbf{x}_l, \\mathbf{y}_l,"
          " \\mathbf{z}_l$ to body l; they are right-handed and coincide as drawn.")
COORDINATES = "Coordinates are those of l relative to k, 0 as drawn."
FIXED = ("A vector $\\mathbf{a}$ fixed to a body changes by $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}"
         "\\times\\mathbf{a}$.")
SIDE = (
    "The equations of motion read $\\mathbf{M}\\dot{\\mathbf{u}} + \\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda} + \\ldots ="
    " \\mathbf{0}$: forces listed here stand on the left-hand side, what acts on a body is the opposite."
)
ABOUT_EFFORTS = "$h$ are the factors of the virtual changes of the coordinates: on the joints of these acts the opposite."
RULE = "every vector fixed to a body changes by $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$"
REGROUPED = (
    "$\\mathbf{a}\\cdot(\\mathbf{b}\\times\\mathbf{c}) = \\mathbf{b}\\cdot(\\mathbf{c}\\times\\mathbf{a})$, sorted by virtual"
    " displacements"
)
ABOUT_FORCES = (
    "$\\mathbf{f}$ and $\\mathbf{m}$ are the factors of the virtual displacements of the joint's points and of the"
    " virtual rotations. About the centre of a body the force is the same and the moment is"
    " $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$. They stand on the left-hand side of the equations of motion: the joint acts"
    " on body l with $-\\mathbf{f}_l$ and $-\\mathbf{m}_l$, the reactions in its sensors `force` and `torque`."
)


class JointReport(LawPage):
    """The report of one joint law: its rows, and the forces, rates and stiffness derived from them."""

    def __init__(self, law: type[Law], structure: Structure) -> None:
        statement = ReportedLaw(law, structure)
        if not statement.rows and not statement.speeds and not statement.law.own_coordinates:
            raise LawError(f"{law.__name__} states no rows, so that there is nothing to report: return some from `constraints`")
        _ = statement.branches
        super().__init__(statement)
        _ = statement.gradients
        self.kernel = self.compiled(report_outputs)
        if not statement.rows and not statement.speeds:
            return
        self._want_rows()
        for letter, side, i in self.letters():
            self.want(letter, self.covector(self.state, side)[i], DERIVED)
            self.want(rf"\delta{letter}", np.imag(self.covector(self.varied, side)[i]) / STEP, MOVED)
        for name in statement.coordinates:
            rows = [self.varied.scalar(self.d.G[i][self.s.places[name]][0][0] * m) for i, m in enumerate(self.d.multipliers)]
            self.want(rf"\delta {effort(name)}", np.imag(sum(rows)) / STEP, MOVED, effort_unit(self.known[name].unit))
        want_efforts(self)

    # -- required values of the equations

    def _want_rows(self) -> None:
        for row in (row for row in self.s.rows | self.s.speeds if row not in self.d.rows):
            raise LawError(f"{self.s.cls.__name__}: the row '{row}' is 0 between bodies in space, wherever they are: "
                           f"correct it, or leave it out of `constraints`")
        work: Any = 0.0
        for i, row in enumerate(self.d.rows):
            by_rates = row in self.d.by_rates
            unit = self.unit(self.s.speeds[row], "s") if by_rates else self.unit(self.s.rows[row])
            for head, letter, per in (("g", "c", ""), ("gd", r"\dot c", "/s"), ("gdd", r"\gamma", "/s^2"))[by_rates:]:
                self.want(f"{letter}_{below(row)}", self.kernel.get((head, i), 0.0), KERNEL, unit + per)
            change = self._allowed(i) if by_rates else np.imag(self.varied.scalar(self.d.g[i])) / STEP
            self.want(rf"\delta c_{below(row)}", change, DERIVED if by_rates else MOVED, unit)
            work = work + self.state.given[f"lambda_{row}"] * change
        self.want(r"\delta W", work, MOVED)
        stated = self.d.law.positives(*self.d.sides)
        for i, (name, e) in enumerate(self.s.branches.items()):
            self.want(f"b_{{{i + 1}}}", self.state.scalar(self.d.variation.name(stated[name])), DERIVED, self.unit(e))

    def _allowed(self, i: int) -> Any:
        """Values of row i of the derived Jacobian times the virtual displacements."""
        weights: list[Expr] = [se.Integer(int(k == i)) for k in range(len(self.d.rows))]
        total = sum((self.state.scalar(self.d.G[i][self.s.places[name]][0][0]) * self.state.given[str(self.s.virtual[c])]
                     for name, c in self.s.coordinates.items()), np.zeros(1))
        for side in (side for side in self.s.record.sides if side not in self.s.still):
            for part, kind in zip(self.covector(self.state, side, weights), ("du", "dpsi"), strict=True):
                total = total + np.einsum("pi,pi->p", *np.broadcast_arrays(part, self.state.atom(Base(kind, side))))
        return total

    # -- sections of the report

    def document(self) -> Document:
        """The whole report."""
        sections = [*coordinates_section(self), self._constraint()]
        if self.s.rows or self.s.speeds:
            sections += [*self._solutions(), self._variation(), self._forces(), *self._balances(), *self._by_parameters(),
                         self._rates(), self._stiffness()]
        sections += resistance_section(self)
        planar, none, flat = planar_pages(self)
        further: list[tuple[Any, list[Block]]] = [*flat]
        if not self.s.speeds:
            further += recursive_pages(self.s, self.taken.union(*(page.taken for page, _ in flat)))
        head: list[Block] = [*described(self.s.cls), *figure_of(self.s), *other_statements(self.s)]
        pages: list[tuple[Any, list[Block]]] = [(self, [*sections, *none]), *further]
        trees = [page for page, _ in pages if isinstance(page, RecursivePage)]
        tail: list[Block] = [provenance(self.d, planar), *([origin(trees)] if trees else [])]
        convention = f"{FRAMES} {COORDINATES} {FIXED} {SIDE}" if self.s.sides else SIDE  # a coupling of coordinates has no frames
        return document(title_of_joint(self.s), head, pages, convention, tail)

    def _solutions(self) -> list[Section]:
        return [Section("Solution set and branches", solution_set(self))] if self.s.sides and self.s.rows else []

    def _constraint(self) -> Section:
        if not self.s.rows and not self.s.speeds:
            return Section("Constraint", [Paragraph("No row must vanish: the joint holds nothing.")])
        rows = [self.line(f"c_{below(name)}", e) + " = 0" for name, e in self.s.rows.items()]
        speeds = [self.line(rf"\dot c_{below(name)}", e) + " = 0" for name, e in self.s.speeds.items()]
        self.writer.used |= {f"lambda_{name}" for name in (*self.s.rows, *self.s.speeds)}
        blocks = self.told(f"{counted(len(rows), 'row')} must vanish.", *rows) if rows else []
        blocks += self.told(f"{counted(len(speeds), 'row')} of velocities must vanish, linear in these, no derivative of a row "
                            f"of positions.", *speeds) if speeds else []
        found = Section("Constraint", blocks)
        text = ("With a scaling $s$ and a penalty $p$ (both left out below) the potential of a row is"
                " $s\\,\\lambda\\,c + p\\,c^2$: its force $\\lambda$ becomes $s\\,\\lambda + 2\\,p\\,c$ everywhere in this"
                " report.")
        augmented = {"scaling", "penalty"} <= set(self.s.cls.params)
        return Section(found.title, [*found.blocks, *([Paragraph(text)] if augmented else [])])

    def _variation(self) -> Section:
        """delta c by the rule delta a = delta psi x a, then regrouped by virtual displacements."""
        rule, blocks = self.s.variation, list[Block]()
        changes = {name: rule.scalar(e) for name, e in self.s.rows.items()}
        for i, (name, change) in enumerate(changes.items()):
            rule_, regrouped = (RULE, REGROUPED) if i == 0 and self.s.sides else ("", "")
            named = self.lines(rf"\delta c_{below(name)} = {self.writer.scalar(change)}", note=rule_)
            sorted_ = [Equation(f"= {self._sorted(name)}", note=regrouped)] if self.s.sides else []
            blocks += [named[0], *sorted_, *named[1:], *self.definitions()]
        if self.s.speeds:
            lines = (rf"\delta c_{below(name)} = {self._sorted(name)}" for name in self.s.speeds)
            blocks += self.told("Virtual displacements satisfy the rows of velocities as velocities do, without the terms that "
                                "contain none:", *lines)
        work = " + ".join(rf"\lambda_{below(name)}\,\delta c_{below(name)}" for name in self.s.gradients)
        return Section("Variation", [*blocks, *self.told("The virtual work of the rows:", rf"\delta W = {work}")])

    def _sorted(self, row: str) -> str:
        """The variation of a row, with terms grouped by virtual displacement."""
        w, (pairs, partial) = self.writer, self.s.gradients[row]
        terms = []
        for side in self.s.record.sides:
            for kind, part in zip(("du", "dpsi"), pairs[side], strict=True):
                sign, text = w.signed(part)
                terms += [rf"{sign}{w.atom(Base(kind, side))}\cdot {text}"] if part.terms else []
        for symbol, p in partial.items():
            terms += [rf"{w.scalar(self.s.virtual[symbol])}\,{w.factor(p, 2)}"] if p != 0 else []
        return summed(terms)

    def _forces(self) -> Section:
        """Generalised forces on bodies and coordinates: the factors of the virtual displacements."""
        w, totals, virtual = self.writer, self.totals(), self.s.virtual
        work = [rf"{letter}\cdot {w.atom(Base('dpsi' if i else 'du', side))}" for letter, side, i in self.letters()]
        work += [rf"{effort(name)}\,{w.scalar(virtual[symbol])}" for name, symbol in self.s.coordinates.items()]
        lines = [self.line(letter, totals[side][i]) for letter, side, i in self.letters()]
        lines += [self.line(effort(name), e) for name, e in self._efforts().items()]
        text = ABOUT_FORCES if self.s.sides else ABOUT_EFFORTS
        if self.s.coordinates and self.s.sides:
            text += " The equation of a massless coordinate is $h = 0$ with springs, dampers and loads added."
        if self.s.turning:
            text += " The equation of a massless free rotation: its moment vanishes."
        first = [Equation(rf"\delta W = {' + '.join(work)}")] if self.s.thrust is None or not self.s.coordinates else []
        return Section("Generalised forces", [Paragraph(text), *first, *self.lines(*lines)])

    def _by_parameters(self) -> list[Section]:
        """Derivatives of the forces and moments on the bodies by the parameters of the joint."""
        totals = self.totals()

        def pair(state: SymbolValues, side: str, i: int) -> Any:
            return self.covector(state, side)[i]

        parts = [Shown(letter, "N m" if i else "N", totals[side][i], functools.partial(pair, side=side, i=i))
                 for letter, side, i in self.letters()]
        return self.by_parameters([*parts, *(Shown(effort(name), effort_unit(self.known[name].unit), e,
                                                   functools.partial(self.effort_at, name=name))
                                             for name, e in self._efforts().items())])

    def _efforts(self) -> dict[str, Expr]:
        """Generalised forces on the coordinates, by name."""
        found = dict[str, Expr]()
        for name, symbol in self.s.coordinates.items():
            found[name] = self._by_rows(symbol) + self.stated_partials[symbol]
        return found

    def _by_rows(self, symbol: Expr) -> Expr:
        """What the rows add to the equation of a coordinate."""
        return sum((se.Symbol(f"lambda_{row}") * p[symbol] for row, (_, p) in self.s.gradients.items()), se.Integer(0))

    def _balances(self) -> list[Section]:
        if not self.s.sides:
            return []
        lines, vanishes = self.balance(self.totals())
        text = ("at every attitude, whether the constraint is satisfied or not." if vanishes else
                "where the constraint is satisfied: rows along inertial axes do not turn with the bodies.")
        return [Section("Balance of forces and moments", [*lines, Paragraph(f"Both sums vanish {text}")])]

    def _rates(self) -> Section:
        """The Jacobian as a matrix; first and second time derivative of the rows, the latter without accelerations."""
        rate = self.s.motion
        rates = {row: rate.scalar(e) for row, e in self.s.rows.items()}
        second = {row: rate.scalar(e) for row, e in (rates | self.s.speeds).items()}
        text = ("The factors of the virtual displacements in the variation are the rows of the Jacobian $\\mathbf{G}$; rows"
                " as in the constraint, columns as in the velocities beside it:")
        lacks = "no acceleration of a centre and no angular acceleration" if self.s.sides else "no second rate of a coordinate"
        bias = f"$\\ddot c = \\mathbf{{G}}\\dot{{\\mathbf{{u}}}} + \\gamma$, where $\\gamma$ contains {lacks}:"
        blocks = [Paragraph(text), *self._jacobian()]
        if rates:
            blocks += self.told("The same rates by the motion of the bodies:",
                                *(self.line(rf"\dot c_{below(row)}", e) for row, e in rates.items()))
        blocks += self.told(bias, *(self.line(rf"\gamma_{below(row)}", e) for row, e in second.items()))
        return Section("Jacobian, rate and acceleration", blocks)

    def _jacobian(self) -> list[Block]:
        """G as a matrix, and the rates of the rows as its product with the velocities."""
        w, of_time = self.writer, self.s.of_time()
        sides = [side for side in self.s.record.sides if side not in self.s.still]
        columns = [(side, i) for side in sides for i in (0, 1) if i or side in self.s.sides]
        rows = []
        for pairs, partial in self.s.gradients.values():
            cells = ["".join(w.signed(pairs[side][i])) + r"^{\mathsf{T}}" for side, i in columns]
            rows.append(" & ".join([*cells, *(w.scalar(partial[c]) for c in self.s.coordinates.values())]))
        speeds = [w.atom(Base("w" if i else "v", side)) for side, i in columns]
        speeds += [w.scalar(self.s.clock[c]) for c in self.s.coordinates.values()]
        timed = [w.scalar(of_time.scalar(e)) for e in self.s.rows.values()] + [w.scalar(e) for e in self.s.prescribed.values()]
        rates = matrix([rf"\dot c_{below(row)}" for row in self.s.gradients])
        self.wanted.setdefault(rates, BOTH)
        product = f"{rates} = \\mathbf{{G}}\\,{matrix(speeds)}"
        product += plus(matrix(timed)) if any(text != "0" for text in timed) else ""
        return self.lines(rf"\mathbf{{G}} = {matrix(rows)}", product)

    def _stiffness(self) -> Section:
        totals, rule = self.totals(), self.s.variation
        changes = {letter: rule.vector(totals[side][i]) for letter, side, i in self.letters()}
        text = ("Change of the forces in a virtual displacement at constant multipliers,"
                " $\\delta(\\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda})$:")
        lines = [self.line(rf"\delta{letter}", change) for letter, change in changes.items()]
        lines += [self.line(rf"\delta {effort(name)}", rule.scalar(self._by_rows(symbol)))
                  for name, symbol in self.s.coordinates.items()]
        return self.section("Geometric stiffness", text, *lines)


def summed(terms: list[str]) -> str:
    """Terms with their signs as a sum."""
    return (terms[0] + "".join(f" - {t[1:]}" if t.startswith("-") else f" + {t}" for t in terms[1:])) if terms else "0"


def want_efforts(page: Any) -> None:
    """Require that the law's terms in the equations of the coordinates equal those of its compiled kernel."""
    for name in page.s.coordinates:
        values = page.kernel.get(("u", page.s.places[name], 0), 0.0)
        page.want(effort(name), values, KERNEL, effort_unit(page.known[name].unit))


def report_outputs(d: Derived) -> list[tuple[Any, Expr]]:
    """Terms of a joint in the equations: rows, their first and second rates, forces."""
    return [*position(d), *velocity(d), *acceleration(d), *dynamics(d)]
