"""Functions of time as polynomials: Chebyshev series on intervals, halved until they reproduce the function to round-off.

Arguments of functions with a characteristic width, such as w in exp(-(x/w)^2) and tanh(x/w), are followed too: none changes by
more than a few widths over an interval, so that no narrow peak is missed between the nodes of a polynomial.

Values of sensors over a run, for conditions. Sensors that loads may read are evaluated as for loads; all others are read from
results.

Times at which vibrations begin in a run: its start, and inputs that excite them by a jump or a change shorter than a mean step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.polynomial import chebyshev

from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.inputs import tables, timed
from mbdae.inputs.breaks import TOLERANCE, distinct, tables_within
from mbdae.inputs.sensed import path_of, symbol
from mbdae.inputs.text import TIME
from mbdae.integrators.solution import Solution
from mbdae.integrators.watched_arguments import LOGARITHMS, TINIEST
from mbdae.results.result import Result
from mbdae.results.sensors import BodySensor, ConnectionSensor, quantities_of
from mbdae.results.stored_parts import started
from mbdae.scene.components import Body, Connection
from mbdae.scene.sensed import drives_of, parsed, placed
from mbdae.scene.sensed import found as sensed
from mbdae.symbolic.rebuild import KINDS, limited, nodes, scales, substituted
from mbdae.symbolic.switches import LOCAL_POWER
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.guards import Observer
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.values import BadValueError

DEGREE = 16
RESOLVED = 1e-13  #: a polynomial is accurate where its last coefficients are below this times the function's largest value
NOISE = 64 * float(np.finfo(float).eps)  #: round-off of a function, relative to the sum of the magnitudes of its terms
LEVELS = 42  #: halvings of a step at most: a kink or jump inside is then located to round-off
#: last coefficients that halving does not reduce are round-off where they are below ROUGH times the largest value of the
#: function; its round-off is then taken as AMPLIFIED times these coefficients
ROUGH, AMPLIFIED = 1e-5, 8.0
MOST = 200_000  #: where more intervals than this would have to be halved at once, none is halved any more
WIDTHS = 2.5  #: an interval is halved where an argument changes by more than this many widths of its function over it
POOR = 1e-3  #: the polynomial of an argument is accurate enough where its last coefficients are below this fraction of its change
NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
FIT = np.linalg.inv(chebyshev.chebvander(NODES, DEGREE))

#: scale of every kind of function, in which its argument is measured in widths of the function; beyond arguments of 19 (tanh) and
#: 745 (exp) values do not change in double precision
_SCALES = {**scales(19.0, 745.0), "decaying": limited(-745.0, 745.0)}


class Pieces(NamedTuple):
    """Intervals of time from `low` to `high` (m,), with the Chebyshev coefficients c (m, DEGREE + 1) of the polynomials on them;
    size: largest sum of the magnitudes of the coefficients; noise: round-off of the function."""

    low: Array
    high: Array
    c: Array
    size: float
    noise: float


class Steep(NamedTuple):
    """Functions with a characteristic width in an expression: their arguments, and scales that turn an argument into a number of
    widths."""

    arguments: tuple[Expr, ...]
    scales: tuple[Callable[[Any], Any], ...]

    def changes(self, c: Array) -> Array:
        """Largest change (m,), in widths, of arguments with coefficients (m, DEGREE + 1, na); infinite where the polynomial of
        an argument is not good enough."""
        middle, reach = c[:, 0], np.abs(c[:, 1:]).sum(axis=1)
        poor = np.abs(c[:, -3:]).max(axis=1) > POOR * reach + NOISE * np.abs(middle)
        found = np.zeros(len(c))
        for i, scale in enumerate(self.scales):
            change = np.abs(scale(middle[:, i] + reach[:, i]) - scale(middle[:, i] - reach[:, i]))
            found = np.fmax(found, np.where(poor[:, i], np.inf, change))
        return found


def steep_functions(e: Expr) -> Steep:
    """The functions with a characteristic width in an expression; its floors and conditions must have been replaced by
    symbols."""
    found = list(dict.fromkeys(pair for node in nodes(e) for pair in _steep(node)))
    scales_of = (_logarithm(weight) if weight else _SCALES[kind] for _, (kind, weight) in found)
    return Steep(tuple(u for u, _ in found), tuple(scales_of))


def _steep(node: Expr) -> Iterator[tuple[Expr, tuple[str, float]]]:
    kind = KINDS.get(type(node).__name__)
    if isinstance(node, se.Pow):
        yield from _of_power(*node.args)
    elif kind is not None and kind != "kink" and node.args[0].free_symbols:
        yield node.args[0], (kind, 1.0 if kind == "power" else 0.0)


def _of_power(base: Expr, exponent: Expr) -> Iterator[tuple[Expr, tuple[str, float]]]:
    if exponent.free_symbols:
        yield exponent * se.log(base), ("decaying", 0.0)
    elif base.free_symbols and float(exponent) >= LOCAL_POWER:
        yield base, ("power", float(exponent))
    elif base.free_symbols and not (float(exponent).is_integer() and float(exponent) > 0):
        yield base, ("power", abs(float(exponent)))


def _logarithm(weight: float) -> Callable[[Any], Any]:
    """The scale of the power |u|^weight: u -> number of its widths, weight ln|u|, with the sign of u and bounded; so an interval
    that contains 0 is many widths long."""
    bounded = limited(*LOGARITHMS)
    return lambda u: np.sign(u) * weight * (bounded(np.log(np.abs(u) + TINIEST)) - LOGARITHMS[0])


def resolved(function: Callable[[Array], Array], edges: Array, steep: Steep | None = None, least: float = 0.0) -> Pieces:
    """Polynomials that reproduce a function between the times `edges` (n+1,), in the order of time. function: times (k,) -> its
    values (k,), or (k, 1 + na) with the arguments of `steep` as further columns; least: the size of the function, to which errors
    are relative, is taken as this at least."""
    low, high, done, size, noise = edges[:-1], edges[1:], list[tuple[Array, ...]](), least, 0.0
    before = np.full(len(low), np.inf)
    for level in range(LEVELS + 1):
        middle, half = (low + high) / 2, (high - low) / 2
        values = function((middle[:, None] + half[:, None] * NODES).ravel()).reshape(len(low), DEGREE + 1, -1)
        known = np.isfinite(values[:, :, 0]).any(axis=1)
        c = np.einsum("kn,mnf->mkf", FIT, values)
        size = max(size, float(np.nanmax(np.abs(values[known, :, 0]), initial=0.0)))
        tail = np.max(np.abs(c[:, -3:, 0]), axis=1)
        smooth = tail <= RESOLVED * size
        stays = _stays(tail, before, size) if level > 2 else np.zeros(len(low), dtype=bool)
        noise = max(noise, AMPLIFIED * float(np.max(tail[stays & ~smooth], initial=0.0)))
        smooth |= stays
        if steep is not None and steep.arguments:
            smooth &= steep.changes(c[:, :, 1:]) <= WIDTHS
        short = half < 4 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
        good = smooth | short | ~known | (level == LEVELS) | (np.count_nonzero(~smooth) > MOST)
        done.append((low[good], high[good], c[good][:, :, 0]))
        low, high = (np.concatenate(ends) for ends in ((low[~good], middle[~good]), (middle[~good], high[~good])))
        before = np.tile(tail[~good], 2)
        if not len(low):
            break
    joined = [np.concatenate(parts) for parts in zip(*done, strict=True)]
    order = np.argsort(joined[0])
    most = max(least, float(np.nanmax(np.abs(joined[2]).sum(axis=1), initial=0.0)))
    return Pieces(joined[0][order], joined[1][order], joined[2][order], most, max(noise, NOISE * most))


def _stays(tail: Array, before: Array, size: float) -> Any:
    """For the 2 n halves of n intervals: whether halving reduced the last coefficients in neither half, so that these are
    round-off. tail (2 n,): largest of the last coefficients of each half; before (2 n,): that of the interval it comes from;
    size: of the function."""
    n = len(tail) // 2
    same = (tail > 0.25 * before) & (tail <= ROUGH * size)
    both = same[:n] & same[n:]
    return np.concatenate([both, both])


MANY = 50_000  #: largest number of times that are evaluated at once


def check(scene: Any, path: str) -> None:
    """Raise BadValueError where a path such as "J.angle" names no quantity of the scene that results have."""
    try:
        sensed(scene, path)
    except BadValueError as refused:
        name, quantity, _ = parsed(path)
        try:
            item = placed(scene, name)[0]
        except SceneError:
            raise refused from None
        of_joints = (*quantities_of(ConnectionSensor), "length", "rate", *drives_of(item)) if isinstance(item, Connection) else ()
        known = quantities_of(BodySensor) if isinstance(item, Body) else of_joints
        if quantity not in known:
            raise (refused if "no sensor" in str(refused) else BadValueError(
                f"there is no sensor '{path}': '{name}' has {', '.join(known) or 'none'}")) from None


def may_be_observed(scene: Any, path: str) -> bool:
    """Whether a load could read the sensor: it does not depend on accelerations and reactions."""
    try:
        sensed(scene, path)
    except BadValueError:
        return False
    return True


def in_sensors(scene: Any, e: Expr) -> Expr:
    """An expression in which the symbols of named signals are replaced by the expressions of these signals, and curves over
    sensors by cases."""
    named = {symbol(one.name): se.sympify(one.value) for one in scene.signals if one.kind == "signal"}
    while e.free_symbols & named.keys():
        e = substituted(e, named)
    return timed.curves_in_cases(e)


class Signals:
    """The time, the sensors and the tables of time that some expressions contain, as `symbols`, and their values over a
    solution."""

    def __init__(self, prepared: Prepared, solution: Solution, expressions: Sequence[Expr]) -> None:
        self._prepared, self.solution = prepared, solution
        read = sorted({s for e in expressions for s in e.free_symbols if path_of(s)}, key=str)
        self._tables = list(dict.fromkeys(node for e in expressions for node in nodes(e) if tables.lookup_of(node)))
        self._observer, self._shown = self._readers(read)
        self.symbols = [TIME, *read, *(se.Symbol(f"table_{n}") for n in range(len(self._tables)))]

    def _readers(self, read: list[Expr]) -> tuple[Any, dict[int, str]]:
        """An observer of the sensors that loads may read; index and path of each other sensor, which is read from results."""
        model, moved = self._prepared.model, self._prepared.all_bodies.moved
        observed, shown = [], dict[int, str]()
        for n, one in enumerate(read):
            if may_be_observed(model.scene, path_of(one)) and not _between_nodes(model, moved, one):
                observed.append(n)
            else:
                shown[n] = path_of(one)
        self._order = [*observed, *shown]
        return Observer(model, moved, [read[n] for n in observed]) if observed else None, shown

    def plain(self, e: Expr) -> Expr:
        """The expression with a symbol in place of every table."""
        return e.subs(dict(zip(self._tables, self.symbols[len(self.symbols) - len(self._tables) :], strict=True)))

    @property
    def edges(self) -> Array:
        """Times (m+1,) between which sensors are smooth: ends of steps, jumps and kinks of tables, and the
        ends of the intervals that limit steps along tables."""
        t = self.solution.t
        found = [part for e in self._tables for part in tables_within(e, float(t[0]), float(t[-1]), TOLERANCE)]
        return distinct(np.concatenate([t, *(times for part in found for times in part)]))

    def __call__(self, t: Array) -> Array:
        """Values of `symbols`, (k, number of symbols), at times (k,)."""
        return np.concatenate([self._some(part) for part in np.array_split(t, max(1, -(-len(t) // MANY)))])

    def _some(self, t: Array) -> Array:
        out = np.empty((len(t), len(self.symbols)))
        out[:, 0] = t
        count = len(self._order)
        values = np.empty((len(t), count))
        observed = count - len(self._shown)
        if self._observer is not None:
            values[:, self._order[:observed]] = self._observer(t, self.solution.interpolant.value(t))
        if self._shown:
            result = Result(self._prepared, self.solution, None, t)  # type: ignore[arg-type]
            for n, path in self._shown.items():
                values[:, n] = result.read(path)
        out[:, 1 : 1 + count] = values
        for n, table in enumerate(self._tables):
            out[:, 1 + count + n] = timed.values(table, t)
        return out


def _between_nodes(model: Any, moved: Any, one: Expr) -> bool:
    """Whether a sensor is at a place between the nodes of a beam, where only results can interpolate its value."""
    try:
        Observer(model, moved, [one])
    except SceneError:
        return True
    return False


def probe(prepared: Prepared, paths: Sequence[str]) -> None:
    """Raise OptionError where a sensor that loads may not read, so that it is read from results, is not a single number at the
    start."""
    paths = [path for path in paths if not may_be_observed(prepared.model.scene, path)]
    result = started(prepared) if paths else None
    for path in paths:
        assert result is not None
        try:
            found = result.read(path)
        except (MbdaeError, AttributeError) as error:
            raise OptionError(f"until, record: '{path}' cannot be read at the start: {error}; name another sensor") from None
        if found.ndim > 1:
            one = f"{path}[{', '.join('0' for _ in found.shape[1:])}]"
            raise OptionError(f"until, record: '{path}' is no single number; say which component, such as '{one}'")


BEGINNINGS = 4  #: largest number of excitations considered besides the start: those that change velocities and accelerations most
#: short changes and breaks of inputs that follow each other within a mean step count as one excitation; one that lasts this many
#: mean steps or longer does not count
LONG = 50.0


def windows(system: System, run: Solution, span: float) -> Iterator[tuple[float, float]]:
    """(begin, end), s, of the parts of a run to be compared, each `span` (s) long, after its start and after its excitations."""
    for a, b in _beginnings(system, run):
        yield a, min(b + span, float(run.t[-1]))


def _beginnings(system: System, run: Solution) -> list[tuple[float, float]]:
    """(begin, end), s, of the start of a run and of its excitations."""
    t0, t1 = float(run.t[0]), float(run.t[-1])
    line = None if system.timeline is None or not t1 > t0 else system.timeline(system.t0, t1)
    if line is None:
        return [(t0, t0)]
    h = (t1 - t0) / max(run.stats.steps, 1)
    edges = line.stretches.edges
    short = np.flatnonzero(np.diff(edges) < h)
    sudden = np.concatenate([line.breaks, line.stretches.kinks])
    found = np.concatenate([np.stack([edges[short], edges[short + 1]], axis=1), np.stack([sudden, sudden], axis=1)])
    found = found[(found[:, 0] > t0) & (found[:, 1] < t1)]
    clusters = _merged(found[np.argsort(found[:, 0], kind="stable")], h)
    clusters = [(a, b) for a, b in clusters if b - a < LONG * h]
    worst = sorted(clusters, key=lambda c: -_change(system, run, c, h))[:BEGINNINGS]
    return [(t0, t0), *sorted(worst)]


def _merged(found: Array, near: float) -> list[tuple[float, float]]:
    """Intervals (k, 2) in order, with those closer to each other than `near` joined."""
    clusters: list[list[float]] = []
    for a, b in found.tolist():
        if clusters and a - clusters[-1][1] < near:
            clusters[-1][1] = max(b, clusters[-1][1])
        else:
            clusters.append([a, b])
    return [(a, b) for a, b in clusters]


def _change(system: System, run: Solution, excitation: tuple[float, float], h: float) -> float:
    """Largest change of a velocity, relative to its scale, during an `excitation` (begin, end), s, plus the changes that the
    jumps of its acceleration and of the slope of that cause within one step h (s)."""
    velocities = np.array([kind == "v" for kind in system.kinds])
    a, b = excitation
    aside = 1e-9 * max(abs(a), abs(b), h)
    times = np.clip([a - h, a - aside, b + aside, b + h], run.t[0], run.t[-1])
    y, yp = run(times), run.derivative(times)
    moved = np.abs(y[2] - y[1]) + h * np.abs(yp[2] - yp[1]) + h * np.abs(yp[3] - yp[2] - yp[1] + yp[0])
    return float(np.max((moved / system.scale)[velocities], initial=0.0))


def beginning_at(system: System, run: Solution, t: float) -> System:
    """The system started at a time t (s) inside a run, with consistent values."""
    if t <= system.t0:
        return system
    system.read_at(t)
    values = system.restarted(t, run(t))
    system.read_at(None)
    other = system.starting(t, *values)
    return other if system.sampled is None else other.sampling(system.sampled.going_on(t, run.t, run.y))
