"""Report of a law on a line (a beam): strains, stress resultants, virtual work, balance, linearised form."""

from __future__ import annotations

import hashlib
import re
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.reports.common import FormulaPage, described, title_of
from mbdae.reports.evaluate import Numbers, value
from mbdae.reports.letters import Letter, letters, name_vectors
from mbdae.reports.page import document
from mbdae.reports.pages.line_states import LineState
from mbdae.reports.printed import Check, Printed, Wanted
from mbdae.reports.states import POINTS, STEP
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
    Base("y", "b"): (r"\mathbf{d}_2", "1", "axis 2 of the section"),
    Base("z", "b"): (r"\mathbf{d}_3", "1", "axis 3 of the section"),
    Base("v", "b"): (r"\mathbf{v}", "m/s", "velocity of the axis"),
    Base("drs", "b"): (r"\delta\mathbf{r}'", "1", "virtual change of $\\mathbf{r}'$"),
    Base("dpsi", "b"): (r"\delta\boldsymbol{\psi}", "rad", "virtual rotation of the section"),
    Base("dpsis", "b"): (r"\delta\boldsymbol{\psi}'", "rad/m", "its derivative by the reference length"),
    Base("ns", "b"): (r"\mathbf{n}'", "N/m", "derivative of the force of the section"),
    Base("ms", "b"): (r"\mathbf{m}'", "N", "derivative of the moment of the section"),
    Base("load", "b"): (r"\bar{\mathbf{f}}", "N/m", "load per reference length"),
}
CONVENTION = (
    "A prime is the derivative by the length $s$ of the reference curve; $\\delta\\mathbf{d}_i ="
    " \\delta\\boldsymbol{\\psi}\\times\\mathbf{d}_i$, $\\mathbf{d}_i' ="
    " \\boldsymbol{\\kappa}\\times\\mathbf{d}_i$ with $\\boldsymbol{\\kappa} = \\sum_i \\kappa_i\\,\\mathbf{d}_i$."
)


class LineWriter(Writer):
    """Writes the vectors of a line."""

    @staticmethod
    def plain(base: Base) -> str:
        return f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else _BASES[base][0]


