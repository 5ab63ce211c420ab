"""Bounds of a table over intervals of time.

Interval arithmetic: bounds of an expression of time over intervals.

An `Enclosure` takes many intervals at once. Conditions and floors are evaluated at one time inside the interval between two
breaks (`timed.sided`), where they do not change. Values outside a function's domain are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.inputs import tables
from mbdae.inputs.tables import Table
from mbdae.inputs.timed import SIDE, TIME, sided
from mbdae.symbolic.rebuild import nodes
from mbdae.symbolic.vectors import Expr
from mbdae.threads import check
from mbdae.values import Array


def table_range(table: Table, order: int, low: Array, high: Array, side: Array) -> tuple[Array, Array]:
    """Least and largest value (k,) of a table, or of a derivative of it, over intervals [low, high] (k,); side (k,): times inside
    of the intervals or, where low = high is a point of the table, on the side of it to be used."""
    c = table.of_order(order)
    (s, i), (e, j) = table.segments(low, side), table.segments(high, side)
    if np.array_equal(i, j) and not table.period:
        return _of_cubic(c[:, i], s, e)
    turned = ((j < i) | ((i == j) & (e < s))) if table.period else np.zeros(len(i), dtype=bool)
    same = (i == j) & ~turned
    last = _of_cubic(c[:, j], np.where(same, s, 0.0), e)
    first = _of_cubic(c[:, i], s, np.where(same, e, _length(table, i)))
    inner = np.arange(table.first, table.last + 1)
    whole = _of_cubic(c[:, inner], np.zeros(len(inner)), _length(table, inner))
    i, j = i - table.first, j - table.first + len(inner) * turned
    between = [_between(f, np.tile(x, 2), i, j, none)
               for f, x, none in ((np.minimum, whole[0], np.inf), (np.maximum, whole[1], -np.inf))]
    least, most = np.minimum.reduce([first[0], last[0], between[0]]), np.maximum.reduce([first[1], last[1], between[1]])
    longer = high - low >= (table.period or np.inf)
    return np.where(longer, whole[0].min(), least), np.where(longer, whole[1].max(), most)


def _length(table: Table, i: NDArray[np.intp]) -> Array:
    """(k,) lengths (s) of segments with numbers i (k,); 0 for the two segments before the first and after the last point."""
    inside = (i > 0) & (i < len(table.t))
    a = np.clip(i, 1, len(table.t) - 1)
    return np.where(inside, table.t[a] - table.t[a - 1], 0.0)


def _of_cubic(c: Array, s: Array, e: Array) -> tuple[Array, Array]:
    """Least and largest value of polynomials c (4, k) between s and e (k,)."""

    def at(x: Array) -> Array:
        return np.asarray(c[0] + x * (c[1] + x * (c[2] + x * c[3])))

    with np.errstate(all="ignore"):
        root = np.sqrt(c[2] ** 2 - 3 * c[3] * c[1])
        q = -(c[2] + np.copysign(root, c[2]))
        turns = [np.clip(np.nan_to_num(x, nan=0.0), np.minimum(s, e), np.maximum(s, e)) for x in (q / (3 * c[3]), c[1] / q)]
    found = [at(x) for x in (s, e, *turns)]
    return np.minimum.reduce(found), np.maximum.reduce(found)


def _between(extreme: np.ufunc, x: Array, i: NDArray[np.intp], j: NDArray[np.intp], none: float) -> Array:
    """(k,) least or largest value (`extreme`) of the entries of x between indices i and j (k,), both excluded; `none` where no
    entry lies between them."""
    found, some = np.full(len(i), none), j - i > 1
    if some.any():
        found[some] = extreme.reduceat(np.append(x, none), np.stack([i[some] + 1, j[some]], axis=1).ravel())[::2]
    return found


Bounds = tuple[Any, Any]  #: lower and upper bounds of an expression in k intervals of time, (k,) each

_RISING: dict[str, tuple[Callable[..., Any], float, float]] = {
    "atan": (np.arctan, -np.inf, np.inf), "sinh": (np.sinh, -np.inf, np.inf), "tanh": (np.tanh, -np.inf, np.inf),
    "asinh": (np.arcsinh, -np.inf, np.inf), "exp": (np.exp, -np.inf, np.inf), "log": (np.log, 0.0, np.inf),
    "asin": (np.arcsin, -1.0, 1.0), "acosh": (np.arccosh, 1.0, np.inf), "atanh": (np.arctanh, -1.0, 1.0),
    "floor": (np.floor, -np.inf, np.inf),
}
_COMPARE: dict[str, Callable[..., Any]] = {
    "StrictLessThan": np.less, "LessThan": np.less_equal, "Equality": np.equal, "Unequality": np.not_equal,
}


class Node(NamedTuple):
    """One subexpression: the name of its class, and the indices of its arguments in `Enclosure.nodes`."""

    expression: Expr
    name: str
    args: tuple[int, ...]


class Enclosure:
    """Bounds of expressions of `TIME` (an interval) and of `SIDE`, the time of conditions and floors (a number, `timed.sided`);
    `nodes`: their subexpressions, inner ones first."""

    def __init__(self, *expressions: Expr) -> None:
        at: dict[Expr, int] = {}
        self.nodes: list[Node] = []
        for e in expressions:
            for node in nodes(e):
                if node not in at:
                    at[node] = len(self.nodes)
                    self.nodes.append(Node(node, type(node).__name__, tuple(at[part] for part in node.args)))
        self.roots = [at[e] for e in expressions]

    def all(self, low: Any, high: Any, side: Any,
            tighter: Mapping[int, Callable[..., Bounds]] = MappingProxyType({})) -> list[Any]:
        """Bounds of every node over intervals [low, high] (k,), with conditions and floors evaluated at times side (k,); of a
        condition, whether it holds (k,). tighter: by index of a node, a function (bounds, low, high, side) for closer bounds."""
        found: list[Any] = []
        with np.errstate(all="ignore"):
            for i, node in enumerate(self.nodes):
                check("inputs of time were examined")
                bounds = self._one(node, [found[j] for j in node.args], low, high, side)
                found.append(tighter[i](bounds, low, high, side) if i in tighter else bounds)
        return found

    def __call__(self, low: Any, high: Any, side: Any) -> list[Bounds]:
        """Bounds (lower and upper ends, (k,) each) of the expressions, without those of their subexpressions; arguments as in
        `all`."""
        found = self.all(low, high, side)
        return [found[i] for i in self.roots]

    def at(self, t: Any, side: Any) -> list[Any]:
        """Values (k,) of the expressions at times t (k,), with conditions and floors evaluated at times side (k,)."""
        return [low for low, _ in self(t, t, side)]

    @staticmethod
    def _one(node: Node, args: list[Any], low: Any, high: Any, side: Any) -> Any:
        if not args:
            if node.expression in (TIME, SIDE):
                return (low, high) if node.expression == TIME else (side, side)
            if node.name in ("BooleanTrue", "BooleanFalse"):
                return np.full(len(low), node.name == "BooleanTrue")
            number = np.full(len(low), float(node.expression))
            return number, number
        if node.name == "FunctionSymbol":
            return _table(node, args)
        rule = _RULES.get(node.name)
        if rule is None:
            return np.full(len(low), -np.inf), np.full(len(low), np.inf)
        found = rule(node, args)
        if not isinstance(found, tuple):
            return found
        return np.where(np.isnan(found[0]), -np.inf, found[0]), np.where(np.isnan(found[1]), np.inf, found[1])


def halves(low: Any, high: Any, side: Any) -> tuple[Any, Any, Any]:
    """Ends and sides of the left and then of the right halves of intervals (k,)."""
    middle = (low + high) / 2
    return np.r_[low, middle], np.r_[middle, high], np.r_[side, side]


# ---- rules: one for every function ---------------------------------------------------------------------------------------


def _add(_: Node, args: list[Bounds]) -> Bounds:
    return sum(a[0] for a in args), sum(a[1] for a in args)


def _product(a: Bounds, b: Bounds) -> Bounds:
    ends = [np.where((x == 0) | (y == 0), 0.0, x * y) for x in a for y in b]
    return np.minimum.reduce(ends), np.maximum.reduce(ends)


def _multiply(_: Node, args: list[Bounds]) -> Bounds:
    product = args[0]
    for other in args[1:]:
        product = _product(product, other)
    return product


def _power(node: Node, args: list[Bounds]) -> Bounds:
    base, (a, b) = node.expression.args[0], args[1]
    if base == se.E:
        return np.exp(a), np.exp(b)
    exponent = node.expression.args[1]
    if not exponent.is_number:
        low, high = args[0]
        u = _product((np.log(np.maximum(low, 0.0)), np.log(np.maximum(high, 0.0))), (a, b))
        return np.exp(u[0]), np.exp(u[1])
    n, (low, high) = float(exponent), args[0]
    return _inverse(_positive_power(low, high, -n)) if n < 0 else _positive_power(low, high, n)


def _positive_power(low: Any, high: Any, n: float) -> Bounds:
    if n != round(n):
        return np.maximum(low, 0.0) ** n, np.maximum(high, 0.0) ** n
    ends = low**n, high**n
    if round(n) % 2:
        return ends
    inside = (low <= 0) & (high >= 0)
    return np.where(inside, 0.0, np.minimum(*ends)), np.maximum(*ends)


def _inverse(u: Bounds) -> Bounds:
    low, high = u
    across = (low <= 0) & (high >= 0)
    one_sided_low = np.where(low == 0, np.where(high == 0, -np.inf, 1 / high), -np.inf)  # u in (0, high]: 1/u is not below 1/high
    one_sided_high = np.where(high == 0, np.where(low == 0, np.inf, 1 / low), np.inf)
    return np.where(across, one_sided_low, 1 / high), np.where(across, one_sided_high, 1 / low)


def _rising(node: Node, args: list[Bounds]) -> Bounds:
    function, least, most = _RISING[node.name]
    low, high = args[0]
    return function(np.clip(low, least, most)), function(np.clip(high, least, most))


def _cosine(low: Any, high: Any) -> Bounds:
    """Bounds of the cosine: 1 where a multiple of 2 pi is inside, -1 where an odd multiple of pi is."""
    ends = np.cos(low), np.cos(high)

    def inside(peak: float) -> Any:
        return np.floor((high - peak) / (2 * np.pi)) >= np.ceil((low - peak) / (2 * np.pi))

    wide = ~(high - low < 2 * np.pi)
    return np.where(wide | inside(np.pi), -1.0, np.minimum(*ends)), np.where(wide | inside(0.0), 1.0, np.maximum(*ends))


def _tangent(_: Node, args: list[Bounds]) -> Bounds:
    low, high = args[0]
    pole = ~(high - low < np.pi) | (np.floor((high - np.pi / 2) / np.pi) >= np.ceil((low - np.pi / 2) / np.pi))
    return np.where(pole, -np.inf, np.tan(low)), np.where(pole, np.inf, np.tan(high))


def _cosh(_: Node, args: list[Bounds]) -> Bounds:
    low, high = args[0]
    ends = np.cosh(low), np.cosh(high)
    return np.where((low <= 0) & (high >= 0), 1.0, np.minimum(*ends)), np.maximum(*ends)


def _acos(_: Node, args: list[Bounds]) -> Bounds:
    low, high = (np.clip(x, -1.0, 1.0) for x in args[0])
    return np.arccos(high), np.arccos(low)


def _piecewise(_: Node, args: list[Any]) -> Bounds:
    low, high = (np.full(np.shape(args[1]), end) for end in (np.nan, np.nan))
    open_ = np.ones(np.shape(args[1]), dtype=bool)
    for value, condition in zip(args[::2], args[1::2], strict=True):
        here = open_ & condition
        low, high, open_ = np.where(here, value[0], low), np.where(here, value[1], high), open_ & ~condition
    return low, high


def _table(node: Node, args: list[Bounds]) -> Bounds:
    found = tables.lookup_of(node.expression)
    assert found is not None
    return table_range(found.table, found.order, *args[0], args[-1][0])


_RULES: dict[str, Callable[[Node, list[Any]], Any]] = {
    "Add": _add, "Mul": _multiply, "Pow": _power, "tan": _tangent, "cosh": _cosh, "acos": _acos, "Piecewise": _piecewise,
    "cos": lambda _, args: _cosine(*args[0]), "sin": lambda _, args: _cosine(args[0][0] - np.pi / 2, args[0][1] - np.pi / 2),
    "And": lambda _, args: np.logical_and.reduce(args), "Or": lambda _, args: np.logical_or.reduce(args),
    "Not": lambda _, args: ~args[0], "Xor": lambda _, args: np.logical_xor.reduce(args),
    **dict.fromkeys(_RISING, _rising), **dict.fromkeys(_COMPARE, lambda node, args: _COMPARE[node.name](args[0][0], args[1][0])),
}


@lru_cache(maxsize=256)
def enclosure(e: Expr) -> Enclosure:
    """The enclosure of an expression of time."""
    return Enclosure(sided(e))
