"""Pages of a report: printed blocks, and the check that reads each equation back from its LaTeX and compares it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table, escaped, every, numbered
from mbdae.reports.letters import Letter, introduced, results, worded
from mbdae.reports.reading import RELATIONS, Key, LatexReader, Symbols, UnreadError, key_of, members
from mbdae.reports.states import POINTS, residual
from mbdae.reports.units import ambiguous
from mbdae.reports.writer import Writer, inlined
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import fingerprint

BOUND = 1e-10  #: largest relative difference that is attributed to round-off
KERNEL, DERIVED, MOVED = "the compiled kernel", "the derived equations", "a complex step along a motion of the bodies"
BALANCE = "the energy balance of a run"
#: part of its largest value, or of its largest term, below which a divisor counts as 0: above, what is divided by it loses up to
#: four of sixteen digits
NEXT_TO_ZERO = 1e-4
SYMBOLS = ["symbol", "unit", "meaning"]  #: headings of a table of symbols
#: tokens that occur in formulas but in no single symbol
_FORMULA = {"+", "-", r"\times", r"\cdot", r"\frac", r"\begin", r"\left", r"\sum"}
_ZEROS = (("0",), tuple(key_of(r"\mathbf{0}")))


@dataclass(frozen=True)
class Check:
    """A comparison at random states: what is compared, and the largest relative difference."""

    what: str
    residual: float

    @property
    def holds(self) -> bool:
        """Whether the difference is no larger than round-off."""
        return self.residual <= BOUND


@dataclass(frozen=True)
class Wanted:
    """Values (points, ...) that a printed symbol must have, and their source. With values None some equation must have the symbol
    as its left-hand side, and its two sides are compared."""

    values: Any
    source: str
    unit: str = ""  #: unit, where `letters.RESULTS` does not state it


BOTH = Wanted(None, "both sides")  #: for an equation whose two sides are both formulas, which are compared with each other


class Printed:
    """Displayed equations of some sections, read back from their LaTeX.

    known: values of given symbols; wanted: required values of left-hand sides. Every other left-hand side is a definition,
    which some checked equation has to use. A printed condition "x \\ne 0" takes points next to zeros of x out of all checks, by
    its values, its terms, and sizes of symbols: all terms may be small. noise: difference, at each point, that is round-off."""

    def __init__(self, known: Mapping[str, Any], wanted: Mapping[str, Wanted], points: int = POINTS,
                 sizes: Mapping[str, float] | None = None, noise: Any = 0.0) -> None:
        self.noise, self.sizes = noise, {key_of(latex): size for latex, size in (sizes or {}).items()}
        self.points, self.wanted = points, {key_of(latex): (latex, w) for latex, w in wanted.items()}
        self.symbols = Symbols({latex: value for latex, value in known.items() if latex not in wanted})
        for key, (_, w) in self.wanted.items():
            if w.values is not None:
                self.symbols.add(key, np.asarray(w.values))
        self.defined: dict[Key, Equation] = {}
        self.used, self.seen, self.checks = set[Key](), set[Key](), list[Check]()
        self.terms: dict[Key, float] = {}  #: largest term of the formula of a defined symbol
        self.conditions: list[Key] = []  #: what the page says to differ from 0

    def read(self, blocks: Sequence[Block]) -> list[Check]:
        """Checks of all equations in the blocks."""
        left: Key = ()
        lines: list[tuple[Equation, Key, list[tuple[str, Key]]]] = []
        for equation in every(Equation, blocks):
            chain = members(key_of(equation.latex))
            left = chain[0][1] or left
            rest = chain[1:] or chain
            self.conditions += [left for relation, part in rest if relation == r"\ne" and part in _ZEROS]
            if len(chain) > 1 and self._defines(left, rest):
                self.defined[left] = equation
                self.symbols.add(left, lambda left=left, line=rest[0][1]: self._defined(left, line))
                rest = rest[1:]
            lines.append((equation, left, rest))
        for equation, left, rest in lines:
            self._check(equation, left, rest)
        for left, equation in self.defined.items():
            if left not in self.used:
                self._failed(equation, "is defined, and no equation that has a value uses it")
        missing = (name for key, (name, _) in self.wanted.items() if key not in self.seen)
        return [*self.checks, *(Check(f"{name} is displayed", float("inf")) for name in missing)]

    def _defines(self, left: Key, rest: list[tuple[str, Key]]) -> bool:
        """Whether an equation defines a new symbol."""
        return left not in self.symbols and RELATIONS[rest[0][0]] == "=" and not _FORMULA & {*left}

    def _defined(self, left: Key, line: Key) -> Any:
        self.used.add(left)
        found, self.terms[left] = self._value(line), self.outer
        return found

    def value(self, line: Key) -> Any:
        """Values of a symbol or formula at the points, which `read` has made known."""
        return self.symbols.value(line) if line in self.symbols else self._value(line)

    def _value(self, line: Key) -> Any:
        with np.errstate(all="ignore"):
            found = (reader := LatexReader(line, self.symbols, self.points)).whole()
        self.largest, self.outer = reader.largest, reader.outer
        return found

    def _check(self, equation: Equation, left: Key, rest: list[tuple[str, Key]]) -> None:
        """Compare every member of a chain of equations with the required value of its left-hand side."""
        name, wanted = self.wanted.get(left, ("", BOTH))
        self.seen.add(left)
        for relation, part in rest:
            if RELATIONS.get(relation) == "<":
                break
            if part in _ZEROS and len(rest) > 1:  # a condition on the solution, not an identity
                continue
            try:
                want = self._value(left) if wanted.values is None else wanted.values
                terms = max(1.0, self.largest) if wanted.values is None else 1.0
                got = self._value(part)
                size = np.broadcast_shapes(np.shape(got), np.shape(want))
                got, want = np.broadcast_to(got, size), np.broadcast_to(want, size) / terms
                got = np.where(np.abs(got - want * terms) <= self.noise, want, got / terms)
                error = residual(got[self.stated], want[self.stated]) if size else residual(got, want)
            except (UnreadError, ValueError) as found:
                self._failed(equation, f"cannot be read: {found}")
                continue
            source = "both sides" if wanted.values is None else f"${name}$, {wanted.source}"
            self.checks.append(Check(f"({equation.number}) {source}", error))

    @cached_property
    def stated(self) -> Any:
        """(points,) whether no divisor is next to a zero that the page names."""
        found = np.ones(self.points, dtype=bool)
        for key in self.conditions:
            v = np.abs(np.broadcast_to(self.value(key), (self.points,)))
            least = max(self.terms.get(key, 0.0), self.sizes.get(key, 0.0))
            found &= v > NEXT_TO_ZERO * np.max(v, where=np.isfinite(v), initial=least)
        return found

    def undivided(self, blocks: Sequence[Block]) -> list[Check]:
        """A failed check for every divisor with symbols of which no condition says that it differs from 0."""
        found = []
        for equation in every(Equation, blocks):
            for divisor in divisors(key_of(equation.latex)):
                if divisor not in self.conditions and any(self.symbols.at(divisor, i) for i in range(len(divisor))):
                    found.append(Check(f"({equation.number}) does not say that its divisor {' '.join(divisor)} differs from 0",
                                       float("inf")))
        return found

    def _failed(self, e: Equation, why: str) -> None:
        self.checks.append(Check(f"({e.number}) {why}".replace("$", ""), float("inf")))


def divisors(line: Key) -> list[Key]:
    r"""What stands below the bars of the fractions of a formula."""
    found: list[Key] = []
    for i, token in enumerate(line):
        if token == r"\frac":
            above = _group_end(line, i + 1)
            found.append(line[above + 1 : _group_end(line, above) - 1])
    return found


def _group_end(line: Key, i: int) -> int:
    """The place after the group in braces that begins at i."""
    depth = 0
    while True:
        depth += (line[i] == "{") - (line[i] == "}")
        i += 1
        if not depth:
            return i


def checks_section(checks: Sequence[Check]) -> Section:
    """Section with the checks, their residuals, and whether all hold."""
    rows = [[c.what, f"${power_of_ten(c.residual)}$", "yes" if c.holds else "NO"] for c in checks]
    wrong = [c.what for c in checks if not c.holds]
    verdict = f"All {len(checks)} comparisons hold." if not wrong else f"NOT EQUAL: {'; '.join(wrong)}."
    told = (f"Every numbered equation was read back as it is printed, evaluated at {POINTS} random states of motion (attitudes,"
            f" positions, velocities and parameters that satisfy no constraint unless a section says so) and compared with the"
            f" equations that are integrated, or with a complex step along a motion of the bodies. {verdict}")
    head = ["equation, and with what it is compared", "largest relative difference", f"below ${power_of_ten(BOUND)}$"]
    table = Table(head, rows, f"The {len(checks)} comparisons", folded=not wrong)
    return Section("Numeric check", [Paragraph(told), table])


def power_of_ten(x: float) -> str:
    """A small number as a power of ten in LaTeX."""
    if x == 0 or not np.isfinite(x):
        return "0" if x == 0 else r"\infty"
    mantissa, exponent = f"{x:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1.0" else f"{mantissa}\\cdot {power}"


class Page:
    """Printed blocks about one law or scene, and the values that the symbols must have at random states.

    known: letters by symbol; writer: writes the formulas; wanted: required values of left-hand sides by their LaTeX."""

    stated = False  #: whether its left-hand sides are listed in `letters.RESULTS`
    #: letters that this page gives to intermediate quantities; the document checks that no other symbol has one of them
    own: Sequence[str] = ()
    known: dict[str, Letter]
    writer: Writer
    wanted: dict[str, Wanted]

    def want(self, latex: str, values: Any, source: str, unit: str = "") -> None:
        """Keep the values that the printed formulas of a symbol must give when they are read back, (POINTS, ...) or one for
        all points; source: what computed them."""
        values = np.asarray(values)
        self.wanted[latex] = Wanted(np.broadcast_to(values, (POINTS, *values.shape[1:])), source, unit)

    def line(self, latex: str, e: Any, values: Any = None, source: str = "", unit: str = "") -> str:
        """An equation of a symbol and its formula (scalar or vector). values, source: as in `want`."""
        if values is not None:
            self.want(latex, values, source, unit)
        return f"{latex} = {self.writer.of(e)}"

    def lines(self, *lines: str, note: str = "") -> list[Block]:
        """Equations, one a line; the note is printed with the last one."""
        return [Equation(line, note=note if i == len(lines) else "") for i, line in enumerate(lines, 1)]

    def told(self, text: str, *lines: str) -> list[Block]:
        """A sentence followed by equations."""
        return [Paragraph(text), *self.lines(*lines)]

    def section(self, title: str, text: str, *lines: str) -> Section:
        """A section with a sentence and equations."""
        return Section(title, self.told(text, *lines))

    def symbols(self) -> list[list[str]]:
        """Rows of the table of symbols: every symbol used, with unit and meaning."""
        return [self.known[name].row for name in sorted(self.writer.used) if name in self.known]

    def given(self) -> dict[str, Any]:
        """Values of the symbols that are no definitions, or functions that return them, by LaTeX."""
        raise NotImplementedError

    def units(self) -> list[Check]:
        """Checks that all terms of a stated quantity have one unit; empty where units are unknown."""
        return []

    def printed(self, blocks: list[Block]) -> list[Check]:
        """Checks of the equations in numbered blocks, read back from their LaTeX."""
        return Printed(self.given(), self.wanted).read(blocks)


def document(title: str, head: list[Block], pages: list[tuple[Any, list[Block]]], convention: str, tail: list[Block],
             shared: float = 0.0) -> Document:
    """A document whose pages have numbered equations, which are read back. head: blocks without equations; convention: sentence
    below these, or ""; symbols are explained where they appear and listed at the end; tail: blocks after the checks; shared: as
    in `inlined`."""
    rows = dict.fromkeys(tuple(row) for page, _ in pages for row in page.symbols())
    names = [[n for n in page.own if not any(n in latex for latex in page.wanted)] for page, _ in pages]
    parts = [Section("", inlined(part, own, shared)) for (_, part), own in zip(pages, names, strict=True)]
    blocks = [part.blocks for part in numbered(introduced(parts, list(rows))) if isinstance(part, Section)]
    checks = [c for (page, _), part in zip(pages, blocks, strict=True) for c in page.printed(list(part))]
    stated = [{k: w.unit for k, w in page.wanted.items() if w.values is not None} for page, _ in pages if page.stated]
    letters = [row[0] for row in rows] + [name for page, _ in pages for name in page.own]
    sides = list(dict.fromkeys(item for units in stated for item in units.items()))
    letters += [name for name, _ in sides]
    twice = [name for name in dict.fromkeys(letters) if letters.count(name) > 1]
    twice += ambiguous([(type(page), page.symbols(), list(part)) for (page, _), part in zip(pages, blocks, strict=True)])
    checks += [Check(f"{symbol} has one meaning", float("inf")) for symbol in dict.fromkeys(twice)]
    units = list(dict.fromkeys(c for page, _ in pages for c in page.units()))
    head = [*head, *(Paragraph(f"**The units do not fit: {c.what}.**") for c in units if not c.holds)]
    checks += units
    table = Table(SYMBOLS, [*map(list, rows), *results(dict(sides))])
    told = [Paragraph(convention)] if convention else []
    body = [b for part in blocks for b in part]
    symbols = [Section("Symbols", [table])] if table.rows else []
    return Document(title, [*head, *told, *body, *symbols, *([checks_section(checks)] if checks else []), *tail])


# -- names and origin of laws


def row_name(name: str) -> str:
    """Name of a row in text."""
    return name.replace("_", " ")


def below(row: str) -> str:
    """The name of a row as a subscript."""
    return f"{{\\text{{{row_name(row)}}}}}"


def title_of(law: type) -> str:
    """The name of a class split into words."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", law.__name__)