class LinePage(FormulaPage):
    """A law stated at a point of a line."""

    def __init__(self, law: type[LineLaw], structure: Structure) -> None:
        self.cls, self.structure, self.law, self.record = law, structure, law.symbolic(structure), Record()
        self.d: LineDerived = derive_line(law, structure, NodeKind.SPATIAL)
        self.flat: LineDerived = derive_line(law, structure, NodeKind.PLANAR)
        K, W = (Vec(*(se.Symbol(f"{name}{i + 1}") for i in range(3))) for name in ("kappa", "spin"))
        self.a = {base.kind: Vector(self.record, {base: se.Integer(1)}) for base in _BASES}
        axes = (self.a["x"], self.a["y"], self.a["z"])
        self.x: Any = LinePoint(NodeKind.SPATIAL, self.a["r"], self.a["rs"], axes, K, self.a["v"], W, ())
        self.known = letters(law, structure, self.law)
        self._letters()
        self.strains = {name: se.sympify(e) for name, e in self.law.strains(self.x).items()}
        for name in self.strains:
            unit = "N" if name.startswith("N") else "N m"
            self.known[name] = Letter(f"{name[0]}_{{{name[1:]}}}", unit, f"stress resultant {name}, in the axes of the section")
        self.writer = LineWriter(self.record, {n: letter.latex for n, letter in self.known.items()}, name_vectors(self.record))
        self.state, self.wanted = LineState(np.random.default_rng(9), self.law), dict[str, Wanted]()
        kinds = enumerate(("ns", "ms", "load", "v"))
        self.random = {kind: np.random.default_rng(i).normal(size=(POINTS, 3)) for i, kind in kinds}

    def _letters(self) -> None:
        for name, spec in self.law.params.items():
            head, _, which = name.partition("_")
            if head in ("compliance", "reference") and which:
                latex = f"{'C' if head == 'compliance' else chr(92) + 'varepsilon'}_{{{which}}}"
                self.known[name] = Letter(latex, spec.unit, spec.meaning)
        for i in range(3):
            what = "twist" if i == 0 else f"curvature about axis {i + 1}"
            self.known[f"kappa{i + 1}"] = Letter(f"\\kappa_{i + 1}", "1/m", what)
            self.known[f"spin{i + 1}"] = Letter(f"\\Omega_{i + 1}", "rad/s", f"angular velocity about axis {i + 1}")

    def want(self, latex: str, values: Any, source: str) -> None:
        """The values a printed symbol must have."""
        self.wanted[latex] = Wanted(values, source)

    def symbols(self) -> Table:
        """Every symbol, with unit and meaning."""
        rows = [Letter(*letter).row for base, letter in _BASES.items() if base in self.writer.bases]
        rows += [self.known[n].row for n in sorted(self.writer.used)]
        if any(base.kind == "E" for base in self.writer.bases):
            rows.append([r"$\mathbf{i}_x,\ \mathbf{i}_y,\ \mathbf{i}_z$", "1", "inertial axes"])
        return Table(["symbol", "unit", "meaning"], rows)

    def printed(self, blocks: list[Block]) -> list[Check]:
        """The equations of numbered blocks, read back."""
        known: dict[str, Any] = {letter.latex: (lambda name=name: self.symbol(name)) for name, letter in self.known.items()}
        known |= {latex: (lambda base=base: self.atom(base)) for base, (latex, *_) in _BASES.items()}
        known |= {rf"\mathbf{{i}}_{a}": np.broadcast_to(e, (POINTS, 3)) for a, e in zip("xyz", np.eye(3), strict=True)}
        return Printed({k: v for k, v in known.items() if k not in self.wanted}, self.wanted).read(blocks)

    def symbol(self, name: str) -> Any:
        """Values of a scalar."""
        if name.startswith("rate_"):
            moved = self.state.moving()
            return np.imag(Numbers(self.record, moved.atom, moved.symbol).scalar(self.strains[name.removeprefix("rate_")])) / STEP
        if name.startswith("spin"):
            return np.random.default_rng(int(name[-1])).normal(size=POINTS)
        return self.state.symbol(name)

    def atom(self, base: Base) -> Any:
        """Values of a vector (points, 3)."""
        moved = {"drs": self.state.dr, "dpsi": self.state.dpsi, "dpsis": self.state.dpsi_s} | self.random
        return moved[base.kind] if base.kind in moved else self.state.atom(base)

    def numbers(self) -> Numbers:
        """Values of formulas."""
        return Numbers(self.record, self.atom, self.symbol)

    # -- sections

    def blocks(self) -> list[Block]:
        """Strains, resultants, virtual work, balance, load, inertia."""
        found = [*(self.strain() if self.strains else []), *self.loads(), *self.inertia()]
        kept, gone = ", ".join(self.flat.stresses) or "none", ", ".join(self.flat.vanished) or "none"
        text = f"In the plane z = 0 stress resultants {kept} remain; {gone} vanish identically and are left out."
        return [*found, Section("Planar form", [Paragraph(text)])]

    def strain(self) -> list[Section]:
        """Strains, their stress resultants, virtual work and balance."""
        w, lines, resultants = self.writer, [], []
        for i, (name, e) in enumerate(self.strains.items()):
            given, row = self.state.given, se.sympify(self.d.rows[i])
            moving, still = (value(row, state.get) / given["weight"] for state in (self.state, self.state.at_rest()))
            self.want(f"\\gamma_{{{name}}}", still + given[f"reference_{name}"] + given[f"compliance_{name}"] * given[name],
                      "the compatibility row that is integrated, at rest")  # fmt: skip
            self.want(f"g_{{{name}}}", moving, "the compatibility row that is integrated")
            lines.append(f"\\gamma_{{{name}}} = {w.scalar(e)}")
            rate = f" + {self._letter('damping')}\\,\\dot\\gamma_{{{name}}}" if "damping" in self.known else ""
            start = f" - {self._letter(f'reference_{name}')}" if f"reference_{name}" in self.known else ""
            stress = f"{self._letter(f'compliance_{name}')}\\,{self._letter(name)}"
            resultants.append(f"g_{{{name}}} = \\gamma_{{{name}}}{start}{rate} - {stress} = 0")
            self.known[f"rate_{name}"] = Letter(f"\\dot\\gamma_{{{name}}}", "", f"rate of the strain of {name}")
            w.used |= {f"rate_{name}"} if rate else set()
        text = "Strain measures, one for each stress resultant:"
        further = (
            "Stress resultants are unknowns, each with the row $g = 0$. A compliance of zero is allowed:"
            " the strain is then a constraint and the resultant its multiplier."
        )
        return [Section("Strain measures", [Paragraph(text), *self.lines(*lines)]),
                Section("Stress resultants", [*self.lines(*resultants), Paragraph(further)]), *self.balance()]  # fmt: skip

    def _letter(self, name: str) -> str:
        self.writer.used.add(name)
        return self.known[name].latex

    @cached_property
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
        """Virtual work of the stress resultants, and what follows by parts."""
        w, record = self.writer, self.record
        work, sums = se.Integer(0), [record.zero()] * 3
        for name, parts in self.variations.items():
            change = sum((part @ self.a[kind] for part, kind in zip(parts, ("drs", "dpsi", "dpsis"), strict=True)), se.Integer(0))
            work += se.Symbol(name) * change
            sums = [total + part * se.Symbol(name) for total, part in zip(sums, parts, strict=True)]
        letters = (r"\mathbf{n}", r"\mathbf{q}", r"\mathbf{m}")
        self.want(r"\delta W", self._work(), "the forces that are integrated, along a virtual displacement of the fields")
        lines = [rf"\delta W = {w.scalar(work)}"]
        moves = [w.vector(self.a[kind]) for kind in ("drs", "dpsi", "dpsis")]
        lines.append("= " + " + ".join(rf"{x}\cdot {move}" for x, move in zip(letters, moves, strict=True)))
        lines += [f"{letter} = {w.vector(total)}" for letter, total in zip(letters, sums, strict=True)]
        force, moment = self._strong([self.numbers().vector(total) for total in sums])
        by_parts = "the virtual work of smooth fields that vanish at the ends, by quadrature"
        self.want(r"\dot{\mathbf{p}}", force, by_parts)
        self.want(r"\dot{\mathbf{l}}", moment, by_parts)
        strong = [rf"\dot{{\mathbf{{p}}}} = {w.vector(self.a['ns'])} + {w.vector(self.a['load'])}",
                  rf"\dot{{\mathbf{{l}}}} = {w.vector(self.a['ms'])} - \mathbf{{q}}"]  # fmt: skip
        text = "Virtual work of the stress resultants per reference length, sorted by virtual displacements:"
        told = ("By parts, with the rates of momentum and angular momentum per length, the balance of the section follows. The"
                " elements integrate the virtual work with interpolated positions and quaternions.")  # fmt: skip
        blocks = [Paragraph(text), *self.lines(*lines), Paragraph(told), *self.lines(*strong)]
        return [Section("Virtual work and balance", blocks)]

    def _work(self) -> Any:
        """Virtual work of the derived forces dual to the fields, per reference length."""
        moved, total = self.state.changed(), np.zeros(POINTS)
        for field, e in self.d.duals:
            name = str(field.symbol)
            if name in moved.given and name in self.state.given:
                total = total + value(se.sympify(e), self.state.get) * np.imag(moved.given[name]) / STEP
        return total / self.state.given["weight"]

    def _strong(self, work: list[Any]) -> tuple[Any, Any]:
        """Rates of momentum and angular momentum for which the virtual work of bumps (1 - s^2) e vanishes."""
        n, q, m = work
        s, weights = np.polynomial.legendre.leggauss(4)
        bump, slope = 1 - s**2, -2 * s
        size = np.sum(weights * bump)
        grown = [a[:, None, :] + self.random[kind][:, None, :] * s[:, None] for a, kind in ((n, "ns"), (m, "ms"))]
        force, moment = (np.einsum("s,psi->pi", weights * slope, a) for a in grown)
        return self.random["load"] - force / size, -q - moment / size

    def loads(self) -> list[Section]:
        """Load per length."""
        load = self.record.lift(self.law.load(self.x))
        if not load.terms:
            return []
        text = "Force per reference length on the axis, N/m:"
        names = [f"r{i + 1}" for i in range(3)]
        found = {str(f.symbol): value(se.sympify(e), self.state.get) for f, e in self.d.duals}
        values = [-found[name] / self.state.given["weight"] if name in found else np.zeros(POINTS) for name in names]
        self.want(r"\mathbf{p}_f", np.stack([np.broadcast_to(v, (POINTS,)) for v in values], -1), "the force that is integrated")
        return [Section("Load", [Paragraph(text), *self.lines(rf"\mathbf{{p}}_f = {self.writer.vector(load)}")])]

    def inertia(self) -> list[Section]:
        """Kinetic energy per length and the momenta that follow."""
        kinetic, w, record = se.sympify(self.law.kinetic_energy(self.x)), self.writer, self.record
        if kinetic == 0:
            return []
        momentum, spin = record.zero(), record.zero()
        for symbol in sorted(kinetic.free_symbols, key=str):
            p = se.diff(kinetic, symbol)
            if symbol in record.dots:
                momentum = momentum + self.a["v"] * (2 * p)
            elif str(symbol).startswith("spin"):
                spin = spin + self.x.axes[int(str(symbol)[-1]) - 1] * p
        u = np.concatenate([self.random["v"], np.stack([self.symbol(f"spin{i}") for i in (1, 2, 3)], -1)], 1)
        mass = np.zeros((POINTS, 6, 6))
        for (i, j), e in self.d.mass.items():
            mass[:, i, j] = value(se.sympify(e), self.state.get)
        rates = np.einsum("pij,pj->pi", mass, u)
        self.want("T", np.sum(u * rates, -1) / 2, "the mass that is integrated")
        self.want(r"\mathbf{p}", rates[:, :3], "the mass that is integrated")
        axes = np.stack([self.state.atom(Base(a, "b")) for a in "xyz"], -1)
        self.want(r"\mathbf{l}", np.einsum("pij,pj->pi", axes, rates[:, 3:]), "the mass that is integrated")
        text = "Kinetic energy per reference length, J/m, with momentum and angular momentum per length:"
        lines = [f"T = {w.scalar(kinetic)}", rf"\mathbf{{p}} = {w.vector(momentum)}", rf"\mathbf{{l}} = {w.vector(spin)}"]
        return [Section("Inertia", [Paragraph(text), *self.lines(*lines)])]

    def origin(self) -> Section:
        """Hash of the derived equations."""
        parts = [f"{field.symbol}: {canonical(e)}" for field, e in self.d.duals] + [canonical(e) for e in self.d.rows]
        parts += [f"{place}: {canonical(e)}" for place, e in self.d.mass.items()]
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        text = (f"This report was made from the law object that is integrated, `{self.cls.__module__}.{self.cls.__qualname__}`."
                " The sha256 of its derived equations at a point in space is:")  # fmt: skip
        count = len(se.cse(self.d.outputs)[0]) + len(self.d.outputs)
        size = (f"At a point: {len(self.d.outputs)} outputs of {len(self.d.variables)} variables, {count} operations after common"
                " subexpressions.")  # fmt: skip
        return Section("Origin", [Paragraph(text), Paragraph(f"`{digest}`"), Paragraph(size)])


