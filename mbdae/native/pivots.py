"""Search for pivots: elimination orders chosen by the present values of a matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import csc_matrix, splu
from mbdae.native.elimination import Entries, Order, address, whole
from mbdae.native.equations import Pointer, Whole
from mbdae.native.library import declared

functions = declared(("lu_choose", Whole, (Whole, Whole, *[Pointer] * 6)))


def largest_pivots(entries: Entries, values: NDArray[Any]) -> Order | None:
    """The order with the largest pivots of the present values."""
    return pivoted(entries, entries.matrix(values), np.arange(entries.n), permc_spec="COLAMD")


def pivoted(entries: Entries, ordered: csc_matrix, order: NDArray[Any], **options: Any) -> Order | None:
    """The order with the pivots that SuperLU chooses in a matrix whose rows and columns were permuted by `order` (n,); None
    where SuperLU finds it singular."""
    try:
        factors = splu(ordered, **options)
    except RuntimeError:
        return None
    return Order(entries, order[np.argsort(factors.perm_r)], order[np.argsort(factors.perm_c)])


def by_counts(entries: Entries, values: NDArray[Any]) -> Order | None:
    """The order whose pivots have the fewest other entries in their rows and columns (Markowitz), of those that are the largest
    in their column: for small matrices, at n^3 comparisons; None where the matrix is singular. Smaller pivots would lose
    digits that runs need near singular positions."""
    n, complex_ = entries.n, values.dtype.kind == "c"
    d, at = np.zeros((n, n), complex if complex_ else float), np.zeros((n, n), dtype=np.int8)
    d[entries.row_of, entries.column_of], at[entries.row_of, entries.column_of] = values, 1
    rows, columns, count, top = whole(np.arange(n)), whole(np.arange(n)), np.zeros(2 * n, dtype=np.int64), np.zeros(n)
    found = functions().lu_choose(n, complex_, address(d), address(at), *map(address, (rows, columns, count, top)))
    return Order(entries, rows, columns) if found == n else None
