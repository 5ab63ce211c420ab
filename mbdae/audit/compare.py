"""Printed formulas against the derivation in random states: one number per equation, and where it differs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mbdae.audit import notation
from mbdae.audit.evaluate import SizeError, Value, evaluate
from mbdae.audit.motion import Motion
from mbdae.audit.notation import Node, Statement
from mbdae.audit.phrases import Env
from mbdae.audit.reading import Printed

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
    shared: dict[tuple[str, int], Motion] = field(default_factory=dict)

    def of(self, kind: str) -> list[Env]:
        """Values of the symbols in random states of one kind ("free", "revolute", "clearance")."""
        return [self._env(kind, seed) for seed in range(STATES)]

    def _env(self, kind: str, seed: int) -> Env:
        if (kind, seed) not in self.shared:
            self.shared[kind, seed] = Motion(seed, kind)
        motion = self.shared[kind, seed]
        return Env(motion.without(self.absent) if self.absent else motion, self.equation.scope, self.inner, self.side)

    @cached_property
    def free(self) -> list[Env]:
        """States of two free bodies; those of the joint where the text speaks of no others (`states: ... only`)."""
        return self.of(self.equation.states if self.equation.only else "free")

    @cached_property
    def joint(self) -> list[Env]:
        """States in which the constraints of the joint hold."""
        return self.of(self.equation.states)


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


def _value(node: Node, env: Env) -> Value | None:
    try:
        with np.errstate(all="ignore"):
            return evaluate(node, env)
    except SizeError:
        return None


def gap_in(statement: Statement, equation: Printed, envs: Iterable[Env]) -> float:
    """Largest relative difference, over some states, of the sides of a statement and of the quantity it is said to be."""
    sides = [side for side in statement.sides if not notation.is_zero(side)]
    worst, largest, reached, count = 0.0, 0.0, 0, 0
    for env in envs:
        count += 1
        values = [_value(side, env) for side in sides]
        if equation.quantity is not None and statement is equation.statements[0]:
            values.append(equation.quantity.value(env))
        if any(v is None for v in values):
            return INFINITE
        largest_here: Value = values[0]
        if statement.relation == "<=":
            worst, reached = max(worst, _excess(values)), reached + (_excess(values, reached=True) < SAME)
        else:
            worst = max(worst, max((difference(values[0], v) for v in values[1:]), default=0.0))
            largest = max(largest, float(np.max(np.abs(largest_here))))
        if worst == INFINITE:
            return worst
    if statement.relation == "<=":
        return worst if 2 * reached >= count else INFINITE  # a bound counts if half of the states reach it
    return worst if largest > 1e-9 else INFINITE  # 0 = 0 proves nothing


def _excess(values: list[Value], reached: bool = False) -> float:
    """By how much a exceeds b, relative to the larger; reached: the distance of a from b."""
    a, b = (float(np.real(v)) for v in values)
    return (abs(a - b) if reached else max(0.0, a - b)) / max(abs(a), abs(b), 1e-12)


def vanishes(statement: Statement, envs: Iterable[Env]) -> float:
    """Largest value of the first side of a statement that ends with `= 0`; 0.0 for other statements."""
    if not any(notation.is_zero(side) for side in statement.sides):
        return 0.0
    values = [_value(statement.sides[0], env) for env in envs]
    return max(INFINITE if v is None else float(np.max(np.abs(v))) for v in values)


@dataclass(frozen=True)
class Compared:
    """Difference of the sides of a statement, and the states it was found in."""

    gap: float
    everywhere: bool = True  #: found in free states; False: in states of the joint alone

    @property
    def same(self) -> bool:
        """Whether the sides agree."""
        return self.gap < SAME


def compared(statement: Statement, states: States) -> Compared:
    """The sides compared in free states; in states of the joint where they agree only there."""
    equation = states.equation
    if vanishes(statement, states.joint) > 1e-9:
        return Compared(INFINITE)
    free = gap_in(statement, equation, states.free)
    if free < SAME or equation.only or equation.states == "free":
        return Compared(free)
    joint = gap_in(statement, equation, states.joint)
    return Compared(joint, everywhere=False) if joint < SAME else Compared(min(free, joint))
