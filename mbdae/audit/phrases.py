"""Phrases that define a symbol ("force of rows tilt_y of Revolute on turn k"), each with the rule that computes its value.

The modules `rules_*` register a rule for every kind of phrase by `register` or `@phrase`; `reading` imports them all. This module
contains no printed formula.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit import carried
from mbdae.audit.calculus import MOVING, chain, exact
from mbdae.audit.evaluate import STEP, SizeError, Value, derivative, evaluate, shifted
from mbdae.audit.laws import PARAMETER, PHRASES, Own, Phrase
from mbdae.audit.motion import RandomMotion
from mbdae.audit.notation import AuditError, Node, Relation
from mbdae.reports.units import Unit, unit


@dataclass(frozen=True)
class Meaning:
    """The printed meaning of a symbol: phrase, unit (one for all rows, or one for every block of three rows) and rule."""

    text: str
    units: tuple[Unit, ...]
    phrase: Phrase
    words: tuple[Any, ...]
    letter: str = ""  #: how the text prints the symbol, in TeX

    def value(self, env: Env) -> Value:
        """Value of the quantity in a state, in SI units."""
        return self.phrase.rule(env, *self.words)


def understand(text: str, units: tuple[Unit, ...], line: int = 0, name: str = "", letter: str = "") -> Meaning:
    """The meaning of a phrase; AuditError where no rule covers it."""
    found = [(known, match) for known in PHRASES if (match := known.pattern.match(text))]
    if found:  # of several matching wordings take the most specific
        known, match = min(found, key=lambda pair: sum(map(len, pair[1].groups())))
        own = (name or text,) if known.given else ()
        return Meaning(f"{text} {name}" if known.given and name else text, units, known, (*own, *match.groups()), letter)
    raise AuditError(f"line {line}: mbdae does not know the meaning '{text}'; the list of those it knows: "
                     "from mbdae.audit import wordings; wordings()")


#: stands in for the phrase of a symbol that the text (`let`) or the caller of `audit` defines
OWN = Phrase(re.compile(""), lambda env: None, True, "", "")


@dataclass(frozen=True)
class Definition(Meaning):
    """A symbol that the text defines by a formula of earlier symbols (`let`)."""

    node: Any = None
    scope: Any = None


@dataclass(frozen=True)
class Scope:
    """What a formula may refer to: symbols with their meaning, earlier statements by number, the user's laws."""

    symbols: Mapping[str, Meaning]
    printed: Mapping[str, tuple[Relation, ...]] = field(default_factory=dict)
    own: Own = ()
    sides: str = ""  #: "left" or "applied": side of the equations of motion that the text declares for its forces
    written: Mapping[str, str] = field(default_factory=dict)  #: {formula: how the text prints it, in TeX}

    def widened(self, names: Iterable[str]) -> Scope:
        """This scope with the quantities that derivations of the named symbols contain and the text does not declare."""
        table, known = dict(self.symbols), {m.text for m in self.symbols.values()}
        for name in names:
            for new, units, text in self.symbols[name].phrase.needs:
                if text not in known:
                    while new in table:
                        new += "_"
                    table[new] = understand(text, (unit(units),))
        return replace(self, symbols=table)

    @cached_property
    def letters(self) -> dict[str, str]:
        """{symbol: TeX} as the text gives it; names in upright letters where their default TeX is that of another symbol."""
        found = {n: m.letter for n, m in self.symbols.items() if m.letter}
        taken = set(found.values())
        for n in sorted(self.symbols.keys() - found.keys(), key=len):
            tex = carried.name(n)
            found |= {n: rf"\mathrm{{{n}}}".replace("_", r"\_")} if tex in taken else {}
            taken.add(tex)
        return found | dict(self.written)

    @cached_property
    def texts(self) -> frozenset[str]:
        """The wordings of all meanings that the scope declares."""
        return frozenset(m.text for m in self.symbols.values())

    @cached_property
    def derivatives(self) -> dict[Node, Node | None]:
        """Derivatives by the rules of calculus that were asked for, see `calculus`."""
        return {}

    def printed_side(self, name: str, number: str) -> Node:
        """The formula that the earlier equation `number` prints for the symbol `name`."""
        for statement in self.printed.get(number, ()):
            if str(statement.sides[0]) == name:
                return statement.sides[-1]
        raise AuditError(f"no equation {number} above prints `{name} = ...`; name the equation that defines {name}")

    def reached(self, names: Iterable[str]) -> set[str]:
        """The named symbols and all symbols that their definitions contain."""
        out: set[str] = set()
        for name in names:
            if name in self.symbols and name not in out:
                meaning = self.symbols[name]
                out |= {name} | (meaning.scope.reached(meaning.node.free) if isinstance(meaning, Definition) else set())
        return out


