"""Checks of what is printed: every displayed equation is read back and compared with the equations that are integrated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Table, every
from mbdae.reports.reading import RELATIONS, Key, Reader, Symbols, UnreadError, key_of, members
from mbdae.reports.states import POINTS, residual

BOUND = 1e-10  #: largest relative difference that passes as round-off
_FORMULA = {"+", "-", r"\times", r"\cdot", r"\frac", r"\begin", r"\left"}  #: what no symbol contains
_ZEROS = (("0",), tuple(key_of(r"\mathbf{0}")))


@dataclass(frozen=True)
class Check:
    """A comparison at random states: what is compared, and the largest relative difference."""

    what: str
    residual: float

    @property
    def holds(self) -> bool:
        """Whether the difference is round-off."""
        return self.residual <= BOUND


@dataclass(frozen=True)
class Wanted:
    """What a printed symbol must be: values (points, ...), and where they come from; values None: some equation must have it as
    its left-hand side, whose two sides are compared."""

    values: Any
    source: str


class Printed:
    """The displayed equations of some sections, read back.

    known: values of the symbols that are given; wanted: what the left-hand sides must be. Every other left-hand side is a
    definition, which some checked equation has to use."""

    def __init__(self, known: Mapping[str, Any], wanted: Mapping[str, Wanted], points: int = POINTS) -> None:
        self.points, self.wanted = points, {key_of(latex): (latex, w) for latex, w in wanted.items()}
        self.symbols = Symbols({latex: (lambda latex=latex: self._given(known[latex])) for latex in known})
        for key, (_, w) in self.wanted.items():
            if key not in self.symbols and w.values is not None:
                self.symbols.add(key, np.asarray(w.values))
        self.defined: dict[Key, Equation] = {}
        self.used: set[Key] = set()
        self.seen: set[Key] = set()
        self.checks: list[Check] = []

    @staticmethod
    def _given(value: Any) -> Any:
        return value() if callable(value) else value

    def read(self, blocks: Sequence[Block]) -> list[Check]:
        """Checks of all equations in the blocks."""
        left: Key = ()
        lines: list[tuple[Equation, Key, list[tuple[str, Key]]]] = []
        for equation in every(Equation, blocks):
            chain = members(key_of(equation.latex))
            left = chain[0][1] or left
            rest = chain[1:]
            if not rest:
                lines.append((equation, left, chain))
            elif self._defines(left, rest):
                self.defined[left] = equation
                self.symbols.add(left, lambda left=left, line=rest[0][1]: self._defined(left, line))
                lines.append((equation, left, rest[1:]))
            else:
                lines.append((equation, left, rest))
        for equation, left, rest in lines:
            self._check(equation, left, rest)
        for left, equation in self.defined.items():
            if left not in self.used:
                self._failed(equation, "is defined, and no equation that has a value uses it")
        for key, (name, _) in self.wanted.items():
            if key not in self.seen:
                self.checks.append(Check(f"{name} is displayed", float("inf")))
        return self.checks

    def _defines(self, left: Key, rest: list[tuple[str, Key]]) -> bool:
        """Whether an equation defines a symbol that nothing has given before."""
        return left not in self.symbols and RELATIONS[rest[0][0]] == "=" and not _FORMULA & {*left}

    def _defined(self, left: Key, line: Key) -> Any:
        self.used.add(left)
        return self._value(line)

    def _value(self, line: Key) -> Any:
        with np.errstate(all="ignore"):
            reader = Reader(line, self.symbols, self.points)
            found = reader.whole()
        self.largest = reader.largest
        return found

    def _check(self, equation: Equation, left: Key, rest: list[tuple[str, Key]]) -> None:
        """Compare the members of a chain with what the left-hand side must be."""
        name, wanted = self.wanted.get(left, ("", None))
        wanted = wanted if wanted is not None and wanted.values is not None else None
        self.seen.add(left)
        for relation, part in rest:
            if part in _ZEROS and len(rest) > 1:
                continue  # a demand on the solution
            if RELATIONS.get(relation) == "<":
                break
            try:
                want = self._value(left) if wanted is None else wanted.values
                terms = 1.0 if wanted else max(1.0, self.largest)
                got = self._value(part)
                size = np.broadcast_shapes(np.shape(got), np.shape(want))
                error = residual(np.broadcast_to(got, size) / terms, np.broadcast_to(want, size) / terms)
            except (UnreadError, ValueError) as found:
                self._failed(equation, f"cannot be read: {found}")
                continue
            source = "both sides" if wanted is None else f"${name}$, {wanted.source}"
            self.checks.append(Check(f"({equation.number}) {source}", error))

    def _failed(self, equation: Equation, why: str) -> None:
        self.checks.append(Check(f"({equation.number}) {why}".replace("$", ""), float("inf")))


def checks_table(checks: Sequence[Check], points: int = POINTS) -> list[Block]:
    """The checks with their residuals, and a verdict."""
    rows = [[c.what, f"${power_of_ten(c.residual)}$", "yes" if c.holds else "NO"] for c in checks]
    wrong = [c.what for c in checks if not c.holds]
    verdict = f"All {len(checks)} comparisons hold." if not wrong else f"NOT EQUAL: {'; '.join(wrong)}."
    told = (
        f"Every numbered equation was read back as it is printed, evaluated at {points} random states of motion (attitudes,"
        f" positions, velocities and parameters that satisfy no constraint unless a section says so) and compared with the"
        f" equations that are integrated, or with a complex step along a motion of the bodies. {verdict}"
    )
    head = ["equation, and with what it is compared", "largest relative difference", f"below ${power_of_ten(BOUND)}$"]
    return [Paragraph(told), Table(head, rows, f"The {len(checks)} comparisons", folded=not wrong)]


def power_of_ten(x: float) -> str:
    """A small number in LaTeX."""
    if x == 0 or not np.isfinite(x):
        return "0" if x == 0 else r"\infty"
    mantissa, exponent = f"{x:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1.0" else f"{mantissa}\\cdot {power}"
