"""Comparison of printed formulas with the derivation in random states: largest difference per equation, states it occurs in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import NO_VALUE, OutsideError, SizeError, Value, attempt, evaluate, infinite
from mbdae.audit.motion import VECTORS, WIDE, RandomMotion
from mbdae.audit.notation import Node, Relation
from mbdae.audit.phrases import Env
from mbdae.audit.reading import Printed
from mbdae.audit.rules_motion import bounds
from mbdae.errors import MbdaeError

SAME = 1e-9  #: relative difference below which two sides count as equal
STATES = 4  #: number of random states of each kind; sides that differ agree in a random state by accident only
TRIED = 2 * WIDE  #: number of random states among which those are looked for in which a formula is real
INFINITE = float("inf")


@dataclass
class ComparedStates:
    """The states an equation is compared in: states of two free bodies, then states in which the text's joint connects them. In
    all of them what the text assumes holds and the formulas have real values."""

    equation: Printed
    inner: str = "l"  #: the body that carries the inner race
    side: int = 1  #: side of the equations of motion on which forces are read whose side the text leaves open, see `Env.side`
    absent: str | None = None  #: wording of a vector that is zero in all states of the comparison
    neutral: tuple[tuple[str, float], ...] = ()  #: parameters of laws, each with the value at which it has no effect
    shared: dict[tuple[str, int, str], RandomMotion] = field(default_factory=dict)  #: states made, for all equations of a text
    fill: int = 1  #: number of rows of a literal 0 whose size nothing else gives

    def of(self, kind: str, count: int = STATES) -> list[Env]:
        """Values of the symbols in random states of one kind ("free", "clearance", a joint), the first in which all sides are
        real. Where there are hardly any, states in which the same sides are; SizeError where no side is."""
        known, wanted = dict[tuple[bool, ...], list[Env]](), set[str]()
        for seed in range(TRIED):
            env = self.env(kind, seed)
            real = self.real(env, wanted)
            known.setdefault(real, []).append(env)
            if all(real) and len(known[real]) == count:
                break
        known = {real: envs for real, envs in known.items() if any(real)}
        for real in sorted(known, key=lambda real: (not all(real), -len(known[real]))):
            if len(known[real]) >= min(STATES, count):
                return known[real][:count]
        raise OutsideError(" and ".join([*(one.text for one in self.equation.assumed), *sorted(wanted)]))

    def real(self, env: Env, wanted: set[str]) -> tuple[bool, ...]:
        """Whether the sides of the equation are real in a state, False for all where an assumption does not hold; the conditions
        of those that are not are added to `wanted`."""
        holds = all(one.holds(env) for one in self.equation.assumed)
        return tuple(holds and _real(side, env, wanted) for s in self.equation.statements for side in s.sides)

    def env(self, kind: str, seed: int) -> Env:
        """Values of the symbols in one random state."""
        section = self.equation.states
        if (kind, seed, section) not in self.shared:
            self.shared[kind, seed, section] = RandomMotion(seed, kind, self.equation.scope.own, section)
        motion = self.shared[kind, seed, section]
        motion = motion.without(self.absent) if self.absent else motion
        drawn = self.drawn
        if self.neutral or drawn:
            motion = motion.taking({f"parameter {n}": v for n, v in self.neutral}, drawn)
        return Env(motion, self.equation.scope, self.inner, self.side, self.fill)

    @cached_property
    def drawn(self) -> dict[str, tuple[float, float]]:
        """Bounds of numbers of the text, by the words of their meaning."""
        return bounds(self.equation.assumed, self.equation.scope, self.equation.scope.reached(self.equation.used))

    @property
    def _everywhere(self) -> str:
        return self.equation.states if self.equation.only else "free"

    @cached_property
    def free(self) -> list[Env]:
        """States of two free bodies; those of the joint where the text says that it speaks of no others (`states: ... only`)."""
        return self.of(self._everywhere)

    @cached_property
    def many(self) -> list[Env]:
        """Four times as many states as `free`: a missing factor is found by a fit of a constant and exponents to all of them."""
        return self.of(self._everywhere, 4 * STATES)

    @cached_property
    def joint(self) -> list[Env]:
        """States in which the constraints of the joint hold."""
        return self.of(self.equation.states)

    @cached_property
    def many_joint(self) -> list[Env]:
        """Four times as many states of the joint as `joint`."""
        return self.of(self.equation.states, 4 * STATES)

    def fitting(self) -> ComparedStates:
        """These states, with a literal 0 in a column of blocks taken as 1 row or as 3 rows, whichever makes the sides equal in
    size."""
        for fill in (1, 3):
            found = replace(self, fill=fill)
            if all(_fits(s, found) for s in self.equation.statements):
                return found
        return self


def _real(side: Node, env: Env, wanted: set[str]) -> bool:
    try:
        with np.errstate(all="ignore"):
            evaluate(side, env)
    except OutsideError as outside:
        wanted |= {outside.condition} - {""}
        return False
    except NO_VALUE:
        pass  # told where the sides are compared
    return True


def _fits(statement: Relation, states: ComparedStates) -> bool:
    values = [attempt(s, states.free[0]) for s in statement.compared]
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

    gap: float  #: largest relative difference of the sides
    everywhere: bool = True  #: True: `gap` was found in free states; False: in states in which the joint connects the bodies
    doubt: str = ""  #: why the comparison proves nothing; empty where it does
    mendable: bool = False  #: whether a change of the formula could remove the `doubt`, as where matrix sizes do not fit

    @property
    def same(self) -> bool:
        """Whether the sides agree."""
        return self.gap < SAME and not self.doubt


def _values(sides: Sequence[Node], env: Env) -> list[Value]:
    with np.errstate(all="ignore"):
        found = [evaluate(side, env) for side in sides]
    for side, value in zip(sides, found, strict=True):
        if not np.all(np.isfinite(np.asarray(value, dtype=complex))):
            piece = infinite(side, env) or side
            raise SizeError(f"{piece} is infinite or undefined in a random state of motion: correct it, or state by `states:` "
                            f"in which states it is finite")
    return found


def _in_states(statement: Relation, equation: Printed, envs: Sequence[Env]) -> Compared:
    """Compare the sides of a statement with each other in some states, and with the quantity that an equation of the form
    `NUMBER (MEANING): STATEMENT` names."""
    sides = statement.compared
    said = equation.quantity if equation.statements and statement is equation.statements[0] else None
    rows: list[list[Value]] = []
    for env in envs:
        try:
            rows.append(_values(sides, env) + ([said.value(env)] if said else []))
        except SizeError as error:
            return Compared(INFINITE, doubt=str(error), mendable=True)
    if statement.relation == "<=":
        return _bound([row[: len(sides)] for row in rows])
    if not rows[0]:
        return Compared(0.0, doubt="both sides are 0, which shows nothing")
    gap = max(max((difference(v[0], other) for other in v[1:]), default=0.0) for v in rows)
    if len(rows[0]) > 1 and gap < SAME and max(float(np.max(np.abs(v[0]))) for v in rows) < SAME:
        return Compared(gap, doubt="both sides vanish in the states tried, which shows nothing")
    return Compared(gap)


def _bound(rows: list[list[Value]]) -> Compared:
    """Check of a <= b: it must hold in all states, with equality in half of them or more; a bound that is hardly ever reached
    says too little (a <= b + 1 would hold too), which is noted as doubt."""
    if any(np.ndim(x) for x in rows[0]):
        return Compared(INFINITE, doubt="a bound is one of numbers", mendable=True)
    if len(rows[0]) > 2:
        return max((_bound([row[i : i + 2] for row in rows]) for i in range(len(rows[0]) - 1)), key=lambda c: (c.gap, c.doubt))
    pairs = [tuple(float(np.real(x)) for x in v) for v in rows]
    sizes = [max(abs(a), abs(b), 1e-12) for a, b in pairs]
    worst = max(max(0.0, a - b) / n for (a, b), n in zip(pairs, sizes, strict=True))
    reached = sum(abs(a - b) / n < SAME for (a, b), n in zip(pairs, sizes, strict=True))
    if worst < SAME and 2 * reached < len(pairs):
        return Compared(worst, doubt="the bound holds in all states tried, but too few reach it to show that it is the one meant")
    return Compared(worst)


def vanishes(statement: Relation, envs: Sequence[Env]) -> float:
    """Largest value of the nonzero sides of an equation that has the side 0; 0.0 for other statements."""
    if not statement.ends_at_zero:
        return 0.0
    try:
        return max((float(np.max(np.abs(v))) for env in envs for v in _values(statement.compared, env)), default=0.0)
    except SizeError:
        return INFINITE


def compared(statement: Relation, states: ComparedStates) -> Compared:
    """Difference of the sides in free states; that in states of the joint where the sides agree in those only. Where they agree
    in neither, the smaller difference."""
    if statement not in states.equation.statements:  # a repaired one has states of its own, as it may be real elsewhere
        states = replace(states, equation=replace(states.equation, statements=(statement,), quantity=None))
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


def _vanishing(statement: Relation, states: ComparedStates) -> bool:
    """Whether a quantity of the statement is zero in the states of the joint but not in free ones: its terms remain untested."""
    return _smaller(statement.symbols() & set(states.equation.scope.symbols), states.free, states.joint)


def vanishing(names: Iterable[str], states: ComparedStates, others: ComparedStates) -> bool:
    """Whether one of the named quantities is zero in the states `others`, free or of the joint, but not in `states`: there an
    agreement of the sides says nothing about terms with that quantity."""
    return _smaller(names, states.free, others.free) or _smaller(names, states.joint, others.joint)


def _smaller(names: Iterable[str], before: Sequence[Env], after: Sequence[Env]) -> bool:
    def size(name: str, envs: Sequence[Env]) -> float:
        return max(float(np.max(np.abs(env.value(name)))) for env in envs)

    return any(size(n, after) < SAME < size(n, before) for n in names)


# -- comparison in symbols


class SymbolicMotion(RandomMotion):
    """Two free bodies whose quantities are symbols. Complex steps and the relative angle have no value here (SizeError)."""

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
        raise SizeError("no mistake of the user: the relative angle of two free bodies has no formula in symbols, so that both "
                        "sides are compared by numbers only")

    def _copy(self, amount: complex) -> RandomMotion:
        raise SizeError("no mistake of the user: a complex step takes a derivative of numbers, not of symbols, so that both "
                        "sides are compared by numbers only")


def identical(equation: Printed, inner: str, side: int = 1) -> bool:
    """Whether all sides are the same polynomials in the components of free vectors; False where this cannot be decided.

    inner: the body with the inner race; side: see `Env.side`."""
    env = Env(SymbolicMotion(), equation.scope, inner, side)
    try:
        return all(_identical(equation, i, env) for i in range(len(equation.statements)))
    except (SizeError, MbdaeError, TypeError, ValueError, AttributeError, RuntimeError, IndexError):
        return False


def _identical(equation: Printed, i: int, env: Env) -> bool:
    statement = equation.statements[i]
    values = [evaluate(s, env) for s in statement.compared]
    if i == 0 and equation.quantity is not None:
        values.append(equation.quantity.value(env))
    if statement.relation != "=" or len(values) < 2:
        return False
    first, *others = values
    return all(np.shape(v) == np.shape(first) and all(se.expand(d) == 0 for d in np.ravel(np.asarray(first - v))) for v in others)
