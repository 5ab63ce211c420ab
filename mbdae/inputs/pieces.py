"""Where a table has to be landed on, and how long steps may be between: tables have many points, most without significance.

Neighbouring segments are joined as long as one polynomial of degree DEGREE follows all of them within a tolerance, a share of the
range of the table in the run. A step that stays within the joined segments sees the polynomial and a rest of at most the
tolerance, whose effect on a velocity over the time T is at most 2 T tolerance: an error in proportion to the run's tolerance,
which the companion run shows like every other. A point between two joined pieces is landed on where no such polynomial goes
across it; elsewhere it only bounds the steps. Where the value in use jumps there, accelerations and reactions do too, and the run
begins anew; at a kink a step ends and the next one goes on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.inputs.tables import Array, Table

Index = NDArray[np.intp]

DEGREE = 7
PARTS = 4  #: stretches of a joined piece, at most one a segment: a step is to see a polynomial of DEGREE several times
SAMPLES = np.array([0.0, 1 / 3, 2 / 3, 1.0])  #: inside a segment, which is a cubic
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

    def deviation(self, low: Array, high: Array, first: Index, last: Index) -> Array:
        """(k,) largest distance, over the samples inside [low, high] (k,) of the segments from `first` to before `last`, from a
        polynomial of DEGREE."""
        nodes = low[:, None] + (high - low)[:, None] * _NODES
        c = self.table.lookup(nodes.ravel(), nodes.ravel(), self.order).reshape(nodes.shape) @ _FROM_NODES.T
        counts = last - first
        begins = np.cumsum(counts) - counts
        window = np.repeat(np.arange(len(low)), counts)
        segment = np.arange(len(window)) - np.repeat(begins - first, counts)
        x, centre = self.x[segment], ((low + high) / 2)[window, None]
        u = (x - centre) * (2 / (high - low))[window, None]
        fitted = np.zeros_like(u)
        for power in reversed(range(DEGREE + 1)):
            fitted = fitted * u + c[window, power, None]
        off = np.where(np.abs(u) <= 1 + 1e-9, np.abs(self.values[segment] - fitted), 0.0)
        return np.asarray(np.maximum.reduceat(off.max(axis=1), begins)) if len(begins) else np.zeros(0)


def pieces(table: Table, order: int, x0: float, x1: float, tolerance: float) -> Pieces:
    """Of a table, or of a derivative of it, between x0 and x1."""
    s = _Samples(table, order, x0, x1)
    if not s.range > 0:
        return Pieces(*np.zeros((3, 0)))
    allowed = max(tolerance, FINEST) * s.range
    ends = _joined(s, allowed)
    inner = ends[1:-1]
    width = np.minimum(s.at[ends[1:-1]] - s.at[ends[:-2]], s.at[ends[2:]] - s.at[ends[1:-1]]) / 2
    landed = inner[_across(s, inner, width) > allowed]
    jumps = np.abs(s.values[landed, 0] - s.values[landed - 1, -1]) > allowed
    parts = np.minimum(np.diff(ends), PARTS)
    shares = np.arange(1, PARTS) / parts[:, None]
    between = (s.at[ends[:-1], None] + (s.at[ends[1:]] - s.at[ends[:-1]])[:, None] * shares)[shares < 1]
    return Pieces(s.at[landed[jumps]], s.at[landed[~jumps]], np.unique(np.concatenate([s.at[inner], between])))


def _across(s: _Samples, point: Index, width: Array) -> Array:
    """(k,) deviation in windows about points (k,), numbers in `at`, of half widths (k,)."""
    low, high = s.at[point] - width, s.at[point] + width
    first = np.searchsorted(s.at, low, side="right") - 1
    last = np.searchsorted(s.at, high, side="left")
    return s.deviation(low, high, first, last)


def _joined(s: _Samples, allowed: float) -> Index:
    """Numbers in `at` (m,) of the ends of joined segments: neighbours are joined in pairs until no pair can be."""
    ends: Index = np.arange(len(s.at), dtype=np.intp)
    changed = np.ones(len(s.at) - 1, dtype=bool)
    while changed.any():
        merged_any = np.zeros(len(ends) - 1, dtype=bool)
        for parity in (0, 1):
            i = np.arange(parity, len(ends) - 2, 2)
            i = i[changed[i] | changed[i + 1] | merged_any[i] | merged_any[i + 1]]
            if not len(i):
                continue
            off = s.deviation(s.at[ends[i]], s.at[ends[i + 2]], ends[i], ends[i + 2])
            gone = i[off <= allowed]
            merged_any[gone] = True
            keep = np.ones(len(ends) - 1, dtype=bool)
            keep[gone + 1] = False
            ends = np.delete(ends, gone + 1)
            changed, merged_any = changed[keep], merged_any[keep]
        changed = merged_any
    return ends
