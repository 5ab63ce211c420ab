"""Report of a law stated by constraints: from the rows to forces, rates and geometric stiffness, each step checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.reports.branches import solution_set
from mbdae.reports.calculus import Motion
from mbdae.reports.common import checks_table, described, joined, provenance, row_name, title_of
from mbdae.reports.joint_checks import JointChecks, planar_of
from mbdae.reports.letters import multiplier
from mbdae.reports.recursive import recursive_sections
from mbdae.reports.resistance import resistance_section
from mbdae.reports.states import POINTS
from mbdae.reports.vectors import Base, Vector
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure
from mbdae.symbolic.vectors import Expr

CONVENTION = (
    "The frame $\\mathbf{x}_k, \\mathbf{y}_k, \\mathbf{z}_k$ is fixed to body k, $\\mathbf{x}_l, \\mathbf{y}_l,"
    " \\mathbf{z}_l$ to body l; they are right-handed and coincide as drawn, all components are inertial."
    " Coordinates are those of l relative to k, positive about or along $\\mathbf{z}_k$. A vector"
    " $\\mathbf{a}$ fixed to a body changes by $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$."
    " Equations of motion read $\\mathbf{M}\\dot{\\mathbf{u}} +"
    " \\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda} + \\ldots - \\mathbf{f} = \\mathbf{0}$: forces listed beside a virtual"
    " displacement stand on the left-hand side, the force that acts on a body is the opposite."
)


class JointReport(JointChecks):
    """The report of one joint law: its rows, and forces, rates and stiffness that follow from them."""

    # -- sections

    def document(self) -> Document:
        """The whole report."""
        rate = self.s.motion()
        rates = {row: rate.scalar(e) for row, e in self.s.rows.items()}
        sections = [
            self.constraint(),
            Section("Solution set and branches", solution_set(self)),
            self.variation(),
            self.work(),
            self.forces(),
            self.body_frame(),
            self.balance(),
            self.rates(rate, rates),
            self.stiffness(),
        ]
        resisted = resistance_section(self)
        sections += [resisted] if resisted else []
        planar = planar_of(self.s)
        sections += recursive_sections(self)
        self.formulas.refresh()
        self.run_checks(rate, rates)
        symbols = Section("Symbols", [self.formulas.symbols(), Paragraph(CONVENTION)])
        checked = Section("Numeric check", checks_table(self.formulas.checks, POINTS))
        title = f"{title_of(self.s.cls)} joint" if "oint" not in self.s.cls.__name__ else title_of(self.s.cls)
        return Document(
            title, [*described(self.s.cls), symbols, *sections, self.plane(planar), checked, provenance(self.d, planar)]
        )

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
        coordinates = "".join(
            f" + h_{{{name}}}\\,\\delta {self.formulas.known[str(symbol)].latex}" for name, symbol in self.s.coordinates.items()
        )
        text = (
            "Virtual work of the rows, with forces that act at the points of the joint. About the centre of a body the"
            " force is the same and the moment is $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$."
        )
        return Section(
            "Virtual work",
            [
                Equation(
                    r"\sum_i \lambda_i\,\delta c_i = \mathbf{f}_k\cdot\delta\mathbf{r}_k +"
                    r" \mathbf{m}_k\cdot\delta\boldsymbol{\psi}_k "
                    rf"+ \mathbf{{f}}_l\cdot\delta\mathbf{{r}}_l + \mathbf{{m}}_l\cdot\delta\boldsymbol{{\psi}}_l{coordinates}"
                ),
                Paragraph(text),
            ],
        )

    def forces(self) -> Section:
        """The forces of every row on both bodies, zero ones included."""
        w = self.formulas.writer
        head = ["row", r"$\mathbf{f}_k$", r"$\mathbf{m}_k$", r"$\mathbf{f}_l$", r"$\mathbf{m}_l$"]
        head += [f"$h_{{{name}}}$" for name in self.s.coordinates]
        rows = []
        for row, (pairs, partial) in self.duals.items():
            lam = self.weights[row]
            cells = [w.vector(part * lam) for side in "kl" for part in pairs[side]] + [
                w.scalar(lam * p) for p in partial.values()
            ]
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        text = (
            "Coordinate-free, on the left-hand side: the force on body k at its point is $-\\mathbf{f}_k$, its moment about that"
            " point $-\\mathbf{m}_k$; likewise on body l."
        )
        blocks: list[Block] = [Paragraph(text), Table(head, rows)]
        if self.s.coordinates:
            blocks.append(
                Paragraph(
                    "The equation of the massless coordinate is "
                    + " and ".join(
                        f"$h_{{{name}}} + \\text{{(spring, damper, torque)}} = 0$, the sum over its column"
                        for name in self.s.coordinates
                    )
                    + "."
                )
            )
        return Section("Forces on both bodies", blocks)

    def body_frame(self) -> Section:
        """The moments in the axes of each body."""
        w, rows = self.formulas.writer, []
        for row, (pairs, _) in self.duals.items():
            cells = []
            for side in "kl":
                w.frame = lambda base, side=side: in_frame(base, side)
                cells += [w.vector(part * self.weights[row]) for part in pairs[side]]
                w.frame = None
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        head = ["row", r"$\bar{\mathbf{f}}_k$", r"$\bar{\mathbf{m}}_k$", r"$\bar{\mathbf{f}}_l$", r"$\bar{\mathbf{m}}_l$"]
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
        d = self.s.record.single(self.s.record.atom("r", "l") - self.s.record.atom("r", "k"))
        self.formulas.refresh()
        mark, n, all_balance = self.formulas.mark(), self.formulas.numbers(self.state), True
        for row, (pairs, _) in self.duals.items():
            force = pairs["k"][0] + pairs["l"][0]
            moment = pairs["k"][1] + pairs["l"][1] + d.cross(pairs["l"][0])
            moment = _settled(moment, n)
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
        head = [
            "row",
            r"$\mathbf{f}_k + \mathbf{f}_l$",
            r"moment about $\mathbf{r}_k$: $\mathbf{m}_k + \mathbf{m}_l + (\mathbf{r}_l - \mathbf{r}_k)\times\mathbf{f}_l$",
        ]
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
            row: {side: [rule.vector(part * self.weights[row]) for part in pairs[side]] for side in "kl"}
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
                        lines.append(f"\\delta\\mathbf{{{letter}}}_{side} = {w.vector(part)}")
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
                    *(f"${w.vector(pairs[side][0])}$" for side in "kl"),
                    *(f"${_normal_part(w.vector(pairs[side][1]))}$" for side in "kl"),
                ]
            )
        head = ["row", r"$\mathbf{f}_k/\lambda$", r"$\mathbf{f}_l/\lambda$", r"$m_k/\lambda$", r"$m_l/\lambda$"]
        return Section("Planar form", [Paragraph(text), *([Table(head, lines)] if lines else [])])


def _normal_part(text: str) -> str:
    return "0" if text == r"\mathbf{0}" else f"\\mathbf{{i}}_z\\cdot\\left({text}\\right)"


def _settled(a: Vector, n: Any) -> Vector:
    """The vector, or zero where it vanishes at all states."""
    return a if a.terms and float(np.max(np.abs(n.vector(a)))) > 1e-12 else a.record.zero()


def in_frame(base: Base, side: str) -> str:
    """A frame vector resolved in the joint axes of one side."""
    if base.kind in ("x", "y", "z"):
        unit = f"\\mathbf{{e}}_{base.kind}"
        if base.side == side:
            return unit
        return f"\\mathbf{{A}}{unit}" if side == "k" else f"\\mathbf{{A}}^{{\\mathsf{{T}}}}{unit}"
    name = "ijk"["xyz".index(base.side)] if base.kind == "E" else base.kind
    plain = f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else f"\\mathbf{{{name}}}_{base.side}"
    return f"\\mathbf{{J}}_{side}^{{\\mathsf{{T}}}}{plain}"


def joint_report(law: type[Joint], structure: Structure) -> Document:
    """The report of a joint law."""
    return JointReport(law, structure).document()