@dataclass
class Env:
    """Values of the symbols of a text (its `Scope`) in one state; formulas are evaluated in it."""

    motion: RandomMotion
    scope: Scope
    inner: str = "l"  #: the body that carries the inner race
    #: forces whose side of the equations of motion is open count as applied to the bodies (1) or as on the left-hand side (-1)
    side: int = 1
    fill: int = 1  #: number of rows of a literal 0 where no neighbouring block gives it
    scale: Mapping[str, float] | None = None  #: sizes of the basic units, for the check of units
    zero: str | None = None  #: a symbol that is set to zero
    #: for derivatives: meanings of symbols in words, each with the index of one of its entries, the increment added to it or to
    #: its rate of an order, and the time from which that grows
    shifts: tuple[tuple[str, int, Value, int, Value], ...] = ()
    watch: dict[str, set[bool]] | None = None  #: where it is kept by the formula of a divisor whether this was positive
    #: what a force acts on by other symbols of the formula; where given, a part that the text does not list raises an error
    complete: frozenset[str] | None = None
    #: wordings declared outside of this scope, which the formula of an earlier `let` may need
    stated: frozenset[str] = frozenset()
    names: Mapping[str, Value] = field(default_factory=dict)  #: values of names bound by a sum or an integral
    #: cache: values of symbols and pieces of formulas in this state, and the caches of states that are reached from it by a step
    store: dict[Any, Any] = field(default_factory=dict)

    def value(self, name: str) -> Value:
        """The value of a symbol."""
        if name in self.names:
            return self.names[name]
        if name not in self.store:
            self.store[name] = self._value(name)
        return self.store[name]

    def kept(self, node: Node, rule: Callable[[Node, Env], Value]) -> Value:
        """The value of a piece of a formula by a rule, cached unless it contains names that are bound."""
        if self.names and not node.free.isdisjoint(self.names):
            return rule(node, self)
        if node not in self.store:
            self.store[node] = rule(node, self)
        return self.store[node]

    def _inner(self, *key: Any) -> Any:
        """The cache of a state that is reached from this one."""
        return self.store.setdefault(key, {})

    def _value(self, name: str) -> Value:
        if name == "I" and name not in self.scope.symbols:  # a text may mean a second moment of area by it
            return np.eye(3, dtype=int).astype(object) if self.motion.symbolic else np.eye(3) + 0j
        if name == "pi" and name not in self.scope.symbols:
            return se.pi if self.motion.symbolic else complex(np.pi)
        meaning = self._meaning(name)
        if isinstance(meaning, Definition):
            value = evaluate(meaning.node, replace(self, scope=meaning.scope, stated=self.stated | self.scope.texts, names={},
                                                   store=self._inner(id(meaning))))
        else:
            value = meaning.value(self.plain) * self._sign(meaning.phrase)
        if not meaning.phrase.drawn:
            value = self._shifted(value, meaning.text)
        if self.scale is not None and not isinstance(meaning, Definition):
            value = value * scaled(meaning.units, value, self.scale)
        return value * 0 if name == self.zero else value

    def _meaning(self, name: str) -> Meaning:
        if name not in self.scope.symbols:
            raise AuditError(f"the symbol '{name}' has no meaning: declare it as `{name} [unit]: meaning`")
        return self.scope.symbols[name]

    def _sign(self, phrase: Phrase) -> int:
        """Factor of a force: -1 where the rule gives it on the side that the text does not declare; `side` where none is."""
        if not phrase.side:
            return 1
        rule = -1 if phrase.side == "left" else 1  # the side on which the rule gives the force
        return rule * {"left": -1, "applied": 1}[self.scope.sides] if self.scope.sides else self.side

    @property
    def stepped(self) -> bool:
        """Whether the values carry the imaginary part of a complex step."""
        return self.motion.stepped or any(np.imag(amount) for _, _, amount, *_ in self.shifts)

    def size_of(self, what: str) -> float:
        """Size of the unit of a step: s for "time", m for "line"; 1 for the others and unless units are checked."""
        return 1.0 if self.scale is None else {"time": self.scale["s"], "line": self.scale["m"]}.get(what, 1.0)

    def constant(self, number: float) -> Value:
        """The value of a number that stands in a formula."""
        if not self.motion.symbolic:
            return complex(number)
        return se.Integer(int(number)) if number == int(number) else se.RealDouble(number)

    @cached_property
    def plain(self) -> Env:
        """This state in SI units with no symbol set to zero, in which the rules compute."""
        return self if self.scale is None and self.zero is None else replace(self, scale=None, zero=None, store={})

    def by_rules(self, node: Node) -> Value | None:
        """The value of a derivative of numbers and functions of time by the rules of calculus; None where they do not give it."""
        place = chain(node)
        if place is not None and place[1] and place[0] in self.scope.symbols and place[0] not in self.names:
            meaning = self.scope.symbols[place[0]]
            if meaning.phrase.wording in MOVING:
                return self._rate(meaning, place[1])
        found = exact(node, self.scope) if place is None or place[0] not in self.names else None
        if found is None or found == node:
            return None
        evaluate(node.parts[0], self)  # it is real where the derivative is asked for, or says where it is
        return evaluate(found, replace(self, watch=None))

    def _rate(self, meaning: Meaning, order: int) -> Value:
        """A derivative of a function of time."""
        name, shape = meaning.words[0], (3, 1) if "vector" in meaning.phrase.wording else ()
        value = self.motion.polynomial(f"{meaning.phrase.wording} {name}", self.motion.clock, shape, order)
        for text, entry, amount, rise, since in self.shifts:
            if text == meaning.text and rise >= order:
                value = shifted(value, entry, amount * (self.motion.clock - since) ** (rise - order) / factorial(rise - order))
        if self.scale is not None:
            value = value * scaled(meaning.units, value, self.scale) / self.size_of("time") ** order
        return value

    def moved(self, how: str, amount: complex = 1j * STEP) -> Env:
        """This state after a step: "virtual", "time", "line" or "linear" (see `Motion.moved`)."""
        return replace(self, motion=self.motion.moved(how, amount), store=self._inner(how, amount))

    def changes(self, how: str, value: Callable[[Env], Value]) -> Value:
        """Derivative of a value by the step `how` of `moved`."""
        return derivative(lambda h: value(self.moved(how, h)), self.stepped)

    def at_base(self) -> Env:
        """This state before the complex step."""
        return replace(self, motion=self.motion.base, store={}) if self.motion.stepped else self

    def shifted(self, name: str, amount: complex, entry: int = 0, order: int = 0) -> Env:
        """This state with a number, or one entry of a column, increased; order: of the rate that is, of what is moving."""
        if name in self.names:
            return replace(self, names={**self.names, name: self.names[name] + amount})
        meaning = self._meaning(name)
        if isinstance(meaning, Definition):
            raise SizeError(f"diff is by '{name}', which `let` defines by other symbols: differentiate by one of those")
        factors = 1.0 if self.scale is None else scaled(meaning.units, self.plain.value(name), self.scale)
        size = float(np.real(np.ravel(factors)[0])) / self.size_of("time") ** order
        shifts = (*self.shifts, (meaning.text, entry, amount / size, order, self.motion.clock))
        return replace(self, shifts=shifts, store=self._inner(name, entry, amount, order))

    def _shifted(self, value: Value, text: str) -> Value:
        """The value of the quantity with a wording, with its increments."""
        for name, entry, amount, order, since in self.shifts:
            if name == text:
                value = shifted(value, entry, amount * (self.motion.clock - since) ** order / factorial(order))
        return value

    def watched(self, divisor: Node, value: Value) -> None:
        """Keep the sign of a divisor where `watch` asks for it."""
        if self.watch is not None and divisor.free.isdisjoint(self.names):
            self.watch.setdefault(str(divisor), set()).add(bool(np.real(value) > 0))

    def touching(self) -> Env:
        """This state without a step, moved so far that the pin touches its race."""
        base = self.at_base()
        if base.motion.kind == "clearance":
            return base
        memory = base.motion.memory
        memory.setdefault("touching", RandomMotion(base.motion.seed, "clearance"))
        return replace(base, motion=memory["touching"], store={})

    def bound(self, name: str, value: Value) -> Env:
        """This state with a value for a name that a sum or an integral binds."""
        return replace(self, names={**self.names, name: value})

    def drawn(self, key: str, draw: Callable[[str], Value]) -> Value:
        """A random value, reproducible by its wording, plus its increment if it is the shifted quantity."""
        return self._shifted(draw(key) + 0j, key)

    def number(self, key: str) -> Value:
        """A random number of either sign, reproducible by its wording."""
        return self.drawn(key, self.motion.number)

    def positive(self, key: str) -> Value:
        """A random positive number, reproducible by its wording."""
        return self.drawn(key, self.motion.positive)

    def parameters(self, of: str) -> frozenset[str]:
        """The parameters of a law that the text declares."""
        found = map(PARAMETER.match, self.stated | self.scope.texts)
        return frozenset(match[1] for match in found if match and match[2] == of)

    def declares(self, *wordings: str) -> bool:
        """Whether the text declares a quantity with one of these wordings."""
        return bool((self.stated | self.scope.texts) & set(wordings))

    def printed(self, name: str, number: str) -> Value:
        """The value of the formula that the earlier equation `number` prints for the symbol `name`."""
        return evaluate(self.scope.printed_side(name, number), self)

    def of(self, text: str) -> Value:
        """The value of the quantity with a wording."""
        return understand(text, ()).value(self)


def scaled(units: tuple[Unit, ...], value: Value, scale: Mapping[str, float]) -> Any:
    """Factors by which a value of those units changes when the basic units have the sizes in `scale`."""
    factors = np.array([u.size(scale) for u in units])
    if len(factors) == 1 or np.ndim(value) == 0:
        return factors[0]
    if value.shape[0] % len(factors):
        raise SizeError(f"{len(factors)} units are declared for {value.shape[0]} rows: give one, or one for each equal block")
    return np.repeat(factors, value.shape[0] // len(factors))[:, None]
