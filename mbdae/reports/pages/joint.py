"""Report of a law stated by constraints: from the rows to forces, rates and geometric stiffness, each line read back."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.documents.document import Document
from mbdae.errors import LawError
from mbdae.reports.common import LawFormulas, described, provenance, row_name
from mbdae.reports.page import BOTH, DERIVED, KERNEL, MOVED, LawPage, document, planar_of, told
from mbdae.reports.pages.branches import solution_set
from mbdae.reports.pages.coordinates import coordinates_section, other_statements, title_of_joint
from mbdae.reports.pages.figure import figure_of
from mbdae.reports.pages.plane import plane_section
from mbdae.reports.pages.recursive import RecursivePage, origin, recursive_pages
from mbdae.reports.pages.resistance import resistance_section
from mbdae.reports.statement import Statement
from mbdae.reports.states import STEP, random_state
from mbdae.reports.vectors import Base
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.outputs import acceleration, dynamics, position, velocity
from mbdae.symbolic.vectors import Expr

CONVENTION = (
    "The axes $\\mathbf{x}_k, \\mathbf{y}_k, \\mathbf{z}_k$ are fixed to body k, $\\mathbf{x}_l, \\mathbf{y}_l,"
    " \\mathbf{z}_l$ to body l; they are right-handed and coincide as drawn. Coordinates are those of l relative to k, 0 as"
    " drawn. A vector $\\mathbf{a}$ fixed to a body changes by"
    " $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$. The equations of motion read"
    " $\\mathbf{M}\\dot{\\mathbf{u}} + \\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda} + \\ldots ="
    " \\mathbf{0}$: forces listed here stand on the left-hand side, what acts on a body is the opposite."
)
RULE = "every vector fixed to a body changes by $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$"
REGROUPED = (
    "$\\mathbf{a}\\cdot(\\mathbf{b}\\times\\mathbf{c}) = \\mathbf{b}\\cdot(\\mathbf{c}\\times\\mathbf{a})$, sorted by virtual"
    " displacements"
)


class JointReport(LawPage):
    """The report of one joint law: its rows, and forces, rates and stiffness that follow from them."""

    def __init__(self, law: type[Law], structure: Structure) -> None:
        self.s = Statement(law, structure)
        _ = self.s.rows, self.s.branches
        self.formulas, self.d = LawFormulas(self.s), self.s.derived
        self.state, self.wanted = random_state(self.d), {}
        self.duals = self.s.gradients
        self.weights = {row: se.Symbol(f"lambda_{row}") for row in self.s.rows}
        self.kernel = self.compiled(report_outputs)
        self._want_rows()
        self._want_forces()

    # -- what the equations must be

    def _want_rows(self) -> None:
        missing = [row for row in self.s.rows if row not in self.d.rows]
        if missing:
            raise LawError(f"row '{missing[0]}' vanishes in space: state it where it does not")
        for i, row in enumerate(self.d.rows):
            for head, letter in (("g", "c"), ("gd", r"\dot c"), ("gdd", r"\gamma")):
                self.want(f"{letter}_{below(row)}", self.kernel.get((head, i), 0.0), KERNEL)
            change = np.imag(self.varied.scalar(self.d.g[i])) / STEP
            self.want(rf"\delta c_{below(row)}", change, MOVED)
        given, rows = self.state.given, self.d.rows
        work = sum((given[f"lambda_{row}"] * self.wanted[rf"\delta c_{below(row)}"].values for row in rows), 0.0)
        self.want(r"\delta W", work, MOVED)
        stated = self.d.law.positives(*self.d.sides)
        for i, name in enumerate(self.s.branches):
            self.want(f"b_{{{i + 1}}}", self.state.scalar(self.d.variation.name(stated[name])), DERIVED)

    def _want_forces(self) -> None:
        for letter, side, i in self.letters():
            self.want(letter, self.covector(self.state, side)[i], DERIVED)
            self.want(rf"\delta{letter}", np.imag(self.covector(self.varied, side)[i]) / STEP, MOVED)
        for name in self.s.coordinates:
            self.want(effort(name), self.kernel.get(("u", self.s.places[name], 0), 0.0), KERNEL)

    # -- sections

    def document(self) -> Document:
        """The whole report."""
        stated = coordinates_section(self)
        sections = [*([stated] if stated else []), self.constraint()]
        if self.s.rows:
            sections += [*self.solutions(), self.variation(), self.forces(), *self.balances(), self.rates(), self.stiffness()]
        resisted = resistance_section(self)
        sections += [resisted] if resisted else []
        planar = planar_of(self.s)
        sections += [] if planar else [Section("Planar form", [Paragraph("The law has no planar form.")])]
        flat = plane_section(self, planar)
        further = [*flat, *recursive_pages(self.s, self.formulas.taken.union(*(page.formulas.taken for page, _ in flat)))]
        head: list[Block] = [*described(self.s.cls), *figure_of(self.s), *other_statements(self.s)]
        pages: list[tuple[Any, list[Block]]] = [(self, list(sections)), *further]
        trees = [page for page, _ in pages if isinstance(page, RecursivePage)]
        tail: list[Block] = [provenance(self.d, planar), *([origin(trees)] if trees else [])]
        return document(title_of_joint(self.s), head, pages, CONVENTION, tail)

    def solutions(self) -> list[Section]:
        """The solution set of the rows."""
        return [Section("Solution set and branches", solution_set(self))] if self.s.sides else []

    def constraint(self) -> Section:
        """The rows."""
        if not self.s.rows:
            return Section("Constraint", [Paragraph("No row must vanish: the joint holds nothing.")])
        w = self.formulas.writer
        rows = [f"c_{below(name)} = {w.scalar(e)} = 0" for name, e in self.s.rows.items()]
        w.used |= {f"lambda_{name}" for name in self.s.rows}
        count = f"{len(self.s.rows)} {'row' if len(self.s.rows) == 1 else 'rows'} must vanish."
        return Section("Constraint", [Paragraph(count), *self.formulas.lines(*rows), *self._augmented()])

    def _augmented(self) -> list[Block]:
        if not {"scaling", "penalty"} <= set(self.s.cls.params):
            return []
        text = (
            "With a scaling $s$ and a penalty $p$ (both left out below) the potential of a row is $s\\,\\lambda\\,c + p\\,c^2$: "
            "its force $\\lambda$ becomes $s\\,\\lambda + 2\\,p\\,c$ everywhere in this report."
        )
        return [Paragraph(text)]

    def variation(self) -> Section:
        """delta c by the rule, then its triple products regrouped: what multiplies each virtual displacement."""
        rule, blocks = self.s.variation, list[Block]()
        changes = {name: rule.scalar(e) for name, e in self.s.rows.items()}
        for i, (name, change) in enumerate(changes.items()):
            first = rf"\delta c_{below(name)} = {self.formulas.writer.scalar(change)}"
            named = self.formulas.lines(first, note=RULE if i == 0 else "")
            sorted_ = f"= {self._sorted(name)}"
            blocks += [named[0], Equation(sorted_, note=REGROUPED if i == 0 else ""), *named[1:], *self.formulas.definitions()]
        work = " + ".join(rf"\lambda_{below(name)}\,\delta c_{below(name)}" for name in self.s.rows)
        return Section("Variation", [*blocks, *told("The virtual work of the rows:", rf"\delta W = {work}")])

    def _sorted(self, row: str) -> str:
        """The variation of a row, sorted by virtual displacements."""
        w, (pairs, partial) = self.formulas.writer, self.duals[row]
        terms = []
        for side in self.s.record.sides:
            for kind, part in zip(("du", "dpsi"), pairs[side], strict=True):
                sign, text = w.signed(part)
                terms += [rf"{sign}{w.atom(Base(kind, side))}\cdot {text}"] if part.terms else []
        for symbol, p in partial.items():
            terms += [rf"{w.scalar(self.s.virtual[symbol])}\,{w.factor(p, 2)}"] if p != 0 else []
        return summed(terms)

    def efforts(self) -> dict[str, Expr]:
        """Generalised forces of the rows, and of what the law states, on the coordinates that are unknowns."""
        sums = {symbol: sum((self.weights[row] * p[symbol] for row, (_, p) in self.duals.items()), se.Integer(0))
                for symbol in self.s.coordinates.values()}  # fmt: skip
        return {name: sums[symbol] + self.stated_partials[symbol] for name, symbol in self.s.coordinates.items()}

    def forces(self) -> Section:
        """The generalised forces on the bodies and coordinates, from the factors of the virtual displacements."""
        w, totals = self.formulas.writer, self.totals()
        work = [rf"{letter}\cdot {w.atom(Base('dpsi' if i else 'du', side))}" for letter, side, i in self.letters()]
        work += [rf"{effort(name)}\,{w.scalar(change)}" for name, change in self.changes.items()]
        lines = [f"{letter} = {w.vector(totals[side][i])}" for letter, side, i in self.letters()]
        lines += [f"{effort(name)} = {w.scalar(e)}" for name, e in self.efforts().items()]
        resisted = self.s.thrust is not None and self.s.coordinates
        text = (
            "$\\mathbf{f}$ and $\\mathbf{m}$ are the factors of the virtual displacements of the joint's points and of the"
            " virtual rotations. About the centre of a body the force is the same and the moment is"
            " $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$."
        )
        if self.s.coordinates:
            text += " The equation of a massless coordinate is $h = 0$ with springs, dampers and loads added."
        if self.s.turning:
            text += " The equation of a massless free rotation: its moment vanishes."
        first = [Equation(rf"\delta W = {' + '.join(work)}")] if not resisted else []
        return Section("Generalised forces", [Paragraph(text), *first, *self.formulas.lines(*lines)])

    def balances(self) -> list[Section]:
        """Sum of forces and moments."""
        if not self.s.sides:
            return []
        lines, vanishes = self.balance(self.totals())
        text = ("at every attitude, whether the constraint is satisfied or not." if vanishes else
                "where the constraint is satisfied: rows along inertial axes do not turn with the bodies.")  # fmt: skip
        return [Section("Balance of forces and moments", [*lines, Paragraph(f"Both sums vanish {text}")])]

    def rates(self) -> Section:
        """The Jacobian as a matrix; first and second time derivative of the rows, the latter without accelerations."""
        rate, w = self.s.motion, self.formulas.writer
        rates = {row: rate.scalar(e) for row, e in self.s.rows.items()}
        second = {row: rate.scalar(e) for row, e in rates.items()}
        blocks: list[Block] = [
            Paragraph("The factors of the virtual displacements in the variation are the rows of the Jacobian $\\mathbf{G}$; rows"
                      " as in the constraint, columns as in the velocities beside it:"),
            *self._jacobian(),
            Paragraph("The same rates by the motion of the bodies:"),
            *self.formulas.lines(*(rf"\dot c_{below(row)} = {w.scalar(e)}" for row, e in rates.items())),
            Paragraph(
                "$\\ddot c = \\mathbf{G}\\dot{\\mathbf{u}} + \\gamma$, where $\\gamma$ contains no acceleration of a centre and"
                " no angular acceleration:"
            ),
            *self.formulas.lines(*(rf"\gamma_{below(row)} = {w.scalar(e)}" for row, e in second.items())),
        ]  # fmt: skip
        return Section("Jacobian, rate and acceleration", blocks)

    def _jacobian(self) -> list[Block]:
        """G as a matrix, and the rates as its product with the velocities."""
        w, of_time = self.formulas.writer, self.s.of_time()
        sides = [side for side in self.s.record.sides if side not in self.s.still]
        columns = [(side, i) for side in sides for i in (0, 1) if i or side in self.s.sides]
        rows = []
        for row in self.s.rows:
            pairs, partial = self.duals[row]
            cells = ["".join(w.signed(pairs[side][i])) + r"^{\mathsf{T}}" for side, i in columns]
            rows.append(" & ".join([*cells, *(w.scalar(partial[c]) for c in self.s.coordinates.values())]))
        speeds = [w.atom(Base("w" if i else "v", side)) for side, i in columns]
        speeds += [w.scalar(self.s.clock[c]) for c in self.s.coordinates.values()]
        timed = [w.scalar(of_time.scalar(e)) for e in self.s.rows.values()]
        rates = matrix([rf"\dot c_{below(row)}" for row in self.s.rows])
        self.wanted.setdefault(rates, BOTH)
        product = f"{rates} = \\mathbf{{G}}\\,{matrix(speeds)}"
        product += f" + {matrix(timed)}" if any(text != "0" for text in timed) else ""
        return self.formulas.lines(rf"\mathbf{{G}} = {matrix(rows)}", product)

    def stiffness(self) -> Section:
        """Change of the forces in a virtual displacement at constant multipliers."""
        rule, totals, w = self.s.variation, self.totals(), self.formulas.writer
        changes = {letter: rule.vector(totals[side][i]) for letter, side, i in self.letters()}
        lines = [rf"\delta{letter} = {w.vector(change)}" for letter, change in changes.items()]
        text = ("Change of the forces in a virtual displacement at constant multipliers,"
                " $\\delta(\\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda})$:")  # fmt: skip
        return Section("Geometric stiffness", [Paragraph(text), *self.formulas.lines(*lines)])


def matrix(rows: list[str]) -> str:
    """A matrix, its rows as cells between ampersands."""
    if len(rows) == 1 and "&" not in rows[0]:
        return rows[0]
    inside = r" \\ ".join(rows)
    return rf"\begin{{bmatrix}} {inside} \end{{bmatrix}}"


def summed(terms: list[str]) -> str:
    """Terms with their signs as a sum."""
    return (terms[0] + "".join(f" - {t[1:]}" if t.startswith("-") else f" + {t}" for t in terms[1:])) if terms else "0"


def below(row: str) -> str:
    """The name of a row as a subscript."""
    return f"{{\\text{{{row_name(row)}}}}}"


def effort(name: str) -> str:
    """The letter of the generalised force of the rows on a coordinate."""
    return f"h_{below(name)}"


def report_outputs(d: Derived) -> list[tuple[Any, Expr]]:
    """What a joint contributes to the equations: rows, their first and second rates, forces."""
    return [*position(d), *velocity(d), *acceleration(d), *dynamics(d)]


def joint_report(law: type[Law], structure: Structure) -> Document:
    """The report of a joint, or of a coupling of the coordinates of joints."""
    return JointReport(law, structure).document()
