"""Printed formulas against the derivation in random states: one number per equation, and where it differs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit import notation
from mbdae.audit.evaluate import SizeError, Value, attempt, evaluate, infinite
from mbdae.audit.motion import VECTORS, Motion
from mbdae.audit.notation import Node, Statement
from mbdae.audit.phrases import Env
from mbdae.audit.reading import Printed
from mbdae.errors import MbdaeError

SAME = 1e-9  #: relative difference below which two sides are the same
STATES = 4  #: random states of every kind
INFINITE = float("inf")


@dataclass
class States:
    """The states an equation is compared in: states of two free bodies, then states in which the text's joint connects them."""

    equation: Printed
    inner: str = "l"
    side: int = 1
    absent: str | None = None
    shared: dict[tuple[str, int, str], Motion] = field(default_factory=dict)
    fill: int = 1

    def of(self, kind: str, count: int = STATES) -> list[Env]:
        """Values of the symbols in random states of one kind ("free", "clearance", a joint)."""
        return [self._env(kind, seed) for seed in range(count)]

    def _env(self, kind: str, seed: int) -> Env:
        section = self.equation.states
        if (kind, seed, section) not in self.shared:
            self.shared[kind, seed, section] = Motion(seed, kind, self.equation.scope.own, section)
        motion = self.shared[kind, seed, section]
        return Env(motion.without(self.absent) if self.absent else motion, self.equation.scope, self.inner, self.side, self.fill)

    @property
    def _everywhere(self) -> str:
        return self.equation.states if self.equation.only else "free"

    @cached_property
    def free(self) -> list[Env]:
        """States of two free bodies; those of the joint where the text speaks of no others (`states: ... only`)."""
        return self.of(self._everywhere)

    @cached_property
    def many(self) -> list[Env]:
        """More of them, to find powers of several numbers at once."""
        return self.of(self._everywhere, 4 * STATES)

    @cached_property
    def joint(self) -> list[Env]:
        """States in which the constraints of the joint hold."""
        return self.of(self.equation.states)

    @cached_property
    def many_joint(self) -> list[Env]:
        """More of those."""
        return self.of(self.equation.states, 4 * STATES)

    def fitting(self) -> States:
        """The same with literal zeros of one row or three, whichever fits the sizes of the equation."""
        for fill in (1, 3):
            found = replace(self, fill=fill)
            if all(_fits(s, found) for s in self.equation.statements):
                return found
        return self


def _fits(statement: Statement, states: States) -> bool:
    values = [attempt(s, states.free[0]) for s in statement.sides if not notation.is_zero(s)]
    return all(v is not None for v in values) and len({np.shape(v) for v in values}) == 1


def difference(a: Value, b: Value) -> float:
    """Largest difference of two values relative to the larger one; infinite where shapes differ or a value is not finite."""
    if np.shape(a) != np.shape(b):
        return INFINITE
    with np.errstate(all="ignore"):
        gap = float(np.max(np.abs(a - b)))
        size = max(float(np.max(np.abs(a))), float(np.max(np.abs(b))))
    if not (np.isfinite(gap) and np.isfinite(size)):
        return INFINITE
    return gap / size if size > 1e-12 else gap


@dataclass(frozen=True)
class Compared:
    """Difference of the sides of a statement, and the states it was found in."""

    gap: float
    everywhere: bool = True  #: found in free states; False: in states of the joint alone
    doubt: str = ""  #: why the difference says nothing
    mendable: bool = False  #: whether a change of the formula could remove the doubt, as it can where sizes do not fit

    @property
    def same(self) -> bool:
        """Whether the sides agree."""
        return self.gap < SAME and not self.doubt


def _values(sides: Sequence[Node], env: Env) -> list[Value]:
    with np.errstate(all="ignore"):
        found = [evaluate(side, env) for side in sides]
    for side, value in zip(sides, found, strict=True):
        if not np.all(np.isfinite(np.asarray(value, dtype=complex))):
            raise SizeError(f"{infinite(side, env) or side} is not finite in a random state of motion")
    return found


def _in_states(statement: Statement, equation: Printed, envs: Sequence[Env]) -> Compared:
    """The sides of a statement, and the quantity it is said to be, in some states."""
    sides = [side for side in statement.sides if not notation.is_zero(side)]
    said = equation.quantity if equation.statements and statement is equation.statements[0] else None
    rows: list[list[Value]] = []
    for env in envs:
        try:
            rows.append(_values(sides, env) + ([said.value(env)] if said else []))
        except SizeError as error:
            return Compared(INFINITE, doubt=str(error), mendable=True)
    if statement.relation == "<=":
        return _bound(rows)
    gap = max(max((difference(v[0], other) for other in v[1:]), default=0.0) for v in rows)
    if len(rows[0]) > 1 and gap < SAME and max(float(np.max(np.abs(v[0]))) for v in rows) < SAME:
        return Compared(gap, doubt="both sides vanish in the states tried, which shows nothing")
    return Compared(gap)


