"""Joint forces of a scene in closed form: the page of its equations and their solution, read back."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section, Table
from mbdae.reports.page import Check, Page, Printed, Wanted, short_hash
from mbdae.reports.scenes.equations import Row, SceneEquations, determinant, said, total
from mbdae.reports.states import value
from mbdae.symbolic.joint import Joint

RUN = "the multipliers of the scene at random states"


class ClosedForms(SceneEquations, Page):
    """The joint forces of a scene as formulas. Raises ValueError, with the reason, where a scene has none."""

    # -- formulas

    def blocks(self) -> list[Block]:
        """Equations of the bodies, solution, forces on the bodies l, letters with their numbers, laws."""
        balance, solution = self.balance(), self.solution()
        forces, numbers = self.forces(), self.numbers()
        told = (
            "$\\lambda$ is the multiplier of a row of a joint; $p$ is mass times acceleration less $f$, all forces that are no"
            " reactions: along $c$, the position of a body's centre, or about it ($\\theta$, $\\psi$). The factors are the"
            " entries of $\\mathbf{G}$ in the laws below: $s$ the arm from the centre to the joint, $x, y, z$ its axes."
        )
        how = (
            "Force balances give a multiplier each. What is left falls into the smallest blocks of rows that stand for"
            " themselves, solved by determinants; the other multipliers follow:"
        )
        on_l = "The force on body l of each joint, N:"
        return [
            Section("Equations of the bodies", [Paragraph(told), *balance]),
            Section("Joint forces in closed form", [Paragraph(how), *solution, Paragraph(on_l), *forces]),
            Section("Numbers at the start", [numbers]),
            Section("Laws of the equations", [self.laws()]),
        ]

    def balance(self) -> list[Block]:
        """p by mass and acceleration, and the rows."""
        w, lines = self.writer, []
        for at, v in self.velocities.items():
            terms = [f"{self.mass_letter(at, j)}\\,\\ddot{{{self.velocities[j].letter}}}_{self.velocities[j].below}"
                     for j in self.mass[at]]  # fmt: skip
            lines.append(f"{self.latex[f'p{at}']} = {' + '.join(terms)} - f^{v.letter}_{v.below}")
            left = [*(e * key for key, e in self.rows[at].items() if key is not None), self.rows[at][None]]
            lines.append(f"{w.scalar(sum(left, se.Integer(0)))} = 0")
        return self.lines(*lines)

    def solution(self) -> list[Block]:
        """The multipliers in the order of their solution."""
        w, out, count = self.writer, list[Block](), 0
        for unknowns, rows in self.steps:
            if any(unknown in row for row in rows for unknown in unknowns):
                count += 1
                out += self._determinants(unknowns, rows, count)
            else:
                out += self.lines(f"{w.scalar(unknowns[0])} = {w.scalar(total(rows[0]))}")
        return out

    def _determinants(self, unknowns: list[Any], rows: list[Row], count: int) -> list[Block]:
        """A block of rows A lambda = h by Cramer's rule."""
        w, n, lines = self.writer, len(unknowns), []
        A = [[self.letter(f"a{count}_{i}{j}", f"a^{{({count})}}_{{{i + 1}{j + 1}}}") for j in range(n)] for i in range(n)]
        h = [self.letter(f"h{count}_{i}", f"h^{{({count})}}_{{{i + 1}}}") for i in range(n)]
        for i, row in enumerate(rows):
            lines += [f"{w.scalar(A[i][j])} = {w.scalar(row.get(unknown, se.Integer(0)))}" for j, unknown in enumerate(unknowns)]
            rest = {key: e for key, e in row.items() if key not in unknowns}
            lines.append(f"{w.scalar(h[i])} = {w.scalar(se.expand(-total(rest)))}")
        if n == 1:
            return self.lines(*lines, f"{w.scalar(unknowns[0])} = {w.scalar(h[0] / A[0][0])}")
        det = self.letter(f"d{count}", f"\\Delta^{{({count})}}")
        lines.append(f"{w.scalar(det)} = {w.scalar(determinant(A))}")
        for j, unknown in enumerate(unknowns):
            replaced = [[h[i] if column == j else A[i][column] for column in range(n)] for i in range(n)]
            lines.append(f"{w.scalar(unknown)} = {w.scalar(determinant(replaced) / det)}")
        return self.lines(*lines)

    def forces(self) -> list[Block]:
        """Components of the force of every joint on its body l, by the multipliers of its rows."""
        lines = []
        for (item, i), e in self.forces_on_l().items():
            lines.append(f"F_{{{said(item)},{'xyz'[i]}}} = {self.writer.scalar(e)}")
        return self.lines(*lines)

    def printed(self, blocks: list[Block]) -> list[Check]:
        """The lines read back at random states, with the multipliers of the scene there."""
        known, multipliers = self.values(*self.states())
        return self.read(blocks, known, multipliers)

    def read(self, blocks: list[Block], known: dict[str, Any], multipliers: Any) -> list[Check]:
        """The lines read back: multipliers against given ones (nt, m)."""
        wanted = {self.latex[str(s)]: Wanted(multipliers[:, i], RUN) for i, s in enumerate(self.unknowns)}
        table = {name: known[latex] for name, latex in self.latex.items() if latex in known}
        table |= {str(s): multipliers[:, n] for n, s in enumerate(self.unknowns)}
        for (item, i), e in self.forces_on_l().items():
            wanted[f"F_{{{said(item)},{'xyz'[i]}}}"] = Wanted(value(se.sympify(e), lambda symbol: table[str(symbol)]), RUN)
        return Printed(known, wanted, len(multipliers)).read(blocks)

    # -- tables

    def numbers(self) -> Table:
        """Letters that depend on the position, and masses, at the start."""
        start = self.prepared.start
        known, multipliers = self.values(np.array([start.t]), start.q[None], start.u[None], start.s[None])
        rows = [[f"${latex}$", f"{float(v[0]) + 0.0:.6g}"] for latex, v in known.items()]
        rows += [[f"${self.latex[str(s)]}$", f"{multipliers[0, i]:.6g}"] for i, s in enumerate(self.unknowns)]
        return Table(["symbol", "value (SI)"], rows)

    def laws(self) -> Table:
        """The joints with the hashes of their laws as they are derived for this scene."""
        rows, seen = [], dict.fromkeys((row.group, row.instance) for row in self.m.rows)
        for g, i in seen:
            group = self.prepared.model.groups[g]
            names = ", ".join(row.name for row in self.m.rows if (row.group, row.instance) == (g, i))
            law, shape, kinds = *group.key[:2], " - ".join(kind.value for kind, _ in group.key[2])
            said_ = [f"{name}=None" for name in law.drives() if name in shape.absent] if issubclass(law, Joint) else []
            call, hash_ = ", ".join([f"mb.{law.__name__}", *said_]), short_hash(group.derived)
            rows.append([group.instances[i].item, f"`mb.report({call})`", kinds, names, hash_])
        return Table(["joint", "its law", "between", "rows", "sha256 of the derived equations"], rows)
