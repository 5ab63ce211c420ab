"""Sparsity patterns of matrices, and orders of elimination with the pattern of L + U: the Python side of `Order` in sparse.h.

Sizes and indices are checked here, before C uses them; wrong ones raise ValueError.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import csc_matrix, distinct
from mbdae.errors import internal
from mbdae.native.equations import Pointer, Whole
from mbdae.native.library import declared

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class OrderTable(ctypes.Structure):
    """The C struct `Order` of sparse.h, with the same members in the same order."""

    _fields_ = (("n", Whole), *((name, Pointer) for name in ("low", "up", "run", "first", "rows", "columns", "col", "origin",
                                                             "to")))  # fmt: skip


#: function that opens the library and states the types of the function for the fill-in, for ctypes
functions = declared(("lu_fill", Whole, (Whole, Pointer, Pointer, Whole, Pointer, Pointer, Pointer, Pointer)))


def address(array: NDArray[Any]) -> int:
    """Address of the first number of an array."""
    return int(array.ctypes.data)


def whole(what: Any) -> Index:
    """An array of integers as C reads it: contiguous, 64 bits each."""
    return np.ascontiguousarray(what, dtype=np.int64)


class Entries:
    """Sparsity pattern of matrices (n, n) by columns: `indptr` (n + 1,) and row `indices` (nnz,) as in SciPy's csc_matrix."""

    def __init__(self, n: int, indptr: Any, indices: Any) -> None:
        self.n, self.indptr, self.row_of = int(n), whole(indptr), whole(indices)
        self.nnz = len(self.row_of)
        ends = 0, self.nnz
        if self.indptr.shape != (n + 1,) or (self.indptr[0], self.indptr[-1]) != ends or (np.diff(self.indptr) < 0).any():
            raise internal(f"the pattern of a sparse matrix has column pointers of shape {self.indptr.shape} that do not divide "
                           f"its {self.nnz} entries into {n} columns")  # fmt: skip
        if n < 1 or self.row_of.ndim != 1 or not ((self.row_of >= 0) & (self.row_of < n)).all():
            raise internal(f"the pattern of a sparse matrix ({n}, {n}) has no rows, entries in rows outside of it, or no list of "
                           "these rows")
        self.column_of = np.repeat(np.arange(n, dtype=np.int64), np.diff(self.indptr))
        if len(distinct(self.column_of * n + self.row_of)) != self.nnz:
            raise internal("the pattern of a sparse matrix names an entry (row and column) twice")

    @classmethod
    def full(cls, n: int) -> Entries:
        """The pattern of a full matrix (n, n), column by column."""
        return cls(n, np.arange(n + 1) * n, np.tile(np.arange(n), n))

    def matrix(self, values: NDArray[Any]) -> csc_matrix:
        """The matrix (n, n) with this pattern whose entries have the values (nnz,)."""
        return csc_matrix((values, self.row_of, self.indptr), shape=(self.n, self.n))


class Order:
    """An order of elimination: pivot i is in row rows[i] and column columns[i]; with the pattern of L + U for this order.

    work: number of multiplications of a factorisation; size: number of entries of L + U, fill-in included.
    """

    def __init__(self, entries: Entries, rows: Any, columns: Any) -> None:
        n = entries.n
        self.rows, self.columns = whole(rows), whole(columns)
        for order in (self.rows, self.columns):
            if order.shape != (n,) or not np.array_equal(np.sort(order), np.arange(n)):
                raise internal(f"an order of elimination does not name each of the {n} rows or columns of a sparse matrix once")
        row_of, column_of = np.empty((2, n), dtype=np.int64)
        row_of[self.rows] = column_of[self.columns] = np.arange(n)
        i, j = row_of[entries.row_of], column_of[entries.column_of]
        ptr, col, diag = filled(n, i, j)
        self.size = len(col)
        low, up = diag - ptr[:-1], ptr[1:] - diag  # number of entries in every row of L, and of U with its diagonal
        self.low = np.concatenate([[0], np.cumsum(low)])
        self.up = self.size - np.concatenate([[0], np.cumsum(up)])
        row = np.repeat(np.arange(n), low + up)
        place = np.arange(self.size) + np.where(col < row, (self.low[:-1] - ptr[:-1])[row], (self.up[1:] - diag)[row])
        breaks = np.where(np.diff(row * n + col, prepend=-2) != 1, np.arange(self.size), 0)
        self.run = self.up[1:] + np.maximum(np.maximum.reduceat(breaks, ptr[:-1]) - diag, 1)
        self.work = int(up[col[col < row]].sum())
        self.col = np.empty(self.size, dtype=np.int32)
        self.col[place] = col
        by_rows = np.lexsort((j, i))
        self.first = np.searchsorted(i[by_rows], np.arange(n + 1))
        self.origin, self.to = by_rows.astype(np.int32), j[by_rows].astype(np.int32)
        kept = [self.low, self.up, self.run, self.first, self.rows, self.columns, self.col, self.origin, self.to]
        self.table = OrderTable(n, *map(address, kept))


def filled(n: int, i: Index, j: Index) -> tuple[Index, Index, Index]:
    """The pattern of L + U, fill-in included, of a matrix with entries in rows i, columns j: where its rows begin (n + 1,), the
    columns of its entries in ascending order, and where its diagonal entries are (n,)."""
    cells = distinct(np.r_[i * n + j, np.arange(n) * (n + 1)])
    rows, columns = whole(np.searchsorted(cells, np.arange(n + 1) * n)), whole(cells % n)
    ptr, diag, work = np.zeros(n + 1, dtype=np.int64), np.zeros(n, dtype=np.int64), np.zeros(n + 2, dtype=np.int64)
    most, count = 4 * (len(i) + n), -1
    while count < 0:
        most *= 4
        col = np.empty(most, dtype=np.int64)
        count = functions().lu_fill(n, address(rows), address(columns), most, *map(address, (ptr, col, diag, work)))
    return ptr, col[:count].copy(), diag
