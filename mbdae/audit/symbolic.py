"""Formulas in symbols: a state whose quantities are symbols, so that two sides can be shown to be identical polynomials."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.audit import notation
from mbdae.audit.evaluate import SizeError, Value, evaluate
from mbdae.audit.motion import VECTORS, Motion
from mbdae.audit.phrases import Env
from mbdae.audit.reading import Printed
from mbdae.errors import MbdaeError


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
