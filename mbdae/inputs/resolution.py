"""How fast inputs vary: divides the run into stretches in which the argument of no function (sin, exp, tanh, ...) changes by more
than two characteristic widths of the function; these are in `symbolic.functions`.

Nothing is sampled: a stretch is accepted where interval arithmetic bounds the change of every function in it, so a pulse of any
width is found. A function counts only while the input that contains it changes with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from math import ceil, inf, log
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.inputs.breaks import TOLERANCE, TooManyError, breaks, distinct, tables_within
from mbdae.inputs.enclosure import Bounds, Enclosure, Node, halves
from mbdae.inputs.tables import SIDED
from mbdae.inputs.timed import TIME, rate, sided
from mbdae.symbolic.rebuild import KINDS, is_condition, nodes, scales
from mbdae.symbolic.vectors import Expr
from mbdae.values import Array

NONE = np.zeros(0)
WIDTHS = 2.0  #: largest change of a function's argument over a stretch, in widths of the function; else the stretch is halved
FLAT = 1e-13  #: changes of an expression up to this share of its largest magnitude in the run count as none
SATURATED = 18.0  #: magnitude of the argument beyond which tanh counts as constant
MOST = 4_000_000  #: largest number of intervals examined at a time; an input that needs more is refused (TooManyError)
LEVELS = 52  #: number of halvings after which an input counts as not finite in an interval that would have to be halved again
POWERS = 2.0  #: number of widths by which a power u^n counts as changed when ln|u^n| changes by 1
ROOT = 1e-6  #: ratio to its largest value in the run up to which a root u^n, 0 < n < 1, counts as constant
#: powers u^n with a whole n from 1 to this count as smooth over the whole run; higher ones rise like an exponential near its end
FAST_POWER = 4.0


@dataclass(frozen=True)
class Stretches:
    """Consecutive stretches of time between `edges` (n+1,), s; poles: times near which an input is not finite; kinks (k,) of
    tables: times at which a step ends."""

    edges: Array
    poles: tuple[float, ...] = ()
    kinks: Array = field(default_factory=lambda: NONE)

    @property
    def finest(self) -> tuple[float, float]:
        """Length (s) and start (s) of the shortest stretch."""
        widths = np.diff(self.edges)
        i = int(np.argmin(widths))
        return float(widths[i]), float(self.edges[i])


class LongestStep(NamedTuple):
    """Longest step (s) from a time: a share of the stretch between two edges (n+1,) in which it begins and, where it reaches
    into the next stretch, the same share of that. It may reach beyond the end of the run, not beyond a kink (k,). unseen: the
    time (s) until which something grows that error tests do not see."""

    edges: Array
    share: float = 1.0
    kinks: Array = NONE
    unseen: float = -inf

    def __call__(self, t: float) -> float:
        return min(self.of_stretches(t), self.kink_after(t) - t)

    def kink_after(self, t: float, near: float = 0.0) -> float:
        """Time (s) of the next kink that is later than t by more than `near` (s) and round-off; infinite where there is none."""
        if not len(self.kinks):
            return inf
        k = int(np.searchsorted(self.kinks, t + max(near, SIDED * max(abs(t), abs(self.kinks[-1]))), side="right"))
        return float(self.kinks[k]) if k < len(self.kinks) else inf

    def of_stretches(self, t: float) -> float:
        """The longest step (s) from t if there were no kinks."""
        edges, share = self.edges, self.share
        i = min(max(int(np.searchsorted(edges, t, side="right")) - 1, 0), len(edges) - 2)
        a, b = float(edges[i]), float(edges[i + 1])
        if i + 2 >= len(edges):
            return share * (b - a)
        return min(share * (b - a), b - t + share * (t - a) / (b - a) * (float(edges[i + 2]) - b))


class Bound(NamedTuple):
    """The longest step (s) in a part of a run, from `begin` to `end` (s); unseen: whether it follows what the error test does not
    see."""

    begin: float
    end: float
    longest: float
    unseen: bool = False


def kept_by(t: Array, bounds: Sequence[Bound]) -> bool:
    """Whether no step between the times t (k,), s, is longer than a bound of the part in which it begins or ends."""
    h = np.diff(t)
    return not any(np.any(h[(t[1:] > bound.begin) & (t[:-1] < bound.end)] > bound.longest) for bound in bounds)


#: at a start at order 1 the length of steps grows by WIDENS after EQUAL steps: BDF of order k takes a higher one after steps of
#: equal length, k + 2 of them
WIDENS, EQUAL = 4.0, 7


def divided(bounds: Sequence[Bound], t0: float, t1: float, share: float, begins: Sequence[float] = (),
            error: float = 1.0) -> Array:
    """Edges (s) of the intervals of a run from t0 to t1 (s) to which its steps are confined so that they keep `share` times every
    bound. begins: times (s) at which a method starts at order 1. Where a bound is of what its error test does not see, its first
    steps, which make a relative error of the square of their length over the bound, are so short that this is at most `error`;
    those after them are longer, as the order rises."""
    ends = {t for bound in bounds for t in bound[:2] if t0 < t < t1}
    found = [np.array([t1])]
    for a, b in pairwise(sorted({t0, t1, *ends, *begins})):
        here = [bound for bound in bounds if bound.begin <= a < bound.end]
        longest = share * min((bound.longest for bound in here), default=inf)
        rises = -ceil(-log(error) / (2 * log(WIDENS))) if a in begins and any(bound.unseen for bound in here) else 0
        edges = a + np.concatenate([[0], np.cumsum(np.repeat(longest * WIDENS ** np.arange(rises, 0.0), EQUAL))])
        found.append(edges[edges < b])
        last = found[-1][-1]
        found.append(np.linspace(last, b, ceil((b - last) / longest) + 1) if longest < b - last else np.array([last]))
    return distinct(np.concatenate(found))


def with_edges(longest: LongestStep | None, edges: Array, share: float = 1.0) -> LongestStep:
    """A bound of the steps by the intervals between `edges` (s), in addition to those of `longest`. Without `longest` a step may
    be at most the fraction `share` of the interval in which it begins."""
    if longest is None:
        return LongestStep(distinct(edges), share)
    return longest._replace(edges=distinct(np.concatenate([longest.edges, edges])))


def stretches(expressions: Sequence[Expr], edges: Array, tolerance: float = TOLERANCE) -> Stretches:
    """The stretches of expressions over the intervals between `edges` (start, breaks, end); raises TooManyError."""
    t0, t1 = float(edges[0]), float(edges[-1])
    varying = [e for e in expressions if getattr(e, "free_symbols", None)]
    found = [part for e in varying for part in tables_within(e, t0, t1, tolerance)]
    kinks = distinct(np.concatenate([edges[[0, -1]], *(part.kinks for part in found)]))[1:-1]
    done = [part.edges for part in found]
    trees = [tree for tree in map(_Tree, {sided(e) for e in varying}) if tree.functions]
    low, high = edges[:-1], edges[1:]
    side = (low + high) / 2
    for tree in trees:
        tree.measure(low, high, side)
    poles: list[float] = []
    for level in range(LEVELS + 1):
        coarse = np.zeros(len(low), dtype=bool)
        for tree in trees:
            coarse |= tree.coarse(low, high, side)
        if level == LEVELS:
            poles = [float(t) for t in low[coarse]]
            coarse[:] = False
        done.append(low[~coarse])
        low, high, side = low[coarse], high[coarse], side[coarse]
        if not len(low):
            break
        if len(low) > MOST:
            raise TooManyError(f"the input varies so fast that more than {MOST} intervals between {edges[0]:g} and "
                               f"{edges[-1]:g} s are needed: shorten the run, or give the mean of the input")
        low, high, side = halves(low, high, side)
    return Stretches(distinct(np.concatenate([*done, edges])), tuple(poles), kinks)


@lru_cache(maxsize=64)
def resolved(expressions: tuple[Expr, ...], t0: float, t1: float, tolerance: float = TOLERANCE) -> tuple[Array, Stretches]:
    """Edges (start, breaks, end) and stretches of expressions over a run from t0 to t1; raises TooManyError. tolerance: for
    tables, relative to the range of their values."""
    edges = np.r_[t0, breaks(expressions, t0, t1, tolerance=tolerance), t1]
    return edges, stretches(expressions, edges, tolerance)


class _Tree:
    """One expression: its functions, the subexpressions that contain them, and the largest value of each over the run."""

    def __init__(self, e: Expr) -> None:
        self.enclosure = Enclosure(e)
        self.nodes = self.enclosure.nodes
        self.functions = [i for i, node in enumerate(self.nodes) if _varies(node)]
        self.parents: list[list[int]] = [[] for _ in self.nodes]
        for i, node in enumerate(self.nodes):
            for child in node.args:
                if not is_condition(node.expression) and not is_condition(self.nodes[child].expression):
                    self.parents[child].append(i)
        self.arguments = {i: _Argument(self.nodes[i].expression) for i in self.functions}
        self.inner = {i: self.nodes[i].args[argument.place] for i, argument in self.arguments.items()}
        self.tighter = {self.inner[i]: argument.bounds for i, argument in self.arguments.items() if argument.cancels}
        self.size: list[Any] = []

    def measure(self, low: Array, high: Array, side: Array) -> None:
        """Set `size`, the largest magnitude of every node over the run; 0 where it is not bounded."""
        for node, bounds in zip(self.nodes, self.enclosure.all(low, high, side, self.tighter), strict=True):
            size = 0.0 if is_condition(node.expression) else float(np.max(np.maximum(np.abs(bounds[0]), np.abs(bounds[1]))))
            self.size.append(size if np.isfinite(size) else 0.0)

    def coarse(self, low: Array, high: Array, side: Array) -> NDArray[np.bool_]:
        """(k,) whether an interval is too long for some function in it."""
        bounds = self.enclosure.all(low, high, side, self.tighter)
        live: list[Any] = [np.zeros(len(low), dtype=bool) for _ in self.nodes]
        coarse = np.zeros(len(low), dtype=bool)
        for i in reversed(range(len(self.nodes))):
            if is_condition(self.nodes[i].expression):
                continue
            a, b = bounds[i]
            with np.errstate(invalid="ignore"):
                changes = ~(b - a <= FLAT * self.size[i])
            live[i] = changes & (np.logical_or.reduce([live[p] for p in self.parents[i]]) if self.parents[i] else True)
            if i in self.arguments:
                coarse |= live[i] & ~(self.arguments[i].widths(bounds[self.inner[i]], self.size[self.inner[i]]) <= WIDTHS)
        return coarse


class _Argument:
    """The argument u of a function: tight bounds of it, and its change in widths of the function."""

    def __init__(self, function: Expr) -> None:
        self.place = 1 if _is_exponential(function) else 0
        u = function.args[self.place]
        slope = rate(u)
        self.cancels = not slope.is_number and not _functions_inside(u)  # the terms of u may cancel
        self._slope = Enclosure(slope, u) if self.cancels else None
        self._stretched = _stretch(function)
        exponent = function.args[1] if isinstance(function, se.Pow) else None
        self._root = float(exponent) if exponent is not None and exponent.is_number and 0 < float(exponent) < 1 else 0.0

    def bounds(self, natural: Bounds, low: Array, high: Array, side: Array) -> Bounds:
        """The bounds of u, with those by its slope about the middle, which are tight where terms cancel."""
        assert self._slope is not None
        middle = (low + high) / 2
        slope, _ = self._slope(low, high, side)
        centre = self._slope(middle, middle, side)[1][0]
        reach = np.maximum(np.abs(slope[0]), np.abs(slope[1])) * (high - low) / 2
        return np.fmax(natural[0], centre - reach), np.fmin(natural[1], centre + reach)

    def widths(self, u: Bounds, size: float) -> Array:
        """(k,) change of the function in its own widths while its argument varies over u; size: largest argument of the run.
        0 for u^n, 0 < n < 1, near u = 0, where the slope is infinite but the value small."""
        with np.errstate(all="ignore"):
            found = np.asarray(self._stretched(*u))
            if self._root:
                small = np.maximum(np.abs(u[0]), np.abs(u[1])) ** self._root <= ROOT * size**self._root
                found = np.where(small, 0.0, found)
        return found


def _varies(node: Node) -> bool:
    """Whether a node is a function of time with a characteristic width."""
    e = node.expression
    if TIME not in e.free_symbols:
        return False
    if node.name == "Pow":
        if _is_exponential(e):
            return True
        exponent = e.args[1]
        return not exponent.is_number or not (float(exponent) == round(float(exponent)) and 0 < float(exponent) <= FAST_POWER)
    return node.name in _STRETCHES


def _is_exponential(e: Expr) -> bool:
    return isinstance(e, se.Pow) and not e.args[1].is_number


def _functions_inside(u: Expr) -> bool:
    return any(len(node.args) == 1 or isinstance(node, se.Piecewise | se.FunctionSymbol) or _is_exponential(node)
               for node in nodes(u))


_SCALES = scales(SATURATED, np.inf)


def _difference(scale: Callable[[Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda a, b: np.abs(scale(b) - scale(a))


def _logarithmic(a: Any, b: Any) -> Any:
    """Change of ln|u| from u = a to u = b; infinite where 0 lies between them."""
    small, large = np.minimum(np.abs(a), np.abs(b)), np.maximum(np.abs(a), np.abs(b))
    return np.where((a <= 0) & (b >= 0) & (a < b), np.inf, np.log(large) - np.log(small))


#: name of a function -> function (a, b) that gives its change from argument a to argument b in widths; correct also near poles
#: and at the ends of its domain
_STRETCHES: dict[str, Callable[[Any, Any], Any]] = {
    **{name: _difference(_SCALES[KINDS[name]]) for name in ("sin", "cos", "sinh", "cosh", "tanh", "atan", "asinh")},
    "log": _logarithmic, "tan": lambda a, b: np.where(b - a > 3, np.inf, _tangents(a, b)),
    "asin": _difference(lambda u: np.arcsin(np.clip(u, -1, 1))), "acos": _difference(lambda u: np.arccos(np.clip(u, -1, 1))),
    "acosh": _difference(lambda u: np.arccosh(np.maximum(u, 1))), "atanh": _difference(lambda u: np.arctanh(np.clip(u, -1, 1))),
}


def _tangents(a: Any, b: Any) -> Any:
    """Change of asinh(tan u) from u = a to u = b, the change of the tangent in its widths; infinite where a pole lies between."""
    low, high = np.tan(a), np.tan(b)
    return np.where(high < low, np.inf, np.arcsinh(high) - np.arcsinh(low))


def _stretch(function: Expr) -> Callable[[Any, Any], Any]:
    """A function (a, b) for the change from argument a to argument b in widths of the given function."""
    name = type(function).__name__
    if name != "Pow":
        return _STRETCHES[name]
    if _is_exponential(function):
        return _difference(lambda u: u)
    n = float(function.args[1])
    return lambda a, b: POWERS * abs(n) * _logarithmic(a, b)
