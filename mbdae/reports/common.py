"""What all reports of laws share: letters, definitions of intermediate quantities, numeric checks, origin of the equations."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.formulas import escaped
from mbdae.formulations.ggl import ggl_outputs
from mbdae.kernels.plan import LinearisedPlan, linearised_plan
from mbdae.reports.evaluate import Numbers
from mbdae.reports.letters import Letter, letters, multiplier, name_scalars, name_vectors, unit_text
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
BOUND = 1e-10  #: largest relative difference that passes as round-off


@dataclass(frozen=True)
class Check:
    """A comparison at random states: what is compared, and the largest relative difference."""

    what: str
    residual: float

    @property
    def holds(self) -> bool:
        """Whether the difference is round-off."""
        return self.residual <= BOUND


@dataclass
class LawFormulas:
    """Formulas of one law in LaTeX, the letters of their symbols, and the numeric checks made so far."""

    statement: Statement
    what: str = "joint"
    rows: bool = True  #: whether its rows are written
    checks: list[Check] = field(default_factory=list)

    def __post_init__(self) -> None:
        s = self.statement
        self.known: dict[str, Letter] = letters(s.cls, s.structure, s.law)
        for row in s.rows if self.rows else ():
            self.known[f"lambda_{row}"] = Letter(multiplier(row), row_unit(s, s.rows[row]), f"multiplier of row {row}")
        self.known |= {name: replace(self.known[name], unit="") for name in s.turning}
        for name, symbol in s.coordinates.items():
            letter = self.known[name]
            self.known[str(symbol)] = letter
            self.known[str(s.clock[symbol])] = Letter(f"\\dot{{{letter.latex}}}", f"{letter.unit}/s", "its rate")
            self.known[str(s.virtual[symbol])] = Letter(f"\\delta {letter.latex}", letter.unit, "its virtual change")
        self.writer = Writer(s.record, {})
        self.refresh()

    def refresh(self) -> None:
        """Give letters to the intermediate quantities named since the last call."""
        record = self.statement.record
        self.writer.names = name_vectors(record)
        self.writer.letters = {name: letter.latex for name, letter in self.known.items()} | name_scalars(record)

    def numbers(self, state: State) -> Numbers:
        """Evaluates formulas of the law at random states."""
        return Numbers(self.statement.record, state.atom, state.symbol)

    def definitions(self, start: tuple[set[str], set[int]]) -> list[Block]:
        """Definitions of the intermediate quantities that appear in the formulas written since `start`, a `mark`."""
        self.refresh()
        record, w = self.statement.record, self.writer
        lines: dict[tuple[int, int], str] = {}
        while True:
            scalars = {s for s in record.scalars if str(s) in w.used and str(s) not in start[0]}
            numbers = {n for n in w.vectors if n not in start[1]}
            todo = [(0, n) for n in numbers if (0, n) not in lines]
            order = {str(symbol): i for i, symbol in enumerate(record.scalars)}
            todo += [(1, order[str(s)]) for s in scalars if (1, order[str(s)]) not in lines]
            if not todo:
                break
            for kind, n in sorted(todo):
                if kind == 0:
                    lines[kind, n] = f"{w.names[n]} = {w.vector(record.vectors[n])}"
                else:
                    symbol, value = list(record.scalars.items())[n]
                    lines[kind, n] = f"{w.letters[str(symbol)]} = {w.scalar(value)}"
        return [Equation(joined(lines[key] for key in sorted(lines)))] if lines else []

    def explained(self, start: tuple[set[str], set[int]]) -> list[Block]:
        """The definitions under the word "with"; nothing where there are none."""
        named = self.definitions(start)
        return [Paragraph("with"), *named] if named else []

    def mark(self) -> tuple[set[str], set[int]]:
        """Symbols and named vectors written so far."""
        return set(self.writer.used), set(self.writer.vectors)

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
    """The docstring of a law in paragraphs."""
    text = inspect.getdoc(law) or ""
    return [Paragraph(escaped(" ".join(part.split()))) for part in text.split("\n\n") if part.strip()]


def checks_table(checks: Sequence[Check], points: int) -> list[Block]:
    """The checks with their residuals, and a verdict."""
    rows = [[c.what, f"${_power_of_ten(c.residual)}$", "yes" if c.holds else "NO"] for c in checks]
    wrong = [c.what for c in checks if not c.holds]
    verdict = f"All {len(checks)} comparisons hold." if not wrong else f"NOT EQUAL: {'; '.join(wrong)}."
    told = (
        f"Every formula of this report was evaluated at {points} random states of motion (attitudes, positions, velocities and"
        f" parameters that satisfy no constraint) and compared with the equations that are integrated. {verdict}"
    )
    return [Paragraph(told), Table(["compared", "largest relative difference", f"below ${_power_of_ten(BOUND)}$"], rows)]


def _power_of_ten(x: float) -> str:
    if x == 0:
        return "0"
    mantissa, exponent = f"{x:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1.0" else f"{mantissa}\\cdot {power}"


def kernel_counts(d: Derived, planar: Derived | None) -> list[list[str]]:
    """Operations of the compiled kernels in space and in the plane."""
    rows = []
    for name, derived in (("space", d), ("plane", planar)):
        if derived is None:
            continue
        p: LinearisedPlan = linearised_plan(derived, ggl_outputs)
        rows.append(
            [
                name,
                str(len(p.targets)),
                str(len(p.nonlinear)),
                str(p.residual.operations if p.nonlinear else 0),
                str(len(p.jacobian_places)),
                str(p.jacobian.operations if p.jacobian_places else 0),
            ]
        )
    return rows


def provenance(d: Derived, planar: Derived | None) -> Section:
    """The section on the origin of a report: hash of the derived equations, size of the compiled kernels."""
    blocks: list[Block] = [
        Paragraph(
            f"This report was made from the law object that is integrated, `{type(d.law).__module__}.{type(d.law).__qualname__}`."
            " The sha256 of its derived equations in space is:"
        ),
        Paragraph(f"`{fingerprint(d)}`"),
    ]
    head = [
        "in",
        "outputs",
        "nonlinear ones",
        "operations of the residual",
        "varying derivatives",
        "operations of the derivatives",
    ]
    blocks.append(
        Table(head, kernel_counts(d, planar), "Compiled kernels in the form GGL, operations after common subexpressions")
    )
    return Section("Origin", blocks)


def external(s: Statement) -> bool:
    """Whether a law is an external load on l."""
    return isinstance(s.law, Force) and s.law.external


def row_name(name: str) -> str:
    """Name of a row in text."""
    return name.replace("_", " ")


def joined(lines: Iterable[str]) -> str:
    """The lines of one displayed formula, joined."""
    return r" \\ ".join(lines)


def title_of(law: type) -> str:
    """The name of a class as words."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", law.__name__)
