"""Phrases that say what a symbol stands for ("force of rows tilt_y of Revolute on turn k"), each with the rule that computes it.

The modules `rules_*` register one rule for every kind of phrase under `@phrase`; `meaning` loads them all. Nothing here knows
any printed formula.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import STEP, Value, evaluate
from mbdae.audit.laws import WITH_COORDINATES, Own
from mbdae.audit.motion import Motion
from mbdae.audit.notation import AuditError, Node, Statement
from mbdae.audit.units import Unit, unit

Rule = Callable[..., Value]


@dataclass(frozen=True)
class Phrase:
    """One kind of meaning: how it is worded and the rule that computes it."""

    pattern: re.Pattern[str]
    rule: Rule
    vanishes: bool  #: whether the quantity may be zero in a state the text speaks of
    signed: bool  #: whether texts leave open on which side of the equations of motion it stands (a force, its virtual work)
    wording: str
    needs: tuple[tuple[str, str, str], ...] = ()  #: (name, unit, meaning) of quantities of the derivation a text may not name


PHRASES: list[Phrase] = []


def phrase(wording: str, vanishes: bool = False, signed: bool = False,
           needs: tuple[tuple[str, str, str], ...] = ()) -> Callable[[Rule], Rule]:  # fmt: skip
    """Register a rule under its wording: "axis {i} of {side}"; {side} is k or l, {i} a number, {name} a word, {...} any words."""
    pattern = re.escape(wording).replace(r"\ ", " ")
    kinds = {"side": "(k|l)", "i": r"(\d+)", "name": rf"(\w+(?:{WITH_COORDINATES})?)"}
    pattern = re.sub(r"\\\{(\w+)\\\}", lambda m: kinds.get(m[1].rstrip("0123456789"), "(.+?)"), pattern)

    def register(rule: Rule) -> Rule:
        PHRASES.append(Phrase(re.compile(pattern + "$"), rule, vanishes, signed, wording, needs))
        return rule

    return register


def random_number(wording: str) -> Rule:
    """Register a quantity that the text gives, in every state a random number of either sign; returns its rule."""
    return phrase(wording, vanishes=True)(lambda env: env.number(wording) + 0j)


def random_positive(wording: str) -> Rule:
    """The same with a positive number."""
    return phrase(wording)(lambda env: env.positive(wording) + 0j)


@dataclass(frozen=True)
class Meaning:
    """The printed meaning of a symbol: phrase, unit (one, or one for every block of three rows) and rule."""

    text: str
    units: tuple[Unit, ...]
    phrase: Phrase
    words: tuple[str, ...]

    def value(self, env: Env) -> Value:
        """Its value in a state, in SI units."""
        return self.phrase.rule(env, *self.words)


def understand(text: str, units: tuple[Unit, ...], line: int = 0) -> Meaning:
    """The meaning of a phrase; AuditError where no rule knows it."""
    for known in PHRASES:
        match = known.pattern.match(text)
        if match:
            return Meaning(text, units, known, match.groups())
    raise AuditError(f"line {line}: no rule knows the meaning '{text}'; mbdae.audit.wordings() lists those there are")


@dataclass(frozen=True)
class Scope:
    """What a formula may refer to: symbols with their meaning, earlier statements by number, the user's laws."""

    symbols: Mapping[str, Meaning]
    printed: Mapping[str, tuple[Statement, ...]] = field(default_factory=dict)
    own: Own = ()

    def widened(self, names: Iterable[str]) -> Scope:
        """The scope with the quantities that the derivations of some symbols contain and the text does not name."""
        table, known = dict(self.symbols), {m.text for m in self.symbols.values()}
        for name in names:
            for new, units, text in self.symbols[name].phrase.needs:
                if text not in known:
                    while new in table:
                        new += "_"
                    table[new] = understand(text, (unit(units),))
        return replace(self, symbols=table)

    def printed_side(self, name: str, number: str) -> Node:
        """The formula an earlier equation prints for a symbol."""
        for statement in self.printed.get(number, ()):
            if str(statement.sides[0]) == name:
                return statement.sides[-1]
        raise AuditError(f"equation {number} defines no symbol '{name}'")


