"""Orders of elimination for sparse LU factors, chosen by the present values of a matrix, so that its pivots are large enough."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import csc_matrix, splu
from mbdae.errors import internal
from mbdae.native.elimination import Entries, Order, address, whole
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.library import declared

functions = declared(("lu_choose", Whole, (Whole, Whole, Number, *[Pointer] * 8)))


#: `largest_pivots` calls `by_counts` for up to MANY unknowns if the product of the numbers of unknowns and entries is up to MOST,
#: else SuperLU. `by_counts` takes 8 ms and 9 MB for 780 unknowns with 9000 entries; its memory grows with the square of the
#: number of unknowns
MANY, MOST = 1000, 20_000_000


def is_small(entries: Entries) -> bool:
    """Whether a matrix is small enough for `by_counts`. SuperLU suits any size, but importing SciPy for it takes 0.15 s."""
    return entries.n <= MANY and entries.n * entries.nnz <= MOST


def largest_pivots(entries: Entries, values: NDArray[Any]) -> Order | None:
    """The order in which every pivot is the largest entry of its column for the present values: partial pivoting."""
    if is_small(entries):
        return by_counts(entries, values)
    return pivoted(entries, entries.matrix(values), np.arange(entries.n), permc_spec="COLAMD")


def pivoted(entries: Entries, ordered: csc_matrix, order: NDArray[Any], **options: Any) -> Order | None:
    """The order with the pivots that SuperLU chooses in a matrix whose rows and columns were permuted by `order` (n,); None
    where SuperLU finds it singular."""
    try:
        factors = splu(ordered, **options)
    except RuntimeError:
        return None
    return Order(entries, order[np.argsort(factors.perm_r)], order[np.argsort(factors.perm_c)])


def by_counts(entries: Entries, values: NDArray[Any], share: float = 1.0) -> Order | None:
    """The order by Markowitz counts: in every step the pivot is the entry with the fewest other entries in its row and column,
    among those of at least `share` times the largest magnitude in their column. It needs memory for n^2 numbers; None where the
    matrix is singular."""
    n, complex_ = entries.n, values.dtype.kind == "c"
    if n > MANY:
        raise internal(f"the order of elimination of a matrix of {n} unknowns was to be found by a search that takes {MANY} "
                       "unknowns at most")  # fmt: skip
    d, at = np.zeros((n, n), complex if complex_ else float), np.zeros((n, n), dtype=np.int8)
    d[entries.row_of, entries.column_of], at[entries.row_of, entries.column_of] = values, 1
    rows, columns, top, lists = whole(np.arange(n)), whole(np.arange(n)), np.zeros(n), np.empty((2, n, n), dtype=np.int16)
    count, place = np.zeros((2, 2 * n), dtype=np.int64)
    found = functions().lu_choose(n, complex_, share, address(d), address(at),
                                  *(address(array) for array in (rows, columns, count, place, lists, top)))  # fmt: skip
    return Order(entries, rows, columns) if found == n else None
