"""Files of printed formulas: sections, symbols with their printed meaning, numbered equations, countable claims.

    title: TEXT
    inner race: k                    (contact only) the body that the text calls the inner race
    section: TEXT
    states: revolute                 the section speaks of bodies connected by a revolute joint ("only": of no others)
    NAME [UNIT]: MEANING             a symbol, from here on
    NUMBER: STATEMENT                an equation; further statements and lines are indented
    NUMBER (MEANING): STATEMENT      an equation for a quantity that has no symbol
    claims:                          from here on `NAME: NUMBER = WORDS`
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from mbdae.audit.laws import Own
from mbdae.audit.meaning import understand
from mbdae.audit.motion import KINDS
from mbdae.audit.notation import AuditError, Reader, Statement
from mbdae.audit.phrases import Meaning, Scope
from mbdae.audit.units import Unit, unit

_SYMBOL = re.compile(r"([^\W\d]\w*)\s*\[([^\]]*)\]\s*:\s*(.+)$")
_EQUATION = re.compile(r"([\w.]+)\s*(?:\((.*?)\))?\s*:\s*(.+)$")
_UNIT_OF_LAWS: tuple[Unit, ...] = ()


@dataclass(frozen=True)
class Printed:
    """One printed equation with what the text around it says."""

    number: str
    statements: tuple[Statement, ...]
    scope: Scope
    section: str = ""
    states: str = "free"
    only: bool = False  #: whether the text speaks of no other states
    quantity: Meaning | None = None  #: what the sides of the first statement are said to be, if that has no symbol
    inner: str | None = None

    @property
    def text(self) -> str:
        """The formulas as they were read."""
        return "; ".join(map(str, self.statements))


@dataclass(frozen=True)
class Claimed:
    """A number the text claims, and of what."""

    name: str
    count: int
    words: str


@dataclass
class Text:
    """What a file of printed formulas holds."""

    title: str = ""
    inner: str | None = None
    equations: list[Printed] = field(default_factory=list)
    claims: list[Claimed] = field(default_factory=list)


def read(text: str, laws: Mapping[str, type] | None = None) -> Text:
    """Read a file of printed formulas; AuditError names the line and what stands there."""
    return _File(text, tuple(sorted((laws or {}).items()))).read()


class _File:
    def __init__(self, text: str, own: Own) -> None:
        self.lines, self.own, self.found = text.splitlines(), own, Text()
        self.symbols: dict[str, Meaning] = {}
        self.printed: dict[str, tuple[Statement, ...]] = {}
        self.section, self.states, self.only, self.in_claims = "", "free", False, False

    def read(self) -> Text:
        for at, joined in self._items():
            self._item(at, joined)
        return self.found

    def _items(self) -> list[tuple[int, str]]:
        """Lines without comments; an indented line continues the one before, after a line end."""
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

    def _item(self, at: int, line: str) -> None:
        word, _, rest = line.partition(":")
        rest = rest.strip()
        if word == "title":
            self.found.title = rest
        elif word == "inner race":
            if rest not in ("k", "l"):
                raise AuditError(f"line {at}: 'inner race: {rest}': say k or l")
            self.found.inner = rest
        elif word == "section":
            self.section, self.states, self.only = rest, "free", False
        elif word == "states":
            self._states(at, rest)
        elif word == "claims":
            self.in_claims = True
        elif self.in_claims:
            self._claim(at, line)
        elif match := _SYMBOL.match(line):
            self._symbol(at, *match.groups())
        elif match := _EQUATION.match(" ".join(line.split("\n", 1)[:1])):
            self._equation(at, line, match)
        else:
            raise AuditError(f"line {at}: '{line}' is neither `NAME [UNIT]: MEANING` nor `NUMBER: STATEMENT`")

    def _states(self, at: int, words: str) -> None:
        kind, _, only = words.partition(" ")
        if kind not in KINDS or only not in ("", "only"):
            raise AuditError(f"line {at}: 'states: {words}': say one of {', '.join(KINDS)}, and 'only' where there are no others")
        self.states, self.only = kind, bool(only)

    def _symbol(self, at: int, name: str, units: str, meaning: str) -> None:
        self.symbols[name] = understand(" ".join(meaning.split()), tuple(unit(u, at) for u in units.split(",")), at)

    def _claim(self, at: int, line: str) -> None:
        match = re.match(r"(\w+)\s*:\s*(\d+)\s*=\s*(.+)$", line)
        if match is None:
            raise AuditError(f"line {at}: '{line}' is no claim: write `NAME: NUMBER = WORDS`")
        self.found.claims.append(Claimed(match[1], int(match[2]), match[3]))

    def _equation(self, at: int, line: str, match: re.Match[str]) -> None:
        said = understand(match[2], _UNIT_OF_LAWS, at) if match[2] else None
        body = line[match.start(3) :]
        statements = tuple(Reader(text, at + shift).statement() for shift, text in _statements(body))
        scope = Scope(dict(self.symbols), dict(self.printed), self.own)
        for statement in statements:
            unknown = sorted(statement.symbols() - set(self.symbols) - {"I"})
            if unknown:
                raise AuditError(f"line {statement.line}: the symbol '{unknown[0]}' has no meaning: declare it above as "
                                 f"`{unknown[0]} [unit]: meaning` (in '{statement}')")  # fmt: skip
        self.printed[match[1]] = statements
        self.found.equations.append(Printed(match[1], statements, scope, self.section, self.states, self.only, said,
                                            self.found.inner))  # fmt: skip


def _statements(body: str) -> list[tuple[int, str]]:
    """Statements of an equation with the lines they start in: a line without a relation continues the one before."""
    found: list[tuple[int, str]] = []
    for shift, line in enumerate(body.split("\n")):
        if found and "=" not in line:
            found[-1] = (found[-1][0], found[-1][1] + " " + line.strip())
        else:
            found.append((shift, line))
    return found