class LinearPage(FormulaPage):
    """Small displacements of a straight line along axis 1."""

    def __init__(self, of: LinePage) -> None:
        self.of, self.own = of, []
        rng = np.random.default_rng(12)
        self.state = LineState(rng, of.law)
        still = {f"{n}{end}": np.zeros(POINTS) for n in ("r1", "r2", "r3", "P2", "P3", "P4") for end in ("", "_xi")}
        self.state.given |= still | {"P1": np.ones(POINTS), "P1_xi": np.zeros(POINTS), "r1_xi": self.state.given["ds"]}
        self.known = {f"u_{i + 1}'": self.state.dr[:, i] for i in range(3)}
        self.known |= {f"\\theta_{i + 1}": self.state.dpsi[:, i] for i in range(3)}
        self.known |= {f"\\theta_{i + 1}'": self.state.dpsi_s[:, i] for i in range(3)}

    def symbols(self) -> Table:
        """Displacements and small rotations."""
        rows = [Letter(r"u_1, u_2, u_3", "m", "small displacements").row,
                Letter(r"\theta_1, \theta_2, \theta_3", "rad", "small rotations").row]  # fmt: skip
        return Table(["symbol", "unit", "meaning"], rows)

    def printed(self, blocks: list[Block]) -> list[Check]:
        """The lines read back, against a complex step of the strains."""
        shifted = self.state.changed()
        m = Numbers(self.of.record, shifted.atom, shifted.symbol)
        slopes = {name: np.imag(m.scalar(e)) / STEP for name, e in self.of.strains.items()}
        wanted = {f"\\gamma_{{{name}}}": Wanted(slope, "a complex step of the strain") for name, slope in slopes.items()}
        return Printed(self.known, wanted).read(blocks)

    def blocks(self) -> list[Block]:
        """The strains to first order."""
        lines, numbers = [], Numbers(self.of.record, _straight, lambda s: 0.0)
        for name, parts in self.of.variations.items():
            terms = []
            for part, letter in zip(parts, ("u_{}'", "\\theta_{}", "\\theta_{}'"), strict=True):
                for i, c in enumerate(np.broadcast_to(numbers.vector(part), (3,))):
                    factor = "" if abs(abs(c) - 1) < 1e-12 else f"{abs(c):g}\\,"
                    terms += [f"{'-' if c < 0 else '+'} {factor}{letter.format(i + 1)}"] if abs(c) > 1e-12 else []
            text = re.sub("^- ", "-", " ".join(terms).removeprefix("+ "))
            lines.append(f"\\gamma_{{{name}}} \\approx {text or '0'}")
        told = (
            "About a straight line along axis 1 without stress, with displacements $u_i$ and small rotations $\\theta_i$"
            " (Timoshenko's beam; with rigid shear Euler and Bernoulli's):"
        )
        return [Section("Linearised form", [Paragraph(told), *self.lines(*lines)])]


def _straight(base: Base) -> Any:
    return np.eye(3)[{"x": 0, "y": 1, "z": 2, "rs": 0}.get(base.kind, 0)]


def line_report(law: type[LineLaw], structure: Structure) -> Document:
    """The report of a law on a line."""
    page = LinePage(law, structure)
    pages: list[tuple[Any, list[Block]]] = [(page, page.blocks())]
    if page.strains:
        linear = LinearPage(page)
        pages.append((linear, linear.blocks()))
    return document(title_of(law), described(law), pages, CONVENTION if page.strains else "", [page.origin()])
