"""Nested dissection: an order of elimination for mechanisms with many loops, whose factors fill in less than by minimum degree.

Bodies are eliminated before the multipliers of their joints, which leaves the matrix of the joints: two joints that share a body
are neighbours in its graph. A set of joints that divides this graph into two halves is eliminated last, and each half is divided
in the same way (George, Nested dissection of a regular finite element mesh, 1973). All pivots are taken on the diagonal; that of
a multiplier is zero at first and becomes nonzero by the elimination of its bodies.

The order in which unknowns are eliminated from a sparse iteration matrix.

The iteration matrix dF/dy + (lambda/h) dF/dy' of a system, scaled and factorised.

Unknowns of index k are divided by h^-(k-1) times their scale, and every row by its largest entry. Otherwise the condition
number would grow like h^-4 for short steps (index 3), and round-off would stop Newton's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import bmat, connected_components, csc_matrix, csr_matrix, dijkstra, identity, maximum_flow, splu
from mbdae.native import Entries, Index, Order, Searches, by_counts, is_small, largest_pivots, pivoted
from mbdae.native.sparse import Matrix, SingularMatrixError
from mbdae.system.base import Array, Kept, System

MULTIPLIERS = ("lambda", "mu")
#: a separator is sought in the middle of a graph, between the fractions MARGIN and 1 - MARGIN of its weight along a coordinate
MARGIN = 0.35
FEW_GROUPS = 8  #: a graph of at most this number of groups of multipliers is not divided any more


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
    if n <= FEW_GROUPS:
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
    from_u = _distances(graph, int(np.argmax(_distances(graph, 0))))
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


#: kinds of unknowns that are eliminated first, because their own block is easily inverted: that of stresses is their compliance,
#: that of positions follows from q' = H u
FIRST = ("z", "q")
#: FEW: with more unknowns, nested dissection is tried too (see LOOPS), in matrices with stresses the order with the largest
#: pivots is tried last only, since its factors fill in, and in matrices without stresses pivots on the diagonal are not tried;
#: CHEAP: number of multiplications of a factorisation with the largest pivots up to which no other order is compared with that
#: one
FEW, CHEAP = 600, 15_000
#: with more than FEW unknowns, positions are eliminated first only where the inverse of their block has at most COUPLED times as
#: many entries as the whole matrix. (In space that inverse is full: joints couple the positions of all the bodies that they
#: connect.)
COUPLED = 2
#: ratio of the entries of the factors to those of the matrix, above which, with more than FEW unknowns, nested dissection is
#: tried too: measured 1 to 3 for chains, trees and beams, more than 4 for nets of bars
LOOPS = 4
#: smallest pivot, relative to the largest entry of its column, that is accepted on the diagonal or, in a small matrix, in a
#: choice by counts of entries. Fill-in is then a third to a half of that with the largest pivots; in large nets and chains of
#: bodies, where the diagonal of multipliers is zero, 20 to 1000 times as much
LARGE = 0.1
#: smallest pivot, relative to the largest entry of its column, that is accepted where stresses and positions are eliminated
#: first. The pivots of stresses are compliances, which are small in a stiff beam: with a larger bound these pivots are refused,
#: and the factors of the matrix fill in (0.24 s instead of 0.007 s for 1000 elements)
THRESHOLD = 1e-8


def searches(kinds: Sequence[str]) -> Searches:
    """Functions that seek an order of elimination for a matrix with unknowns of `kinds`; each is called where the order of the
    one before loses too many digits:

    1. for a small matrix an order by counts of entries, among the largest pivots (with stresses: those above LARGE), because
       smaller ones lose digits that runs need near singular positions; for a large matrix the cheapest of the order with stresses
       and positions first, the largest pivots and, with many loops, nested dissection;
    2. for a large matrix the cheaper of the first two of these;
    3. pivots above LARGE: on the diagonal (above FEW unknowns only with stresses), in a small matrix by counts;
    4. the largest pivots."""
    share = LARGE if "z" in kinds else 1.0

    def cheapest(entries: Entries, values: NDArray[Any]) -> Order | None:
        if is_small(entries):
            return by_counts(entries, values, share)
        order = cheaper(entries, values)
        if order is None or entries.n <= FEW or order.size <= LOOPS * entries.nnz:
            return order
        other = dissected(kinds, entries)
        return order if other is None or other.work >= order.work else other

    def cheaper_of_large(entries: Entries, values: NDArray[Any]) -> Order | None:
        return cheaper(entries, values) if entries.n > FEW and not is_small(entries) else None

    def cheaper(entries: Entries, values: NDArray[Any]) -> Order | None:
        by_pivots = None if "z" in kinds and entries.n > FEW else largest_pivots(entries, values)
        if by_pivots is not None and by_pivots.work <= CHEAP:
            return by_pivots
        by_kinds = _stresses_first(kinds, entries, values)
        both = [order for order in (by_kinds, by_pivots) if order is not None]
        return min(both, key=lambda order: order.work, default=None)

    def on_diagonal(entries: Entries, values: NDArray[Any]) -> Order | None:
        fits = entries.n <= FEW or "z" in kinds or is_small(entries)
        return _large_pivots(entries, values) if fits else None

    return cheapest, cheaper_of_large, on_diagonal, largest_pivots


def _stresses_first(kinds: Sequence[str], entries: Entries, values: NDArray[Any]) -> Order | None:
    matrix = entries.matrix(values)
    order = elimination_order(matrix, kinds)
    if order is None:
        return None
    ordered = matrix[order][:, order].tocsc()
    return pivoted(entries, ordered, order, permc_spec="NATURAL", diag_pivot_thresh=THRESHOLD, options={"SymmetricMode": True})


def _large_pivots(entries: Entries, values: NDArray[Any]) -> Order | None:
    if is_small(entries):
        return by_counts(entries, values, LARGE)
    return pivoted(entries, entries.matrix(values), np.arange(entries.n), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=LARGE)


def elimination_order(matrix: csc_matrix, kinds: Sequence[str]) -> NDArray[np.intp] | None:
    """Stresses, positions, then all other unknowns in an order of little fill-in. None where there are no positions or no other
    unknowns, where the block of positions is too full, or where a strain is rigid (zero compliance: its stress is a
    multiplier)."""
    z, q = (np.flatnonzero(np.array(kinds) == kind) for kind in FIRST)
    rest = np.flatnonzero(~np.isin(kinds, FIRST))
    if not (len(q) and len(rest)) or not np.all(matrix.diagonal()[z]):
        return None
    pattern = csc_matrix((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)

    def block(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Any:
        return pattern[rows][:, columns]

    closure = _closure(block(q, q), COUPLED * matrix.nnz if matrix.shape[0] > FEW else matrix.shape[0] ** 2)
    if closure is None:
        return None
    by_rest = closure @ block(q, rest)  # pattern of the positions as functions of the other unknowns
    left = block(rest, rest) + block(rest, q) @ by_rest + block(rest, z) @ (block(z, rest) + block(z, q) @ by_rest)
    return np.concatenate([z, q, rest[by_degree(left)]])


def _closure(pattern: Any, most: int) -> Any:
    """Sparsity pattern of the inverse of a matrix that is block-diagonal up to a permutation: every block of the inverse is full.
    None where the inverse has more than `most` entries."""
    count, label = connected_components(pattern, directed=False)
    if int(np.sum(np.bincount(label).astype(np.int64) ** 2)) > most:
        return None
    member = csc_matrix((np.ones(len(label)), (label, np.arange(len(label)))), shape=(count, len(label)))
    return member.T @ member


EARLY = 1e-2  #: an order of elimination is sought for a step of this fraction of the motion's characteristic time


class IterationMatrix(Matrix):
    """The iteration matrix for given real and complex lambda (eigenvalues of A^-1 of a collocation method): `refresh` evaluates
    the Jacobian at a point, `factor` sets the step and factorises."""

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128]) -> None:
        pattern = system.sparsity if system.pattern is None else system.pattern
        entries = Entries.full(system.n) if pattern is None else _entries(system, pattern)
        super().__init__(entries, system.scale, np.asarray(system.index) - 1.0, real, pairs,
                         () if pattern is None else searches(system.kinds))
        self.system = system
        if system.kept is not None and self.orders.searches:
            self.orders.present = self._first_order(system.kept)

    def _first_order(self, kept: Kept) -> Order | None:
        """An order of elimination, found for the matrix at the start and stored in `kept` for all runs of the system, because the
        search takes as long as 100 factorisations. Where its pivots become too small later, another order is sought."""
        if "order" not in kept:
            system = self.system
            self.refresh(system.t0, system.y0, system.yp0)
            try:
                self.factor(EARLY * system.time)
                kept["order"] = self.orders.present
            except SingularMatrixError:
                kept["order"] = None
            self.table.ready = False
        found: Order | None = kept["order"]
        return found

    def refresh(self, t: float, y: Array, yp: Array) -> None:
        """Evaluate dF/dy and dF/dy' at (t, y, y')."""
        values = self.system.jacobian_parts if self.system.pattern is None else self.system.jacobian_values
        self.fy[:], self.fyp[:] = (part.ravel(order="F") for part in values(t, y, yp))


def kept_order(system: System) -> list[NDArray[np.int64]] | None:
    """Rows and columns of the pivots of the order stored with `system`; None where none is stored."""
    order = None if system.kept is None else system.kept.get("order")
    return None if order is None else [order.rows, order.columns]


def keep_order(system: System, pivots: list[NDArray[np.int64]] | None) -> None:
    """Store an order with a system, unless it has one already."""
    pattern = system.sparsity if system.pattern is None else system.pattern
    if pivots is not None and system.kept is not None and "order" not in system.kept:
        system.kept["order"] = Order(_entries(system, pattern), *pivots)


def _entries(system: System, pattern: Any) -> Entries:
    kept = Kept() if system.kept is None else system.kept
    if "entries" not in kept:
        kept["entries"] = Entries(system.n, pattern.indptr, pattern.indices)
    found: Entries = kept["entries"]
    return found


def inverse_or_one(largest: Array) -> Array:
    """1 / largest, and 1 where a row is empty or not finite (the factorisation then reports it)."""
    usable = (largest > 0) & np.isfinite(largest)
    return np.divide(1.0, largest, out=np.ones_like(largest), where=usable)


def as_csc(system: System, data: Array) -> csc_matrix:
    """The sparse matrix (n, n) with `data` (nnz,), the entries of a Jacobian, in the sparsity pattern of the system."""
    return csc_matrix((data, system.sparsity.indices, system.sparsity.indptr), shape=(system.n, system.n))


def coupled_correction(system: System, A_inv: Array, h: float, times: Array, Y: Array, Yp: Array, R: Array) -> Array:
    """Newton correction (s, n) of all s stages of a step of h, by one system of s n equations with the Jacobian of every stage:
    without the approximation by one Jacobian, but expensive.

    times (s,), Y, Yp, R (s, n): times, y, y' and residual of the stages; A_inv (s, s): inverse of the Runge-Kutta matrix.
    """
    s, n = R.shape
    parts = [system.jacobian_parts(times[i], Y[i], Yp[i]) for i in range(s)]
    blocks = [[A_inv[i, j] / h * fyp + (fy if i == j else 0.0) for j in range(s)] for i, (fy, fyp) in enumerate(parts)]
    column = np.tile(np.asarray(system.scale, dtype=float) * h ** (1.0 - np.asarray(system.index)), s)
    try:
        if not system.sparse:
            matrix = np.block(blocks) * column
            row = inverse_or_one(np.abs(matrix).max(axis=1))
            x = np.linalg.solve(matrix * row[:, None], R.ravel() * row)
        else:
            sparse = bmat([[as_csc(system, data) for data in line] for line in blocks], format="csc")
            sparse.data *= column[np.repeat(np.arange(s * n), np.diff(sparse.indptr))]
            row = inverse_or_one(abs(sparse).max(axis=1).toarray().ravel())
            sparse.data *= row[sparse.indices]
            x = splu(sparse, permc_spec="COLAMD").solve(R.ravel() * row)
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise SingularMatrixError from error
    return np.asarray(-(x * column).reshape(s, n))
