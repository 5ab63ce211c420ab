"""Nested dissection: an order of elimination for mechanisms with many loops, whose factors fill in less than by minimum degree.

Bodies are eliminated before the multipliers of their joints, which leaves the matrix of the joints: two joints that share a body
are neighbours in its graph. A set of joints that divides this graph into two halves is eliminated last, and each half is divided
in the same way (George, Nested dissection of a regular finite element mesh, 1973). All pivots are taken on the diagonal; that of
a multiplier is zero at first and becomes nonzero by the elimination of its bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import connected_components, csr_matrix, dijkstra, identity, maximum_flow, splu
from mbdae.native.elimination import Entries, Index, Order

MULTIPLIERS = ("lambda", "mu")
#: a separator is sought in the middle of a graph, between the fractions MARGIN and 1 - MARGIN of its weight along a coordinate
MARGIN = 0.35
FEW = 8  #: a graph of at most this number of groups of multipliers is not divided any more


def dissected(kinds: Sequence[str], entries: Entries) -> Order | None:
    """The order of elimination for a matrix (n, n) with unknowns of `kinds`, row i being the equation of unknown i; None for a
    matrix without multipliers."""
    what, n = np.array(kinds), entries.n
    joint = np.isin(what, MULTIPLIERS)
    if not joint.any():
        return None
    row, column = entries.row_of, entries.column_of
    own = (what[row] == "q") & (what[column] == "v")  # q' = H v connects the positions with the velocities of the same body
    _, body = connected_components(_pattern(row[own], column[own], n), directed=False)
    here, there = joint[row] & ~joint[column], joint[column] & ~joint[row]
    touched = _pattern(np.r_[row[here], column[there]], body[np.r_[column[here], row[there]]], n)
    seen: dict[bytes, int] = {}
    group = np.full(n, -1)  # multipliers of the same bodies have the same pattern, so they are eliminated together
    for i in np.flatnonzero(joint):
        group[i] = seen.setdefault(touched.indices[touched.indptr[i] : touched.indptr[i + 1]].tobytes(), len(seen))
    bodies = _pattern(group[joint], np.flatnonzero(joint), n)[: len(seen)] @ touched
    step = np.empty(len(seen))
    step[_divided(bodies @ bodies.T, np.bincount(group[joint]))] = np.arange(len(seen))
    first = np.full(n, -1.0)  # when a body is eliminated: just before the first of its multipliers; -1 (first of all) without any
    by_body = bodies.tocsc()
    filled = np.flatnonzero(np.diff(by_body.indptr))
    first[filled] = np.minimum.reduceat(step[by_body.indices], by_body.indptr[filled])
    when = np.where(joint, step[group], first[body])
    order = np.lexsort((np.arange(n), np.where(joint, 0, body), joint, when))
    return Order(entries, order, order)


def _pattern(row: Any, column: Any, n: int) -> Any:
    found = csr_matrix((np.ones(len(row)), (row, column)), shape=(n, n))
    found.sort_indices()
    return found


def _divided(graph: Any, weight: Index) -> Index:
    """An order of the vertices of a graph (n, n) by nested dissection: both halves, then the vertices that divide them. weight
    (n,): number of multipliers in each vertex."""
    n = len(weight)
    if n <= FEW:
        return np.arange(n)
    count, label = connected_components(graph, directed=False)
    parts = [np.flatnonzero(label == i) for i in range(count)]
    last = parts[0][:0]
    if count == 1:
        found = _separator(graph, weight)
        if found is None:
            return by_degree(graph)
        parts, last = list(found[:2]), found[2]
    return np.concatenate([*(part[_divided(graph[part][:, part], weight[part])] for part in parts), last])


def by_degree(pattern: Any) -> Index:
    """The order (n,) of a symmetric pattern in which an unknown with the fewest neighbours left is eliminated next."""
    n = pattern.shape[0]
    pattern.data[:] = 1.0
    dominant = pattern + identity(n) * (2.0 * n)  # a dominant diagonal, so that SuperLU orders by the sparsity pattern alone
    return np.asarray(np.argsort(splu(dominant.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).perm_c))


def _separator(graph: Any, weight: Index) -> tuple[Index, Index, Index] | None:
    """(vertices on one side, on the other side, vertices that separate them); None where no separator is found. A coordinate
    orders the vertices: the difference of their distances from two far vertices, w and u, or w and v. Along each coordinate the
    lightest separator is found; the one with the smaller ratio of its weight to that of the smaller side is returned."""
    found, least = None, np.inf
    u = int(np.argmax(_distances(graph, 0)))
    from_u = _distances(graph, u)
    from_v = _distances(graph, int(np.argmax(from_u)))
    from_w = _distances(graph, int(np.argmax(np.minimum(from_u, from_v))))
    for coordinate in (from_w - from_u, from_w - from_v):
        along = np.argsort(coordinate, kind="stable")
        share = np.cumsum(weight[along]) / weight.sum()
        low, high = coordinate[along[np.searchsorted(share, [MARGIN, 1 - MARGIN])]]
        parts = _cut(graph, weight, np.flatnonzero(coordinate < low), np.flatnonzero(coordinate > high))
        if parts is None:
            continue
        one, other, between = (weight[part].sum() for part in parts)
        if (ratio := between / min(one, other)) < least:
            found, least = parts, ratio
    return found


def _distances(graph: Any, vertex: int) -> NDArray[np.float64]:
    return np.asarray(dijkstra(graph, directed=False, indices=vertex, unweighted=True))


def _cut(graph: Any, weight: Index, one: Index, other: Index) -> tuple[Index, Index, Index] | None:
    """(vertices on the side of `one`, on the side of `other`, separator), the separator being the lightest set of vertices
    without which no path leads from `one` to `other`; None where one of these is empty, or they are neighbours. By the theorem of
    maximum flow and minimum cut: each vertex has its weight as capacity, and the separator are the vertices at capacity."""
    if not (len(one) and len(other)):
        return None
    n, edges, wide = len(weight), graph.tocoo(), int(weight.sum()) + 1
    enter, leave, source, sink = np.arange(n), np.arange(n, 2 * n), 2 * n, 2 * n + 1
    width = weight.copy()
    width[one] = width[other] = wide
    begin = np.r_[enter, leave[edges.row], np.full(len(one), source), leave[other]]
    end = np.r_[leave, edges.col, one, np.full(len(other), sink)]
    widths = np.r_[width, np.full(len(begin) - n, wide)].astype(np.int32)
    network = csr_matrix((widths, (begin, end)), shape=(2 * n + 2, 2 * n + 2))
    flow = maximum_flow(network, source, sink)
    if flow.flow_value >= wide:
        return None
    left = network - flow.flow
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    reached = np.isfinite(dijkstra(left, indices=source, unweighted=True))
    near, full = reached[leave], reached[enter] & ~reached[leave]
    return np.flatnonzero(near), np.flatnonzero(~near & ~full), np.flatnonzero(full)
