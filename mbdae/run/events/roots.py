"""Zeros of functions of a solution, inside its steps too: by Chebyshev polynomials that reproduce the function to round-off.

In every step a function is represented by a polynomial; where that is not accurate enough the step is halved. Between
neighbouring extremes of a polynomial it is monotonic, so that none of its zeros is missed, however close they are together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from mbdae.system.base import Array

DEGREE = 16
RESOLVED = 1e-13  #: last coefficients of a polynomial over the largest value of the function from which on it is accurate
NOISE = 64 * float(np.finfo(float).eps)  #: round-off of a function over its largest terms
LEVELS = 42  #: halvings of a step at most: a kink or jump inside is then located to round-off
SAME = 1e-10  #: of the run: zeros nearer than this are one, a touched zero that round-off has split
NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
FIT = np.linalg.inv(chebyshev.chebvander(NODES, DEGREE))


class Root(NamedTuple):
    """A zero: its time (s), and the sign of the function before and after it (0: at the start, or at the end); equal signs: it is
    touched, or approached to within the tolerance for that."""

    time: float
    before: int
    after: int


class _Pieces(NamedTuple):
    """Intervals (m,) with the coefficients (m, DEGREE + 1) of the polynomials on them."""

    low: Array
    high: Array
    c: Array


def roots(function: Callable[[Array], Array], edges: Array, touch: float = 0.0, merge: bool = True) -> list[Root]:
    """Zeros of a function, (k,) at times (k,), between edges (n+1,): breaks and ends of steps, where it may jump. touch: extremes
    nearer to 0 than this, over the largest value of the function, count as touching it; merge: whether zeros between which it
    stays so near are one."""
    pieces = _resolved(function, edges)
    size = float(np.max(np.abs(pieces.c).sum(axis=1), initial=0.0))
    if size == 0:
        return []
    small = NOISE * size
    near = max(small, touch * size)
    found = _inside(pieces, small, near) + _at_edges(pieces, small, near)
    return _merged(sorted(found), function, SAME * float(edges[-1] - edges[0]), near if merge else small)


def _resolved(function: Callable[[Array], Array], edges: Array) -> _Pieces:
    """Polynomials that reproduce the function, in the order of time."""
    low, high, done, size = edges[:-1], edges[1:], list[_Pieces](), 0.0
    for level in range(LEVELS + 1):
        middle, half = (low + high) / 2, (high - low) / 2
        values = function((middle[:, None] + half[:, None] * NODES).ravel()).reshape(len(low), -1)
        c = values @ FIT.T
        size = max(size, float(np.max(np.abs(values), initial=0.0)))
        tail = np.max(np.abs(c[:, -3:]), axis=1)
        short = half < 4 * np.spacing(np.maximum(np.abs(low), np.abs(high)))
        good = (tail <= RESOLVED * size) | short | (level == LEVELS)
        done.append(_Pieces(low[good], high[good], c[good]))
        low, high = (np.concatenate(ends) for ends in ((low[~good], middle[~good]), (middle[~good], high[~good])))
        if not len(low):
            break
    joined = _Pieces(*(np.concatenate(parts) for parts in zip(*done, strict=True)))
    order = np.argsort(joined.low)
    return _Pieces(*(part[order] for part in joined))


def _inside(pieces: _Pieces, small: float, near: float) -> list[Root]:
    """Zeros inside the intervals of polynomials that may have some there."""
    may = np.abs(pieces.c[:, 0]) <= np.abs(pieces.c[:, 1:]).sum(axis=1) + near
    found: list[Root] = []
    for i in np.flatnonzero(may):
        found += _of_one(float(pieces.low[i]), float(pieces.high[i]), pieces.c[i], small, near)
    return found


def _of_one(low: float, high: float, c: Array, small: float, near: float) -> list[Root]:
    """Zeros of one polynomial where it changes its sign, and extremes at which it touches 0."""
    kept = c[: int(np.max(np.flatnonzero(np.abs(c) > 1e-17 * np.max(np.abs(c))), initial=0)) + 1]
    x = np.concatenate([[-1.0], _extremes(kept), [1.0]])
    y = chebyshev.chebval(x, kept)
    y[np.abs(y) <= small] = 0.0
    signs = np.sign(y).astype(int)

    def time(at: float) -> float:
        return (low + high) / 2 + at * (high - low) / 2

    found = []
    for k in range(len(x) - 1):
        if signs[k] * signs[k + 1] < 0:
            found.append(Root(time(_bisected(kept, float(x[k]), float(x[k + 1]), signs[k])), int(signs[k]), int(signs[k + 1])))
        if k > 0 and signs[k] == 0:
            found.append(Root(time(float(x[k])), _sign(signs[:k][::-1]), _sign(signs[k + 1 :])))
        elif k > 0 and abs(y[k]) <= near and signs[k - 1] == signs[k] == signs[k + 1]:
            found.append(Root(time(float(x[k])), int(signs[k]), int(signs[k])))
    return found


def _sign(signs: Array) -> int:
    """The first sign that is not 0."""
    return next((int(s) for s in signs if s), 0)


def _extremes(c: Array) -> Array:
    """Places inside (-1, 1) at which the derivative of a polynomial vanishes, or nearly does."""
    d = chebyshev.chebder(c)
    d = d[: int(np.max(np.flatnonzero(np.abs(d) > 1e-15 * np.max(np.abs(d), initial=0.0)), initial=0)) + 1]
    if len(d) < 2:
        return np.zeros(0)
    z = chebyshev.chebroots(d)
    near = np.sort(z.real[np.abs(z.imag) < 1e-4])  # a saddle may have become a complex pair: one place more does no harm
    return np.asarray(near[(near > -1) & (near < 1)])


def _bisected(c: Array, a: float, b: float, sign: int) -> float:
    """The zero between two places with different signs, that of the first one given."""
    for _ in range(60):
        middle = (a + b) / 2
        if not a < middle < b:
            break
        if sign * chebyshev.chebval(middle, c) > 0:
            a = middle
        else:
            b = middle
    return (a + b) / 2


def _at_edges(pieces: _Pieces, small: float, near: float) -> list[Root]:
    """Zeros at the ends of the run, and where two intervals meet: touched, crossed within round-off, or jumped over."""
    ends = [np.asarray(chebyshev.chebval(x, pieces.c.T)) for x in (-1.0, 1.0)]
    first, last = (np.where(np.abs(y) <= small, 0.0, y) for y in ends)
    found = [Root(float(pieces.low[0]), 0, _after(pieces, 0, small))] if first[0] == 0 else []
    found += [Root(float(pieces.high[-1]), _before(pieces, len(pieces.low) - 1, small), 0)] if last[-1] == 0 else []
    met = (last[:-1] == 0) | (first[1:] == 0) | (np.sign(last[:-1]) != np.sign(first[1:]))
    for i in np.flatnonzero(met | (np.minimum(np.abs(last[:-1]), np.abs(first[1:])) <= near)):
        n = int(i)
        if met[n] or _turns(pieces, n):
            found.append(Root(float(pieces.high[n]), _before(pieces, n, small), _after(pieces, n + 1, small)))
    return found


def _turns(pieces: _Pieces, i: int) -> bool:
    """Whether the size of the function has a minimum where interval i ends."""
    ends = (pieces.c[i], 1.0, pieces.high[i] - pieces.low[i]), (pieces.c[i + 1], -1.0, pieces.high[i + 1] - pieces.low[i + 1])
    falls, rises = (float(chebyshev.chebval(x, chebyshev.chebder(c)) * np.sign(chebyshev.chebval(x, c)) / h) for c, x, h in ends)
    return falls <= 0 <= rises


def _before(pieces: _Pieces, i: int, small: float) -> int:
    """Sign of the function before the end of interval i."""
    return _near(pieces.c[i], 1.0, small)


def _after(pieces: _Pieces, i: int, small: float) -> int:
    """Sign of the function after the begin of interval i."""
    return _near(pieces.c[i], -1.0, small)


def _near(c: Array, end: float, small: float) -> int:
    """Sign of a polynomial just inside an end of its interval, 0 where it vanishes nearly everywhere."""
    y = chebyshev.chebval(end * (1 - np.concatenate([[0.0], np.logspace(-9, 0, 28)])), c)
    return _sign(np.sign(np.where(np.abs(y) <= small, 0.0, y)).astype(int))


def _merged(found: list[Root], function: Callable[[Array], Array], same: float, level: float) -> list[Root]:
    """Zeros of which neighbours are one, in their middle, where the function stays within `level` between them: a zero of higher
    order that round-off, or the error of the run, has split; and where they are nearer than `same` and it changes no sign."""
    if len(found) < 2:
        return found
    times = np.array([root.time for root in found])
    between = times[:-1, None] + np.diff(times)[:, None] * np.linspace(0.1, 0.9, 9)
    flat = np.max(np.abs(function(between.ravel()).reshape(between.shape)), axis=1) <= level
    groups = [[found[0]]]
    for root, one in zip(found[1:], flat, strict=True):
        if one or (root.time - groups[-1][-1].time <= same and groups[-1][-1].after * root.before >= 0):
            groups[-1].append(root)
        else:
            groups.append([root])
    return [Root((group[0].time + group[-1].time) / 2, group[0].before, group[-1].after) for group in groups]