def described(law: Any) -> list[Block]:
    """A sentence on a law: the first of its docstring, with vectors written as symbols."""
    text = " ".join((inspect.getdoc(law) or "").split("\n\n")[0].split())
    text = re.sub(r"[,;]? *\(?[Pp]aper Eqs?\. [0-9, to-]*[0-9]\)?", "", text)
    sentence = re.split(r"(?<=[.;])\s", text)[0].rstrip(";.")
    told = re.sub(r"^([klm])(?=\W)", r"body \1", worded(escaped(sentence)))
    return [Paragraph(f"{told[:1].upper()}{told[1:]}.")] if told else []


def short_hash(d: Derived) -> str:
    """The first half of the hash of a derived law, for a cell of a table."""
    return f"`{fingerprint(d)[:32]}…`"


def made_from(cls: type, what: str = "law object") -> str:
    """Sentence that names the class from which a report was made; what: noun for it."""
    return f"This report was made from the {what} that is integrated, `{cls.__module__}.{cls.__qualname__}`"


def provenance(d: Derived, planar: Derived | None) -> Section:
    """Section on the origin of a report: hashes of the derived equations."""
    text = f"{made_from(type(d.law))}. The sha256 of its derived equations in space is:"
    rates = "With the rates of its rows, its coordinates and its branches:"
    flat = [] if planar is None else [Paragraph("That of its equations in the plane:"), Paragraph(f"`{fingerprint(planar)}`")]
    return Section("Origin", [Paragraph(text), Paragraph(f"`{fingerprint(d)}`"), Paragraph(rates),
                              Paragraph(f"`{fingerprint(d, rates=True)}`"), *flat])


def effort(name: str) -> str:
    """Letter of the generalised force of the rows on a coordinate."""
    return f"h_{below(name)}"
