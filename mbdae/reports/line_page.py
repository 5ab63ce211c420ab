"""Report of a law on a line (a beam): strains, stress resultants, virtual work, balance equations, linearised form."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.reports.law_page import inertial_axes
from mbdae.reports.letters import Letter, letters, name_vectors
from mbdae.reports.page import Page, described, document, made_from, title_of
from mbdae.reports.states import POINTS, STEP, FormulaValues, LineState, value
from mbdae.reports.vectors import Base, NamedQuantities, Vector
from mbdae.reports.writer import Writer
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LineDerived, LineLaw, LinePoint, derive_line
from mbdae.symbolic.outputs import canonical
from mbdae.symbolic.vectors import Vec

_BASES = {
    Base("r", "b"): (r"\mathbf{r}", "m", "position of the axis"),
    Base("rs", "b"): (r"\mathbf{r}'", "1", "derivative of $\\mathbf{r}$ by the reference length"),
    Base("x", "b"): (r"\mathbf{d}_1", "1", "axis 1 of the section, along the line as drawn"),
    Base("y", "b"): (r"\mathbf{d}_2", "1", "axis 2 of the section"),
    Base("z", "b"): (r"\mathbf{d}_3", "1", "axis 3 of the section"),
    Base("v", "b"): (r"\mathbf{v}", "m/s", "velocity of the axis"),
    Base("drs", "b"): (r"\delta\mathbf{r}'", "1", "virtual change of $\\mathbf{r}'$"),
    Base("dpsi", "b"): (r"\delta\boldsymbol{\psi}", "rad", "virtual rotation of the section"),
    Base("dpsis", "b"): (r"\delta\boldsymbol{\psi}'", "rad/m", "derivative of $\\delta\\boldsymbol{\\psi}$ by the length"),
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
    """LaTeX writer for the vectors of a line."""

    told = _BASES  #: of every vector LaTeX, unit and meaning

    def plain(self, base: Base) -> str:
        return f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else self.told[base][0]

    def rows(self) -> list[list[str]]:
        """Rows of a table of symbols for the vectors written so far."""
        axes = [[r"$\mathbf{i}_x,\ \mathbf{i}_y,\ \mathbf{i}_z$", "1", "inertial axes"]]
        rows = [Letter(*letter).row for base, letter in self.told.items() if base in self.bases]
        return [*rows, *(axes if any(base.kind == "E" for base in self.bases) else [])]


class LinePage(Page):
    """The page of a law stated at a point of a line."""

    writer: LineWriter

    def __init__(self, law: type[LineLaw], structure: Structure) -> None:
        self.cls, self.structure, self.law, self.record = law, structure, law.symbolic(structure), NamedQuantities()
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
        self.state, self.wanted = LineState(np.random.default_rng(9), self.law), dict[str, Any]()
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

    def written(self, elements: Sequence[tuple[Page, list[Block]]]) -> Document:
        """The whole report. elements: pages on what elements make of the law, with their blocks."""
        pages: list[tuple[Any, list[Block]]] = [(self, self.blocks())]
        if self.strains:
            linear = LinearPage(self)
            pages.append((linear, linear.blocks()))
        pages += elements
        convention = CONVENTION if self.strains else ""
        return document(title_of(self.cls), described(self.cls), pages, convention, [self._origin()])

    def symbols(self) -> list[list[str]]:
        return [*self.writer.rows(), *super().symbols()]

    def given(self) -> dict[str, Any]:
        known: dict[str, Any] = {letter.latex: (lambda name=name: self.symbol(name)) for name, letter in self.known.items()}
        known |= {latex: (lambda base=base: self.atom(base)) for base, (latex, *_) in _BASES.items()}
        return known | inertial_axes(POINTS)

    def symbol(self, name: str) -> Any:
        """Values of a scalar symbol (points,)."""
        if name.startswith("rate_"):
            moved = self.state.moving()
            values = FormulaValues(self.record, moved.atom, moved.symbol)
            return np.imag(values.scalar(self.strains[name.removeprefix("rate_")])) / STEP
        if name.startswith("spin"):
            return np.random.default_rng(int(name[-1])).normal(size=POINTS)
        return self.state.symbol(name)

    def atom(self, base: Base) -> Any:
        """Values of a vector (points, 3)."""
        moved = {"drs": self.state.dr, "dpsi": self.state.dpsi, "dpsis": self.state.dpsi_s} | self.random
        return moved[base.kind] if base.kind in moved else self.state.atom(base)

    # -- sections

    def blocks(self) -> list[Block]:
        """Sections: strains, resultants, virtual work, balance, load, inertia, planar form."""
        kept, gone = (", ".join(names) or "none" for names in (self.flat.stresses, self.flat.vanished))
        text = f"In the plane z = 0 stress resultants {kept} remain; {gone} vanish identically and are left out."
        strain = [*self._strain(), self._balance()] if self.strains else []
        return [*strain, *self._loads(), *self._inertia(), self.section("Planar form", text)]

    def _strain(self) -> list[Section]:
        """Sections on the strains and their stress resultants."""
        lines, resultants = [], []
        for i, (name, e) in enumerate(self.strains.items()):
            given, row = self.state.given, se.sympify(self.d.rows[i])
            moving, still = (value(row, state.get) / given["weight"] for state in (self.state, self.state.at_rest()))
            strain, row_ = still + given[f"reference_{name}"] + given[f"compliance_{name}"] * given[name], "the compatibility row"
            lines.append(self.line(f"\\gamma_{{{name}}}", e, strain, f"{row_} that is integrated, at rest"))
            self.want(f"g_{{{name}}}", moving, f"{row_} that is integrated")
            rate = f" + {self._letter('damping')}\\,\\dot\\gamma_{{{name}}}" if "damping" in self.known else ""
            start = f" - {self._letter(f'reference_{name}')}" if f"reference_{name}" in self.known else ""
            stress = f"{self._letter(f'compliance_{name}')}\\,{self._letter(name)}"
            resultants.append(f"g_{{{name}}} = \\gamma_{{{name}}}{start}{rate} - {stress} = 0")
            unit = "1/s" if name.startswith("N") else "1/(m s)"
            self.known[f"rate_{name}"] = Letter(f"\\dot\\gamma_{{{name}}}", unit, f"rate of the strain of {name}")
            self.writer.used |= {f"rate_{name}"} if rate else set()
        further = (
            "Stress resultants are unknowns, each with the row $g = 0$. A compliance of zero is allowed:"
            " the strain is then a constraint and the resultant its multiplier."
        )
        return [self.section("Strain measures", "Strain measures, one for each stress resultant:", *lines),
                Section("Stress resultants", [*self.lines(*resultants), Paragraph(further)])]

    def _letter(self, name: str) -> str:
        self.writer.used.add(name)
        return self.known[name].latex

    @cached_property
    def variations(self) -> dict[str, tuple[Vector, Vector, Vector]]:
        """For every strain the factors of delta r', delta psi and delta psi' in its variation."""
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

    @cached_property
    def resultants(self) -> list[Vector]:
        """The factors of delta r', delta psi and delta psi' in the virtual work of the stress resultants per length."""
        parts = [[part * se.Symbol(name) for part in each] for name, each in self.variations.items()]
        return [sum(of, self.record.zero()) for of in zip(*parts, strict=True)]

    def _balance(self) -> Section:
        """Virtual work of the stress resultants, and the balance equations that follow by partial integration."""
        w, record, sums = self.writer, self.record, self.resultants
        work = sum((se.Symbol(name) * (part @ self.a[kind]) for name, parts in self.variations.items()
                    for part, kind in zip(parts, ("drs", "dpsi", "dpsis"), strict=True)), se.Integer(0))
        letters = (r"\mathbf{n}", r"\mathbf{q}", r"\mathbf{m}")
        along = "the forces that are integrated, along a virtual displacement of the fields"
        lines = [self.line(r"\delta W'", work, self._work(), along)]
        moves = [w.vector(self.a[kind]) for kind in ("drs", "dpsi", "dpsis")]
        lines.append("= " + " + ".join(rf"{x}\cdot {move}" for x, move in zip(letters, moves, strict=True)))
        lines += [self.line(letter, total) for letter, total in zip(letters, sums, strict=True)]
        numbers = FormulaValues(record, self.atom, self.symbol)
        for letter, values in zip("pl", self._strong([numbers.vector(total) for total in sums]), strict=True):
            by_parts = "the virtual work of smooth fields that vanish at the ends, by quadrature"
            self.want(rf"\dot{{\mathbf{{{letter}}}}}", values, by_parts)
        strong = [rf"\dot{{\mathbf{{p}}}} = {w.vector(self.a['ns'])} + {w.vector(self.a['load'])}",
                  rf"\dot{{\mathbf{{l}}}} = {w.vector(self.a['ms'])} - \mathbf{{q}}"]
        text = "Virtual work of the stress resultants per reference length, sorted by virtual displacements:"
        told = ("By parts, with the rates of momentum and angular momentum per length, the balance of the section follows. The"
                " elements integrate the virtual work with interpolated positions and quaternions.")
        return Section("Virtual work and balance", [*self.told(text, *lines), *self.told(told, *strong)])

    def _work(self) -> Any:
        """Virtual work of the derived generalised forces of the fields, per reference length."""
        moved, total = self.state.changed(), np.zeros(POINTS)
        for field, e in self.d.duals:
            name = str(field.symbol)
            if name in moved.given and name in self.state.given:
                total = total + value(se.sympify(e), self.state.get) * np.imag(moved.given[name]) / STEP
        return total / self.state.given["weight"]

    def _strong(self, work: list[Any]) -> tuple[Any, Any]:
        """Rates of momentum and angular momentum per length for which the virtual work of test fields (1 - s^2) e vanishes."""
        n, q, m = work
        s, weights = np.polynomial.legendre.leggauss(4)
        bump, slope = 1 - s**2, -2 * s
        size = np.sum(weights * bump)
        grown = [a[:, None, :] + self.random[kind][:, None, :] * s[:, None] for a, kind in ((n, "ns"), (m, "ms"))]
        force, moment = (np.einsum("s,psi->pi", weights * slope, a) for a in grown)
        return self.random["load"] - force / size, -q - moment / size

    def _loads(self) -> list[Section]:
        load = self.record.lift(self.law.load(self.x))
        if not load.terms:
            return []
        found = {str(f.symbol): value(se.sympify(e), self.state.get) for f, e in self.d.duals}
        values = [np.broadcast_to(-found.get(f"r{i}", 0.0) / self.state.given["weight"], (POINTS,)) for i in (1, 2, 3)]
        line = self.line(r"\mathbf{p}_f", load, np.stack(values, -1), "the force that is integrated")
        return [self.section("Load", "Force per reference length on the axis, N/m:", line)]

    @cached_property
    def momenta(self) -> tuple[Vector, dict[str, Any]]:
        """Momentum per length, and the derivatives of the kinetic energy by the angular velocities."""
        kinetic, momentum, spins = se.sympify(self.law.kinetic_energy(self.x)), self.record.zero(), dict[str, Any]()
        for symbol in sorted(kinetic.free_symbols, key=str):
            p = se.diff(kinetic, symbol)
            if symbol in self.record.dots:
                momentum = momentum + self.a["v"] * (2 * p)
            elif str(symbol).startswith("spin"):
                spins[str(symbol)] = p
        return momentum, spins

    def _inertia(self) -> list[Section]:
        """Kinetic energy per length and the momenta derived from it."""
        kinetic, (momentum, spins) = se.sympify(self.law.kinetic_energy(self.x)), self.momenta
        if kinetic == 0:
            return []
        spin = sum((self.x.axes[int(name[-1]) - 1] * p for name, p in spins.items()), self.record.zero())
        u = np.concatenate([self.random["v"], np.stack([self.symbol(f"spin{i}") for i in (1, 2, 3)], -1)], 1)
        mass = np.zeros((POINTS, 6, 6))
        for (i, j), e in self.d.mass.items():
            mass[:, i, j] = value(se.sympify(e), self.state.get)
        rates = np.einsum("pij,pj->pi", mass, u)
        axes = np.stack([self.state.atom(Base(a, "b")) for a in "xyz"], -1)
        turning = np.einsum("pij,pj->pi", axes, rates[:, 3:])
        values = {"T": (kinetic, np.sum(u * rates, -1) / 2), r"\mathbf{p}": (momentum, rates[:, :3]),
                  r"\mathbf{l}": (spin, turning)}
        lines = [self.line(latex, *found, "the mass that is integrated") for latex, found in values.items()]
        text = "Kinetic energy per reference length, J/m, with momentum and angular momentum per length:"
        return [self.section("Inertia", text, *lines)]

    def _origin(self) -> Section:
        parts = [f"{field.symbol}: {canonical(e)}" for field, e in self.d.duals] + [canonical(e) for e in self.d.rows]
        parts += [f"{place}: {canonical(e)}" for place, e in self.d.mass.items()]
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        text = f"{made_from(self.cls)}. The sha256 of its derived equations at a point in space is:"
        return Section("Origin", [Paragraph(text), Paragraph(f"`{digest}`")])


class LinearPage(Page):
    """Strains of small displacements of a straight line along axis 1, compared with a complex step of the exact strains."""

    def __init__(self, of: LinePage) -> None:
        self.of = of
        self.state = LineState(np.random.default_rng(12), of.law)
        still = {f"{n}{end}": np.zeros(POINTS) for n in ("r1", "r2", "r3", "P2", "P3", "P4") for end in ("", "_xi")}
        self.state.given |= still | {"P1": np.ones(POINTS), "P1_xi": np.zeros(POINTS), "r1_xi": self.state.given["ds"]}
        shifted = self.state.changed()
        m = FormulaValues(of.record, shifted.atom, shifted.symbol)
        self.wanted = {}
        for name, e in of.strains.items():
            strain = np.asarray(m.scalar(e))
            self.want(f"\\gamma_{{{name}}}", np.real(strain) + np.imag(strain) / STEP, "the strain at rest and its complex step")

    def given(self) -> dict[str, Any]:
        fields = {"u_{}'": self.state.dr, "\\theta_{}": self.state.dpsi, "\\theta_{}'": self.state.dpsi_s}
        return {letter.format(i + 1): values[:, i] for letter, values in fields.items() for i in range(3)}

    def symbols(self) -> list[list[str]]:
        return [Letter(r"u_1, u_2, u_3", "m", "small displacements").row,
                Letter(r"\theta_1, \theta_2, \theta_3", "rad", "small rotations").row]

    def blocks(self) -> list[Block]:
        """Section with the strains to first order."""
        lines, numbers = [], FormulaValues(self.of.record, _straight, lambda s: 0.0)
        for name, parts in self.of.variations.items():
            start = float(numbers.scalar(self.of.strains[name]))
            terms = [f"{'-' if start < 0 else '+'} {abs(start):g}"] if start else []
            for part, letter in zip(parts, ("u_{}'", "\\theta_{}", "\\theta_{}'"), strict=True):
                for i, c in enumerate(np.broadcast_to(numbers.vector(part), (3,))):
                    factor = "" if abs(abs(c) - 1) < 1e-12 else f"{abs(c):g}\\,"
                    terms += [f"{'-' if c < 0 else '+'} {factor}{letter.format(i + 1)}"] if abs(c) > 1e-12 else []
            text = re.sub("^- ", "-", " ".join(terms).removeprefix("+ "))
            lines.append(f"\\gamma_{{{name}}} \\approx {text or '0'}")
        told = ("About a straight line along axis 1 without stress, with displacements $u_i$ and small rotations $\\theta_i$"
                " (Timoshenko's beam; with rigid shear Euler and Bernoulli's):")
        return [self.section("Linearised form", told, *lines)]


def _straight(base: Base) -> Any:
    return np.eye(3)[{"x": 0, "y": 1, "z": 2, "rs": 0}.get(base.kind, 0)]
