"""Report of a law stated by an energy, a dissipation function or a wrench: springs, dampers, loads, contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.documents.document import Document
from mbdae.reports.common import LawFormulas, described, external, provenance, title_of
from mbdae.reports.letters import Letter
from mbdae.reports.page import DERIVED, KERNEL, LawPage, document, planar_of
from mbdae.reports.pages.figure import figure_of
from mbdae.reports.pages.joint import CONVENTION, effort
from mbdae.reports.pages.parts import part_section
from mbdae.reports.pages.plane import plane_section
from mbdae.reports.pages.resistance import power_blocks, state_blocks, thrust_blocks
from mbdae.reports.statement import Statement
from mbdae.reports.states import POINTS, random_state
from mbdae.symbolic.law import Force, Structure
from mbdae.symbolic.outputs import dynamics
from mbdae.symbolic.vectors import Expr


class ForceReport(LawPage):
    """One law of force."""

    def __init__(self, law: type[Force], structure: Structure) -> None:
        self.s = Statement(law, structure)
        self.energy, self.dissipation, self.wrench = self.s.energy, self.s.dissipation, self.s.wrench
        self.losses = {name: self.s.scalar(e) for name, e in self.s.law.losses(*self.s.frames).items()}
        self.gaps = [(self.s.scalar(g), self.s.scalar(rate)) for g, rate in self.s.law.gaps(*self.s.frames)]
        self.formulas, self.d = LawFormulas(self.s, "law"), self.s.derived
        self.state, self.wanted = random_state(self.d), {}
        self.elastic = self.s.gradient(self.energy)
        self.kernel = self.compiled(dynamics)
        for letter, side, i in self.letters():
            self.want(letter, -self.at_point(side, self.kernel)[i], KERNEL)
        for name in self.s.coordinates:
            self.want(effort(name), self.kernel.get(("u", self.s.places[name], 0), 0.0), KERNEL)

    def document(self) -> Document:
        """The whole report."""
        sections = [self.statement(), self.forces(), *self.states(), *self.one_sided(), self.power(), *part_section(self.s)]
        planar = planar_of(self.s)
        sections += [] if planar else [Section("Planar form", [Paragraph("The law has no planar form.")])]
        head = [*described(self.s.cls), *figure_of(self.s)]
        pages: list[tuple[Any, list[Block]]] = [(self, list(sections)), *plane_section(self, planar)]
        return document(title_of(self.s.cls), head, pages, CONVENTION, [provenance(self.d, planar)])

    def statement(self) -> Section:
        """Energy, dissipation function, force and torque as the law states them."""
        w, d, blocks = self.formulas.writer, self.d, list[Block]()
        law, sides = d.law, d.sides
        if self.energy != 0:
            self.want("V", self.state.scalar(d.energy), DERIVED)
            blocks += [Paragraph("Potential energy, J:"), *self.formulas.lines(f"V = {w.scalar(self.energy)}")]
        if self.dissipation != 0:
            self.want("D", self.state.scalar(d.variation.name(law.dissipation(*sides))), DERIVED)
            text = "Rayleigh dissipation function, half the dissipated power, W:"
            blocks += [Paragraph(text), *self.formulas.lines(f"D = {w.scalar(self.dissipation)}")]
        if self.wrench is not None:
            for letter, part in zip("FT", law.wrench(*sides), strict=True):
                values = [self.state.scalar(d.variation.resolve(d.variation.name(c))) for c in part]
                self.want(rf"\mathbf{{{letter}}}", np.stack(values, -1), DERIVED)
            on_k = "" if external(self.s) else "; the opposite acts on k at the same point"
            text = f"Force $\\mathbf{{F}}$ (N) on l at its point and torque $\\mathbf{{T}}$ (N m) on l{on_k}:"
            lines = [rf"\mathbf{{{letter}}} = {w.vector(part)}" for letter, part in zip("FT", self.wrench, strict=True)]
            blocks += [Paragraph(text), *self.formulas.lines(*lines)]
        return Section("Law", [*blocks, *thrust_blocks(self)])

    def forces(self) -> Section:
        """Forces and moments that act on the bodies."""
        w, total = self.formulas.writer, self.all_pairs()
        lines = [f"{letter} = {w.vector(-total[side][i])}" for letter, side, i in self.letters()]
        lines += [f"{effort(name)} = {w.scalar(e)}" for name, e in self.coordinate_rows().items()]
        text = (
            "Forces and moments on the bodies at their points, from $-\\delta V$,"
            " $-\\partial D/\\partial\\dot{\\mathbf{r}}$ and the stated force; about the centre of a body the moment is"
            " $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$."
        )
        if self.s.coordinates:
            text += " $h$ is what the law adds to the left-hand side of the equation of the joint's coordinate."
        blocks = [Paragraph(text), *self.formulas.lines(*lines)]
        if not external(self.s):
            sums, _ = self.balance({side: (-pair[0], -pair[1]) for side, pair in total.items()}, must=True)
            blocks += [Paragraph("Balance:"), *sums]
        return Section("Forces on the bodies", blocks)

    def coordinate_rows(self) -> dict[str, Expr]:
        """Contributions of the law to the equations of joint coordinates."""
        parts = (self.elastic[1], {s: self.s.drag[1][self.s.clock[s]] for s in self.s.coordinates.values()}, self.stated_partials)
        return {name: sum((part[symbol] for part in parts), se.Integer(0)) for name, symbol in self.s.coordinates.items()}

    def states(self) -> list[Section]:
        """Internal states."""
        return [Section("Internal states", state_blocks(self))] if self.d.states else []

    def one_sided(self) -> list[Section]:
        """Gaps of a law that acts where they are negative."""
        if not self.gaps:
            return []
        w, lines, several = self.formulas.writer, list[str](), len(self.gaps) > 1
        for i, (pair, stated) in enumerate(zip(self.gaps, self.d.law.gaps(*self.d.sides), strict=True)):
            below = f"_{{{i + 1}}}" if several else ""
            for mark, e, wanted in zip((f"g{below}", rf"\dot g{below}"), pair, stated, strict=True):
                self.want(mark, self.state.scalar(self.d.variation.name(wanted)), DERIVED)
                lines.append(f"{mark} = {w.scalar(e)}")
        self.formulas.known["gap"] = Letter("g", "m", "gap: the law acts where it is negative")
        w.used.add("gap")
        text = "The law acts where the gap is negative; no step of a solver passes over a change of its sign."
        return [Section("Gap", [Paragraph(text), *self.formulas.lines(*lines)])]

    def power(self) -> Section:
        """Power and its sign."""
        w, d, blocks = self.formulas.writer, self.d, list[Block]()
        dissipated: Any = np.asarray(self.state.scalar(d.dissipated_power))
        if not np.any(dissipated != 0):
            return Section("Power", [Paragraph("The law dissipates nothing." if self.energy != 0 else
                                               "The power of the law counts as work.")])  # fmt: skip
        stated = d.law.losses(*d.sides)
        for name, e in self.losses.items():
            self.want(f"P_{{\\text{{{name}}}}}", self.state.scalar(d.variation.resolve(d.variation.name(stated[name]))), DERIVED)
            blocks += self.formulas.lines(f"P_{{\\text{{{name}}}}} = {w.scalar(e)}")
        if self.losses:
            self.want("P_d", dissipated, "the energy balance of a run")
            blocks += self.formulas.lines("P_d = " + " + ".join(f"P_{{\\text{{{name}}}}}" for name in self.losses))
            sign = "never negative" if np.min(dissipated) >= -1e-12 else "of either sign: internal states store energy"
            return Section("Power", [Paragraph(f"Dissipated power: {sign} at {POINTS} random states."), *blocks])
        zero = self.s.record.zero()
        stated_pairs = self.stated_pairs if d.law.dissipative else None
        pairs = {side: tuple(self.s.drag[0][side][i] + (stated_pairs[side][i] if stated_pairs else zero) for i in (0, 1))
                 for side in self.s.sides}  # fmt: skip
        partials = {s: self.s.drag[1][self.s.clock[s]] + (self.stated_partials[s] if d.law.dissipative else 0)
                    for s in self.s.coordinates.values()}  # fmt: skip
        return Section("Power", [Paragraph("Power of what dissipates, on the bodies:"), *power_blocks(self, pairs, partials)])  # type: ignore[arg-type]


def force_report(law: type[Force], structure: Structure) -> Document:
    """The report of a force law."""
    return ForceReport(law, structure).document()
