"""Functions of time as polynomials: Chebyshev series on intervals, halved until they reproduce the function to round-off.

Arguments of functions with a characteristic width, such as w in exp(-(x/w)^2) and tanh(x/w), are followed too: none changes by
more than a few widths over an interval, so that no narrow peak is missed between the nodes of a polynomial.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.polynomial import chebyshev

from mbdae.integrators.watched.arguments import LOGARITHMS, TINIEST
from mbdae.symbolic.functions import KINDS, limited, scales
from mbdae.symbolic.rebuild import nodes
from mbdae.symbolic.switches import LOCAL_POWER
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

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