@dataclass
class Env:
    """Values of the symbols of a scope in one state; formulas are evaluated in it."""

    motion: Motion
    scope: Scope
    inner: str = "l"  #: the body that carries the inner race
    side: int = 1  #: 1: signed quantities are what is applied to the bodies, -1: what stands on the left-hand side
    scale: Mapping[str, float] | None = None  #: sizes of the basic units
    zero: str | None = None  #: a symbol that is set to zero
    shift: Mapping[str, Value] = field(default_factory=dict)
    known: dict[str, Value] = field(default_factory=dict)

    def value(self, name: str) -> Value:
        """The value of a symbol."""
        if name not in self.known:
            self.known[name] = self._value(name)
        return self.known[name]

    def _value(self, name: str) -> Value:
        if name == "I":
            return np.eye(3, dtype=int).astype(object) if self.motion.symbolic else np.eye(3) + 0j
        if name not in self.scope.symbols:
            raise AuditError(f"the symbol '{name}' has no meaning: declare it as `{name} [unit]: meaning`")
        meaning = self.scope.symbols[name]
        value = meaning.value(self.plain) * (self.side if meaning.phrase.signed else 1)
        if self.scale is not None:
            value = value * scaled(meaning.units, value, self.scale)
        return value * 0 if name == self.zero else value

    @property
    def second(self) -> float:
        """The size of the unit of time."""
        return 1.0 if self.scale is None else self.scale["s"]

    def constant(self, number: float) -> Value:
        """A number of a formula."""
        if not self.motion.symbolic:
            return complex(number)
        return se.Integer(int(number)) if number == int(number) else se.RealDouble(number)

    @cached_property
    def plain(self) -> Env:
        """The same in SI units and with no symbol set to zero: the rules compute in this."""
        return self if self.scale is None and self.zero is None else replace(self, scale=None, zero=None, known={})

    def moved(self, how: str) -> Env:
        """The same in the state after an imaginary step: "virtual", "time" or "linear"."""
        return replace(self, motion=self.motion.moved(how), known={})

    def at_base(self) -> Env:
        """The same in the state before the complex step."""
        return replace(self, motion=self.motion.base, known={}) if self.motion.stepped else self

    def shifted(self, name: str) -> Env:
        """The same with one number increased by an imaginary step."""
        if name not in self.scope.symbols:
            raise AuditError(f"the symbol '{name}' has no meaning: declare it as `{name} [unit]: meaning`")
        meaning = self.scope.symbols[name]
        size = 1.0 if self.scale is None else float(np.real(scaled(meaning.units, 0.0, self.scale)))
        return replace(self, shift={meaning.text: 1j * STEP / size}, known={})

    def number(self, key: str) -> Value:
        """A random number of either sign, the same for the same wording."""
        return self.motion.number(key) + self.shift.get(key, 0.0)

    def positive(self, key: str) -> Value:
        """A random positive number, the same for the same wording."""
        return self.motion.positive(key) + self.shift.get(key, 0.0)

    def printed(self, name: str, number: str) -> Value:
        """The value of the formula an earlier equation prints for a symbol."""
        return evaluate(self.scope.printed_side(name, number), self)

    def of(self, text: str) -> Value:
        """The value of a quantity by its wording."""
        return understand(text, ()).value(self)


def scaled(units: tuple[Unit, ...], value: Value, scale: Mapping[str, float]) -> Any:
    """Factors by which a value of those units changes with the sizes of the basic units."""
    factors = np.array([u.size(scale) for u in units])
    if len(factors) == 1 or np.ndim(value) == 0:
        return factors[0]
    return np.repeat(factors, value.shape[0] // len(factors))[:, None]
