"""At which points of a table a step has to end, and how long steps may be in between: most points of a measured table matter less
than the accuracy.

Neighbouring segments are joined as long as one polynomial of degree DEGREE follows all of them within a tolerance, a share of the
range of the table in the run. Within joined segments the table is this polynomial and a remainder of at most the tolerance, which
acts like a load of that size. Its error is in proportion to the accuracy asked for, and the comparison with the companion run,
which has a lower accuracy, includes it like every other error. A step ends at a point between two joined pieces where no such
polynomial fits across it; elsewhere the point only limits the steps. Where the value in use jumps, accelerations and reactions
jump too, and the integration restarts; at a kink a step ends and the integration continues.

Measured inputs: tables as expressions of `mb.t`, from arrays or from a file.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import OptionError, naming_arguments
from mbdae.inputs import sympy_time, tables
from mbdae.inputs.sensed import symbol_name
from mbdae.inputs.tables import OF_SENSOR, Table
from mbdae.inputs.timed import after
from mbdae.values import Array, BadValueError, option, path, shown, text

Index = NDArray[np.intp]

DEGREE = 7
#: a piece of joined segments is divided into this many equal parts, but not into more than it has segments; the parts limit the
#: steps, so that several steps follow the polynomial of the piece
PARTS = 4
SAMPLES = np.array([0.0, 1 / 3, 2 / 3, 1.0])  #: parts of a segment's length at which deviations are measured; segments are cubics
#: largest number of segments of a block at which the polynomial is compared first, before it is at all of them; and of segments
#: on each side of a point between two pieces, at which one polynomial across this point is compared
SOME = 16
LARGE = 256  #: the deviation of a block is cached if it is compared at this many of its segments or more
FINEST = 1e-11  #: smaller tolerances, relative to the range of the table in the run, are raised to this: less is rounding error
_NODES = (1 - np.cos((2 * np.arange(DEGREE + 1) + 1) * np.pi / (2 * DEGREE + 2))) / 2
_FROM_NODES = np.linalg.inv(np.vander(2 * _NODES - 1, increasing=True))


class Pieces(NamedTuple):
    """Times of a table, s. jumps (k,): a step ends there, and the value jumps; kinks (l,): a step ends there, without a jump;
    edges (m,): ends of the intervals that limit the steps, without start and end of the run."""

    jumps: Array
    kinks: Array
    edges: Array


class _Samples:
    """A table over a run: ends `at` (n+1,) of its segments, and its values (n, 4) at SAMPLES in each segment."""

    def __init__(self, table: Table, order: int, x0: float, x1: float) -> None:
        self.table, self.order = table, order
        self.at = np.concatenate([[x0], table.points(x0, x1), [x1]])
        a, b = self.at[:-1, None], self.at[1:, None]
        self.x = a + (b - a) * SAMPLES
        side = np.broadcast_to((a + b) / 2, self.x.shape)
        self.values = table.lookup(self.x.ravel(), side.ravel(), order).reshape(self.x.shape)
        self.range = float(np.max(self.values) - np.min(self.values))
        self.whole: dict[tuple[int, int], float] = {}  #: cached deviations of blocks of 2^level segments, by level and begin

    def deviation(self, low: Array, high: Array, segments: Index) -> Array:
        """(k,) largest distance, over the samples of segments (k, m) inside [low, high] (k,), from a polynomial of DEGREE."""
        nodes = low[:, None] + (high - low)[:, None] * _NODES
        c = self.table.lookup(nodes.ravel(), nodes.ravel(), self.order).reshape(nodes.shape) @ _FROM_NODES.T
        centre, scale = (low + high) / 2, 2 / (high - low)
        u = (self.x[segments] - centre[:, None, None]) * scale[:, None, None]
        fitted = np.zeros_like(u)
        for power in reversed(range(DEGREE + 1)):
            fitted *= u
            fitted += c[:, power, None, None]
        fitted -= self.values[segments]
        fitted[np.abs(u) > 1 + 1e-9] = 0.0
        return np.asarray(np.abs(fitted).max(axis=(1, 2)))


@lru_cache(maxsize=8)
def _samples(table: Table, order: int, x0: float, x1: float) -> _Samples:
    return _Samples(table, order, x0, x1)


def pieces(table: Table, order: int, x0: float, x1: float, tolerance: float) -> Pieces:
    """The `Pieces` of a table, or of its derivative of an order, between x0 and x1."""
    s = _samples(table, order, x0, x1)
    if not s.range > 0:
        return Pieces(*np.zeros((3, 0)))
    allowed = max(tolerance, FINEST) * s.range
    ends = _joined(s, allowed)
    inner = ends[1:-1]
    width = np.minimum(s.at[ends[1:-1]] - s.at[ends[:-2]], s.at[ends[2:]] - s.at[ends[1:-1]]) / 2
    single = (np.diff(ends)[:-1] == 1) & (np.diff(ends)[1:] == 1)
    off = np.zeros(len(inner))
    for some, most in ((single, 1), (~single, SOME)):
        off[some] = _across(s, inner[some], width[some], most)
    landed = inner[off > allowed]
    jumps = np.abs(s.values[landed, 0] - s.values[landed - 1, -1]) > allowed
    parts = np.minimum(np.diff(ends), PARTS)
    shares = np.arange(1, PARTS) / parts[:, None]
    between = (s.at[ends[:-1], None] + (s.at[ends[1:]] - s.at[ends[:-1]])[:, None] * shares)[shares < 1]
    return Pieces(s.at[landed[jumps]], s.at[landed[~jumps]], distinct(np.concatenate([s.at[inner], between])))


def _across(s: _Samples, point: Index, width: Array, most: int) -> Array:
    """Deviations (k,) from one polynomial across points (k,), indices in `at`, in windows of half widths (k,); `most` segments
    are checked on each side, among them the one beside the point."""
    low, high = s.at[point] - width, s.at[point] + width
    first = np.searchsorted(s.at, low, side="right") - 1
    last = np.searchsorted(s.at, high, side="left") - 1
    left, right = (point - 1 - first)[:, None], (last - point)[:, None]
    shares = np.arange(most) / max(most - 1, 1)
    chosen = np.hstack([point[:, None] - 1 - (left * shares).astype(np.intp), point[:, None] + (right * shares).astype(np.intp)])
    return s.deviation(low, high, chosen)


def _joined(s: _Samples, allowed: float) -> Index:
    """Indices in `at` (m,) of the ends of joined segments: blocks of 2^k segments, halved until a polynomial follows each."""
    n = len(s.at) - 1
    level, begin, done = (n - 1).bit_length(), np.zeros(1, dtype=np.intp), [np.array([0, n], dtype=np.intp)]
    while level and len(begin):
        end, good = np.minimum(begin + 2**level, n), np.ones(len(begin), dtype=bool)
        for count in sorted({min(SOME, 2**level), 2**level}):  # a few segments exclude most large blocks
            good[good] = _of_blocks(s, level, begin[good], end[good], count) <= allowed
        done += [begin[good], end[good]]
        level, begin = level - 1, begin[~good]
        begin = np.sort(np.concatenate([begin, begin + 2**level]))
        begin = begin[begin < n]
    return distinct(np.concatenate([*done, begin, np.minimum(begin + 1, n)]))


def _of_blocks(s: _Samples, level: int, begin: Index, end: Index, count: int) -> Array:
    """Deviations (k,) of blocks of segments, at `count` of their segments; those of large blocks are cached."""
    keys = [(level, int(i)) for i in begin] if count >= LARGE else []
    if keys and all(key in s.whole for key in keys):
        return np.array([s.whole[key] for key in keys])
    chosen = begin[:, None] + ((end - begin - 1)[:, None] * (np.arange(count) / (count - 1))).astype(np.intp)
    found = s.deviation(s.at[begin], s.at[end], chosen)
    s.whole |= dict(zip(keys, found.tolist(), strict=True)) if keys else {}
    return found


TIME_UNITS = ("s", "sec", "second", "seconds")
#: SI unit -> other units of the same quantity that files may state, each with its size in the SI unit
FACTORS: dict[str, dict[str, float]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    "m/s": {"mm/s": 1e-3, "km/h": 1 / 3.6}, "m/s^2": {"mm/s^2": 1e-3},
    "rad": {"mrad": 1e-3, "deg": np.pi / 180, "°": np.pi / 180},
    "rad/s": {"deg/s": np.pi / 180, "°/s": np.pi / 180, "rpm": np.pi / 30},
    "N": {"mN": 1e-3, "kN": 1e3, "MN": 1e6}, "N m": {"N mm": 1e-3, "Nmm": 1e-3, "Nm": 1.0, "kN m": 1e3, "kNm": 1e3},
    "Pa": {"kPa": 1e3, "bar": 1e5, "MPa": 1e6, "GPa": 1e9}, "kg": {"t": 1e3},
}
SI = {other: si for si, factors in FACTORS.items() for other in factors}
_HEAD = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
FORMULAS = ("=", "+", "-", "@")  #: first signs of names that spreadsheets take for formulas
MOST_OF_CURVE = 200  #: points of a curve over sensors: each is a case in the equations
LONGEST_LIST = 12  #: most columns that a message lists


@naming_arguments
def table(t: Any, values: Any, kind: str = "linear", outside: str = "hold") -> Any:
    """A table as an expression of `mb.t`: in any drive, load or parameter, alone or inside of an expression.

    t (n,): times in s, rising; values (n,): in SI units of what takes them. kind: "linear" between the points, "cubic" (the
    monotone cubic PCHIP, whose slope is continuous: for prescribed motions), "step" (a value holds until the next point).
    outside: "hold" the first and the last value, "periodic" (the last value is the first), or "error": a run that goes beyond the
    table is refused before it begins. With `.subs(mb.t, 2*mb.t - 1)` it is read at another pace or from another instant.
    OptionError where the points are not rising, not finite or fewer than two."""
    try:
        found = tables.known(Table(t, values, kind, outside))
    except BadValueError as wrong_argument:
        raise OptionError(f"mb.table: {wrong_argument}") from None
    return _function(found.name, 0)(sympy_time())


@naming_arguments
def curve(x: Any, y: Any, kind: str = "linear", outside: str = "hold") -> Any:
    """A curve y(x) over anything that a load can read: `mb.curve(x, y)(s.sensor("D.displacement"))` is an expression for loads,
    springs, dampers, drives and states.

    x (n,): rising; y (n,): in SI units of what takes them; kind and outside as in `mb.table`. The function takes a sensor, by its
    path too, an expression of sensors and `mb.t`, or a number. Value and slope are exact; steps end where the curve has a kink.
    outside="error": a run that leaves the curve ends there with a SolverError that names it. OptionError where the points are not
    rising, not finite, fewer than two or more than 200."""
    try:
        found = tables.known(Table(x, y, kind, outside, OF_SENSOR))
        if len(found.t) > MOST_OF_CURVE:
            raise BadValueError(f"{len(found.t)} points are more than the {MOST_OF_CURVE} that the equations of a curve can "
                                f"have: leave points out where a straight line follows them")
    except BadValueError as wrong_argument:
        raise OptionError(f"mb.curve: {wrong_argument}") from None
    return Curve(found.name)


class Curve(NamedTuple):
    """A curve that `mb.curve` made; name: of its table in expressions."""
    name: str

    def __call__(self, x: Any) -> Any:
        """The value at x: a sensor or its path, an expression of sensors and mb.t, or a number."""
        import sympy

        at = sympy.Symbol(symbol_name(x), real=True) if isinstance(x, str) else sympy.sympify(x)
        if not isinstance(at, sympy.Expr):
            raise OptionError(f"a curve is read at a sensor, an expression or a number, not at {shown(x)}")
        found = _function(self.name, 0)(at)
        return float(found) if at.is_number else found


@naming_arguments
def read_table(file: Any, t: str, value: str, kind: str = "linear", outside: str = "hold", unit: str | None = None) -> Any:
    """A table from two columns of a file of numbers, with the names of the columns in its first line: see `mb.table`.

    Columns are divided by commas, semicolons, tabs or blanks; lines that begin with # are left out. t, value: names of columns,
    which may state a unit behind them: "F [N]". unit: the SI unit of the values, such as "N": a column in a known multiple of it
    (mm, deg, kN, ...) is converted; a unit that the column states itself leaves its values as they are. Times in ms or min are
    converted to s. OptionError where the file or a column is missing, an entry is no number, a unit cannot be converted, or the
    column states one that is not SI and `unit` is not given."""
    place = option("file", file, path, "give the path of a file of numbers with names of columns in its first line")
    names = [option(name, x, text, "give the name of a column") for name, x in (("t", t), ("value", value))]
    head, rows = _rows(place)
    columns = [_column(place, head, name) for name in names]
    factors = [_factor(place, head[c], x, i == 0) for i, (c, x) in enumerate(zip(columns, ("s", unit), strict=True))]
    times, values = ([factor * _number(place, line, head[c], row, c) for line, row in rows]
                     for c, factor in zip(columns, factors, strict=True))
    try:
        found = tables.known(Table(times, values, kind, outside))
    except BadValueError as wrong_points:
        t_name, value_name = (shown(head[c]) for c in columns)
        raise OptionError(f"'{place}', columns {t_name} (t) and {value_name} (values): {wrong_points}") from None
    return _function(found.name, 0)(sympy_time())


# ---- files -----------------------------------------------------------------------------------------------------------------


def _rows(place: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Names of the columns, and the entries of each row with the number of its line in the file."""
    try:
        lines = place.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise OptionError(f"the table '{place}' cannot be read: {error.strerror}; give the path of a file that exists and that "
                          f"you may read") from None
    except UnicodeDecodeError:
        raise OptionError(f"the table '{place}' is no text in UTF-8; save it as CSV in UTF-8") from None
    kept = [(i, line) for i, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise OptionError(f"the table '{place}' is empty, or has comments (#) alone: give a file with names of columns in "
                          f"its first line and numbers below")
    sign = next((s for s in (";", ",", "\t") if s in kept[0][1]), None)
    split = [row if sign else " ".join(row).split() for row in csv.reader((line for _, line in kept), delimiter=sign or " ")]
    if not sign:
        # names of columns from words, where a word in brackets is the unit of the name before it
        found: list[str] = []
        for word in split[0]:
            if found and word.startswith(("[", "(")):
                found[-1] += f" {word}"
            else:
                found.append(word)
        split[0] = found
    return [_plain(h.strip()) for h in split[0]], [(i, row) for (i, _), row in zip(kept[1:], split[1:], strict=True)]


def _plain(head: str) -> str:
    """A name without the apostrophe by which it is no formula to spreadsheets (`Result.to_csv` writes it)."""
    return head[1:] if head[:1] == "'" and head[1:2] in FORMULAS else head


def _column(place: Path, head: Sequence[str], name: str) -> int:
    """Index of the column with a name, which may be given with its unit or without."""
    found = [i for i, h in enumerate(head) if name.strip() in (h, _HEAD.fullmatch(h)["name"])]  # type: ignore[index]
    if len(found) == 1:
        return found[0]
    columns = ", ".join(repr(h) for h in head[:LONGEST_LIST]) + (", ..." if len(head) > LONGEST_LIST else "")
    if found:
        raise OptionError(f"'{place}' has several columns {name!r} among {columns}; rename one of them in the file")
    raise OptionError(f"'{place}' has no column {name!r}; give one of its columns {columns}")


def _factor(place: Path, head: str, wanted: str | None, is_time: bool) -> float:
    """Factor from the unit that a column states to the one that is wanted; 1 where neither says anything."""
    stated = (_HEAD.fullmatch(head)["unit"] or "").strip()  # type: ignore[index]
    if stated == (wanted or "") or (is_time and stated in ("", *TIME_UNITS)) or (wanted is None and stated not in SI):
        return 1.0
    if wanted is not None and stated in FACTORS.get(wanted, ()):
        return FACTORS[wanted][stated]
    column = f"column {head!r} of '{place}'"
    if not stated:
        raise OptionError(f"{column} states no unit to convert to unit={wanted!r}; leave unit= out to take its numbers as they "
                          f"stand, or name the column '{head} [...]' in the file, with their unit")
    if wanted is None:
        raise OptionError(f"{column} is in {stated!r}; give unit={SI[stated]!r} to have it converted, or unit={stated!r} to "
                          f"take its numbers as they stand")
    if is_time:
        raise OptionError(f"{column} is in {stated!r}, which is not converted to s; give times in s, {', '.join(FACTORS['s'])}")
    raise OptionError(f"{column} is in {stated!r}, which cannot be converted to unit={wanted!r}; convert the column in the file, "
                      f"or give unit={stated!r} to take its numbers as they stand")


def _number(place: Path, line: int, head: str, row: Sequence[str], column: int) -> float:
    try:
        return float(row[column])
    except (IndexError, ValueError):
        at = f"'{place}', line {line}, column {head!r}"
        if column < len(row):
            raise OptionError(f"{at}: {row[column]!r} is no number; correct it, or leave the line out") from None
        raise OptionError(f"{at}: the entry is missing; complete the line, or leave it out") from None


# ---- SymPy -----------------------------------------------------------------------------------------------------------------


@cache
def _function(name: str, order: int) -> Any:
    """SymPy's function of a table, or of a derivative of it."""
    from sympy.core.function import AppliedUndef, UndefinedFunction

    class AppliedTable(AppliedUndef):  # type: ignore[misc]
        """A table as a function in SymPy: with derivatives and, where the argument is a number, a value."""

        def _eval_derivative(self, s: Any) -> Any:
            return _function(name, order + 1)(*self.args) * self.args[0].diff(s)

        def _eval_evalf(self, prec: int) -> Any:
            import sympy

            if not self.args[0].is_number:
                return None
            at = np.array([float(self.args[0])])
            found = tables.named(self.func.__name__)
            return None if found is None else sympy.Float(float(found.table.lookup(at, after(at), found.order)[0]))

    return UndefinedFunction(name if order == 0 else f"{name}_d{order}", bases=(AppliedTable,))
