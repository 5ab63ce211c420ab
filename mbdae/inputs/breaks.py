"""Breaks, the discontinuities of inputs: instants at which an expression of time or a derivative of it jumps, because a
condition or a floor in it changes.

They are not searched by sampling: an interval is left out only where interval arithmetic proves that nothing changes in it.

Pulses, inputs that change during one interval alone, are found by sampling, so that they have to be wide enough for that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import MbdaeError
from mbdae.inputs import tables
from mbdae.inputs.enclosure import Enclosure, halves
from mbdae.inputs.measured import Pieces, pieces
from mbdae.inputs.tables import Table
from mbdae.inputs.timed import SIDE, TIME, affine, rate, sided, split, values
from mbdae.symbolic.rebuild import is_condition, nodes
from mbdae.symbolic.vectors import Expr
from mbdae.values import Array, BadValueError

#: most instants at which conditions, floors and tables change between start and end of a run, and most intervals searched at a
#: time; with more the input is refused (TooManyError)
MOST = 200_000
TOLERANCE = 1e-7  #: default tolerance with which steps follow a table, relative to the range of its values in the run
#: bounds of the difference of two instants, relative to their magnitude: up to SAME they count as one, because no step is that
#: short; up to TWINS the difference of two instants of one input is round-off, and an interval is not halved further. An instant
#: of smaller magnitude than EARLY times the largest of start and end counts as having this magnitude
SAME, TWINS, EARLY = 1e3 * float(np.finfo(float).eps), 64 * float(np.finfo(float).eps), 1e-6
LEVELS = 60  #: most halvings of an interval, in the search for intervals with one change each and again in the bisection of these


class TooManyError(MbdaeError):
    """An input that changes too often to be followed."""


def breaks(expressions: Iterable[Expr], t0: float, t1: float, same: float = SAME, tolerance: float = TOLERANCE) -> Array:
    """Times inside (t0, t1), rising, at which conditions of the expressions change or tables jump by more than the
    tolerance (`tables_within`); raises TooManyError."""
    edges = np.array([t0, t1])
    for e in expressions:
        if not getattr(e, "free_symbols", None):
            continue
        edges = _merged(edges, np.concatenate([np.zeros(0), *(p.jumps for p in tables_within(e, t0, t1, tolerance))]), same)
        for kind, u in switches(e):
            edges = _merged(edges, _zeros(u, edges) if kind == "zero" else _integers(u, edges), same)
    return edges[1:-1]


@lru_cache(maxsize=64)
def tables_within(e: Expr, t0: float, t1: float, tolerance: float) -> tuple[Pieces, ...]:
    """Jumps and kinks between t0 and t1 of every table of an expression, and the edges that limit the steps there; raises
    TooManyError."""
    found = []
    for lookup, a, b, _ in split((sided(e),)).readings:
        low, high = lookup.table.within(*sorted((a * t0 + b, a * t1 + b)))
        try:
            part = pieces(lookup.table, lookup.order, low, high, tolerance)
        except BadValueError as error:
            raise TooManyError(str(error)) from error
        found.append(Pieces(*(np.sort((x - b) / a) for x in part)))
    return tuple(found)


def tables_read(e: Expr, t0: float, t1: float) -> list[tuple[Table, float, float]]:
    """Tables that an expression reads within a run, each with the first and last of the table's own times at which it is read;
    cases of a Piecewise that do not hold are not read. Raises TooManyError."""
    edges, e = np.r_[t0, breaks((e,), t0, t1), t1], sided(e)
    middle = (edges[1:] + edges[:-1]) / 2
    known = Enclosure(e)
    values = {node.expression: value for node, value in zip(known.nodes, known.all(middle, middle, middle), strict=True)}
    read: list[tuple[Table, float, float]] = []

    def visit(node: Expr, here: Any) -> None:
        if not here.any():
            return
        lookup = tables.lookup_of(node)
        if lookup is not None:
            a, b = affine(node.args[0], TIME if TIME in node.args[0].free_symbols else SIDE)
            at = a * np.r_[edges[:-1][here], edges[1:][here]] + b
            read.append((lookup.table, float(at.min()), float(at.max())))
        if not isinstance(node, se.Piecewise):
            for part in node.args:
                visit(part, here)
            return
        for value, condition in zip(node.args[::2], node.args[1::2], strict=True):
            visit(condition, here)
            visit(value, here & values[condition])
            here = here & ~values[condition]

    visit(e, np.ones(len(middle), dtype=bool))
    return read


def switches(e: Expr) -> list[tuple[str, Expr]]:
    """("zero", u) for every comparison of u with 0, ("integer", u) for every floor of u; inner ones first."""
    found: dict[tuple[str, Expr], None] = {}
    for node in nodes(e):
        if type(node).__name__ == "floor":
            found["integer", node.args[0]] = None
        elif is_condition(node) and len(node.args) == 2 and not any(is_condition(part) for part in node.args):
            found["zero", node.args[0] - node.args[1]] = None
    return [(kind, u) for kind, u in found if TIME in u.free_symbols]


def unresolved(e: Expr, t0: float, t1: float) -> tuple[float, float] | None:
    """An instant (s) at which conditions of an expression change twice within less than the shortest possible step, and the
    time (s) between both changes; None where there is none."""
    edges = np.concatenate([[t0], breaks((e,), t0, t1, TWINS), [t1]])
    gaps = np.diff(edges)
    close = np.flatnonzero(gaps <= SAME * _sizes(edges)[1:])
    return (float(edges[close[0]]), float(gaps[close[0]])) if len(close) else None


def _sizes(edges: Array) -> Array:
    """Magnitudes relative to which differences of times are measured."""
    return np.asarray(np.maximum(np.abs(edges), EARLY * max(abs(edges[0]), abs(edges[-1]))))


def _merged(edges: Array, found: Array, same: float) -> Array:
    """The edges and the times `found` between them, sorted; times whose difference relative to their size is at most `same` count
    as one. First and last edge stay."""
    inside = found[(found > edges[0]) & (found < edges[-1])]
    if len(edges) + len(inside) > MOST:
        raise TooManyError(f"conditions or tables in the input change more than {MOST} times between {edges[0]:g} and "
                           f"{edges[-1]:g} s: shorten the run, or give the mean of the input")
    return distinct(np.concatenate([edges, inside]), same)


def distinct(times: Array, same: float = SAME) -> Array:
    """Times (k,) sorted; those whose difference relative to their size is at most `same` count as one, because no step is that
    short. The first and the last time stay."""
    both = np.sort(times)
    if len(both) < 2:
        return np.asarray(both)
    near = same * _sizes(both)
    keep = np.concatenate([[True], np.diff(both) > near[1:]])
    keep[1:-1] &= both[-1] - both[1:-1] > near[1:-1]
    keep[-1] = both[-1] > both[0]
    return np.asarray(both[keep])


def _zeros(u: Expr, edges: Array) -> Array:
    """Times at which u, smooth between the edges, may change its sign."""
    a = _slope(u)
    if a.is_number and not switches(u):
        return np.array([float(-u.subs({TIME: 0}) / a)]) if float(a) else np.zeros(0)
    return _isolated(u, edges)


def _slope(u: Expr) -> Expr:
    """Time derivative of an argument of conditions or floors, which may contain tables."""
    return rate(sided(u)) if split((sided(u),)).readings else se.diff(u, TIME)


def _integers(u: Expr, edges: Array) -> Array:
    """Times at which u, smooth between the edges, passes an integer."""
    (low, high), = Enclosure(sided(u))(edges[:-1], edges[1:], (edges[1:] + edges[:-1]) / 2)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise TooManyError(f"{u}, of which the input takes the floor, may be infinite between {edges[0]:g} and {edges[-1]:g} s: "
                           f"give an input that stays finite")
    if np.max(high) - np.min(low) > MOST:
        raise TooManyError(f"floor({u}) in the input jumps more than {MOST} times between {edges[0]:g} and {edges[-1]:g} s: "
                           f"shorten the run, or give the mean of the input")
    levels = np.arange(np.ceil(np.min(low)), np.floor(np.max(high)) + 1)
    slope = _slope(u)
    if slope.is_number and not switches(u):
        a, b = float(slope), float(u.subs({TIME: 0}))
        return (levels - b) / a if a else np.zeros(0)
    return np.concatenate([np.zeros(0), *(_isolated(u - se.Integer(int(n)), edges) for n in levels)])


def _isolated(u: Expr, edges: Array) -> Array:
    """Zeros of u between the edges: intervals are halved until u has no zero in them or is monotone."""
    inside = sided(u)
    both = Enclosure(inside, _slope(inside))
    low, high = edges[:-1], edges[1:]
    side = (low + high) / 2
    found, brackets = [], []
    early = EARLY * max(abs(edges[0]), abs(edges[-1]))
    for _ in range(LEVELS):
        (below, above), (slow, fast) = both(low, high, side)
        near = (below <= 0) & (above >= 0) & ~((below == 0) & (above == 0))
        low, high, side, slow, fast = (x[near] for x in (low, high, side, slow, fast))
        one_way = (slow > 0) | (fast < 0)
        brackets.append((low[one_way], high[one_way], side[one_way]))
        low, high, side = low[~one_way], high[~one_way], side[~one_way]
        thin = high - low <= TWINS * np.maximum(np.maximum(np.abs(low), np.abs(high)), early)
        found.append(low[thin])
        low, high, side = low[~thin], high[~thin], side[~thin]
        if not len(low):
            break
        if len(low) > MOST:
            raise TooManyError(f"a condition or floor in the input changes where {u} is 0, more than {MOST} times between "
                               f"{edges[0]:g} and {edges[-1]:g} s: shorten the run, or give the mean of the input")
        low, high, side = halves(low, high, side)
    a, b, side = (np.concatenate(parts) for parts in zip(*brackets, strict=True))
    return np.concatenate([*found, _bisected(Enclosure(inside), a, b, side)])


def _bisected(u: Enclosure, a: Array, b: Array, side: Array) -> Array:
    """The zeros in intervals in which u is monotone; intervals without a zero are left out."""
    (first,), (last,) = u.at(a, side), u.at(b, side)
    crossing = (first <= 0) != (last <= 0)
    a, b, side, rising = a[crossing], b[crossing], side[crossing], (last > 0)[crossing]
    for _ in range(LEVELS):
        middle = (a + b) / 2
        above = (u.at(middle, side)[0] > 0) == rising
        a, b = np.where(above, a, middle), np.where(above, middle, b)
    return b


def jump(e: Expr, t: float, before: float, after: float) -> float:
    """Jump of an expression (see `timed.sided`) at t, between two intervals that contain the times `before` and `after`."""
    return float(jumps(e, np.array([t]), np.array([before]), np.array([after]))[0])


def jumps(e: Expr, t: Array, before: Array, after: Array) -> Array:
    """Jumps (k,) of an expression at times (k,), between intervals that contain the times `before` and `after` (k,)."""
    found = Enclosure(e)
    return np.asarray(found.at(t, after)[0] - found.at(t, before)[0])


def beyond(e: Expr, t0: float, t1: float) -> str:
    """Message that an expression reads a table with outside="error" before its first point or after its last, "" where not."""
    for table, low, high in tables_read(e, t0, t1):
        if table.outside == "error" and not (table.t[0] - table.near <= low and high <= table.t[-1] + table.near):
            return (f"the table goes from {table.t[0]:g} to {table.t[-1]:g} s, and the run reads it from {low:g} to {high:g} s: "
                    f"give a longer table, outside=\"hold\" or \"periodic\", or a run that stays within its times")
    return ""


# -- pulses: inputs that change during one interval alone


SAMPLES = 20001  #: number of times at which inputs are sampled to find pulses, evenly spaced over the run
CONSTANT = 1e-12  #: change of an input that counts as none, relative to its largest change
BISECTIONS = 60
PARTS = 8  #: number of parts of a pulse: a reference run restarts at each, so that it does not step over a smooth pulse


@dataclass(frozen=True)
class Pulse:
    """Inputs that change only between the times `begin` and `begin + width` (s); strength: their largest difference from their
    value before the pulse, in their own unit."""

    begin: float
    width: float
    strength: float

    @property
    def stops(self) -> list[float]:
        """Times at which a reference run restarts, s."""
        return [float(t) for t in self.begin + self.width * np.arange(PARTS + 1) / PARTS]


def pulse_of(inputs: Sequence[Any], t_end: float) -> Pulse | None:
    """The pulse that several expressions of time make together in a run from 0 to t_end (s); None where one of them changes at
    the start or the end of the run, or where none changes."""
    times = np.linspace(0.0, t_end, SAMPLES)
    seen = np.array([values(e, times) for e in inputs])
    departure = np.abs(seen - seen[:, :1])
    small = CONSTANT * np.max(np.ptp(seen, axis=1), initial=0.0)
    if not np.isfinite(seen).all() or small == 0.0:
        return None
    early = np.flatnonzero(np.any(departure > small, axis=0))[0] - 1
    late = np.flatnonzero(np.any(np.abs(seen - seen[:, -1:]) > small, axis=0))[-1]
    if early < 1 or late > SAMPLES - 3:
        return None
    begin = _edge(inputs, seen[:, 0], small, times[early], times[early + 1])
    end = _edge(inputs, seen[:, -1], small, times[late + 1], times[late])
    return Pulse(begin, max(end - begin, 0.0), float(np.max(departure)))


def _edge(inputs: Sequence[Any], rest: Any, small: float, quiet: float, changed: float) -> float:
    """The time (s) at which inputs leave their constant values `rest`, by bisection between a time `quiet` with these values and
    a time `changed` with other ones: for a Piecewise its edge, else where an input differs from `rest` by `small`."""
    at = np.array([quiet])
    small = 0.0 if all(values(e, at)[0] == value for e, value in zip(inputs, rest, strict=True)) else small
    for _ in range(BISECTIONS):
        middle = np.array([(quiet + changed) / 2])
        off = any(abs(values(e, middle)[0] - value) > small for e, value in zip(inputs, rest, strict=True))
        quiet, changed = (quiet, float(middle[0])) if off else (float(middle[0]), changed)
    return (quiet + changed) / 2
