"""Zeros of functions of a solution, also inside its steps: the zeros of polynomials that reproduce the function (`pieces`).

Between neighbouring extremes of a polynomial it is monotonic, so that none of its zeros is missed, however close together.

An expression of sensors over a run. The instants at which its floors (integer parts) and conditions inside it switch are found
first, those of nested ones before those around them. Between two instants these are constant, so that the expression is
smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.kernels import numpy_function
from mbdae.run.pieces import Pieces, Signals, Steep, resolved, steep_functions
from mbdae.symbolic.rebuild import CONDITIONS, LOGIC, rebuilt
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

#: times nearer to each other than this fraction of the run count as the same: of zeros of one function where there is no change
#: of sign between them (round-off has split one zero), of zeros of the functions of a condition, of an event and the end of the
#: run
SAME = 1e-10
#: last coefficients below this fraction of the largest one are left out, of a polynomial (first number) and of its derivative
#: (second)
NEGLIGIBLE = 1e-17, 1e-15


class Root(NamedTuple):
    """A zero: its time (s), and the sign of the function before and after it (0: at the start, at the end, or where the function
    vanishes over a stretch); equal signs: the function touches 0, or comes nearer to 0 than a tolerance."""

    time: float
    before: int
    after: int


class Zeros(NamedTuple):
    """Zeros of a function in the order of time; noise: magnitude up to which the function counts as 0."""

    roots: list[Root]
    noise: float


class _Bracket(NamedTuple):
    """Two places a, b of interval i, -1 to 1 from its begin to its end, between which its polynomial changes its sign; before,
    after: signs at a and b."""

    i: int
    a: float
    b: float
    before: int
    after: int


def roots(function: Callable[[Array], Array], edges: Array, touch: float = 0.0, merge: bool = True) -> list[Root]:
    """Zeros of a function: times (k,) -> values (k,). edges (n+1,): times between which it is smooth; there (at breaks and ends
    of steps) it may jump. touch: an extremum whose magnitude, relative to the largest value of the function, is below this counts
    as a zero; merge: whether neighbouring zeros between which the function stays that small are merged into one."""
    return zeros(function, edges, touch, merge).roots


def zeros(function: Callable[[Array], Array], edges: Array, touch: float = 0.0, merge: bool = True, steep: Steep | None = None,
          switched: Array | None = None, least: float = 0.0) -> Zeros:
    """`roots`, and the round-off of the function. steep, least: as for `pieces.resolved`; switched: those of the edges at which a
    floor or condition in the function switches. The function may vanish from there on, so that zeros there are not merged."""
    pieces = resolved(function, edges, steep, least)
    if pieces.size == 0:
        return Zeros([], 0.0)
    near = max(pieces.noise, touch * pieces.size)
    found = sorted(_inside(pieces, near) + _at_edges(pieces, near))
    begin, end = float(edges[0]), float(edges[-1])
    found = [root for root in found if root.before or root.after or root.time in (begin, end)]  # none inside a stretch of zeros
    alone = np.isin([root.time for root in found], np.zeros(0) if switched is None else switched)
    return Zeros(_merged(found, alone, function, SAME * (end - begin), near if merge else pieces.noise), pieces.noise)


def _inside(pieces: Pieces, near: float) -> list[Root]:
    """Zeros inside the intervals, of those polynomials whose coefficients allow a zero. near: magnitude up to which an extremum
    counts as a zero."""
    with np.errstate(invalid="ignore"):
        may = np.abs(pieces.c[:, 0]) <= np.abs(pieces.c[:, 1:]).sum(axis=1) + near
    found: list[Root] = []
    brackets: list[_Bracket] = []
    for i, extremes in _with_extremes(pieces, np.flatnonzero(may)):
        touched, crossed = _of_one(pieces, i, extremes, near)
        found += touched
        brackets += crossed
    return found + _crossings(pieces, brackets)


def _with_extremes(pieces: Pieces, chosen: NDArray[np.intp]) -> list[tuple[int, Array]]:
    """(number of an interval, places in (-1, 1) of the extremes of its polynomial) for the chosen intervals."""
    if not len(chosen):
        return []
    d = chebyshev.chebder(pieces.c[chosen].T).T
    steady = np.abs(d[:, 0]) > np.abs(d[:, 1:]).sum(axis=1)
    none = np.zeros(0)
    return [(int(i), none if one_way else _extremes(row)) for i, one_way, row in zip(chosen, steady, d, strict=True)]


def _of_one(pieces: Pieces, i: int, extremes: Array, near: float) -> tuple[list[Root], list[_Bracket]]:
    """Zeros where the polynomial of interval i touches 0, and brackets in which it changes its sign. extremes: places of its
    extremes; near: magnitude up to which an extremum counts as a zero."""
    low, high, c = float(pieces.low[i]), float(pieces.high[i]), _shortened(pieces.c[i], NEGLIGIBLE[0])
    x = np.concatenate([[-1.0], extremes, [1.0]])
    y = chebyshev.chebval(x, c)
    y[np.abs(y) <= pieces.noise] = 0.0
    signs = np.sign(y).astype(int)
    crossed = [_Bracket(i, float(x[k]), float(x[k + 1]), int(signs[k]), int(signs[k + 1])) for k in range(len(x) - 1)
               if signs[k] * signs[k + 1] < 0]
    touched = []
    for k in range(1, len(x) - 1):
        time = (low + high) / 2 + float(x[k]) * (high - low) / 2
        if signs[k] == 0:
            touched.append(Root(time, _sign(signs[:k][::-1]), _sign(signs[k + 1 :])))
        elif abs(y[k]) <= near and signs[k - 1] == signs[k] == signs[k + 1]:
            touched.append(Root(time, int(signs[k]), int(signs[k])))
    return touched, crossed


def _shortened(c: Array, part: float) -> Array:
    """A polynomial without its last coefficients, as far as these are below the fraction `part` of the largest."""
    return c[: int(np.max(np.flatnonzero(np.abs(c) > part * np.max(np.abs(c), initial=0.0)), initial=0)) + 1]


def _sign(signs: Array) -> int:
    """The first of the signs (-1, 0, 1) that is not 0; 0 where all are."""
    return next((int(s) for s in signs if s), 0)


def _extremes(d: Array) -> Array:
    """Places inside (-1, 1) at which the derivative with Chebyshev coefficients d vanishes, or nearly does."""
    d = _shortened(d, NEGLIGIBLE[1])
    if len(d) < 2:
        return np.zeros(0)
    z = chebyshev.chebroots(d)
    near = np.sort(z.real[np.abs(z.imag) < 1e-4])  # round-off may make a double zero complex; an extra place is harmless
    return np.asarray(near[(near > -1) & (near < 1)])


def _crossings(pieces: Pieces, brackets: list[_Bracket]) -> list[Root]:
    """The zeros in brackets, found by bisection of all of them at once."""
    if not brackets:
        return []
    i, a, b, before, after = (np.array(column) for column in zip(*brackets, strict=True))
    c = pieces.c[i].T
    for _ in range(60):
        middle = (a + b) / 2
        rises = before * chebyshev.chebval(middle, c, tensor=False) > 0
        a, b = np.where(rises, middle, a), np.where(rises, b, middle)
    low, high = pieces.low[i], pieces.high[i]
    times = (low + high) / 2 + (a + b) / 2 * (high - low) / 2
    return [Root(*one) for one in zip(times.tolist(), before.tolist(), after.tolist(), strict=True)]


def _at_edges(pieces: Pieces, near: float) -> list[Root]:
    """Zeros at the ends of the run, and where two intervals meet: touched, crossed within round-off, or jumped over."""
    small = pieces.noise
    ends = [np.asarray(chebyshev.chebval(x, pieces.c.T)) for x in (-1.0, 1.0)]
    first, last = (np.where(np.abs(y) <= small, 0.0, y) for y in ends)
    found = [Root(float(pieces.low[0]), 0, _after(pieces, 0))] if first[0] == 0 else []
    found += [Root(float(pieces.high[-1]), _before(pieces, len(pieces.low) - 1), 0)] if last[-1] == 0 else []
    met = (last[:-1] == 0) | (first[1:] == 0) | (np.sign(last[:-1]) != np.sign(first[1:]))
    met &= np.isfinite(last[:-1]) & np.isfinite(first[1:])
    with np.errstate(invalid="ignore"):
        close = np.minimum(np.abs(last[:-1]), np.abs(first[1:])) <= near
    for i in np.flatnonzero(met | close):
        n = int(i)
        if met[n] or _turns(pieces, n):
            found.append(Root(float(pieces.high[n]), _before(pieces, n), _after(pieces, n + 1)))
    return found


def _turns(pieces: Pieces, i: int) -> bool:
    """Whether the absolute value of the function has a minimum where interval i ends."""
    ends = (pieces.c[i], 1.0, pieces.high[i] - pieces.low[i]), (pieces.c[i + 1], -1.0, pieces.high[i + 1] - pieces.low[i + 1])
    falls, rises = (float(chebyshev.chebval(x, chebyshev.chebder(c)) * np.sign(chebyshev.chebval(x, c)) / h) for c, x, h in ends)
    return falls <= 0 <= rises


def _before(pieces: Pieces, i: int) -> int:
    """Sign of the function before the end of interval i."""
    return _near(pieces.c[i], 1.0, pieces.noise)


def _after(pieces: Pieces, i: int) -> int:
    """Sign of the function after the beginning of interval i."""
    return _near(pieces.c[i], -1.0, pieces.noise)


def _near(c: Array, end: float, small: float) -> int:
    """Sign of a polynomial just inside an end (-1 or 1) of its interval: at the point nearest to the end where its magnitude is
    above `small`; 0 where there is none."""
    y = chebyshev.chebval(end * (1 - np.concatenate([[0.0], np.logspace(-9, 0, 28)])), c)
    return _sign(np.sign(np.where(np.abs(y) <= small, 0.0, y)).astype(int))


def _merged(found: list[Root], alone: NDArray[np.bool_], function: Callable[[Array], Array], same: float,
            level: float) -> list[Root]:
    """The zeros `found`, with neighbours merged into one zero in their middle. Merged are zeros between which the magnitude of
    the function stays within `level` (round-off or the error of the run has split a zero of higher order), except where `alone`
    forbids it; and zeros nearer to each other than `same` (s) without a change of sign between them."""
    if len(found) < 2:
        return found
    times = np.array([root.time for root in found])
    between = times[:-1, None] + np.diff(times)[:, None] * np.linspace(0.1, 0.9, 9)
    values = function(between.ravel()).reshape(between.size, -1)[:, 0]
    flat = (np.max(np.abs(values.reshape(between.shape)), axis=1) <= level) & ~(alone[:-1] | alone[1:])
    groups = [[found[0]]]
    for root, one in zip(found[1:], flat, strict=True):
        if one or (root.time - groups[-1][-1].time <= same and groups[-1][-1].after * root.before >= 0):
            groups[-1].append(root)
        else:
            groups.append([root])
    return [Root((group[0].time + group[-1].time) / 2, group[0].before, group[-1].after) for group in groups]


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
