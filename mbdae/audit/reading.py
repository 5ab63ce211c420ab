"""Files of printed formulas: sections, symbols with their printed meaning, numbered equations, countable claims.

    title: TEXT
    inner race: k                    (contact only) the body that the text calls the inner race
    section: TEXT
    assume: x in (-1, 1), l > r      what the text assumes of its quantities from here on, also without `assume:`
    states: revolute                 the section speaks of bodies connected by that joint ("only": of no other states)
    forces: applied                  (or left) side of the equations of motion of the forces that follow in the section
    NAME [UNIT]: MEANING             a symbol, from here on; NAME [UNIT] $TEX$: MEANING says how the text prints it
    let NAME [UNIT] = FORMULA        a symbol that the text defines; [?] where its entries have several units
    NUMBER: STATEMENT                an equation; further statements and lines are indented; it may end in `for x > 0, ...`
    NUMBER (MEANING): STATEMENT      an equation for a quantity that has no symbol
    claims:                          from here on `NAME: NUMBER = WORDS`

A line that cannot be read, and every equation that needs it, gets the verdict CANNOT JUDGE with the reason.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import sympy

from mbdae.audit import rules_contact, rules_laws, rules_motion
from mbdae.audit.calculus import TIME
from mbdae.audit.evaluate import SizeError, Value
from mbdae.audit.laws import PARAMETER, Own
from mbdae.audit.motion import checked_kind
from mbdae.audit.notation import AuditError, Node, Relation, TextReader
from mbdae.audit.phrases import OWN, Definition, Env, Meaning, Scope, understand
from mbdae.audit.rules_laws import unit_of_parameter
from mbdae.audit.rules_motion import SAID, Assumption, assumptions
from mbdae.documents.mathml import FormulaError, inline
from mbdae.reports.units import Unit, UnitError, unit

_LETTER = r"(?:\$([^$]*)\$\s*)?"
_SYMBOL = re.compile(r"([^\W\d]\w*)\s*\[([^\]]*)\]\s*" + _LETTER + r":\s*(.+)$", re.S)
_LET = re.compile(r"let\s+([^\W\d]\w*)\s*\[([^\]]*)\]\s*" + _LETTER + r"=\s*(.+)$", re.S)
_EQUATION = re.compile(r"([\w.]+)\s*(?:\((.*?)\))?\s*:\s*(.+)$")
_WITHIN = re.compile(r"(.*?)(?:,? ((?:in ?[(\[]|[<>!]).*))?")  #: a meaning, and an interval or bound after it
_ASSUMING = re.compile(r"\s(?:for|where|if)\s+")  #: between an equation and what it assumes
_CONSTANTS = {"I", "pi"}
RULES = (rules_contact, rules_laws, rules_motion)  #: named here so that they are imported, which registers their phrases


@dataclass(frozen=True)
class Printed:
    """One printed equation with what the text around it says."""

    number: str
    statements: tuple[Relation, ...]
    scope: Scope
    section: str = ""
    states: str = "free"
    #: whether the text says that the equation holds in `states` only, so that it is not compared in states of free bodies
    only: bool = False
    quantity: Meaning | None = None  #: what the sides of the first statement are, where no symbol stands for it
    inner: str | None = None  #: the body, k or l, that carries the inner race
    trouble: str = ""  #: why the equation cannot be read
    raw: str = ""  #: the equation as the file has it, where it cannot be read
    before: Mapping[str, str] = field(default_factory=dict)  #: symbol -> its earlier meaning, where its unit was another
    stated: tuple[Assumption, ...] = ()  #: what the text assumes
    tex: str = ""  #: the display as its author printed it, where the text is TeX
    place: str = ""  #: file and line it stands in
    label: str = ""  #: its label in TeX
    undecided: str = ""  #: why nothing but its units can be judged
    guessed: bool = False  #: whether the units of its letters are not confirmed either

    @property
    def text(self) -> str:
        """The formulas as they were read."""
        return "; ".join(map(str, self.statements)) or self.raw

    @property
    def used(self) -> set[str]:
        """The symbols that appear, without names bound by sums and integrals."""
        return set().union(*(s.symbols() for s in self.statements)) & set(self.scope.symbols)

    @property
    def assumed(self) -> list[Assumption]:
        """What the text assumes of the quantities that appear, or of those that they are defined by."""
        reached = self.scope.reached(self.used)
        return [one for one in self.stated if one.names & reached]


@dataclass(frozen=True)
class Claimed:
    """A number that the text claims, with the words for what it counts."""

    name: str
    count: int
    words: str


@dataclass
class Text:
    """Contents of a file of printed formulas."""

    title: str = ""
    inner: str | None = None
    equations: list[Printed] = field(default_factory=list)
    claims: list[Claimed] = field(default_factory=list)


def read(text: str, laws: Mapping[str, type] | None = None, quantities: Mapping[str, Any] | None = None) -> Text:
    """Read a file of printed formulas."""
    return TextFile(text, tuple(sorted((laws or {}).items())), quantities or {}).read()


class TextFile:
    """Reads the lines of a file of printed formulas."""

    def __init__(self, text: str, own: Own, quantities: Mapping[str, Any]) -> None:
        self.lines, self.own, self.quantities, self.found = text.splitlines(), own, quantities, Text()
        self.symbols: dict[str, Meaning] = {}
        self.before: dict[str, str] = {}
        self.unread: dict[str, str] = {}  #: why a symbol has no meaning, by its name
        self.assumed: list[Assumption] = []
        self.places: dict[str, int] = {}  #: the line of every equation, by its number
        self.printed: dict[str, tuple[Relation, ...]] = {}
        self.section, self.states, self.only, self.sides, self.doubt = "", "free", False, "", ""
        self.in_claims = False

    def read(self) -> Text:
        """All that the file holds."""
        for at, joined in self._items():
            try:
                self._item(at, joined)
            except AuditError as error:
                self._spoilt(at, joined, str(error))
        return self.found

    def _spoilt(self, at: int, line: str, why: str) -> None:
        """Record a line that cannot be read as an equation in trouble: under its number if it has one, else as "line 12"."""
        match = None if _SYMBOL.match(line) or _LET.match(line) or self._setting(line) else _EQUATION.match(line.split("\n")[0])
        number = match[1] if match else f"line {at}"
        self._add(Printed(number, (), self._scope(), self.section, trouble=why, raw=" ".join(line.split())))

    def _items(self) -> list[tuple[int, str]]:
        """Lines without comments; an indented line is joined to the one before it, with a line end between."""
        items: list[tuple[int, str]] = []
        for at, raw in enumerate(self.lines, 1):
            line = raw.split("#", 1)[0].rstrip()
            if not line.strip():
                continue
            if raw[0].isspace() and items:
                items[-1] = (items[-1][0], items[-1][1] + "\n" + line)
            else:
                items.append((at, line.strip()))
        return items

    def _setting(self, line: str) -> str:
        word = line.partition(":")[0]
        return word if word in ("title", "inner race", "section", "states", "forces", "claims", "assume") else ""

    def _item(self, at: int, line: str) -> None:
        word, rest = self._setting(line), line.partition(":")[2].strip()
        if word:
            self._set(at, word, rest)
        elif self.in_claims:
            self._claim(at, line)
        elif match := _LET.match(line):
            self._symbol(at, match[1], match[2], match[3], match[4], defined=True)
        elif match := _SYMBOL.match(line):
            self._symbol(at, match[1], match[2], match[3], match[4])
        elif match := _EQUATION.match(" ".join(line.split("\n", 1)[:1])):
            self._equation(at, line, match)
        elif SAID.search(line):
            self.assumed += self._assumptions(at, line)
        else:
            raise AuditError(f"line {at}: '{line}' is neither a symbol nor an equation: write `NAME [UNIT]: MEANING`, "
                             f"`let NAME [UNIT] = FORMULA` or `NUMBER: STATEMENT`")

    def _set(self, at: int, word: str, rest: str) -> None:
        if word == "title":
            self.found.title = rest
        elif word == "inner race":
            self.found.inner = self._one_of(at, f"inner race: {rest}", rest, ("k", "l"))
        elif word == "section":
            self.section, self.states, self.only, self.sides, self.doubt = rest, "free", False, "", ""
        elif word == "forces":
            sides = self._one_of(at, f"forces: {rest}", rest, ("left", "applied", "open"))
            self.sides = "" if sides == "open" else sides
        elif word == "claims":
            self.in_claims = True
        elif word == "assume":
            self.assumed += self._assumptions(at, rest)
        else:
            self._states(at, rest)

    def _one_of(self, at: int, what: str, given: str, known: tuple[str, ...]) -> str:
        if given not in known:
            self.doubt = f"line {at}: '{what}': say {' or '.join(known)}"
            raise AuditError(self.doubt)
        return given

    def _assumptions(self, at: int, text: str) -> list[Assumption]:
        found = assumptions(text, at)
        for one in found:
            self._known(one.text, f"line {at}", one.names, self._scope())
        return found

    def _states(self, at: int, words: str) -> None:
        only = words.endswith(" only")
        kind = words.removesuffix(" only").strip().lower()
        wrong = checked_kind(kind, self.own)
        if wrong:
            self.doubt = (f"line {at}: 'states: {words}': {wrong}; write free, clearance or the name of a joint, with `only` "
                          f"after it where the text speaks of no other states")
            raise AuditError(self.doubt)
        self.states, self.only = kind, only

    def _symbol(self, at: int, name: str, units: str, letter: str | None, meaning: str, defined: bool = False) -> None:
        old = self.symbols.pop(name, None)
        self.assumed = [one for one in self.assumed if name not in one.names]
        meaning, within = _WITHIN.fullmatch(" ".join(meaning.split())).groups("")  # type: ignore[union-attr]
        try:
            if letter is not None and not _prints(letter):
                raise AuditError(f"line {at}: '${letter}$' prints nothing or is no TeX: give the TeX of the letter that the text "
                                 f"prints for {name}")
            known = () if defined and units.strip() == "?" else tuple(_unit(u, at) for u in units.split(","))
            self.symbols[name] = self._defined(at, name, meaning, known, letter or "") if defined else (
                self._understood(at, name, meaning, known, letter or ""))
            self.assumed += self._assumptions(at, f"{name} {within}") if within else []
            self.unread.pop(name, None)
            if old is not None and [u.powers for u in old.units] != [u.powers for u in known]:
                self.before[name] = old.text
        except AuditError as error:
            self.unread[name] = str(error)
            raise

    def _understood(self, at: int, name: str, words: str, units: tuple[Unit, ...], letter: str) -> Meaning:
        if (letter or name) == "t" and words in ("number", "positive number") and [u.powers for u in units] == [unit("s").powers]:
            words = TIME  # whose rate is 1
        if words in self.quantities:
            return stated_by_caller(words, units, self.quantities[words], letter)
        if match := PARAMETER.match(words):
            stated = unit_of_parameter(match[1], match[2], self.own)
            if stated and units[0].powers not in [_unit(u, at).powers for u in stated.split(" or ")]:
                raise AuditError(f"line {at}: {words} has the unit {stated} in mbdae: declare it with that, not {units[0]}")
        return understand(words, units, at, name, letter)

    def _defined(self, at: int, name: str, words: str, units: tuple[Unit, ...], letter: str) -> Meaning:
        node = TextReader(words, at).expression()
        scope = self._scope()
        self._known(node, f"line {at}", node.free, scope)
        return Definition(f"defined as {node}", units, OWN, (), letter, node, scope)

    def _claim(self, at: int, line: str) -> None:
        match = re.match(r"(\w+)\s*:\s*(\d+)\s*=\s*(.+)$", line)
        if match is None:
            raise AuditError(f"line {at}: '{line}' is no claim: write `NAME: NUMBER = WORDS`")
        if match[1] in {c.name for c in self.found.claims}:
            raise AuditError(f"line {at}: a claim above has the name {match[1]} too: give each a name of its own")
        self.found.claims.append(Claimed(match[1], int(match[2]), match[3]))

    def _scope(self) -> Scope:
        return Scope(dict(self.symbols), dict(self.printed), self.own, self.sides)

    def _known(self, where: Node | Relation | str, line: str, names: Set[str], scope: Scope) -> None:
        for name in sorted(names - set(scope.symbols) - _CONSTANTS):
            if name in self.unread:
                declared = self.unread[name]
                raise AuditError(f"{line}: the symbol '{name}' has no meaning: correct its declaration, {declared} "
                                 f"(in '{where}')")
            raise AuditError(f"{line}: the symbol '{name}' has no meaning: declare it above as `{name} [unit]: meaning` or "
                             f"`let {name} [unit] = formula` (in '{where}')")

    def _equation(self, at: int, line: str, match: re.Match[str]) -> None:
        first = self.places.setdefault(match[1], at)
        if first != at:
            raise AuditError(f"line {at}: the equation in line {first} is {match[1]} too: give each a number of its own")
        said = understand(match[2], (), at) if match[2] else None
        body, *assumed = _ASSUMING.split(line[match.start(3) :], maxsplit=1)
        statements = tuple(TextReader(text, at + shift).statement() for shift, text in _statements(body))
        scope = self._scope()
        for statement in statements:
            self._known(statement, f"line {statement.line}", statement.symbols(), scope)
        stated = (*self.assumed, *(one for text in assumed for one in self._assumptions(at, text)))
        self.printed[match[1]] = statements
        self._add(Printed(match[1], statements, scope, self.section, self.states, self.only, said, self.found.inner, self.doubt,
                          before=dict(self.before), stated=stated))

    def _add(self, equation: Printed) -> None:
        self.found.equations.append(equation)


def is_expression(e: Any) -> bool:
    """Whether a value is an expression or a matrix of SymPy, or a number."""
    return isinstance(e, sympy.Basic | sympy.MatrixBase | int | float) and not isinstance(e, bool)


def stated_by_caller(text: str, units: tuple[Unit, ...], e: Any, letter: str = "") -> Meaning:
    """A meaning that the caller of `audit` gives as a SymPy expression in names of the text, with t the time."""
    e = sympy.sympify(e)
    names = sorted({str(s) for s in e.free_symbols})
    by_name = [next(s for s in e.free_symbols if str(s) == n) for n in names]
    compute = sympy.lambdify(by_name, e, modules="numpy")

    def rule(env: Env) -> Value:
        for name in (n for n in names if n != "t" and n not in env.scope.symbols):
            raise AuditError(f"quantities: the expression for '{text}' contains {name}: declare it in the text, or "
                             f"leave it out")
        values = [env.motion.clock if n == "t" and n not in env.scope.symbols else env.value(n) for n in names]
        try:
            found = compute(*values)
            return np.asarray(found) + 0j if np.ndim(found) else complex(found)
        except (TypeError, ValueError, NameError, AttributeError) as error:
            raise SizeError(f"quantities: the expression {e} for '{text}' cannot be evaluated ({error}): mbdae puts complex "
                            f"numbers and columns for its symbols, so give smooth functions of them, with sizes that "
                            f"fit") from error

    return Meaning(text, units, replace(OWN, rule=rule), (), letter)


def _unit(text: str, at: int) -> Unit:
    try:
        return unit(text)
    except UnitError as unknown_unit:
        raise AuditError(f"line {at}: {unknown_unit}") from unknown_unit


def _prints(letter: str) -> bool:
    try:
        return bool(re.sub(r"<[^>]*>|\s", "", html.unescape(inline(letter))))
    except (FormulaError, RecursionError):
        return False


def _statements(body: str) -> list[tuple[int, str]]:
    """Statements of an equation, each with the line (0: the first) on which it starts; a line without `=` or `<=` continues the
    statement before it."""
    found: list[tuple[int, str]] = []
    for shift, line in enumerate(body.split("\n")):
        if found and "=" not in line:
            found[-1] = (found[-1][0], found[-1][1] + " " + line.strip())
        else:
            found.append((shift, line))
    return found
