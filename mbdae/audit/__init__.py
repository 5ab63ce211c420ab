"""`audit` and its result: rows, a table, JSON and a document.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbdae.audit import carried as latex
from mbdae.audit.laws import wordings
from mbdae.audit.meanings import Paper, begun
from mbdae.audit.notation import AuditError
from mbdae.audit.reading import Claimed, Printed, Text, is_expression, read
from mbdae.audit.verdicts import RIGHT, VERDICTS, Row, audit_text, told
from mbdae.documents import Document
from mbdae.documents.blocks import Block, Code, Equation, Paragraph, Section, Table, escaped
from mbdae.documents.displays import displays
from mbdae.documents.mathml import FormulaError, display
from mbdae.errors import OptionError, naming_arguments
from mbdae.files import write_file
from mbdae.study import as_json
from mbdae.values import BadValueError, of_class, option, shown, whole
from mbdae.values import path as path_of

__all__ = ["Audit", "audit", "wordings"]


HOW = (
    "Every formula is evaluated in random states of two bodies and compared with what the laws of mbdae, the virtual rotation "
    r"$\delta a = \delta\psi \times a$ and complex steps give for the quantity it is said to be: first in states of free bodies, "
    "then in states of bodies connected by the joint the text speaks of, always where the formulas are real and what the text "
    "assumes holds; formulas that are polynomials in free vectors also in symbols. The file of the formulas holds no "
    "verdicts and no repairs."
)


#: {words of a claim: the number to compare it with, or a function that returns this number or (number, remark)}
Counts = Mapping[str, int | Callable[[], int | tuple[int, str]]]


@dataclass(frozen=True)
class Count:
    """A number the text claims, with the number that was counted; None where nothing counts it."""

    claimed: Claimed
    counted: int | None
    remark: str = ""

    @property
    def verdict(self) -> str:
        """RIGHT, MISPRINT where the two numbers differ, CANNOT JUDGE where nothing counts it."""
        if self.counted is None:
            return "CANNOT JUDGE"
        return "RIGHT" if self.counted == self.claimed.count else "MISPRINT"


def counts_something(given: Any) -> bool:
    """Whether a value can be given as a count: a whole number or a function."""
    try:
        return callable(given) or whole(given, least=0) >= 0
    except BadValueError:
        return False


def count(claimed: Claimed, counts: Counts) -> Count:
    """A claim with the number given for its words, or returned by the function given for them."""
    words = claimed.words
    if words not in counts:
        remedy = f"audit(..., counts={{{words!r}: number, or a function that counts}})"
        return Count(claimed, None, f"nothing counts this: give {remedy}")
    given = counts[words]
    found = given() if callable(given) else given
    number, remark = found if isinstance(found, tuple) and len(found) == 2 else (found, "")
    counted = option(f"counts[{words!r}]", number, whole, "give a whole number, or a function that returns one", least=0)
    return Count(claimed, counted, str(remark))


@dataclass(frozen=True)
class Audit:
    """Verdicts on the formulas and the claimed numbers of a text."""

    title: str
    equations: tuple[Row, ...]
    claims: tuple[Count, ...] = ()
    #: of a paper in TeX, the table of meanings that this audit has begun; "" where there was one
    begun: str = ""

    def __getitem__(self, number: str | int) -> Row:
        """The row of an equation by its number or its label; AuditError where there is no such equation."""
        for row in self.equations:
            if str(number) in (row.equation, row.printed.label):
                return row
        there = ", ".join(row.equation for row in self.equations) or "none"
        raise AuditError(f"the audit has no equation {shown(number)}; it has {there}")

    @property
    def holds(self) -> bool:
        """Whether every formula and every claimed number is RIGHT; CANNOT JUDGE counts as not right."""
        return all(verdict == RIGHT for verdict in (*(r.verdict for r in self.equations), *(c.verdict for c in self.claims)))

    def table(self) -> str:
        """One line per equation: number, verdict, residual, repair or remark."""
        lines = [f"{'equation':>8}  {'verdict':<13}  {'residual':>8}  repair or remark"]
        for row in self.equations:
            lines.append(f"{row.equation:>8}  {row.verdict:<13}  {_shown(row.residual):>8}  {row.said}".rstrip())
        lines += [f"{c.claimed.name:>8}  {c.verdict:<13}  {'':>8}  claimed {c.claimed.count}, counted {_counted(c)}"
                  for c in self.claims]
        lines += [f"begun: {self.begun}: confirm its letters and run the audit again"] if self.begun else []
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Rows and claims as a dictionary of plain Python values."""
        return {
            "title": self.title,
            "equations": [
                {"equation": r.equation, "printed": r.printed.text, "derived": r.derived, "verdict": r.verdict,
                 "repair": r.repair or None, "residual": _finite(r.residual), "remark": r.remark or None,
                 "where": r.where or None, "place": r.printed.place or None, "section": r.printed.section,
                 "repaired": r.repaired.text if r.repaired else None,
                 "residual_repaired": _finite(r.repaired_residual), "symbolic": r.symbolic} for r in self.equations],
            "claims": [
                {"claim": c.claimed.words, "printed": c.claimed.count, "derived": c.counted, "verdict": c.verdict,
                 "remark": c.remark or None} for c in self.claims],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """`to_dict` as JSON text, also written to the file `path` where one is named."""
        return as_json(self.to_dict(), path).removesuffix("\n")

    def document(self) -> Document:
        """A document with every formula as printed, its verdict and its repair."""
        counts = {v: sum(r.verdict == v for r in self.equations) for v in VERDICTS}
        rows = [[v, str(n), VERDICTS[v]] for v, n in counts.items() if n]
        blocks: list[Block] = [Paragraph(HOW), Table(["verdict", "equations", "meaning"], rows)]
        blocks.append(Section("Overview", [Table(["equation", "verdict", "residual", "repair or remark"], [
            [r.equation, r.verdict, _shown(r.residual), escaped(r.said)] for r in self.equations])]))
        for section in dict.fromkeys(r.printed.section for r in self.equations):
            rows_in = [r for r in self.equations if r.printed.section == section]
            blocks.append(Section(section or "Equations", [*[b for r in rows_in for b in _blocks(r)], _symbols(rows_in)]))
        if self.claims:
            table = [[c.claimed.words, str(c.claimed.count), _counted(c), c.verdict] for c in self.claims]
            blocks.append(Section("Claimed numbers", [Table(["what", "claimed", "counted", "verdict"], table)]))
        return Document(f"Audit: {self.title}" if self.title else "Audit of published formulas", blocks)

    def save(self, path: str | Path) -> Path:
        """Write the document to a file, format by its ending (.html, .md or .tex); returns its path."""
        return self.document().save(path)


def _counted(c: Count) -> str:
    return f"{'-' if c.counted is None else c.counted}" + (f" ({c.remark})" if c.remark else "")


def _finite(x: float | None) -> float | None:
    return x if x is not None and math.isfinite(x) else None


def _shown(x: float | None) -> str:
    return "-" if x is None or not math.isfinite(x) else "0" if x == 0 else f"{x:.1e}"


def _blocks(row: Row) -> list[Block]:
    printed, how = row.printed, ", the sides are identical in symbols" if row.symbolic and row.repaired is None else ""
    at = f" ({printed.place})" if printed.place else ""
    if not printed.statements:
        shown: list[Block] = [Equation(printed.tex, row.equation, row.verdict)] if _prints(printed.tex) else [Code(printed.raw)]
        return [*shown, Paragraph(f"{escaped(row.equation)}: {row.verdict}: {escaped(row.remark)}.")]
    tex = printed.tex if _prints(printed.tex) else _latex(printed)
    out: list[Block] = [Equation(tex, row.equation, row.verdict + how + escaped(at))]
    if row.said:
        repair, label = row.tex or escaped(row.repair), "repair: " if row.where else "Repair: "
        out.append(Paragraph(told(escaped(f"for {row.where}" * bool(row.where)), f"{label}{repair}" * bool(repair),
                                  escaped(row.remark)) + "."))
    after = ", the sides are identical in symbols" if row.symbolic else ""
    if row.repaired is not None and row.repaired.statements != row.printed.statements:
        out.append(Equation(_latex(row.repaired), None, f"repaired, residual {_shown(row.repaired_residual)}{after}"))
    return out


def _prints(tex: str) -> bool:
    """Whether the TeX of an author is such that a page shows it."""
    try:
        return bool(tex and display(tex))
    except (FormulaError, RecursionError):
        return False


def _symbols(rows: list[Row]) -> Table:
    """The symbols of some equations with their units and the meanings with which they were compared."""
    found: dict[tuple[str, str, str], None] = {}
    for row in rows:
        equation = row.repaired or row.printed
        for name in sorted(equation.used | (row.printed.used & set(equation.scope.symbols))):
            meaning = equation.scope.symbols[name]
            if meaning.letter == "0":  # what an equation stands for is no letter of the paper
                continue
            letter = f"${latex.name(name, equation.scope.letters)}$ ({name})"
            found[letter, ", ".join(map(str, meaning.units)), meaning.text] = None
    return Table(["symbol", "unit", "meaning"], [list(key) for key in found])


def _latex(equation: Printed) -> str:
    return r" \\ ".join(latex.statement(s, equation.scope.letters) for s in equation.statements)


@naming_arguments
def audit(source: str | Path, laws: Mapping[str, type] | None = None, counts: Counts | None = None,
          quantities: Mapping[str, Any] | None = None, meanings: str | Path | None = None) -> Audit:
    """Compare published formulas, given as a file or as its text, with their derivation; returns an `Audit` of verdicts.

    source: a file of printed formulas (.audit), or a paper in TeX or Markdown (.tex, .md), whose displayed equations are read.
    laws: classes of your own that the text names, {name: class}. counts: numbers to compare with those that the text claims,
    {words of the claim: number, or a function without arguments that returns it}; a claim not listed gets CANNOT JUDGE.
    quantities: further meanings used by the text, {meaning: expression of SymPy in names of the text; t is the time}.
    meanings: of a paper, the table of what its letters mean (a file, or its text in several lines; default: the name of the paper
    with the ending .meanings). Where there is no such file, it is begun from the letters found, as guesses to confirm.
    The notation and the wordings of meanings are described in docs/reports.md. A line that cannot be read becomes a row with the
    reason. Raises AuditError where there is neither an equation nor a claim, OptionError for an argument that does not fit."""
    remedy = "give a file of printed formulas, or its text"
    text = source if isinstance(source, str) and "\n" in source else str(option("source", source, path_of, remedy))
    own = _by_name("laws", laws, lambda law: isinstance(law, type), "a class of a law",
                   "give {name: class of a law}")
    given = _by_name("counts", counts, counts_something, "a whole number from 0, or a function",
                     "give {words of the claim: number, or a function that counts}")
    file = None if "\n" in text else Path(text)
    if file is not None and not file.is_file():
        raise AuditError(f"there is no file '{text}'; name one with printed formulas, or give their text in several lines")
    text = text if file is None else _text_of(file)
    stated = _by_name("quantities", quantities, is_expression, "an expression of SymPy or a number",
                      "give {meaning: expression of SymPy in names of the text}")
    begun_ = ""
    if meanings is not None or (file is not None and file.suffix in PAPERS):
        found, begun_ = _of_paper(text, file, meanings, own, stated)
    else:
        found = read(text, own, stated)
    if not found.equations and not found.claims:
        raise AuditError(f"there are no equations, such as '1: a = b + c', and no claims in {shown(source)}: add some")
    for words in sorted(set(given) - {c.words for c in found.claims}):
        raise OptionError(f"counts = {shown(counts)}: the text has no claim with the words {shown(words)}; its claims: "
                          f"{', '.join(shown(c.words) for c in found.claims) or 'none, leave counts out'}")
    return Audit(found.title, tuple(audit_text(found)), tuple(count(c, given) for c in found.claims), begun_)


PAPERS = (".tex", ".md")  #: endings of files that are read as papers


def _of_paper(text: str, file: Path | None, meanings: str | Path | None, own: Mapping[str, type],
              stated: Mapping[str, Any]) -> tuple[Text, str]:
    """The displays of a paper with their table of meanings, and the name of the file of a table that is begun here."""
    shown_ = displays(text, markdown=file is not None and file.suffix == ".md")
    if meanings is not None and all(one.trouble for one in shown_):
        raise OptionError(f"meanings = {shown(meanings)}: the text displays no equation in TeX that can be read, whose letters a "
                          "table could explain; leave it out")
    paper, begun_ = file.name if file is not None else "the text", ""
    if isinstance(meanings, str) and "\n" in meanings:
        table, name = meanings, "meanings"
    else:
        remedy = "give the file of the table, or its text in several lines"
        beside = file.with_suffix(".meanings") if file is not None else None
        path = Path(option("meanings", beside if meanings is None else meanings, path_of, remedy))
        if not path.is_file():
            write_file(path, begun(shown_, text, paper))
            begun_ = str(path)
        table, name = _text_of(path), path.name
    found = Paper(shown_, paper, table, name, tuple(sorted(own.items())), stated).read_paper()
    found.title = found.title or paper
    return found, begun_


def _by_name(name: str, value: Any, fits: Callable[[Any], bool], wanted: str, remedy: str) -> Mapping[str, Any]:
    """A checked option that maps names to values for which `fits` holds; None becomes an empty mapping. wanted: such a value in
    words."""
    found: Mapping[str, Any] = option(name, {} if value is None else value, of_class, remedy, base=Mapping)
    for key, entry in found.items():
        if not isinstance(key, str):
            raise OptionError(f"{name}: the key {shown(key)} is no text; {remedy}")
        if not fits(entry):
            raise OptionError(f"{name}[{shown(key)}] = {shown(entry)} is not {wanted}; {remedy}")
    return found


def _text_of(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise AuditError(f"'{file}' cannot be read: {error}; give a readable text file in UTF-8") from error
