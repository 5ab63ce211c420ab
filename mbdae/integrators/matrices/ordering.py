"""The order in which unknowns are eliminated from a sparse iteration matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import connected_components, csc_matrix
from mbdae.integrators.matrices.dissection import by_degree, dissected
from mbdae.native.elimination import Entries, Order
from mbdae.native.pivots import by_counts, is_small, largest_pivots, pivoted
from mbdae.native.sparse import Searches

#: kinds of unknowns whose own block is easily inverted: stresses by their compliance, positions by q' = H u
FIRST = ("z", "q")
#: FEW: unknowns up to which two orders are compared with stresses (largest pivots fill in much); CHEAP: multiplications of
#: a factorisation below which the search ends
FEW, CHEAP = 600, 15_000
#: number of entries of the inverse of the positions' block, over that of a matrix of more than FEW unknowns, above which
#: positions are not eliminated first: in space the positions of all bodies that joints connect are one block
COUPLED = 2
#: entries of the factors, over those of the matrix, above which an order by nested dissection is compared too: chains, trees and
#: beams have 1 to 3, nets of bars more than 4
LOOPS = 4
#: smallest pivot on the diagonal, or chosen by counts, relative to the largest of its column: a third to a half of the fill-in of
#: the largest pivots, but 20 to 1000 times that in large nets and chains of bodies, whose multipliers have no diagonal
LARGE = 0.1
#: smallest pivot on the diagonal, relative to the largest of its column, in the order by kinds: with larger values the factors of
#: a stiff beam fill in, whose compliances are small beside its strains (0.24 s instead of 0.007 s for 1000 elements)
THRESHOLD = 1e-8


def searches(kinds: Sequence[str]) -> Searches:
    """How orders of elimination are sought for a matrix with unknowns of these kinds. Of a small one by counts of entries, with
    the largest pivots where there are no stresses: smaller ones lose digits that runs need near singular positions. Of a large
    one first the cheapest of stresses and positions first, the largest pivots and, with many loops, nested dissection; where that
    loses too many digits, the cheaper of the first two. Then pivots on the diagonal (of more than FEW unknowns only with
    stresses), or by counts, above `LARGE`; then the largest pivots."""
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
    """Stresses, positions, then the rest in an order of little fill-in; None where there is no such block, or where a strain is
    rigid (its stress is then a multiplier)."""
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
    by_rest = closure @ block(q, rest)  # positions in terms of the rest
    left = block(rest, rest) + block(rest, q) @ by_rest + block(rest, z) @ (block(z, rest) + block(z, q) @ by_rest)
    return np.concatenate([z, q, rest[by_degree(left)]])


def _closure(pattern: Any, most: int) -> Any:
    """Sparsity pattern of the inverse of a block-diagonal matrix: full blocks; None where it has more than `most` entries."""
    count, label = connected_components(pattern, directed=False)
    if int(np.sum(np.bincount(label).astype(np.int64) ** 2)) > most:
        return None
    member = csc_matrix((np.ones(len(label)), (label, np.arange(len(label)))), shape=(count, len(label)))
    return member.T @ member
