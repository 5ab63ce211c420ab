"""Report of a body: kinetic energy, momenta, rows of the equations of motion."""

from __future__ import annotations

import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.reports.common import described, provenance, title_of
from mbdae.reports.letters import Letter, letters
from mbdae.reports.vectors import Record
from mbdae.reports.writer import Writer
from mbdae.symbolic.derive import derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Structure
from mbdae.symbolic.outputs import dynamics


def element_report(law: type[Element], structure: Structure) -> Document:
    """The report of a body."""
    d, flat = (derive(law, structure, ((kind, Axes.GENERAL),)) for kind in (NodeKind.SPATIAL, NodeKind.PLANAR))  # type: ignore[arg-type]
    known = letters(law, structure, d.law)
    for i, axis in enumerate("xyz"):
        known |= {
            f"b_v{i + 1}": Letter(f"v_{axis}", "m/s", f"velocity of the centre, inertial {axis}"),
            f"b_W{i + 1}": Letter(f"\\Omega_{axis}", "rad/s", f"angular velocity about body {axis}"),
            f"b_w{i + 1}": Letter(f"\\omega_{axis}", "rad/s", f"angular velocity about inertial {axis}"),
            f"b_up{i + 1}": Letter(f"\\dot v_{axis}", "m/s^2", f"acceleration of the centre, inertial {axis}"),
            f"b_up{i + 4}": Letter(f"\\dot\\Omega_{axis}", "rad/s^2", f"angular acceleration about body {axis}"),
        }
    w = Writer(Record(), {name: letter.latex for name, letter in known.items()})
    blocks: list[Block] = [Equation(f"T = {w.scalar(d.energy)}")]
    if d.energy == 0:
        blocks.append(Paragraph("The node has no inertia of its own."))
    rows: list[Block] = []
    for target, e in dynamics(d):
        what = f"force along {'xyz'[target[2]]}" if target[2] < 3 else f"moment about body {'xyz'[target[2] - 3]}"
        rows.append(Equation(w.scalar(se.expand(e)), note=f"{what}, left-hand side"))
    text = (
        "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\mathbf{v}}$ in inertial axes, and "
        "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}} + \\boldsymbol{\\Omega}\\times"
        "\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}}$ in body axes:"
    )
    symbols = Table(["symbol", "unit", "meaning"], [known[n].row for n in sorted(w.used)])
    return Document(
        title_of(law),
        [
            *described(law),
            Section("Symbols", [symbols]),
            Section("Kinetic energy", blocks),
            *([Section("Rows of the equations of motion", [Paragraph(text), *rows])] if rows else []),
            provenance(d, flat),
        ],
    )
