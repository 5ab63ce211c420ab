"""Bounds of a table over intervals of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbdae.inputs.tables import Array, Table


def table_range(table: Table, order: int, low: Array, high: Array, side: Array) -> tuple[Array, Array]:
    """Least and largest value (k,) of a table, or of a derivative of it, over intervals [low, high] (k,); side (k,): times inside
    of the intervals or, where low = high is a point of the table, on the side of it to be used."""
    c = table.of_order(order)
    (s, i), (e, j) = table.segments(low, side), table.segments(high, side)
    if np.array_equal(i, j) and not table.period:
        return _of_cubic(c[:, i], s, e)
    turned = ((j < i) | ((i == j) & (e < s))) if table.period else np.zeros(len(i), dtype=bool)
    same = (i == j) & ~turned
    last = _of_cubic(c[:, j], np.where(same, s, 0.0), e)
    first = _of_cubic(c[:, i], s, np.where(same, e, _length(table, i)))
    inner = np.arange(table.first, table.last + 1)
    whole = _of_cubic(c[:, inner], np.zeros(len(inner)), _length(table, inner))
    i, j = i - table.first, j - table.first + len(inner) * turned
    between = [_between(f, np.tile(x, 2), i, j, none)
               for f, x, none in ((np.minimum, whole[0], np.inf), (np.maximum, whole[1], -np.inf))]  # fmt: skip
    least, most = np.minimum.reduce([first[0], last[0], between[0]]), np.maximum.reduce([first[1], last[1], between[1]])
    longer = high - low >= (table.period or np.inf)
    return np.where(longer, whole[0].min(), least), np.where(longer, whole[1].max(), most)


def _length(table: Table, i: NDArray[np.intp]) -> Array:
    """(k,) lengths (s) of segments with numbers i (k,); 0 for the two segments before the first and after the last point."""
    inside = (i > 0) & (i < len(table.t))
    a = np.clip(i, 1, len(table.t) - 1)
    return np.where(inside, table.t[a] - table.t[a - 1], 0.0)


def _of_cubic(c: Array, s: Array, e: Array) -> tuple[Array, Array]:
    """Least and largest value of polynomials c (4, k) between s and e (k,)."""

    def at(x: Array) -> Array:
        return np.asarray(c[0] + x * (c[1] + x * (c[2] + x * c[3])))

    with np.errstate(all="ignore"):
        root = np.sqrt(c[2] ** 2 - 3 * c[3] * c[1])
        q = -(c[2] + np.copysign(root, c[2]))
        turns = [np.clip(np.nan_to_num(x, nan=0.0), np.minimum(s, e), np.maximum(s, e)) for x in (q / (3 * c[3]), c[1] / q)]
    found = [at(x) for x in (s, e, *turns)]
    return np.minimum.reduce(found), np.maximum.reduce(found)


def _between(extreme: np.ufunc, x: Array, i: NDArray[np.intp], j: NDArray[np.intp], none: float) -> Array:
    """(k,) least or largest value (`extreme`) of the entries of x between indices i and j (k,), both excluded; `none` where no
    entry lies between them."""
    found, some = np.full(len(i), none), j - i > 1
    if some.any():
        found[some] = extreme.reduceat(np.append(x, none), np.stack([i[some] + 1, j[some]], axis=1).ravel())[::2]
    return found
