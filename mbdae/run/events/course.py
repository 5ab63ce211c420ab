"""An expression of sensors over a run. The instants at which its floors (integer parts) and conditions inside it switch are found
first, those of nested ones before those around them. Between two instants these are constant, so that the expression is
smooth."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.deferred import distinct
from mbdae.kernels.oracle import numpy_function
from mbdae.run.events.pieces import Steep, steep_functions
from mbdae.run.events.roots import Zeros, zeros
from mbdae.run.events.signals import Signals
from mbdae.symbolic.rebuild import CONDITIONS, LOGIC, rebuilt
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

HALF = se.Rational(1, 2)


class _Held(NamedTuple):
    """A floor, or a comparison (0 or 1), over a run: its constant values (m,) between the times `edges` (m+1,), and its
    symbol."""

    symbol: Expr
    edges: Array
    values: Array

    def __call__(self, t: Array) -> Array:
        return np.asarray(self.values[np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self.values) - 1)])


class Course:
    """The values of an expression of sensors over a solution, and its zeros."""

    def __init__(self, signals: Signals, e: Expr) -> None:
        self._signals = signals
        self._held: list[_Held] = []
        self._functions: dict[Any, Callable[[Array], Array]] = {}
        self.edges, self._switched = signals.edges, np.zeros(0)
        self.expression = rebuilt(signals.plain(e), self._held_part)

    def __call__(self, t: Array) -> Array:
        """Values (k,) at times (k,)."""
        return self._evaluated((self.expression,), t)[:, 0]

    def zeros(self, touch: float = 0.0, merge: bool = True) -> Zeros:
        """The zeros of the expression; options as in `roots.roots`."""
        return self._zeros(self.expression, touch, merge)

    @cached_property
    def _middles(self) -> Array:
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    def _held_part(self, node: Expr, args: list[Expr]) -> Expr | None:
        """What replaces a node of the expression with arguments `args`: a symbol for a floor, (symbol > 1/2) for a comparison;
        None where the node stays."""
        kind = type(node).__name__
        if kind == "floor" and args[0].free_symbols:
            return self._hold(kind, args[0], se.sin(se.pi * args[0]), 1.0)
        if kind in CONDITIONS and kind not in LOGIC and (args[0] - args[1]).free_symbols:
            return se.Gt(self._hold(kind, args[1] - args[0], args[1] - args[0], 0.0), HALF)
        return None

    def _hold(self, kind: str, u: Expr, switch: Expr, least: float) -> Expr:
        """The symbol for a floor or comparison (`kind`) of u, which may change where `switch` changes its sign or vanishes.
        least: size of `switch` to which its round-off is relative at least."""
        found = self._zeros(switch, least=least)
        self._switched = distinct(np.r_[self._switched, [root.time for root in found.roots]])
        self.edges = distinct(np.r_[self.edges, self._switched])
        self.__dict__.pop("_middles", None)
        value = self._evaluated((u,), self._middles)[:, 0]
        symbol = se.Symbol(f"held_{len(self._held)}")
        self._held.append(_Held(symbol, self.edges, np.floor(value) if kind == "floor" else _holds(kind, value, found.noise)))
        return symbol

    def _zeros(self, e: Expr, touch: float = 0.0, merge: bool = True, least: float = 0.0) -> Zeros:
        steep: Steep = steep_functions(e)
        return zeros(lambda t: self._evaluated((e, *steep.arguments), t), self.edges, touch, merge, steep, self._switched, least)

    def _evaluated(self, expressions: tuple[Expr, ...], t: Array) -> Array:
        """Values (k, count) of expressions of the sensors and of the symbols for floors and comparisons."""
        columns = [self._signals(t), *(held(t)[:, None] for held in self._held)]
        key = expressions, len(self._held)
        if key not in self._functions:
            symbols = [*self._signals.symbols, *(held.symbol for held in self._held)]
            self._functions[key] = numpy_function(symbols, expressions)
        with np.errstate(all="ignore"):
            return np.asarray(self._functions[key](np.concatenate(columns, axis=1)))


def _holds(kind: str, more: Array, noise: float) -> Array:
    """1 where a comparison holds, else 0, shape (m,); more (m,): by how much its right side exceeds the left one."""
    equal = np.abs(more) <= noise
    true = {"StrictLessThan": (more > 0) & ~equal, "LessThan": (more > 0) | equal, "Equality": equal, "Unequality": ~equal}[kind]
    return true.astype(float)
