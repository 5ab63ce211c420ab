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
