"""Tables: piecewise polynomials between points. One of time is evaluated by one lookup, whatever the number of points; one of a
sensor (`mb.curve`) becomes cases of a Piecewise, so that the equations contain its slope.

In an expression a table is a function of its name, `table_<digest>(a*t + b)`; its derivatives have the name with `_d1`, `_d2`.
The segment used is the one that contains the time; at a point between two segments, the one on the side of the second argument
(`timed.sided`). `values` here and LOOKUP in `native/evaluation.c` follow the same rule.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.notation import counted
from mbdae.symbolic.vectors import Expr
from mbdae.values import Array, BadValueError, array, shown, word

KINDS, OUTSIDE = ("linear", "cubic", "step"), ("hold", "periodic", "error")
MOST_POINTS = 5_000_000
CLOSEST = 1e-11  #: a table is refused if two successive points are not farther apart, over its largest |t|: no step is shorter
#: distance of a time from a point of the table, relative to the magnitude of the time or the largest of the table, whichever is
#: larger, up to which the time counts as that point: then the argument `side` decides which of the two segments is used
SIDED = 1e3 * float(np.finfo(float).eps)
_NAME = re.compile(r"(table_[0-9a-f]{20})(?:_d(\d+))?", re.ASCII)


class Words(NamedTuple):
    """What messages call the points of a table: its two arguments, and one of its points."""

    at: str
    values: str
    point: str


OF_TIME, OF_SENSOR = Words("t", "values", "time"), Words("x", "y", "x")


class Table:
    """Points t (n,) in s, rising, with values (n,); kind and outside as in `mb.table`. Equal tables have equal names.

    Segment i (0..n) lies between points i - 1 and i and has the polynomial coefficients[:, i] in x - base[i], lowest power
    first; segments 0 and n are outside."""

    def __init__(self, t: Any, values: Any, kind: str = "linear", outside: str = "hold", words: Words = OF_TIME) -> None:
        self.kind, self.outside = _word("kind", kind, KINDS), _word("outside", outside, OUTSIDE)
        self.t, self.values = _checked(t, values, self.outside, words)
        told = f"{kind} {outside} {len(self.t)} ".encode() + self.t.tobytes() + self.values.tobytes()
        self.name = f"table_{hashlib.sha256(told).hexdigest()[:20]}"
        self.first, self.last = (0, len(self.t)) if outside == "hold" else (1, len(self.t) - 1)
        self.period = float(self.t[-1] - self.t[0]) if outside == "periodic" else 0.0
        self.near = SIDED * float(max(abs(self.t[0]), abs(self.t[-1])))

    @cached_property
    def base(self) -> Array:
        """Times (n+1,), s, from which the polynomials of the segments are counted."""
        return np.concatenate([self.t[:1], self.t[:-1], self.t[-1 if self.outside == "hold" else -2 :][:1]])

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients (4, n+1) of the polynomials of the segments, lowest power first."""
        inside, (n,) = _KINDS[self.kind](self.t, self.values, self.outside == "periodic"), self.t.shape
        found = np.zeros((4, n + 1))
        found[:, 1:n] = inside
        if self.outside == "hold":
            found[0, [0, n]] = self.values[[0, -1]]
        else:
            found[:, [0, n]] = inside[:, [0, -1]]
        return found

    def segments(self, x: Array, side: Array) -> tuple[Array, NDArray[np.intp]]:
        """For times x (k,): the time since the base of the segment, and the index of the segment; side (k,): times on the side to
        be used where x is a point of the table."""
        near = np.maximum(self.near, SIDED * np.abs(x))
        seen, turns = x + np.clip(side - x, -near, near), np.zeros(1)
        if self.period:
            turns = self.period * np.floor((seen - self.t[0]) / self.period)
        i = np.clip(np.searchsorted(self.t, seen - turns, side="right"), self.first, self.last)
        return x - turns - self.base[i], i

    def within(self, low: float, high: float) -> tuple[float, float]:
        """The part of an interval of its times (s) in which it may be read; both ends are equal where there is none."""
        if self.outside != "error":
            return low, high
        first, last = float(self.t[0]), float(self.t[-1])
        return min(max(low, first), last), max(min(high, last), first)

    def lookup(self, x: Array, side: Array, order: int = 0) -> Array:
        """Values, or derivatives of an order, (k,) at times x (k,); side (k,) as in `segments`."""
        s, i = self.segments(np.asarray(x, dtype=float), np.asarray(side, dtype=float))
        c = self.of_order(order)
        return np.asarray(c[0, i] + s * (c[1, i] + s * (c[2, i] + s * c[3, i])))

    def of_order(self, order: int) -> Array:
        """Coefficients (4, n+1) of the derivative of an order (0: the table itself), lowest power first."""
        while order >= len(self._orders):
            c = self._orders[-1]
            self._orders.append(np.stack([c[1], 2 * c[2], 3 * c[3], np.zeros(c.shape[1])]))
        return self._orders[order]

    @cached_property
    def _orders(self) -> list[Array]:
        return [self.coefficients]

    @cached_property
    def packed(self) -> Array:
        """The array that C reads: first and last segment, period, `near`, points, bases, coefficients segment by segment."""
        head = [self.first, self.last, self.period, self.near]
        found = np.concatenate([head, self.t, self.base, self.coefficients.T.ravel()])
        found.flags.writeable = False
        return found

    @cached_property
    def as_data(self) -> dict[str, Any]:
        """The table as plain data that keeps every digit."""
        t, values = (base64.b64encode(x.astype("<f8").tobytes()).decode("ascii") for x in (self.t, self.values))
        return {"kind": self.kind, "outside": self.outside, "t": t, "values": values}

    def points(self, x0: float, x1: float) -> Array:
        """Points inside (x0, x1), repeated where the table is periodic."""
        if not self.period:
            return self.t[(self.t > x0) & (self.t < x1)]
        turns = np.arange(np.floor((x0 - self.t[0]) / self.period), np.ceil((x1 - self.t[0]) / self.period))
        if len(turns) * len(self.t) > MOST_POINTS:
            raise BadValueError(f"the input reads a periodic table at times from {x0:g} to {x1:g} s, where it has more than "
                                f"{MOST_POINTS} points with its repetitions: shorten the run, or give its mean")
        all_points = (self.t[:-1] + self.period * turns[:, None]).ravel()
        return all_points[(all_points > x0) & (all_points < x1)]