def _bound(rows: list[list[Value]]) -> Compared:
    """a <= b: holds in all states, and is reached in half of them; else nothing shows that it is the bound meant."""
    pairs = [tuple(float(np.real(x)) for x in v[:2]) for v in rows]
    sizes = [max(abs(a), abs(b), 1e-12) for a, b in pairs]
    worst = max(max(0.0, a - b) / n for (a, b), n in zip(pairs, sizes, strict=True))
    reached = sum(abs(a - b) / n < SAME for (a, b), n in zip(pairs, sizes, strict=True))
    if worst < SAME and 2 * reached < len(pairs):
        return Compared(worst, doubt="the bound holds in all states tried, but too few reach it to show that it is the one meant")
    return Compared(worst)


def vanishes(statement: Statement, envs: Sequence[Env]) -> float:
    """Largest value of the first side of a statement that ends with `= 0`; 0.0 for other statements."""
    if not any(notation.is_zero(side) for side in statement.sides):
        return 0.0
    try:
        return max(float(np.max(np.abs(_values(statement.sides[:1], env)[0]))) for env in envs)
    except SizeError:
        return INFINITE


def compared(statement: Statement, states: States) -> Compared:
    """The sides compared in free states; in states of the joint where they agree only there."""
    equation = states.equation
    if vanishes(statement, states.joint) > SAME:
        return Compared(vanishes(statement, states.joint))
    free = _in_states(statement, equation, states.free)
    if free.same or equation.only or equation.states == "free":
        return free
    joint = _in_states(statement, equation, states.joint)
    if joint.same and (free.doubt or not _vanishing(statement, states)):
        return Compared(joint.gap, everywhere=False)
    sure = [free] if joint.same and not free.doubt else [c for c in (free, joint) if not c.doubt]
    return min(sure, key=lambda c: c.gap) if sure else free


def _vanishing(statement: Statement, states: States) -> bool:
    """Whether a quantity of the statement is zero in the states of the joint alone: agreement there says nothing of its terms."""
    symbols = statement.symbols() & set(states.equation.scope.symbols)

    def size(name: str, envs: Sequence[Env]) -> float:
        return max(float(np.max(np.abs(env.value(name)))) for env in envs)

    return any(size(n, states.joint) < SAME < size(n, states.free) for n in symbols)


# -- in symbols


class SymbolicMotion(Motion):
    """Two free bodies, their quantities symbols. What needs a complex step or the relative angle has no value (SizeError)."""

    def __init__(self) -> None:
        self.seed, self.kind, self.absent = 0, "free", frozenset()
        self.stepped, self.origin, self.memory, self.symbolic = False, None, {}, True
        self.clock, self.arc, self.virtual, self.link = 0, 0, 0, None
        self.Q = {s: self.matrix(f"attitude {s}") for s in "kl"}
        self.R0 = self.matrix("reference attitude")
        self.x0 = {s: self.vector(f"reference place {s}") for s in "kl"}
        self.vectors = {n: {s: self.vector(f"{n} {s}") for s in "kl"} for n in VECTORS}
        self.coordinates = {"angle": [self.number(n) for n in ("phi", "phidot", "phiddot")]}

    def number(self, name: str) -> Any:
        return se.Symbol(name)

    def positive(self, name: str) -> Any:
        return se.Symbol(name)

    def vector(self, name: str) -> Value:
        return np.array([[se.Symbol(f"{name} {i}")] for i in range(3)], dtype=object)

    def matrix(self, name: str, symmetric: bool = False) -> Value:
        return np.array([[se.Symbol(f"{name} {i} {j}") for j in range(3)] for i in range(3)], dtype=object)

    def relative_angle(self) -> Value:
        raise SizeError("the relative angle of free bodies in symbols")

    def _copy(self, amount: complex) -> Motion:
        raise SizeError("a complex step in symbols")


def identical(equation: Printed, inner: str, side: int = 1) -> bool:
    """Whether all sides are the same polynomials in the components of free vectors; False where that cannot be said."""
    env = Env(SymbolicMotion(), equation.scope, inner, side)
    try:
        return all(_identical(equation, i, env) for i in range(len(equation.statements)))
    except (SizeError, MbdaeError, TypeError, ValueError, AttributeError, RuntimeError, IndexError):
        return False


def _identical(equation: Printed, i: int, env: Env) -> bool:
    statement = equation.statements[i]
    values = [evaluate(s, env) for s in statement.sides if not notation.is_zero(s)]
    if i == 0 and equation.quantity is not None:
        values.append(equation.quantity.value(env))
    if statement.relation != "=" or len(values) < 2:
        return False
    first, *others = values
    return all(np.shape(v) == np.shape(first) and all(se.expand(d) == 0 for d in np.ravel(np.asarray(first - v))) for v in others)
