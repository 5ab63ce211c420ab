"""Verdicts on printed formulas by rules that depend on no particular formula: RIGHT, MISPRINT with a repair, INCOMPLETE,
AMBIGUOUS, CANNOT JUDGE. Where sizes do not fit, the verdict is MISPRINT only if a change repairs the formula.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from mbdae.audit.compare import SAME, Compared, ComparedStates, compared, difference, identical
from mbdae.audit.edits import faults, of_definitions
from mbdae.audit.evaluate import NO_VALUE, attempt, reason
from mbdae.audit.laws import of_laws
from mbdae.audit.motion import RandomMotion
from mbdae.audit.notation import Relation
from mbdae.audit.phrases import Definition, Meaning
from mbdae.audit.reading import Printed, Text
from mbdae.audit.remarks import domain, in_part, left_out, remarks
from mbdae.audit.rules_laws import UnlistedError, names
from mbdae.audit.rules_motion import defined_by, law_of_motion, may_define
from mbdae.audit.search import Repair, missing_term, repair

RIGHT, MISPRINT, INCOMPLETE, AMBIGUOUS, CANNOT = "RIGHT", "MISPRINT", "INCOMPLETE", "AMBIGUOUS", "CANNOT JUDGE"
VERDICTS = {
    RIGHT: "both sides agree in random states of motion in which they are real, under the conditions said after `for`",
    MISPRINT: "the sides differ; the repair is the smallest change after which they agree",
    INCOMPLETE: "right, but a term with a quantity the text names nowhere, a case, or a listed force is missing",
    AMBIGUOUS: "right on one side of the equations of motion, while formulas that belong to it are right on the other; "
               "or right if all that follows a slash is a divisor, as in a/2b",
    CANNOT: "the formula cannot be read, a piece of it has no value, or nothing says what a quantity is",
}
SLASH = re.compile(r"/\s*[\\\w]")  #: a divisor without brackets
SIGN = "right with the opposite sign"
#: side on which a rule gives a force, and the side to declare in a text with the opposite sign
DECLARED = {"left": "applied", "applied": "left"}
OPPOSITE = {"applied": "as the forces applied to the bodies or with the opposite multipliers",
            "left": "as it stands on the left-hand side of the equations of motion"}
SIDES = {1: "applied to the bodies", -1: "on the left-hand side of the equations of motion"}


@dataclass(frozen=True, repr=False)
class Row:
    """The verdict on one equation."""

    printed: Printed
    verdict: str
    residual: float  #: largest relative difference of the sides as printed
    repair: str = ""
    remark: str = ""
    repaired: Printed | None = None
    repaired_residual: float | None = None
    symbolic: bool = False  #: whether the sides (after a repair, if any) are also identical polynomials in symbols
    side: int | None = None  #: key of SIDES: side on which a force is right, where the text leaves the side open
    tex: str = ""  #: the repair with the formulas in TeX
    where: str = ""  #: of a formula that is right, the conditions under which it is: "x in (-1, 1)"; "" where it holds everywhere

    @property
    def equation(self) -> str:
        """The number of the equation."""
        return self.printed.number

    def __repr__(self) -> str:
        said = f", said={self.said!r}" if self.said else ""
        return f"Row({self.equation!r}, {self.printed.text!r}, {self.verdict!r}, residual={self.residual:.3g}{said})"

    @property
    def said(self) -> str:
        """Domain, repair and remark in one text."""
        return told(f"for {self.where}" if self.where else "", self.repair, self.remark)

    @property
    def derived(self) -> str:
        """The right formula: as printed where it is right, else repaired, else the quantity in words."""
        if self.repaired is not None and self.repaired.statements != self.printed.statements:
            return self.repaired.text
        if self.residual < SAME or self.repaired is not None:
            return self.printed.text
        if self.verdict == INCOMPLETE and self.residual > SAME:
            return f"{self.printed.text}; {self.repair}"
        return meanings(self.printed)


def told(*remarks: str) -> str:
    """Non-empty remarks joined to one text."""
    return "; ".join(filter(None, remarks))


def meanings(equation: Printed) -> str:
    """The quantities the equation was compared with, in words."""
    if equation.quantity is not None:
        return equation.quantity.text
    if not equation.statements:
        return "cannot be read"
    names = [str(s.subject) for s in equation.statements]
    known = equation.scope.symbols
    return "; ".join(f"{n}: {known[n].text}" if n in known else n for n in names)


def audit_text(text: Text) -> list[Row]:
    """A verdict on every equation of a text."""
    shared: dict[tuple[str, int, str], RandomMotion] = {}
    rows = [audit_equation(equation, shared) for equation in text.equations]
    return [_of_group(row, rows) for row in rows]


def audit_equation(equation: Printed, shared: dict[tuple[str, int, str], RandomMotion] | None = None, search: bool = True) -> Row:
    """The verdict on one equation alone; search: whether to look for a repair."""
    if equation.trouble:
        return _cannot(equation, equation.trouble)
    states = ComparedStates(equation, equation.inner or "l", shared=shared if shared is not None else {})
    try:
        with np.errstate(all="ignore"):
            states = states.fitting()
            wrong = [fault for s in equation.statements for fault in of_definitions(s, states.free[:2])]
            if equation.undecided:
                return _by_units(equation, states, wrong)
            wrong += of_laws(_named(equation), equation.scope.own)
            return _cannot(equation, wrong[0]) if wrong else _with_unlisted(_verdict(equation, states, search), states)
    except NO_VALUE as error:
        return _cannot(equation, reason(error, meanings(equation)))
    except RecursionError:
        return _cannot(equation, "its formulas, with the definitions that they contain, stand too deep in each other")


def _by_units(equation: Printed, states: ComparedStates, wrong: list[str]) -> Row:
    """The verdict on an equation of which nothing but the units can be judged; wrong: what is wrong with those of definitions."""
    wrong = wrong or [fault for s in equation.statements for fault in faults(s, states.free[:2])]
    if wrong and not equation.guessed:
        return Row(equation, MISPRINT, float("nan"), remark=told(wrong[0], equation.undecided))
    return _cannot(equation, told(equation.undecided, f"by the guessed units {wrong[0]}" if wrong else "its units agree"))


def _with_unlisted(row: Row, states: ComparedStates) -> Row:
    """The verdict with a remark on a force that the text does not list; a right formula becomes INCOMPLETE by it."""
    said = _unlisted(row.printed, states)
    if not said:
        return row
    if row.verdict == RIGHT:
        # earlier remarks on resultants assumed that all forces are listed: they are dropped
        return replace(row, verdict=INCOMPLETE, remark=said)
    return replace(row, remark=told(said, row.remark))


def _unlisted(equation: Printed, states: ComparedStates) -> str:
    """Remark on a force that acts on a part the text does not list; empty where there is none."""
    listed = dict[str, frozenset[str]]()
    for meaning in _meanings(equation):
        force, _, parts = meaning.text.partition(" on ")
        listed[force] = listed.get(force, frozenset()) | frozenset(names(parts))
    try:
        for env in (*states.free, *states.joint):
            for meaning in _meanings(equation):
                meaning.value(replace(env, complete=listed[meaning.text.partition(" on ")[0]], store={}))
    except UnlistedError as error:
        return str(error)
    except NO_VALUE:
        pass
    return ""


def _meanings(equation: Printed) -> list[Meaning]:
    """Meanings of the symbols in the formulas, without those that the text itself defines."""
    used = [equation.scope.symbols[n] for n in sorted(equation.scope.reached(equation.used))]
    return [m for m in [*used, equation.quantity] if m is not None and not isinstance(m, Definition)]


def _named(equation: Printed) -> set[str]:
    """Words of the meanings, among them the names of laws."""
    return {word for m in _meanings(equation) for word in m.words if isinstance(word, str)}


def _cannot(equation: Printed, why: str) -> Row:
    return Row(equation, CANNOT, float("nan"), remark=why)


def _verdict(equation: Printed, states: ComparedStates, search: bool) -> Row:
    gaps = [compared(s, states) for s in equation.statements]
    residual = max(c.gap for c in gaps)
    open_sides = _open_sides(equation)
    if open_sides and ("open" in open_sides or not all(c.same for c in gaps)):
        turned = replace(states, side=-1)
        other = [compared(s, turned) for s in equation.statements]
        right = [side for side, found in ((1, gaps), (-1, other)) if all(c.same for c in found)]
        if right:
            return _on_a_side(equation, states, right[0], max(c.gap for c in (gaps if right[0] == 1 else other)), open_sides)
    if not all(c.same for c in gaps):
        return _wrong(equation, states, gaps, search)
    nowhere_else = "" if all(c.everywhere for c in gaps) else "holds where the bodies are joined as the text says"
    found = domain(equation, states)
    if found.gap:
        return Row(equation, INCOMPLETE, residual, f"say what holds where {found.gap} = 0",
                   told(f"not defined where {found.gap} = 0", nowhere_else))
    units = "; ".join(f for s in equation.statements for f in faults(s, states.free[:2]))
    said = units or told(nowhere_else, *remarks(equation, states))
    return Row(equation, MISPRINT if units else RIGHT, residual, remark=said, where="" if units else found.said,
               symbolic=not nowhere_else and identical(equation, states.inner))


def _open_sides(equation: Printed) -> set[str]:
    """Sides ("open", "left", "applied") on which the rules give the forces of a formula; none where the text declares a side."""
    symbols = equation.scope.symbols
    return set() if equation.scope.sides else {symbols[n].phrase.side for n in equation.used} - {""}


def _on_a_side(equation: Printed, states: ComparedStates, side: int, gap: float, open_sides: set[str]) -> Row:
    """The verdict on a force that is right on one side of the equations of motion only."""
    if open_sides & set(DECLARED):
        other = next(DECLARED[s] for s in DECLARED if s in open_sides)
        said = f"{SIGN}, {OPPOSITE[other]}"
        return Row(equation, AMBIGUOUS, gap, f"say on which side: forces: {other}", said)
    return Row(equation, RIGHT, gap, remark=_unbalanced(equation, states), symbolic=identical(equation, states.inner, side),
               side=side)


def _unbalanced(equation: Printed, states: ComparedStates) -> str:
    """Remark on forces and moments printed for both bodies that leave a resultant moment; empty where there is none."""
    env, total = states.joint[0], np.zeros((3, 1))
    sides = {equation.scope.symbols[n].words[0]: n for n in map(str, (s.subject for s in equation.statements))
             if n in equation.scope.symbols and equation.scope.symbols[n].phrase.side == "open"}
    if set(sides) != {"k", "l"}:
        return ""
    for side, name in sides.items():
        value = np.real(env.value(name))
        if value.shape != (6, 1):
            return ""
        total = total + value[3:] + np.cross(np.real(env.motion.of("x", side)), value[:3], axis=0)
    return "" if np.max(np.abs(total)) < SAME else "action and reaction act at two points and leave a moment"


def _wrong(equation: Printed, states: ComparedStates, gaps: list[Compared], search: bool) -> Row:
    residual = max(c.gap for c in gaps)
    doubt = next((c.doubt for c in gaps if c.doubt), "")
    units = "; ".join(f for s in equation.statements for f in faults(s, states.free[:2]))
    if doubt and not any(c.mendable for c in gaps):
        return Row(equation, MISPRINT, residual, remark=units) if units else _cannot(equation, doubt)
    defined = [n for s in equation.statements for n in defined_by(s, equation.scope)]
    if defined and units:
        return Row(equation, MISPRINT, residual, remark=units)
    if law := law_of_motion(equation):
        return Row(equation, MISPRINT, residual, remark=units) if units else _cannot(equation, law)
    if defined:
        return _cannot(equation, f"nothing but this formula says what {defined[0]} is: write it as `let`, or give its meaning")
    lacking = _lacking(equation, states)
    if lacking:
        name, text = lacking
        scope = equation.scope.widened(equation.used)
        found = missing_term(equation, states, scope, name) if len(equation.statements) == 1 else None
        remark = f"agrees where the {text} is zero, which the text names nowhere ({name} here)"
        return Row(equation, INCOMPLETE, residual, str(found or f"terms in the {text} are missing"), remark)
    done_without = _without_parameters(equation, states)
    if done_without:
        values, side = done_without
        said = told(f"agrees where {values}, which the text names nowhere", SIGN if side == -1 else "")
        return Row(equation, INCOMPLETE, residual, f"say that {values}", told(said, units))
    if not doubt and _joined(equation, states):
        said = "holds where a revolute joint connects the bodies, which the text does not say"
        return Row(equation, INCOMPLETE, residual, "states: revolute", said)
    wrong = [s for s in equation.statements if not compared(s, states).same]
    free = [_definable(s, states) for s in wrong]
    if not (units or doubt) and all(free):
        return _cannot(equation, f"the text gives {free[0]} as a number and does not say which: the formula may define it")
    found = repair(equation, states) if search else None
    part = "" if doubt or units else in_part(equation, states)
    if part:
        return Row(equation, INCOMPLETE, residual, f"say that it holds for {part}", f"or {found}" if found else "",
                   repaired=found.equation if found else None)
    if found is not None:
        why = told(*dict.fromkeys((units, doubt)))
        if found.below and SLASH.search(equation.tex):
            return Row(equation, AMBIGUOUS, residual, f"brackets around what follows the slash ({found})", why, tex=found.tex)
        return _repaired(Row(equation, MISPRINT, residual, str(found), why, tex=found.tex), found, states)
    return _cannot(equation, doubt) if doubt else Row(equation, MISPRINT, residual, remark=units)


def _definable(statement: Relation, states: ComparedStates) -> str:
    """A number that a statement defines if it is right; empty where there is none, or where it is wrong whatever that is, unless
    it is 0, which needs no letter."""
    for name, parts in may_define(statement, states.equation.scope):
        zero = [[attempt(s, replace(env, zero=name, store={})) for s in statement.sides] for env in states.free]
        if all(v is not None and difference(row[0], v) < SAME for row in zero for v in row):
            continue
        if all(len(part.sides) < 2 or compared(part, states).same or _definable(part, states) for part in parts):
            return name
    return ""


def _without_parameters(equation: Printed, states: ComparedStates) -> tuple[str, int] | None:
    """Parameters without whose effect the formula is right, in words, and the side of the equations of motion it is right on."""
    for side in (1, -1) if _open_sides(equation) else (states.side,):
        found = left_out(equation, replace(states, side=side), _named(equation))
        if found:
            return " and ".join(f"parameter {n} is {v:g}" for n, v in found.items()), side
    return None


def _joined(equation: Printed, states: ComparedStates) -> bool:
    """Whether an equation with a relative angle, in a text that names no joint, holds for a revolute joint."""
    if equation.states != "free" or not any("relative angle" in equation.scope.symbols[n].text for n in equation.used):
        return False
    joined = replace(states, equation=replace(equation, states="revolute", only=True))
    return all(compared(s, joined).same for s in equation.statements)


def _repaired(row: Row, found: Repair, states: ComparedStates) -> Row:
    again = replace(states, equation=found.equation, inner=found.equation.inner or "l")
    gap = max(compared(s, again).gap for s in found.equation.statements)
    new = [f"{n} is the {m.text}" for n, m in found.equation.scope.symbols.items()
           if n not in row.printed.scope.symbols and n in found.equation.used]
    accents = ["accents alone, which are easily lost in printing and reading"] if found.accents else []
    row = replace(row, remark=told(row.remark, *new, *accents))
    same = identical(found.equation, again.inner, states.side)
    return replace(row, repaired=found.equation, repaired_residual=gap, symbolic=same)


def _lacking(equation: Printed, states: ComparedStates) -> tuple[str, str] | None:
    """A quantity that the text does not name and without which the equation is right: its symbol and wording; None if none."""
    known = set(equation.scope.symbols)
    scope = equation.scope.widened(equation.used)
    for name in set(scope.symbols) - known:
        without = replace(states, absent=scope.symbols[name].text)
        if all(compared(s, without).same for s in equation.statements):
            return name, scope.symbols[name].text
    return None


def _of_group(row: Row, rows: list[Row]) -> Row:
    """The verdict in the context of its section: forces whose side of the equations of motion the text leaves open must all be
    right on the same side."""
    if row.side is None:
        return row
    group = [r for r in rows if r.side is not None and r.printed.section == row.printed.section]
    against = [r.equation for r in group if r.side != row.side]
    if not against:
        return replace(row, remark=told(f"as {SIDES[row.side]}", row.remark))
    others = f"{', '.join(against)} {'is' if len(against) == 1 else 'are'} right {SIDES[-row.side]}"
    remark = told(f"right {SIDES[row.side]}", others, row.remark)
    return replace(row, verdict=AMBIGUOUS, remark=remark, repair=f"the other sign here, or in {', '.join(against)}")

