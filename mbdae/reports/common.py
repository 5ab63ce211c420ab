"""What all reports of laws share: letters, definitions of intermediate quantities, numeric checks, origin of the equations."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.formulas import escaped
from mbdae.formulations.ggl import ggl_outputs
from mbdae.kernels.plan import LinearisedPlan, linearised_plan
from mbdae.reports.evaluate import Numbers
from mbdae.reports.letters import Letter, letters, multiplier, name_scalars, name_vectors, unit_text, worded
from mbdae.reports.statement import Statement
from mbdae.reports.states import State
from mbdae.reports.units import row_unit
from mbdae.reports.vectors import Base
from mbdae.reports.writer import Writer, subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.law import Force

_BASES = {
    "r": ("position of the point of the {what} on body ${side}$", "m"),
    "c": ("centre of body ${side}$", "m"),
    "s": ("arm from the centre of body ${side}$ to the point of the {what}", "m"),
    "x": ("first axis of the {what} on body ${side}$, a unit vector", "1"),
    "y": ("second axis on body ${side}$", "1"),
    "z": ("third axis on body ${side}$: the axis of the {what}", "1"),
    "v": ("velocity of the point on body ${side}$", "m/s"),
    "w": ("angular velocity of body ${side}$", "rad/s"),
    "du": ("virtual displacement of the point on body ${side}$", "m"),
    "dpsi": ("virtual rotation of body ${side}$", "rad"),
    "vc": ("velocity of the centre of body ${side}$", "m/s"),
    "ac": ("acceleration of the centre of body ${side}$", "m/s^2"),
    "al": ("angular acceleration of body ${side}$", "rad/s^2"),
    "F": ("all forces on body ${side}$ without those of the joint, left-hand side", "N"),
    "M": ("all moments on body ${side}$ about its centre, likewise", "N m"),
    "bx": ("first axis of body ${side}$", "1"),
    "by": ("second axis of body ${side}$", "1"),
    "bz": ("third axis of body ${side}$", "1"),
}
_TURNED = {
    "bx": ("first axis of the free rotation: its components along $\\mathbf{i}_x, \\mathbf{i}_y, \\mathbf{i}_z$ are those of the"
           " turned first axis along the axes reached before", "1"),
    "by": ("the same of the second axis", "1"),
    "bz": ("the same of the third axis", "1"),
    "w": ("angular velocity of the free rotation, components likewise", "rad/s"),
    "dpsi": ("virtual rotation of the free rotation, components likewise", "rad"),
}  # fmt: skip
class FormulaPage:
    """A page whose formulas name no intermediate quantities."""

    own: Sequence[str] = ()

    @property
    def formulas(self) -> Any:
        """What writes the formulas."""
        return self

    @staticmethod
    def lines(*lines: str) -> list[Block]:
        """Equations, one a line."""
        return [Equation(line) for line in lines]


@dataclass
class LawFormulas:
    """Formulas of one law in LaTeX, the letters of their symbols, and the numeric checks made so far."""

    statement: Statement
    what: str = "joint"
    rows: bool = True  #: whether its rows are written
    others: frozenset[str] = frozenset()  #: letters that other pages of the document have given
    defined: set[tuple[str, str]] = field(default_factory=set)  #: intermediate quantities that equations have defined

    def __post_init__(self) -> None:
        s = self.statement
        self.known: dict[str, Letter] = letters(s.cls, s.structure, s.law)
        for row in s.rows if self.rows else ():
            self.known[f"lambda_{row}"] = Letter(multiplier(row), row_unit(s, s.rows[row]), f"multiplier of row {row}")
        self.known |= {name: replace(self.known[name], unit="") for name in s.turning}
        for side in s.headings:
            self.known |= {f"{side}_h": Letter(f"\\theta_{side}", "rad", f"rotation of body ${side}$ since the drawing"),
                           f"{side}_w3": Letter(f"\\omega_{side}", "rad/s", f"angular velocity of body ${side}$ in the plane"),
                           f"dpsi_{side}": Letter(f"\\delta\\theta_{side}", "rad", "its virtual rotation")}  # fmt: skip
        for name, symbol in s.coordinates.items():
            letter = self.known[name]
            self.known[str(symbol)] = letter
            self.known[str(s.clock[symbol])] = Letter(f"\\dot{{{letter.latex}}}", f"{letter.unit}/s", "its rate")
            self.known[str(s.virtual[symbol])] = Letter(f"\\delta {letter.latex}", letter.unit, "its virtual change")
        self.writer = Writer(s.record, {})
        self.writer.renew = self.refresh
        self.refresh()

    def refresh(self) -> None:
        """Give letters to the intermediate quantities named since the last call."""
        record, known = self.statement.record, {name: letter.latex for name, letter in self.known.items()}
        others = self.others.union(known.values())
        self.writer.names = name_vectors(record, others)
        self.writer.letters = name_scalars(record, others) | known

    @property
    def taken(self) -> frozenset[str]:
        """Letters given to intermediate quantities, here and on other pages."""
        return self.others | {*self.own}

    @property
    def own(self) -> list[str]:
        """Letters given to intermediate quantities here."""
        return sorted(self._letter(*key) for key in self.defined)

    def numbers(self, state: State) -> Numbers:
        """Evaluates formulas of the law at random states."""
        return Numbers(self.statement.record, state.atom, state.symbol)

    def known_at(self, state: State) -> dict[str, Any]:
        """Values of all symbols that are no definitions, as functions, by their LaTeX."""
        axes = zip("xyz", np.eye(3), strict=True)
        found: dict[str, Any] = {rf"\mathbf{{i}}_{a}": np.broadcast_to(e, (state.points, 3)) for a, e in axes}
        for name, letter in self.known.items():
            found[letter.latex] = lambda name=name: state.symbol(name)
        for side in self.statement.record.sides:
            for kind in _BASES:
                base = Base(kind, side)
                found[Writer.plain(base)] = lambda base=base: state.atom(base)
        return found

    def lines(self, *lines: str, note: str = "") -> list[Block]:
        """Equations, one a line, and below them the definitions of what they name for the first time."""
        blocks: list[Block] = [Equation(line, note=note if i == len(lines) - 1 else "") for i, line in enumerate(lines)]
        return blocks + self.definitions()

    def definitions(self) -> list[Block]:
        """Definitions of the intermediate quantities that formulas name and no equation has defined yet."""
        record, w = self.statement.record, self.writer
        found: list[Block] = []
        while True:
            self.refresh()
            written = {("v", str(n)): record.vectors[n] for n in sorted(w.vectors)}
            written |= {("s", str(symbol)): e for symbol, e in record.scalars.items() if str(symbol) in w.used}
            todo = {key: e for key, e in written.items() if key not in self.defined}
            if not todo:
                return [Paragraph("with"), *found] if found else []
            for (kind, name), e in todo.items():
                self.defined.add((kind, name))
                found.append(Equation(f"{self._letter(kind, name)} = {w.vector(e) if kind == 'v' else w.scalar(e)}"))

    def _letter(self, kind: str, name: str) -> str:
        """The letter of an intermediate quantity."""
        return self.writer.names[int(name)] if kind == "v" else self.writer.letters[name]

    def symbols(self) -> Table:
        """Every symbol of the report, with unit and meaning."""
        kinds = [*_BASES, "E"]
        rows: list[list[str]] = []
        for base in sorted(self.writer.bases, key=lambda b: (kinds.index(b.kind), b.side)):
            row = _base_row(base, self.what if base.side not in self.statement.turning.values() else "")
            if row not in rows:
                rows.append(row)
        rows += [self.known[name].row for name in sorted(self.writer.used) if name in self.known]
        return Table(["symbol", "unit", "meaning"], rows)


def _base_row(base: Base, what: str) -> list[str]:
    if base.kind == "E":
        return [r"$\mathbf{i}_x,\ \mathbf{i}_y,\ \mathbf{i}_z$", "1", "inertial axes"]
    meaning, unit = (_BASES if what else _TURNED)[base.kind]
    side = subscript(base.side)
    return [f"${Writer.plain(base)}$", unit_text(unit), meaning.replace("{side}", side).replace("{what}", what)]


def described(law: Any) -> list[Block]:
    """What a law does, in a sentence: the first one of its docstring with its vectors as symbols."""
    text = " ".join((inspect.getdoc(law) or "").split("\n\n")[0].split())
    text = re.sub(r"[,;]? *\(?[Pp]aper Eqs?\. [0-9, to-]*[0-9]\)?", "", text)
    sentence = re.split(r"(?<=[.;])\s", text)[0].rstrip(";.")
    if "=" in sentence and law.__module__.startswith("mbdae."):
        sentence = (sys.modules[law.__module__].__doc__ or "").split("\n")[0].rstrip(".")
    told = worded(escaped(sentence))
    told = re.sub(r"^([klm])(?=\W)", r"body \1", told)
    return [Paragraph(f"{told[:1].upper()}{told[1:]}.")] if told else []


def kernel_counts(d: Derived, planar: Derived | None) -> list[list[str]]:
    """Operations of the compiled kernels in space and in the plane."""
    rows = []
    for name, derived in (("space", d), ("plane", planar)):
        if derived is None:
            continue
        p: LinearisedPlan = linearised_plan(derived, ggl_outputs)
        sizes = (len(p.targets), len(p.nonlinear), p.residual.operations if p.nonlinear else 0, len(p.jacobian_places),
                 p.jacobian.operations if p.jacobian_places else 0)  # fmt: skip
        rows.append([name, *map(str, sizes), f"`{fingerprint(derived)[:32]}…`"])
    return rows


def provenance(d: Derived, planar: Derived | None) -> Section:
    """The section on the origin of a report: hash of the derived equations, size of the compiled kernels."""
    blocks: list[Block] = [
        Paragraph(
            f"This report was made from the law object that is integrated, `{type(d.law).__module__}.{type(d.law).__qualname__}`."
            " The sha256 of its derived equations in space is:"
        ),
        Paragraph(f"`{fingerprint(d)}`"),
        Paragraph("With the rates of its rows, its coordinates and its branches:"),
        Paragraph(f"`{fingerprint(d, rates=True)}`"),
    ]
    head = ["in", "outputs", "nonlinear ones", "operations of the residual", "varying derivatives",
            "operations of the derivatives", "sha256"]  # fmt: skip
    caption = "Compiled kernels in the form GGL, operations after common subexpressions; between two bodies that move"
    blocks.append(Table(head, kernel_counts(d, planar), caption))
    return Section("Origin", blocks)


def external(s: Statement) -> bool:
    """Whether a law is an external load on l."""
    return isinstance(s.law, Force) and s.law.external


def row_name(name: str) -> str:
    """Name of a row in text."""
    return name.replace("_", " ")


def title_of(law: type) -> str:
    """The name of a class as words."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", law.__name__)
