"""Report of a joint in the recursive formulation: the recursion over a tree, executed with vectors instead of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.errors import LawError
from mbdae.laws.joints import Prismatic, Revolute
from mbdae.reports.calculus import ForwardDerivative, inserted
from mbdae.reports.letters import effort_unit
from mbdae.reports.page import BOTH, document, row_name, short_hash, title_of
from mbdae.reports.recursive_values import MATRIX, ORACLE, TREE, RecursiveValues
from mbdae.reports.sections import chain, motion_in
from mbdae.reports.statement import ReportedLaw, structure_of
from mbdae.reports.vectors import Base, Vector
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.vectors import Expr

INTRODUCED = (
    "Without rows and multipliers the coordinates are the only unknowns of body l: its state follows from that of k, outwards,"
    " and the forces on it are passed on to k and to the equations of the coordinates, inwards. These lines are the program that"
    " is integrated, run with vectors. All forces on l but those of the joint stand on the left-hand side:"
    " $\\mathbf{F}_l, \\mathbf{M}_l$ at its centre."
)


VELOCITIES = [r"\dot{\mathbf{c}}_l", r"\boldsymbol{\omega}_l"]
ACCELERATIONS = [r"\ddot{\mathbf{c}}_l", r"\dot{\boldsymbol{\omega}}_l"]
FORCES, BIAS = [r"\mathbf{F}_l", r"\mathbf{M}_l"], r"\mathbf{a}_0"


class RecursivePage(RecursiveValues):
    """Page of one joint in the recursive formulation."""

    # -- sections

    def blocks(self) -> list[Block]:
        """Sections: motion outwards, forces inwards, map, mass and bias, geometric stiffness."""
        parts = {"Motion outwards": self._outwards, "Forces inwards": self._inwards, "Map, mass and bias": self._map,
                 "Geometric stiffness of the recursion": self._stiffness}
        return [Paragraph(INTRODUCED), *(Section(title, make()) for title, make in parts.items())]

    def _outwards(self) -> list[Block]:
        """Position, attitude, velocity and acceleration of l from those of k and the coordinates."""
        t, l, lines = self.tree, self.tree.l, list[str]()
        if t.reached and not any(step.rotation for step in self.motion.steps):
            lines += [self.line(rf"\mathbf{{{name}}}_l", a) for name, a in zip("xyz", t.reached, strict=True)]
            self.writer.bases |= {Base(name, "l") for name in "xyz"}
        for latex, e in ((r"\mathbf{c}_l", l.r), (r"\boldsymbol{\omega}_l", t.spins[0]), (r"\dot{\mathbf{c}}_l", l.v),
                         (r"\dot{\boldsymbol{\omega}}_l", t.spins[1]), (r"\ddot{\mathbf{c}}_l", l.a)):
            lines.append(self.line(latex, self.s.record.lift(e)))
        self.want(r"\dot{\boldsymbol{\omega}}_l", np.einsum("pij,pj->pi", self.Rl, self.upl[:, 3:]))
        self.want(r"\ddot{\mathbf{c}}_l", self.upl[:, :3])
        self.writer.bases |= {Base(kind, "l") for kind in ("c", "w", "vc", "ac", "al")}
        return [*chain(self.motion, self, list(self.s.law.coordinates)), *self.lines(*lines)]

    @cached_property
    def motion(self) -> Any:
        """The joint's motion in the symbols of its coordinates."""
        return motion_in(self.s)

    @cached_property
    def efforts(self) -> list[tuple[str, Expr, str]]:
        """Letter, row and unit for every coordinate, and for every component of a free rotation."""
        found = []
        for number, name in enumerate(self.tree.link.coordinates, 1):
            unit = effort_unit(self.s.law.coordinates[name].unit)
            for place, e in self.tree.force.items():
                if place[0] == -number:
                    below = row_name(name) + (f" {place[1] + 1}" if name in self.s.turning else "")
                    found.append((f"\\bar r_{{\\text{{{below}}}}}", e, unit))
        return found

    def _inwards(self) -> list[Block]:
        """Force and moment passed on to k, and the equations of the coordinates."""
        (F, N), rows = self.tree.root, self.rows()
        lines = [self.line(r"\bar{\mathbf{F}}_k", F, rows[:, :3], TREE), self.line(r"\bar{\mathbf{M}}_k", N, rows[:, 3:6], TREE)]
        lines += [self.line(latex, e, rows[:, 6 + i], TREE, unit) for i, (latex, e, unit) in enumerate(self.efforts)]
        text = (
            "They add to the equations of k, at its centre, and are the equation $\\bar r = 0$ of each coordinate; springs,"
            " dampers and loads of the coordinate add to it. The joint carries the force and the moment that are passed on."
        )
        return [*self.lines(*lines), Paragraph(text)]

    @cached_property
    def rates(self) -> list[tuple[Expr, Expr]]:
        """Symbols of the rates and of the virtual changes of the coordinates, component by component."""
        found = []
        for name, side in self.s.places.items():
            if name in self.s.turning:
                found += [(se.Symbol(f"{side}_W{i}"), se.Symbol(f"d{side}_W{i}")) for i in "123"]
            else:
                symbol = self.s.coordinates[name]
                found.append((self.s.clock[symbol], self.s.virtual[symbol]))
        return found

    def _map(self) -> list[Block]:
        """Map B from velocities of k and coordinates to those of l, its effect on forces and mass, and the bias acceleration."""
        w, record, t = self.writer, self.s.record, self.tree
        zero, spin = record.zero(), Base("w", "l")
        v, d = inserted(t.l.v, {spin: t.spins[0]}, {}), (t.l.r - record.atom("c", "k"))
        slopes = [ForwardDerivative(record, lambda _: None, {rate: se.Integer(1)}, rf"\partial_{{{i + 1}}}")
                  for i, (rate, _) in enumerate(self.rates)]
        columns = [(slope.vector(v), slope.vector(t.spins[0])) for slope in slopes]
        below = [f"_{{{i + 1}}}" if len(columns) > 1 else "" for i in range(len(columns))]
        lines = [self.line(r"\mathbf{h}", d)]
        for i, pair in zip(below, columns, strict=True):
            lines += [self.line(rf"\mathbf{{{letter}}}{i}", a) for letter, a in zip("tj", pair, strict=True)]
        starts = {"t": r"\mathbf{1} & -\tilde{\mathbf{h}}", "j": r"\mathbf{0} & \mathbf{1}"}
        cells = [" & ".join([start, *(rf"\mathbf{{{letter}}}{i}" for i in below)]) for letter, start in starts.items()]
        bias = {Base("al", "l"): inserted(t.spins[1], *self._still(zero)).named(r"\boldsymbol{\alpha}_0")}
        atoms, symbols = self._still(zero)
        at_rest = inserted(t.l.a, atoms | bias, symbols)
        speeds = [r"\dot{\mathbf{c}}_k", r"\boldsymbol{\omega}_k", *(w.scalar(rate) for rate, _ in self.rates)]
        seconds = [r"\ddot{\mathbf{c}}_k", r"\dot{\boldsymbol{\omega}}_k", *map(w.scalar, self._seconds())]
        rows = [r"\bar{\mathbf{F}}_k", r"\bar{\mathbf{M}}_k", *(latex for latex, _, _ in self.efforts)]
        alpha = w.vector(bias[Base("al", "l")])
        product = [
            rf"\mathbf{{B}} = {matrix(cells)}",
            rf"{matrix(VELOCITIES)} = \mathbf{{B}}\,{matrix(speeds)}",
            rf"{matrix(ACCELERATIONS)} = \mathbf{{B}}\,{matrix(seconds)} + {matrix([BIAS, alpha])}",
            self.line(r"\mathbf{a}_0", at_rest),
            rf"{matrix(rows)} = \mathbf{{B}}^{{\mathsf{{T}}}}\,{matrix(FORCES)}",
        ]
        self.wanted |= dict.fromkeys([matrix(VELOCITIES), matrix(ACCELERATIONS), matrix(rows)], BOTH)
        self._want_mass()
        self.known["mass"] = MATRIX
        w.used.add("mass")
        text = ("Velocities and accelerations of l are linear in those of k and of the coordinates; the bias is the acceleration"
                " of l that remains where theirs are zero:")
        mass = r"\bar{\mathbf{M}} = \mathbf{B}^{\mathsf{T}}\,\mathbf{M}\,\mathbf{B}"
        told = "The mass of l, passed on in the same way:"
        return [*self.told(text, *lines, *product), Paragraph(told), Equation(mass)]

    def _still(self, zero: Vector) -> tuple[dict[Base, Vector], dict[Expr, Expr]]:
        """Tables that replace the accelerations of k and of the coordinates by zero."""
        return {Base("ac", "k"): zero, Base("al", "k"): zero}, {symbol: se.Integer(0) for symbol in self._seconds()}

    def _seconds(self) -> list[Expr]:
        found = []
        for name, side in self.s.places.items():
            turns = name in self.s.turning
            found += [se.Symbol(f"{side}_Wp{i}") for i in "123"] if turns else [self.tree.second(name)]
        return found

    def _stiffness(self) -> list[Block]:
        """Change of the force and moment passed on, at constant force and moment on l."""
        rule, (F, N), values = self.s.variation, self.tree.root, self._varied()
        changes = [(rf"\delta\bar{{\mathbf{{{letter}}}}}_k", rule.vector(a), values[:, n : n + 3], "")
                   for letter, a, n in (("F", F, 0), ("M", N, 3))]
        changes += [(rf"\delta {latex}", rule.scalar(e), values[:, 6 + i], unit)
                    for i, (latex, e, unit) in enumerate(self.efforts)]
        turned = inserted(self.tree.spins[0], {Base("w", "k"): self.s.record.atom("dpsi", "k")}, dict(self.rates))
        lines = [self.line(latex, e, wanted, ORACLE, unit) for latex, e, wanted, unit in changes]
        text = "Change in a virtual displacement at constant $\\mathbf{F}_l, \\mathbf{M}_l$ (all of it, not a part):"
        return self.told(text, self.line(r"\delta\boldsymbol{\psi}_l", turned), *lines)


