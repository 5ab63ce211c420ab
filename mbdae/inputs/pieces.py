"""At which points of a table a step has to end, and how long steps may be in between: most points of a measured table matter less
than the accuracy.

Neighbouring segments are joined as long as one polynomial of degree DEGREE follows all of them within a tolerance, a share of the
range of the table in the run. Within joined segments the table is this polynomial and a remainder of at most the tolerance, which
acts like a load of that size. Its error is in proportion to the accuracy asked for, and the comparison with the companion run,
which has a lower accuracy, includes it like every other error. A step ends at a point between two joined pieces where no such
polynomial fits across it; elsewhere the point only limits the steps. Where the value in use jumps, accelerations and reactions
jump too, and the integration restarts; at a kink a step ends and the integration continues.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.inputs.tables import Array, Table

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
