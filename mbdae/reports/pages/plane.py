"""The planar form of a law: the same statement with vectors in the plane, compared with the planar kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.reports.common import LawFormulas, row_name
from mbdae.reports.page import KERNEL, LawPage
from mbdae.reports.statement import Statement
from mbdae.reports.states import POINTS, random_state
from mbdae.reports.writer import subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import dynamics, position

PLANE = (
    "Where all points and motions lie in the plane $z = 0$ and $\\mathbf{z}_k = \\mathbf{z}_l = \\mathbf{i}_z$, rotations and"
    " moments are numbers: $\\boldsymbol{\\omega} = \\omega\\,\\mathbf{i}_z$, $\\mathbf{m} = m\\,\\mathbf{i}_z$."
)


class PlanarPage(LawPage):
    """A law in the plane: its rows, and what it adds to the equations of the bodies."""

    def __init__(self, of: LawPage, planar: Derived) -> None:
        self.s, self.of = Statement(of.s.cls, of.s.structure, planar=True), of
        _ = self.s.rows
        self.formulas, self.d = LawFormulas(self.s, of.formulas.what, others=of.formulas.taken), planar
        self.state, self.wanted = random_state(planar), {}
        self.kernel = self.compiled(lambda d: [*position(d), *dynamics(d)])

    def blocks(self) -> list[Block]:
        """Rows that remain, forces and moments with them."""
        w, sign, lines = self.formulas.writer, -1 if isinstance(self.s.law, Force) else 1, []
        for row in self.d.rows:
            letter = f"c^{{\\text{{2D}}}}_{{\\text{{{row_name(row)}}}}}"
            self.want(letter, self.kernel.get(("g", self.d.rows.index(row)), 0.0), KERNEL)
            lines.append(f"{letter} = {w.scalar(self.s.rows[row])}")
        for side, (force, moment) in self.pairs().items():
            turning = (moment * sign) @ self.s.record.axis(2)
            got = self.at_point(side, self.kernel)
            for letter, text, values in ((r"\mathbf{f}", w.vector(force * sign), got[0]), ("m", w.scalar(turning), got[1])):
                latex = f"{letter}^{{\\text{{2D}}}}_{subscript(side)}"
                self.want(latex, sign * values, KERNEL)
                lines.append(f"{latex} = {text}")
        gone = [row_name(row) for row in self.d.vanished]
        told = f" The rows {', '.join(gone)} vanish identically and are left out." if gone else ""
        return [Paragraph(PLANE + told), *self.formulas.lines(*lines)]

    def pairs(self) -> dict[str, Any]:
        """Force and moment on every body that moves, left-hand side, at its point."""
        return {side: pair for side, pair in self.all_pairs().items() if side in self.s.sides and side not in self.s.still}

    def at_point(self, side: str, kernel: dict[Any, Any]) -> tuple[Any, Any]:
        f = self.state.frame(side)
        rows = [np.broadcast_to(kernel.get(("u", side, i), 0.0), (POINTS,)) for i in range(3)]
        force = np.stack([rows[0], rows[1], np.zeros(POINTS)], -1)
        return force, rows[2] - np.cross(self.state.vector(f.arm), force)[:, 2]


def plane_section(r: LawPage, planar: Derived | None) -> list[tuple[Any, list[Block]]]:
    """The page on the planar form, where there is one."""
    if planar is None:
        return []
    page = PlanarPage(r, planar)
    return [(page, [Section("Planar form", page.blocks())])]