def _word(name: str, value: Any, words: tuple[str, ...]) -> str:
    try:
        return word(value, words)
    except BadValueError as value_and_reason:
        raise BadValueError(f"{name} = {value_and_reason}") from None


def _checked(t: Any, values: Any, outside: str, words: Words) -> tuple[Array, Array]:
    t, values = (_numbers(name, x) for name, x in ((words.at, t), (words.values, values)))
    if len(t) != len(values):
        raise BadValueError(f"{len(t)} numbers {words.at} and {len(values)} numbers {words.values}: give one value for every "
                            f"{words.point}")
    if len(t) < 2:
        raise BadValueError(f"a table of {counted(len(t), 'point')} is too short: give two or more")
    falling = np.flatnonzero(~(np.diff(t) > CLOSEST * max(abs(t[0]), abs(t[-1]))))
    if len(falling):
        i = int(falling[0])
        relation = "equal" if t[i] == t[i + 1] else "not in rising order" if t[i] > t[i + 1] else "closer than any time step"
        raise BadValueError(f"{words.at}[{i}] = {float(t[i])!r} and {words.at}[{i + 1}] = {float(t[i + 1])!r} are {relation}: "
                            f"give rising numbers that steps can tell apart, one value for each (a jump: kind=\"step\")")
    if outside == "periodic" and values[0] != values[-1]:
        raise BadValueError(f"a periodic table ends with the value with which it begins, not with {float(values[-1])!r} "
                            f"after {float(values[0])!r}: append the first value, a period after its {words.point}")
    return t, values


def _numbers(name: str, x: Any) -> Array:
    try:
        found = array(x)
    except BadValueError as value_and_reason:
        i = _not_finite(x)
        if i is not None:
            raise BadValueError(f"{name}[{i}] is not a finite number: give finite numbers, or leave that point out") from None
        raise BadValueError(f"{name} = {value_and_reason}: give a list of finite numbers") from None
    if found.ndim != 1:
        raise BadValueError(f"{name} = {shown(x)} has shape {found.shape}: give a list of numbers")
    found.flags.writeable = False
    return found


def _not_finite(x: Any) -> int | None:
    try:
        wrong = np.argwhere(~np.isfinite(np.asarray(x, dtype=float)))
    except (TypeError, ValueError, OverflowError):
        return None
    return int(wrong[0, 0]) if wrong.shape[1] == 1 and len(wrong) else None


# ---- polynomials between the points: (4, n-1) ------------------------------------------------------------------------------


def _linear(t: Array, v: Array, periodic: bool) -> Array:
    return np.stack([v[:-1], np.diff(v) / np.diff(t), *np.zeros((2, len(t) - 1))])


