"""Report of a law stated by constraints: from the rows to forces, rates and geometric stiffness, each step checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.reports.branches import solution_set
from mbdae.reports.calculus import Motion
from mbdae.reports.common import checks_table, described, joined, provenance, row_name
from mbdae.reports.coordinates import coordinates_section, other_statements, title_of_joint
from mbdae.reports.joint_checks import JointChecks, planar_of
from mbdae.reports.letters import multiplier
from mbdae.reports.recursive import recursive_sections
from mbdae.reports.resistance import resistance_section
from mbdae.reports.states import POINTS
from mbdae.reports.vectors import Base, Vector
from mbdae.reports.writer import Writer, subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.vectors import Expr

CONVENTION = (
    "The frame $\\mathbf{x}_k, \\mathbf{y}_k, \\mathbf{z}_k$ is fixed to body k, $\\mathbf{x}_l, \\mathbf{y}_l,"
    " \\mathbf{z}_l$ to body l; they are right-handed and coincide as drawn, all components are inertial."
    " Coordinates are those of l relative to k, 0 as drawn. A vector $\\mathbf{a}$ fixed to a body changes by"
    " $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$. Equations of motion read"
    " $\\mathbf{M}\\dot{\\mathbf{u}} + \\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda} + \\ldots - \\mathbf{f} ="
    " \\mathbf{0}$: forces listed beside a virtual"
    " displacement stand on the left-hand side, the force that acts on a body is the opposite."
)


class JointReport(JointChecks):
    """The report of one joint law: its rows, and forces, rates and stiffness that follow from them."""

    # -- sections

    def document(self) -> Document:
        """The whole report."""
        rate = self.s.motion()
        rates = {row: rate.scalar(e) for row, e in self.s.rows.items()}
        stated = coordinates_section(self)
        sections = [*([stated] if stated else []), self.constraint()]
        if self.s.rows:
            sections += [*self.solutions(), self.variation(), self.work(), self.forces()]
            sections += [self.body_frame(), self.balance()] if self.s.sides else []
            sections += [self.rates(rate, rates), self.stiffness()]
        resisted = resistance_section(self)
        sections += [resisted] if resisted else []
        planar = planar_of(self.s)
        sections += recursive_sections(self)
        self.formulas.refresh()
        self.run_checks(rate, rates)
        symbols = Section("Symbols", [self.formulas.symbols(), Paragraph(CONVENTION)])
        checked = Section("Numeric check", checks_table(self.formulas.checks, POINTS))
        head = [*described(self.s.cls), *other_statements(self.s), symbols]
        plane = [self.plane(planar)] if self.s.rows and self.s.sides else []
        return Document(title_of_joint(self.s), [*head, *sections, *plane, checked, provenance(self.d, planar)])

    def solutions(self) -> list[Section]:
        """The solution set of the rows."""
        return [Section("Solution set and branches", solution_set(self))] if self.s.sides else []

    def constraint(self) -> Section:
        """The rows."""
        mark, w = self.formulas.mark(), self.formulas.writer
        rows: list[Block] = [
            Equation(f"c_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)} = 0", i + 1)
            for i, (name, e) in enumerate(self.s.rows.items())
        ]
        multipliers = Table(
            ["row", "multiplier", "unit"],
            [[row_name(name), f"${multiplier(name)}$", self.formulas.known[f"lambda_{name}"].unit] for name in self.s.rows],
        )
        for name in self.s.rows:
            w.used.add(f"lambda_{name}")
        where = self.formulas.explained(mark)
        count = f"{len(self.s.rows)} {'row' if len(self.s.rows) == 1 else 'rows'} must vanish."
        if not rows:
            return Section("Constraint", [Paragraph("No row must vanish: the joint holds nothing.")])
        return Section("Constraint", [Paragraph(count), *rows, *where, multipliers, *self._augmented()])

    def _augmented(self) -> list[Block]:
        if not {"scaling", "penalty"} <= set(self.s.cls.params):
            return []
        text = (
            "With a scaling $s$ and a penalty $p$ (both left out below) the potential of a row is $s\\,\\lambda\\,c + p\\,c^2$: "
            "its force $\\lambda$ becomes $s\\,\\lambda + 2\\,p\\,c$ everywhere in this report."
        )
        return [Paragraph(text)]

    def variation(self) -> Section:
        """delta c by the rule."""
        rule, lines, mark = self.s.variation(), [], self.formulas.mark()
        changes = {name: rule.scalar(e) for name, e in self.s.rows.items()}
        self.formulas.refresh()
        for name, change in changes.items():
            lines.append(f"\\delta c_{{\\text{{{row_name(name)}}}}} = {self.formulas.writer.scalar(change)}")
        blocks: list[Block] = [
            Paragraph(
                "With $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$ for every vector fixed to a body:"
            ),
            Equation(joined(lines)),
        ]
        return Section("Variation", [*blocks, *self.formulas.explained(mark)])

    def work(self) -> Section:
        """Virtual work, sorted by virtual displacements."""
        terms = []
        for i in map(subscript, self.s.sides):
            terms += [rf"\mathbf{{f}}_{i}\cdot\delta\mathbf{{r}}_{i}", rf"\mathbf{{m}}_{i}\cdot\delta\boldsymbol{{\psi}}_{i}"]
        terms += [rf"\mathbf{{m}}_{subscript(i)}\cdot\delta\boldsymbol{{\psi}}_{subscript(i)}" for i in self.s.turning.values()]
        terms += [f"{effort(name)}\\,{self.formulas.known[str(dc)].latex}" for name, dc in self.virtual_changes().items()]
        text = (
            "Virtual work of the rows, with forces that act at the points of the joint. About the centre of a body the"
            " force is the same and the moment is $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$."
        )
        return Section(
            "Virtual work",
            [
                Equation(rf"\sum_i \lambda_i\,\delta c_i = {' + '.join(terms)}"),
                Paragraph(text),
            ],
        )

    def virtual_changes(self) -> dict[str, Expr]:
        """Symbols of the virtual changes of the coordinates that are unknowns, by name."""
        return {name: self.s.virtual[symbol] for name, symbol in self.s.coordinates.items()}

    def head(self, mark: str = "{}") -> list[str]:
        """Names of the forces and moments on the bodies."""
        letters = [(letter, subscript(side)) for side in self.s.sides for letter in "fm"]
        return [f"${mark.format(f'{chr(92)}mathbf{{{letter}}}')}_{side}$" for letter, side in letters]

    def forces(self) -> Section:
        """The forces of every row on the bodies and coordinates, zero ones included."""
        w = self.formulas.writer
        head = ["row", *self.head(), *(rf"$\mathbf{{m}}_{subscript(side)}$" for side in self.s.turning.values())]
        head += [f"${effort(name)}$" for name in self.s.coordinates]
        rows = []
        for row, (pairs, partial) in self.duals.items():
            lam = self.weights[row]
            cells = [w.vector(part * lam) for side in self.s.sides for part in pairs[side]]
            cells += [w.vector(pairs[side][1] * lam) for side in self.s.turning.values()]
            cells += [w.scalar(lam * p) for p in partial.values()]
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        text = (
            "Coordinate-free, on the left-hand side: the force on body k at its point is $-\\mathbf{f}_k$, its moment about that"
            " point $-\\mathbf{m}_k$; likewise on body l."
        )
        blocks: list[Block] = [Paragraph(text)] if self.s.sides else []
        blocks.append(Table(head, rows))
        if self.s.coordinates and self.s.sides:
            blocks.append(Paragraph(
                "The equation of a massless coordinate is "
                + " and ".join(f"${effort(name)} + \\text{{(spring, damper, load)}} = 0$" for name in self.s.coordinates)
                + ", $h$ the sum over its column."
            ))  # fmt: skip
        elif self.s.coordinates:
            blocks.append(Paragraph("$-h$ is the force or torque on the coordinate; it acts on both bodies of its joint."))
        if self.s.turning:
            blocks.append(Paragraph("The equation of a massless free rotation: its moment, the sum over its column, vanishes."))
        return Section("Forces on both bodies" if len(self.s.sides) == 2 else "Forces", blocks)

    def body_frame(self) -> Section:
        """The moments in the axes of each body."""
        w, rows = self.formulas.writer, []
        for row, (pairs, _) in self.duals.items():
            cells = []
            for side in self.s.sides:
                w.frame = lambda base, side=side: in_frame(base, side)
                cells += [w.vector(part * self.weights[row]) for part in pairs[side]]
                w.frame = None
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        head = ["row", *self.head(r"\bar{{{}}}")]
        text = (
            "The same in the joint axes of the body they act on: $\\mathbf{J} = [\\mathbf{x}\\ \\mathbf{y}\\ \\mathbf{z}]$,"
            " $\\mathbf{A} = \\mathbf{J}_k^{\\mathsf{T}}\\mathbf{J}_l$, $\\mathbf{e}_x, \\mathbf{e}_y,"
            " \\mathbf{e}_z$ the columns of the unit matrix; a bar marks components in these axes: $\\bar{\\mathbf{a}} ="
            " \\mathbf{J}^{\\mathsf{T}}\\mathbf{a}$."
        )
        self._check_body_frame()
        return Section("Forces in body axes", [Paragraph(text), Table(head, rows)])


    def balance(self) -> Section:
        """Sum of forces and moments, row by row."""
        w, rows = self.formulas.writer, []
        first, *others = self.s.sides
        atom, record = self.s.record.atom, self.s.record
        d = {side: record.single(atom("r", side) - atom("r", first)) for side in others}
        self.formulas.refresh()
        mark, n, all_balance = self.formulas.mark(), self.formulas.numbers(self.state), True
        for row, (pairs, _) in self.duals.items():
            force = sum((pairs[side][0] for side in self.s.sides), record.zero())
            moments = (pairs[side][1] + d[side].cross(pairs[side][0]) for side in others)
            moment = _settled(sum(moments, pairs[first][1]), n)
            all_balance &= not moment.terms
            rows.append([row_name(row), f"${w.vector(force)}$", f"${w.vector(moment)}$"])
        told = (
            "Forces and moments balance at every attitude, whether the constraint is satisfied or not."
            if all_balance
            else (
                "Forces balance at every attitude; the remaining moment vanishes where the constraint is satisfied and the points"
                " coincide: rows along inertial axes do not turn with the bodies."
            )
        )
        named = self.formulas.definitions(mark)
        below = [subscript(side) for side in self.s.sides]
        forces = " + ".join(rf"\mathbf{{f}}_{i}" for i in below)
        moments_ = " + ".join(rf"\mathbf{{m}}_{i}" for i in below)
        arms = " + ".join(rf"(\mathbf{{r}}_{i} - \mathbf{{r}}_{below[0]})\times\mathbf{{f}}_{i}" for i in below[1:])
        head = ["row", f"${forces}$", rf"moment about $\mathbf{{r}}_{below[0]}$: ${moments_} + {arms}$"]
        return Section(
            "Balance of forces and moments",
            [Paragraph("Per unit of each multiplier."), Table(head, rows), *named, Paragraph(told)],
        )

    def rates(self, rate: Motion, rates: dict[str, Expr]) -> Section:
        """First and second time derivative of the rows, the latter without accelerations."""
        w, mark = self.formulas.writer, self.formulas.mark()
        second = {name: rate.scalar(e) for name, e in rates.items()}
        self.formulas.refresh()
        first = [f"\\dot c_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)}" for name, e in rates.items()]
        further = [f"\\gamma_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)}" for name, e in second.items()]
        named = self.formulas.explained(mark)
        worst = self._rate_proof(rates)
        blocks: list[Block] = [
            Paragraph("$\\mathbf{G}$ has the rows of the table of forces: $\\dot c = \\mathbf{G}\\mathbf{u} + c_t$, with"),
            Equation(joined(first)),
            Paragraph(
                "and $\\ddot c = \\mathbf{G}\\dot{\\mathbf{u}} + \\gamma$, where $\\gamma = \\dot{\\mathbf{G}}\\mathbf{u} +"
                " \\ldots$ contains no acceleration of a centre and no angular acceleration:"
            ),
            Equation(joined(further)),
            *named,
            Paragraph(
                "Proof that $\\frac{\\mathrm{d}}{\\mathrm{d}t} c = \\mathbf{G}\\mathbf{u} + c_t$: forces times"
                " velocities, $\\mathbf{f}_k\\cdot\\mathbf{v}_k + \\mathbf{m}_k\\cdot\\boldsymbol{\\omega}_k +"
                " \\mathbf{f}_l\\cdot\\mathbf{v}_l + \\mathbf{m}_l\\cdot\\boldsymbol{\\omega}_l$, and the derivative of"
                f" $c$ along a motion of the bodies differ by {worst:.1e} at most at the random states below."
            ),
        ]
        return Section("Jacobian and its rate", blocks)

    def stiffness(self) -> Section:
        """Change of the forces in a virtual displacement at constant multipliers."""
        rule, w, mark = self.s.variation(), self.formulas.writer, self.formulas.mark()
        changes = {
            row: {side: [rule.vector(part * self.weights[row]) for part in pairs[side]] for side in self.s.record.sides}
            for row, (pairs, _) in self.duals.items()
        }
        self.formulas.refresh()
        blocks: list[Block] = [
            Paragraph(
                "Change of the forces in a virtual displacement at constant multipliers, $\\delta(\\mathbf{G}^{\\mathsf{T}}"
                "\\boldsymbol{\\lambda})$; what is not listed is zero."
            )
        ]
        for row, sides in changes.items():
            lines = []
            for side, parts in sides.items():
                for letter, part in zip("fm", parts, strict=True):
                    if part.terms:
                        lines.append(f"\\delta\\mathbf{{{letter}}}_{subscript(side)} = {w.vector(part)}")
            text = f"Row {row_name(row)}" + (":" if lines else ": zero.")
            blocks += [Paragraph(text), *([Equation(joined(lines))] if lines else [])]
        return Section("Geometric stiffness", [*blocks, *self.formulas.explained(mark)])

    def plane(self, planar: Derived | None) -> Section:
        """What remains in the plane."""
        if planar is None:
            return Section("Planar form", [Paragraph("The law has no planar form.")])
        kept = ", ".join(row_name(r) for r in planar.rows) or "none"
        gone = ", ".join(row_name(r) for r in planar.vanished) or "none"
        text = (
            "Where all points and motions lie in the plane z = 0 and $\\mathbf{z}_k$ is its normal, the vectors above have two"
            " components, rotations and moments one, $\\boldsymbol{\\omega} = \\omega\\,\\mathbf{i}_z$. Rows that remain:"
            f" {kept}. Rows that vanish identically and are left out: {gone}."
        )
        w, lines = self.formulas.writer, []
        for row in planar.rows:
            pairs = self.duals[row][0]
            lines.append(
                [
                    row_name(row),
                    *(f"${w.vector(pairs[side][0])}$" for side in self.s.sides),
                    *(f"${_normal_part(w.vector(pairs[side][1]))}$" for side in self.s.sides),
                ]
            )
        below = [subscript(side) for side in self.s.sides]
        head = ["row", *(rf"$\mathbf{{f}}_{i}/\lambda$" for i in below), *(rf"$m_{i}/\lambda$" for i in below)]
        return Section("Planar form", [Paragraph(text), *([Table(head, lines)] if lines else [])])


def _normal_part(text: str) -> str:
    return "0" if text == r"\mathbf{0}" else f"\\mathbf{{i}}_z\\cdot\\left({text}\\right)"


def _settled(a: Vector, n: Any) -> Vector:
    """The vector, or zero where it vanishes at all states."""
    return a if a.terms and float(np.max(np.abs(n.vector(a)))) > 1e-12 else a.record.zero()


def in_frame(base: Base, side: str) -> str:
    """A frame vector resolved in the joint axes of one side."""
    if base.kind in ("x", "y", "z") and {base.side, side} <= set("kl"):
        unit = f"\\mathbf{{e}}_{base.kind}"
        if base.side == side:
            return unit
        return f"\\mathbf{{A}}{unit}" if side == "k" else f"\\mathbf{{A}}^{{\\mathsf{{T}}}}{unit}"
    return f"\\mathbf{{J}}_{subscript(side)}^{{\\mathsf{{T}}}}{Writer.plain(base)}"


def effort(name: str) -> str:
    """The letter of the generalised force of the rows on a coordinate."""
    return f"h_{{\\text{{{row_name(name)}}}}}"


def joint_report(law: type[Law], structure: Structure) -> Document:
    """The report of a joint, or of a coupling of the coordinates of joints."""
    return JointReport(law, structure).document()
