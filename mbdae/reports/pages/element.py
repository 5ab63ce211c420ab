"""Report of a body: kinetic energy, rows of the equations of motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.kernels.plan import plan
from mbdae.reports.common import FormulaPage, described, provenance, title_of
from mbdae.reports.letters import Letter, letters
from mbdae.reports.page import document
from mbdae.reports.printed import Check, Printed, Wanted
from mbdae.reports.states import POINTS
from mbdae.reports.vectors import Record
from mbdae.reports.writer import Writer
from mbdae.symbolic.derive import derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Structure
from mbdae.symbolic.outputs import dynamics


class ElementPage(FormulaPage):
    """The law of a body."""

    def __init__(self, law: type[Element], structure: Structure) -> None:
        self.d, self.flat = (derive(law, structure, ((k, Axes.GENERAL),)) for k in (NodeKind.SPATIAL, NodeKind.PLANAR))
        self.known = letters(law, structure, self.d.law)
        for i, axis in enumerate("xyz"):
            self.known |= {
                f"b_v{i + 1}": Letter(f"v_{axis}", "m/s", f"velocity of the centre, inertial {axis}"),
                f"b_W{i + 1}": Letter(f"\\Omega_{axis}", "rad/s", f"angular velocity about body {axis}"),
                f"b_w{i + 1}": Letter(f"\\omega_{axis}", "rad/s", f"angular velocity about inertial {axis}"),
                f"b_up{i + 1}": Letter(f"\\dot v_{axis}", "m/s^2", f"acceleration of the centre, inertial {axis}"),
                f"b_up{i + 4}": Letter(f"\\dot\\Omega_{axis}", "rad/s^2", f"angular acceleration about body {axis}"),
            }
        self.writer = Writer(Record(), {name: letter.latex for name, letter in self.known.items()})
        rng = np.random.default_rng(2)
        self.given: dict[str, Any] = {name: rng.uniform(0.5, 1.5, POINTS) for name in self.known}
        self.wanted: dict[str, Wanted] = {}

    def symbols(self) -> Table:
        """Symbols used."""
        return Table(["symbol", "unit", "meaning"], [self.known[n].row for n in sorted(self.writer.used)])

    def printed(self, blocks: list[Block]) -> list[Check]:
        """The lines read back, against the compiled kernel."""
        return Printed({self.known[n].latex: v for n, v in self.given.items()}, self.wanted).read(blocks)

    def blocks(self) -> list[Block]:
        """Energy and rows."""
        w, p, lines = self.writer, plan(self.d, dynamics), []
        kernel: dict[Any, Any] = {}
        if p.targets:
            x = np.stack([self.given.get(str(s), np.full(POINTS, 0.3)) for s in p.all_inputs.symbols], -1)
            kernel = dict(zip(p.targets, p.kernel.values(x).T, strict=True))
            speeds = [f"b_{'v' if i < 3 else 'W'}{i % 3 + 1}" for i in range(6)]
            still = [str(s) for s in p.all_inputs.symbols]
            at = {f"b_up{i + 1}": self.given[name] for i, name in enumerate(speeds)}
            at |= {f"b_W{i}": np.zeros(POINTS) for i in (1, 2, 3)}
            linear = p.kernel.values(np.stack([at.get(n, self.given.get(n, np.full(POINTS, 0.3))) for n in still], -1)).T
            energy = sum(row * self.given[speeds[t[2]]] for t, row in zip(p.targets, linear, strict=True)) / 2
            self.wanted["T"] = Wanted(energy, "the compiled mass")
        first = self.lines(f"T = {w.scalar(self.d.energy)}") if p.targets else [Paragraph("The node has no inertia of its own.")]
        for target, e in dynamics(self.d):
            axis = "xyz"[target[2] % 3]
            latex = f"{'f' if target[2] < 3 else 'm'}_{axis}"
            self.wanted[latex] = Wanted(kernel[target], "the compiled kernel")
            lines.append(f"{latex} = {w.scalar(se.expand(e))}")
        text = (
            "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\mathbf{v}}$ in inertial axes, and "
            "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}} + \\boldsymbol{\\Omega}\\times"
            "\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}}$ in body axes, on the left-hand side of the rows:"
        )
        rows = [Section("Rows of the equations of motion", [Paragraph(text), *self.lines(*lines)])] if lines else []
        return [Section("Kinetic energy", first), *rows]


def element_report(law: type[Element], structure: Structure) -> Document:
    """The report of a body."""
    page = ElementPage(law, structure)
    return document(title_of(law), described(law), [(page, page.blocks())], "", [provenance(page.d, page.flat)])