def _step(t: Array, v: Array, periodic: bool) -> Array:
    return np.stack([v[:-1], *np.zeros((3, len(t) - 1))])


def _cubic(t: Array, v: Array, periodic: bool) -> Array:
    """The cubic that rises and falls with its points (Fritsch and Butland's PCHIP)."""
    h, d = np.diff(t), np.diff(v) / np.diff(t)
    if periodic:
        m = _slopes(np.r_[h[-1], h, h[0]], np.r_[d[-1], d, d[0]])
    elif len(t) == 2:
        m = np.r_[d, d]
    else:
        m = np.r_[_end(h[0], h[1], d[0], d[1]), _slopes(h, d), _end(h[-1], h[-2], d[-1], d[-2])]
    return np.stack([v[:-1], m[:-1], (3 * d - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * d) / h**2])


def _slopes(h: Array, d: Array) -> Array:
    """Slopes at inner points: the weighted harmonic mean of the slopes d of both segments, 0 where these differ in sign."""
    a, b = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (a + b) / (a / d[:-1] + b / d[1:])
    return np.where(d[:-1] * d[1:] > 0, mean, 0.0)


def _end(h0: float, h1: float, d0: float, d1: float) -> float:
    """Slope at an end: that of the parabola through three points, limited so that the cubic stays monotone."""
    m = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if m * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(m) > 3 * abs(d0) else float(m)


_KINDS = {"linear": _linear, "cubic": _cubic, "step": _step}

# ---- tables by their names -------------------------------------------------------------------------------------------------

_KNOWN: dict[str, Table] = {}


class Lookup(NamedTuple):
    """A table, or its derivative of an order, in an expression."""

    table: Table
    order: int


def known(table: Table) -> Table:
    """Register a table, so that expressions may contain it by its name; returns the table."""
    return _KNOWN.setdefault(table.name, table)


def from_data(name: str, data: Any) -> None:
    """Register a table from stored data; BadValueError where the data cannot be read or belongs to a table of another name."""
    if name in _KNOWN and data == _KNOWN[name].as_data:
        return
    try:
        t, values = (np.frombuffer(base64.b64decode(data[key], validate=True), dtype="<f8") for key in ("t", "values"))
        table = Table(t, values, data["kind"], data["outside"])
    except (KeyError, TypeError, ValueError) as error:
        raise BadValueError(f"the stored points of its table cannot be read ({type(error).__name__}: {error}): the data were "
                            f"changed or damaged; store them again") from None
    if table.name != name:
        raise BadValueError("the points of its table are not those with which it was stored: the data were changed or damaged; "
                            "store them again")
    known(table)


def named(name: str) -> Lookup | None:
    """The table that a function name stands for; None where there is none."""
    found = _NAME.fullmatch(name)
    return None if found is None or found[1] not in _KNOWN else Lookup(_KNOWN[found[1]], int(found[2] or 0))


def in_cases(found: Lookup, x: Expr, number: Callable[[float], Expr] = se.RealDouble) -> Expr:
    """The value of a table at x as cases of a Piecewise, nested so that a value is found by halving. number: what stands for each
    of its numbers. Beyond the ends of a table with outside="error" its last polynomials go on; runs end there."""
    table, c = found.table, found.table.of_order(found.order)
    if table.period:
        x = x - number(table.period) * se.floor((x - number(table.t[0])) / number(table.period))

    def segment(i: int) -> Expr:
        value = number(float(c[0, i]))
        highest = int(np.max(np.flatnonzero(c[:, i]), initial=0))
        if highest:
            s, value = x - number(float(table.base[i])), number(float(c[highest, i]))
            for k in reversed(range(highest)):
                value = value * s + number(float(c[k, i]))
        return value

    def between(low: int, high: int) -> Expr:
        if low == high:
            return segment(low)
        middle = (low + high) // 2
        return se.Piecewise((between(low, middle), x < number(float(table.t[middle]))), (between(middle + 1, high), True))

    return between(table.first, table.last)


def readable(text: str) -> str:
    """The text of an expression for a message, with "table" for the names of tables, which are digests."""
    return _NAME.sub("table", text)


def lookup_of(node: Expr) -> Lookup | None:
    """The table of a node of an expression; None where it is none."""
    return named(node.get_name()) if isinstance(node, se.FunctionSymbol) else None


def function(table: Table, order: int) -> Any:
    """The symengine function of a table or of a derivative of it."""
    return se.Function(table.name if order == 0 else f"{table.name}_d{order}")
