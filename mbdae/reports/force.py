"""Report of a law stated by an energy, a dissipation function or a wrench: springs, dampers, loads, contact."""

from __future__ import annotations

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.documents.document import Document
from mbdae.reports.calculus import Dual, Pair
from mbdae.reports.common import Check, LawFormulas, checks_table, described, external, provenance, title_of
from mbdae.reports.joint import CONVENTION, effort
from mbdae.reports.joint_checks import LawChecks, planar_of
from mbdae.reports.letters import Letter
from mbdae.reports.parts import part_sections
from mbdae.reports.resistance import thrust_blocks
from mbdae.reports.statement import Statement
from mbdae.reports.states import POINTS, random_state, residual
from mbdae.reports.vectors import Base
from mbdae.reports.writer import subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force, Structure
from mbdae.symbolic.outputs import dynamics
from mbdae.symbolic.vectors import Expr


class ForceReport(LawChecks):
    """One law of force."""

    def __init__(self, law: type[Force], structure: Structure) -> None:
        self.s = Statement(law, structure)
        self.energy, self.dissipation, self.wrench = self.s.energy, self.s.dissipation, self.s.wrench
        self.losses = {name: self.s.scalar(e) for name, e in self.s.law.losses(*self.s.frames).items()}
        self.gaps = [(self.s.scalar(g), self.s.scalar(rate)) for g, rate in self.s.law.gaps(*self.s.frames)]
        self.rates, self.starts = self.s.states("rates"), self.s.states("initial")
        self.formulas, self.d = LawFormulas(self.s, "law"), self.s.derived
        self.state = random_state(self.d)
        self.elastic = self.s.gradient(self.energy)
        speeds = tuple(self.s.clock[s] for s in self.s.coordinates.values())
        self.drag = Dual(self.s.record, velocities=True, symbols=speeds).of(self.dissipation)

    def document(self) -> Document:
        """The whole report."""
        sections = [self.statement(), self.forces(), *self.states(), *self.one_sided(), self.power()]
        sections += part_sections(self.s, self.formulas)
        self.run_checks()
        planar = planar_of(self.s)
        symbols = Section("Symbols", [self.formulas.symbols(), Paragraph(CONVENTION)])
        checked = Section("Numeric check", checks_table(self.formulas.checks, POINTS))
        return Document(
            title_of(self.s.cls), [*described(self.s.cls), symbols, *sections, plane(planar), checked, provenance(self.d, planar)]
        )

    def statement(self) -> Section:
        """Energy, dissipation function, force and torque as the law states them."""
        w, mark, blocks = self.formulas.writer, self.formulas.mark(), list[Block]()
        if self.energy != 0:
            blocks += [Paragraph("Potential energy, J:"), Equation(f"V = {w.scalar(self.energy)}")]
        if self.dissipation != 0:
            blocks += [
                Paragraph("Rayleigh dissipation function, half the dissipated power, W:"),
                Equation(f"D = {w.scalar(self.dissipation)}"),
            ]
        if self.wrench is not None:
            on_k = "" if external(self.s) else "; the opposite acts on k at the same point"
            blocks += [
                Paragraph(f"Force $\\mathbf{{F}}$ (N) on l at its point and torque $\\mathbf{{T}}$ (N m) on l{on_k}:"),
                Equation(f"\\mathbf{{F}} = {w.vector(self.wrench[0])} \\\\ \\mathbf{{T}} = {w.vector(self.wrench[1])}"),
            ]
        blocks += thrust_blocks(self)
        return Section("Law", [*blocks, *self.formulas.explained(mark)])

    def total(self) -> dict[str, Pair]:
        """Forces and moments on the bodies at their points, as they stand on the left-hand side."""
        added = self.stated_pairs
        out = {}
        for side in self.s.sides:
            force, moment = (self.elastic[0][side][i] + self.drag[0][side][i] for i in range(2))
            out[side] = (force + added[side][0], moment + added[side][1]) if added else (force, moment)
        return out

    def forces(self) -> Section:
        """Forces and moments that act on the bodies."""
        w, mark = self.formulas.writer, self.formulas.mark()
        total = self.total()
        self.formulas.refresh()
        lines = []
        for side in [side for side in reversed(self.s.sides) if side not in self.s.still]:
            lines.append(f"\\mathbf{{f}}_{subscript(side)} = {w.vector(-total[side][0])}")
            lines.append(f"\\mathbf{{m}}_{subscript(side)} = {w.vector(-total[side][1])}")
        for name, e in self.coordinate_rows().items():
            lines.append(f"{effort(name)} = {w.scalar(e)}")
        text = (
            "Forces and moments on the bodies at their points, from $-\\delta V$,"
            " $-\\partial D/\\partial\\dot{\\mathbf{r}}$ and the stated force; about the centre of a body the moment is"
            " $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$."
        )
        if self.s.coordinates:
            text += " $h$ is what the law adds to the left-hand side of the equation of the joint's coordinate."
        blocks = [Paragraph(text), *_equations(lines), *self.formulas.explained(mark)]
        if not external(self.s):
            blocks.append(Paragraph(self.balance(total)))
        return Section("Forces on both bodies" if len(self.s.sides) == 2 else "Forces on the bodies", blocks)

    def coordinate_rows(self) -> dict[str, Expr]:
        """Contributions of the law to the equations of joint coordinates."""
        parts = (self.elastic[1], {s: self.drag[1][self.s.clock[s]] for s in self.s.coordinates.values()}, self.stated_partials)
        return {name: sum((part[symbol] for part in parts), se.Integer(0)) for name, symbol in self.s.coordinates.items()}

    def balance(self, total: dict[str, Pair]) -> str:
        """Sums of forces and moments."""
        n, st = self.formulas.numbers(self.state), self.state
        forces, moments = ([np.broadcast_to(n.vector(pair[i]), (POINTS, 3)) for pair in total.values()] for i in range(2))
        places = [st.atom(Base("r", side)) for side in total]
        moment = sum(m + np.cross(r - places[0], f) for m, r, f in zip(moments, places, forces, strict=True))
        errors = [residual(sum(forces) + forces[-1], forces[-1]), residual(moment + moments[-1], moments[-1])]
        self.formulas.checks += [Check("sum of forces vanishes", errors[0]), Check("sum of moments vanishes", errors[1])]
        below = [subscript(side) for side in self.s.sides]
        sums = [" + ".join(rf"\mathbf{{{letter}}}_{i}" for i in below) for letter in "fm"]
        arms = [rf"(\mathbf{{r}}_{i} - \mathbf{{r}}_{below[0]})\times\mathbf{{f}}_{i}" for i in below[1:]]
        return (
            rf"Balance: ${sums[0]} = \mathbf{{0}}$ and ${' + '.join([sums[1], *arms])} = \mathbf{{0}}$ at every state; they hold"
            f" within {max(errors):.1e} at the random states."
        )

    def states(self) -> list[Section]:
        """Internal states."""
        if not self.rates:
            return []
        w, mark, blocks = self.formulas.writer, self.formulas.mark(), list[Block]()
        for name in self.rates:
            latex = self.formulas.known[f"state_{name}"].latex
            blocks.append(
                Equation(f"\\dot{{{latex}}} = {w.scalar(self.rates[name])} \\\\ {latex}(0) = {w.scalar(self.starts[name])}")
            )
        return [Section("Internal states", [*blocks, *self.formulas.explained(mark)])]

    def one_sided(self) -> list[Section]:
        """Gaps of a law that acts where they are negative."""
        if not self.gaps:
            return []
        w, mark = self.formulas.writer, self.formulas.mark()
        lines = [f"g = {w.scalar(g)} \\\\ \\dot g = {w.scalar(rate)}" for g, rate in self.gaps]
        self.formulas.known["gap"] = Letter("g", "m", "gap: the law acts where it is negative")
        w.used.add("gap")
        return [
            Section(
                "Gap",
                [
                    Paragraph("The law acts where the gap is negative; no step of a solver passes over a change of its sign."),
                    *_equations(lines),
                    *self.formulas.explained(mark),
                ],
            )
        ]

    def power(self) -> Section:
        """Power and its sign."""
        w, mark, n = self.formulas.writer, self.formulas.mark(), self.formulas.numbers(self.state)
        lines = [f"P_{{\\text{{{name}}}}} = {w.scalar(e)}" for name, e in self.losses.items()]
        dissipated = np.asarray(self.state.scalar(self.d.dissipated_power))
        if self.losses:
            self.check(
                "losses by cause, with the dissipated power that is integrated",
                n.scalar(sum(self.losses.values(), se.Integer(0))),
                dissipated,
            )
        blocks: list[Block] = []
        if np.any(dissipated != 0):
            least = float(np.min(dissipated))
            sign = (
                "never negative" if least >= -1e-12 else "of either sign, because internal states store and release energy"
            )
            blocks.append(Paragraph(f"Dissipated power: {sign} at {POINTS} random states."))
        else:
            blocks.append(
                Paragraph("The law dissipates nothing." if self.energy != 0 else "The power of the law counts as work.")
            )
        return Section("Power", [*blocks, *_equations(lines), *self.formulas.explained(mark)])

    # -- checks

    def run_checks(self) -> None:
        """Formulas against the compiled kernel."""
        st, n = self.state, self.formulas.numbers(self.state)
        kernel = self.compiled(dynamics)
        self.check("potential energy", np.broadcast_to(n.scalar(self.energy), (POINTS,)), st.scalar(self.d.energy))
        for side, pair in self.total().items():
            if side not in self.s.still:
                self.check_pair(side, pair, kernel, side)
        for name, e in self.coordinate_rows().items():
            self.check_coordinate(name, e, kernel)
        stated_gaps = [e for pair in self.d.law.gaps(*self.d.sides) for e in pair]
        for e, wanted_ in zip((e for pair in self.gaps for e in pair), stated_gaps, strict=True):
            self.check("gap or its rate", n.scalar(e), st.scalar(self.d.variation.name(wanted_)))
        for what, stated, derived_ in (("rate", self.rates, self.d.state_rates), ("start", self.starts, self.d.state_starts)):
            for (name, e), wanted_ in zip(stated.items(), derived_, strict=True):
                self.check(f"{what} of {name}", np.broadcast_to(n.scalar(e), (POINTS,)), st.scalar(wanted_))


def _equations(lines: list[str]) -> list[Equation]:
    return [Equation(" \\\\ ".join(lines))] if lines else []


def plane(planar: Derived | None) -> Section:
    """The planar form of a force."""
    if planar is None:
        return Section("Planar form", [Paragraph("The law has no planar form.")])
    text = (
        "Where all motions lie in the plane z = 0 the vectors above have two components, rotations and moments one,"
        " $\\boldsymbol{\\omega} = \\omega\\,\\mathbf{i}_z$; forces out of the plane vanish identically, which the derivation"
        " checks."
    )
    return Section("Planar form", [Paragraph(text)])


def force_report(law: type[Force], structure: Structure) -> Document:
    """The report of a force law."""
    return ForceReport(law, structure).document()
