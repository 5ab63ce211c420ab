"""Where a table has to be landed on, and how long steps may be between: tables have many points, most without significance.

Neighbouring segments are joined as long as one polynomial of degree DEGREE follows all of them within a tolerance, a share of the
range of the table in the run. A step that stays within the joined segments sees the polynomial and a rest of at most the
tolerance, which acts like a load of that size: an error in proportion to the accuracy at which the run aims, and the companion
run, which aims at a lower one, shows it like every other. A point between two joined pieces is landed on where no such polynomial
goes across it; elsewhere it only bounds the steps. Where the value in use jumps there, accelerations and reactions do too, and
the run begins anew; at a kink a step ends and the next one goes on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.inputs.tables import Array, Table

Index = NDArray[np.intp]

DEGREE = 7
PARTS = 4  #: stretches of a joined piece, at most one a segment: a step is to see a polynomial of DEGREE several times
SAMPLES = np.array([0.0, 1 / 3, 2 / 3, 1.0])  #: inside a segment, which is a cubic
SOME = 16  #: segments of a block that are looked at first
LARGE = 256  #: segments of a block whose deviation is kept
FINEST = 1e-11  #: smallest tolerance, of rounding
_NODES = (1 - np.cos((2 * np.arange(DEGREE + 1) + 1) * np.pi / (2 * DEGREE + 2))) / 2
_FROM_NODES = np.linalg.inv(np.vander(2 * _NODES - 1, increasing=True))


class Pieces(NamedTuple):
    """jumps (k,): times to be landed on at which values jump; kinks (l,): those at which they do not; edges (m,): of stretches
    that bound the steps, without start and end."""

    jumps: Array
    kinks: Array
    edges: Array


class _Samples:
    """A table over a run: its segments between `at` (n+1,), each at SAMPLES (n, 4)."""

    def __init__(self, table: Table, order: int, x0: float, x1: float) -> None:
        self.table, self.order = table, order
        self.at = np.concatenate([[x0], table.points(x0, x1), [x1]])
        a, b = self.at[:-1, None], self.at[1:, None]
        self.x = a + (b - a) * SAMPLES
        side = np.broadcast_to((a + b) / 2, self.x.shape)
        self.values = table.lookup(self.x.ravel(), side.ravel(), order).reshape(self.x.shape)
        self.range = float(np.max(self.values) - np.min(self.values))
        self.whole: dict[tuple[int, int], float] = {}  #: deviations of large blocks by level and first segment

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
    """Of a table, or of a derivative of it, between x0 and x1."""
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
    return Pieces(s.at[landed[jumps]], s.at[landed[~jumps]], np.unique(np.concatenate([s.at[inner], between])))


def _across(s: _Samples, point: Index, width: Array, most: int) -> Array:
    """(k,) deviation in windows about points (k,), numbers in `at`, of half widths (k,); on each side `most` segments are looked
    at, that beside the point among them."""
    low, high = s.at[point] - width, s.at[point] + width
    first = np.searchsorted(s.at, low, side="right") - 1
    last = np.searchsorted(s.at, high, side="left") - 1
    left, right = (point - 1 - first)[:, None], (last - point)[:, None]
    shares = np.arange(most) / max(most - 1, 1)
    chosen = np.hstack([point[:, None] - 1 - (left * shares).astype(np.intp), point[:, None] + (right * shares).astype(np.intp)])
    return s.deviation(low, high, chosen)


def _joined(s: _Samples, allowed: float) -> Index:
    """Numbers in `at` (m,) of the ends of joined segments: blocks of 2^k of them, divided until a polynomial follows each."""
    n = len(s.at) - 1
    level, begin, done = (n - 1).bit_length(), np.zeros(1, dtype=np.intp), [np.array([0, n], dtype=np.intp)]
    while level and len(begin):
        end, good = np.minimum(begin + 2**level, n), np.ones(len(begin), dtype=bool)
        for count in sorted({min(SOME, 2**level), 2**level}):  # a few samples refuse most of the large ones
            good[good] = _of_blocks(s, level, begin[good], end[good], count) <= allowed
        done += [begin[good], end[good]]
        level, begin = level - 1, begin[~good]
        begin = np.sort(np.concatenate([begin, begin + 2**level]))
        begin = begin[begin < n]
    return np.unique(np.concatenate([*done, begin, np.minimum(begin + 1, n)]))


def _of_blocks(s: _Samples, level: int, begin: Index, end: Index, count: int) -> Array:
    """(k,) deviations over blocks of segments, by `count` of these; of large blocks they are kept for other tolerances."""
    keys = [(level, int(i)) for i in begin] if count >= LARGE else []
    if keys and all(key in s.whole for key in keys):
        return np.array([s.whole[key] for key in keys])
    chosen = begin[:, None] + ((end - begin - 1)[:, None] * (np.arange(count) / (count - 1))).astype(np.intp)
    found = s.deviation(s.at[begin], s.at[end], chosen)
    s.whole |= dict(zip(keys, found.tolist(), strict=True)) if keys else {}
    return found
