"""Report of a law on a line (a beam): strains, stress resultants, balance, linearised form."""

from __future__ import annotations

import hashlib
import re
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.reports.common import Check, checks_table, described, title_of
from mbdae.reports.evaluate import Numbers, value
from mbdae.reports.letters import Letter, letters, name_vectors
from mbdae.reports.line_states import LineState
from mbdae.reports.states import POINTS, STEP, residual
from mbdae.reports.vectors import Base, Record, Vector
from mbdae.reports.writer import Writer
from mbdae.symbolic.fingerprint import canonical
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LineDerived, LineLaw, LinePoint, derive_line
from mbdae.symbolic.vectors import Vec

_BASES = {
    Base("r", "b"): (r"\mathbf{r}", "m", "position of the axis"),
    Base("rs", "b"): (r"\mathbf{r}'", "1", "its derivative by the reference length"),
    Base("x", "b"): (r"\mathbf{d}_1", "1", "axis 1 of the section, along the line as drawn"),
    Base("y", "b"): (r"\mathbf{d}_2", "1", "axis 2"),
    Base("z", "b"): (r"\mathbf{d}_3", "1", "axis 3"),
    Base("v", "b"): (r"\mathbf{v}", "m/s", "velocity of the axis"),
}


class LineWriter(Writer):
    """Writes the vectors of a line."""

    @staticmethod
    def plain(base: Base) -> str:
        return f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else _BASES[base][0]