def matrix(rows: list[str]) -> str:
    """A matrix in LaTeX from rows whose cells are separated by ampersands."""
    inside = r" \\ ".join(rows)
    return rows[0] if len(rows) == 1 and "&" not in rows[0] else rf"\begin{{bmatrix}} {inside} \end{{bmatrix}}"


def recursive_pages(s: ReportedLaw, others: frozenset[str]) -> list[tuple[Any, list[Block]]]:
    """The page on a joint in the recursive formulation; empty for a joint that states no motion of l relative to k."""
    if not (isinstance(s.law, Joint) and s.law.states_motion() and s.sides == ("k", "l")):
        return []
    page = RecursivePage(type(s.law), s.structure, others)
    return [(page, [Section("As a recursive joint", page.blocks())])]


def recursive_report(laws: tuple[type[Joint], ...] = (Revolute, Prismatic), options: Mapping[str, Any] | None = None) -> Document:
    """The report of recursive joints, a page for each; LawError where one states no motion. options: those of the laws."""
    pages: list[tuple[Any, list[Block]]] = []
    for law in laws:
        if not law.states_motion() or law.frames != ("k", "l"):
            raise LawError(f"{law.__name__} has no recursive form: state motion(self, from_k) of l relative to k, between two "
                           f"bodies k and l only")
        others = frozenset().union(*(page.taken for page, _ in pages))
        page = RecursivePage(law, structure_of(law, dict(options or {}) | {"kept": True}), others)
        pages.append((page, [Section(f"{title_of(law)} joint", page.blocks())]))
    title = "Recursive joint" if len(laws) > 1 else f"{title_of(laws[0])} joint, recursive"
    text = "The same section of any other joint: `mb.report(MyJoint, model=mb.Recursive())`."
    return document(title, [Paragraph(text)], pages, "", [origin([page for page, _ in pages])])


def origin(pages: list[RecursivePage]) -> Section:
    """Section with the hashes of the recursion programs and of the rows."""
    rows = [[f"`{type(p.s.law).__name__}`", f"`{p.hash[:32]}…`", short_hash(p.d)] for p in pages]
    text = "The lines are those of the program that is integrated; the rows name the reactions."
    head = ["law", "sha256 of the program", "sha256 of the rows"]
    return Section("Origin of the recursion", [Paragraph(text), Table(head, rows)])