class LineReport:
    """A law stated at a point of a line."""

    def __init__(self, law: type[LineLaw], structure: Structure) -> None:
        self.cls, self.structure, self.law, self.record = law, structure, law.symbolic(structure), Record()
        self.d: LineDerived = derive_line(law, structure, NodeKind.SPATIAL)  # type: ignore[arg-type]
        self.flat: LineDerived = derive_line(law, structure, NodeKind.PLANAR)  # type: ignore[arg-type]
        K, W = (Vec(*(se.Symbol(f"{name}{i + 1}") for i in range(3))) for name in ("kappa", "spin"))
        atoms = {base.kind: Vector(self.record, {base: se.Integer(1)}) for base in _BASES}
        axes = (atoms["x"], atoms["y"], atoms["z"])
        self.x: Any = LinePoint(NodeKind.SPATIAL, atoms["r"], atoms["rs"], axes, K, atoms["v"], W, ())
        self.known = letters(law, structure, self.law)
        for name, spec in law.params.items():
            head, _, which = name.partition("_")
            if head in ("compliance", "reference") and which:
                latex = f"{'C' if head == 'compliance' else chr(92) + 'varepsilon'}_{{{which}}}"
                self.known[name] = Letter(latex, spec.unit, spec.meaning)
        for i in range(3):
            self.known[f"kappa{i + 1}"] = Letter(
                f"\\kappa_{i + 1}", "1/m", "twist" if i == 0 else f"curvature about axis {i + 1}"
            )
            self.known[f"spin{i + 1}"] = Letter(f"\\Omega_{i + 1}", "rad/s", f"angular velocity about axis {i + 1}")
        self.strains = {name: se.sympify(e) for name, e in self.law.strains(self.x).items()}
        for name in self.strains:
            unit = "N" if name.startswith("N") else "N m"
            self.known[name] = Letter(
                f"{name[0]}_{{{name[1:]}}}", unit, f"stress resultant {name}, a force or moment of the section in its axes"
            )
        self.load = self.record.lift(self.law.load(self.x))
        self.kinetic = se.sympify(self.law.kinetic_energy(self.x))
        self.writer = LineWriter(self.record, {n: letter.latex for n, letter in self.known.items()}, name_vectors(self.record))
        self.checks: list[Check] = []

    def document(self) -> Document:
        """The whole report."""
        sections = [*self.strain(), *self.balance(), *self.linear(), *self.loads(), *self.inertia(), self.plane()]
        self.check_strains()
        w = self.writer
        rows = [Letter(*letter).row for base, letter in _BASES.items() if base in w.bases]
        rows += [self.known[n].row for n in sorted(w.used)]
        if any(base.kind == "E" for base in w.bases):
            rows.append([r"$\mathbf{i}_x,\ \mathbf{i}_y,\ \mathbf{i}_z$", "1", "inertial axes"])
        symbols = Section(
            "Symbols",
            [
                Table(["symbol", "unit", "meaning"], rows),
                Paragraph(
                    "A prime is the derivative by the length $s$ of the reference curve; $\\delta\\mathbf{d}_i ="
                    " \\delta\\boldsymbol{\\psi}\\times\\mathbf{d}_i$, $\\mathbf{d}_i' ="
                    " \\boldsymbol{\\kappa}\\times\\mathbf{d}_i$ with $\\boldsymbol{\\kappa} = \\sum_i"
                    " \\kappa_i\\,\\mathbf{d}_i$."
                ),
            ],
        )
        checked = [Section("Numeric check", checks_table(self.checks, POINTS))] if self.checks else []
        return Document(title_of(self.cls), [*described(self.cls), symbols, *sections, *checked, self.origin()])

    def strain(self) -> list[Section]:
        """Strains and their stress resultants."""
        if not self.strains:
            return []
        w, lines = self.writer, []
        for name, e in self.strains.items():
            lines.append(f"\\gamma_{{{name}}} = {w.scalar(e)}")
        text = "Strain measures, one for each stress resultant; those of the reference curve are subtracted:"
        resultants = []
        for name in self.strains:
            w.used.add(name)
            reference = f" - {self._letter(f'reference_{name}')}" if f"reference_{name}" in self.known else ""
            lag = f" + {self._letter('damping')}\\,\\dot\\gamma_{{{name}}}" if "damping" in self.known else ""
            resultants.append(
                f"{self._letter(f'compliance_{name}')}\\,{self.known[name].latex} = \\gamma_{{{name}}}{reference}{lag}"
            )
        further = (
            "Stress resultants are unknowns, each with the equation above as its row. A compliance of zero is allowed:"
            " the strain is then a constraint and the resultant its multiplier."
        )
        return [
            Section("Strain measures", [Paragraph(text), Equation(" \\\\ ".join(lines))]),
            Section("Stress resultants", [Equation(" \\\\ ".join(resultants)), Paragraph(further)]),
        ]

    def _letter(self, name: str) -> str:
        self.writer.used.add(name)
        return self.known[name].latex

    def variations(self) -> dict[str, tuple[Vector, Vector, Vector]]:
        """For every strain the vectors that multiply delta r', delta psi and delta psi' in its variation."""
        found = {}
        for name, e in self.strains.items():
            move, turn, slope = self.record.zero(), self.record.zero(), self.record.zero()
            for symbol in sorted(e.free_symbols, key=str):
                p = se.diff(e, symbol)
                if symbol in self.record.dots:
                    for one, other in (self.record.dots[symbol], self.record.dots[symbol][::-1]):
                        dual = Vector(self.record, {other: p})
                        if one == Base("rs", "b"):
                            move = move + dual
                        else:
                            turn = turn - dual.cross(Vector(self.record, {one: se.Integer(1)}))
                elif str(symbol).startswith("kappa"):
                    slope = slope + self.x.axes[int(str(symbol)[-1]) - 1] * p
            found[name] = (move, turn, slope)
        return found

    def balance(self) -> list[Section]:
        """Virtual work and the strong form."""
        if not self.strains:
            return []
        w, rows = self.writer, []
        for name, parts in self.variations().items():
            rows.append([f"$\\delta\\gamma_{{{name}}}$", *(f"${w.vector(part)}$" for part in parts)])
        head = [
            "variation",
            r"$\cdot\,\delta\mathbf{r}'$",
            r"$\cdot\,\delta\boldsymbol{\psi}$",
            r"$\cdot\,\delta\boldsymbol{\psi}'$",
        ]
        text = (
            "With $\\mathbf{n} = \\sum N_i\\,\\mathbf{d}_i$ and $\\mathbf{m} = \\sum M_i\\,\\mathbf{d}_i$ the virtual work of the"
            " section is $\\mathbf{n}\\cdot(\\delta\\mathbf{r}' - \\delta\\boldsymbol{\\psi}\\times\\mathbf{r}') +"
            " \\mathbf{m}\\cdot\\delta\\boldsymbol{\\psi}'$; by parts the balance of forces and moments of the section follows,"
            " with $\\bar{\\mathbf{f}}$ the load and $\\mathbf{l}$ the angular momentum per length:"
        )
        return [
            Section(
                "Balance",
                [
                    Table(head, rows, "Variation of every strain, coordinate-free"),
                    Paragraph(text),
                    Equation(
                        r"\mathbf{n}' + \bar{\mathbf{f}} = \rho_A\,\ddot{\mathbf{r}} \\ \mathbf{m}' + \mathbf{r}'\times\mathbf{n}"
                        r" = \dot{\mathbf{l}}"
                    ),
                    Paragraph(
                        "The elements integrate the virtual work with interpolated positions and quaternions: their forces are"
                        " derivatives of an energy, so that energy and angular momentum are kept."
                    ),
                ],
            )
        ]

    def linear(self) -> list[Section]:
        """Small displacements of a straight line along x."""
        if not self.strains:
            return []
        lines = []
        for name, (move, turn, slope) in self.variations().items():
            terms = []
            for part, letter in ((move, "u_{}'"), (turn, "\\theta_{}"), (slope, "\\theta_{}'")):
                numbers = Numbers(self.record, _straight, lambda s: 0.0)
                for i in range(3):
                    c = float(np.broadcast_to(numbers.vector(part), (3,))[i])
                    if abs(c) > 1e-12:
                        sign = "-" if c < 0 else "+"
                        factor = "" if abs(abs(c) - 1) < 1e-12 else f"{abs(c):g}\\,"
                        terms.append(f"{sign} {factor}{letter.format(i + 1)}")
            text = re.sub("^- ", "-", " ".join(terms).removeprefix("+ "))
            lines.append(f"\\gamma_{{{name}}} \\approx {text or '0'}")
        told = (
            "About a straight line along axis 1 without stress, with displacements $u_i$ and small rotations $\\theta_i$"
            " (Timoshenko's beam; with rigid shear Euler and Bernoulli's):"
        )
        return [Section("Linearised form", [Paragraph(told), Equation(" \\\\ ".join(lines))])]

    def loads(self) -> list[Section]:
        """Load per length."""
        if not self.load.terms:
            return []
        return [
            Section(
                "Load",
                [
                    Paragraph("Force per reference length on the axis, N/m:"),
                    Equation(f"\\bar{{\\mathbf{{f}}}} = {self.writer.vector(self.load)}"),
                ],
            )
        ]

    def inertia(self) -> list[Section]:
        """Kinetic energy per length."""
        if self.kinetic == 0:
            return []
        return [
            Section(
                "Inertia",
                [Paragraph("Kinetic energy per reference length, J/m:"), Equation(f"T = {self.writer.scalar(self.kinetic)}")],
            )
        ]

    def plane(self) -> Section:
        """Stress resultants that remain in the plane."""
        kept, gone = ", ".join(self.flat.stresses) or "none", ", ".join(self.flat.vanished) or "none"
        return Section(
            "Planar form",
            [Paragraph(f"In the plane z = 0 stress resultants {kept} remain; {gone} vanish identically and are left out.")],
        )

    # -- checks

    def check_strains(self) -> None:
        """Strains against the derived rows, their variation against a complex step through the quaternions."""
        if not self.strains:
            return
        state = LineState(np.random.default_rng(9), self.law)
        for i, (name, e) in enumerate(self.strains.items()):
            n = Numbers(self.record, state.atom, state.symbol)
            row = value(se.sympify(self.d.rows[i]), state.get)
            wanted = state.given["weight"] * (
                n.scalar(e) - state.given[f"reference_{name}"] - state.given[f"compliance_{name}"] * state.given[name]
            )
            self.checks.append(Check(f"compatibility row of {name}, as integrated", residual(row, wanted)))
        for name, (move, turn, slope) in self.variations().items():
            n = Numbers(self.record, state.atom, state.symbol)
            shifted = state.changed()
            m = Numbers(self.record, shifted.atom, shifted.symbol)
            got = np.imag(m.scalar(self.strains[name])) / STEP
            formula = [
                np.sum(np.broadcast_to(n.vector(part), (POINTS, 3)) * change, axis=-1)
                for part, change in zip((move, turn, slope), (state.dr, state.dpsi, state.dpsi_s), strict=True)
            ]
            self.checks.append(Check(f"variation of the strain of {name} by moving the section", residual(sum(formula), got)))

    def origin(self) -> Section:
        """Hash of the derived equations."""
        parts = [f"{field.symbol}: {canonical(e)}" for field, e in self.d.duals] + [canonical(e) for e in self.d.rows]
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        blocks: list[Block] = [
            Paragraph(
                f"This report was made from the law object that is integrated, `{self.cls.__module__}.{self.cls.__qualname__}`."
                " The sha256 of its derived equations at a point in space is:"
            ),
            Paragraph(f"`{digest}`"),
            Paragraph(
                f"At a point: {len(self.d.outputs)} outputs of {len(self.d.variables)} variables,"
                f" {len(se.cse(self.d.outputs)[0]) + len(self.d.outputs)} operations after common subexpressions."
            ),
        ]
        return Section("Origin", blocks)


def _straight(base: Base) -> Any:
    return np.eye(3)[{"x": 0, "y": 1, "z": 2, "rs": 0}.get(base.kind, 0)]


def line_report(law: type[LineLaw], structure: Structure) -> Document:
    """The report of a law on a line."""
    return LineReport(law, structure).document()
