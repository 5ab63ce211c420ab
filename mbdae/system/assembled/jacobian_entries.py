"""Entries of the Jacobian: places of the values of kernels and of constants; the chain rule for loaded nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels.tree_plan import Piece
from mbdae.system.base import Array

Index = NDArray[np.intp]


class Entries:
    """Collects entries (row, column) of F_y and F_y'.

    Rows: below n rows of F, n: left out, above n rows of loaded nodes. Columns: below n those of F_y, below 2 n those of F_y',
    above that q, u and u' of loaded nodes; -1: left out. An entry of a loaded node is multiplied by derivatives of the tree: its
    row by the derivatives of F by the node's rows, its column by the derivatives of the node's motion by the unknowns."""

    def __init__(self, n: int) -> None:
        self.n = n
        none = np.zeros(0, np.intp)
        self._varying: list[tuple[Index, Index]] = [(none, none)]
        self._fixed: list[tuple[Index, Index, Array]] = [(none, none, np.zeros(0))]
        #: (row, column) of every value of the trees; (n, -1) for a value that is only a factor of products
        self._tree_cells: list[tuple[int, int]] = []
        #: row of a loaded node -> every row of F that it enters, with the number of the tree's value that multiplies it there
        self._left: dict[int, list[tuple[int, int]]] = defaultdict(list)
        #: q, u or u' of a loaded node -> every unknown that it follows from, with the number of that derivative's value
        self._right: dict[int, list[tuple[int, int]]] = defaultdict(list)

    def varying(self, rows: Index, columns: Index) -> None:
        """Add entries whose values a kernel returns, in the order of its outputs."""
        self._varying.append((rows.ravel(), columns.ravel()))

    def constant(self, rows: Index, columns: Index, values: Array) -> None:
        """Add entries with constant values."""
        self._fixed.append((rows.ravel(), columns.ravel(), values.ravel()))

    def chain(self, piece: Piece, trees: int, slot: Callable[[int, tuple[object, ...]], int]) -> None:
        """Add the values of a kernel of equal trees; slot(tree, place): slot of a row, of a state or of an input."""
        for tree in range(trees):
            for target, place in piece.targets:
                factor = len(self._tree_cells)
                row, column = slot(tree, target), slot(tree, place)
                self._tree_cells.append((self.n, -1))
                if target[1] > 0:
                    self._right[row].append((column, factor))
                elif place[0] in ("wu", "wq"):
                    self._left[column - self.n + 1].append((row, factor))
                else:
                    self._tree_cells[-1] = row, column

    def finish(self) -> Pattern:
        """All entries as a finished pattern."""
        n = self.n
        rows, columns = (np.concatenate(parts) for parts in zip(*self._varying, strict=True))
        fixed_rows, fixed_columns, values = (np.concatenate(parts) for parts in zip(*self._fixed, strict=True))
        chained = (fixed_rows > n) | (fixed_columns >= 2 * n)
        all_rows, all_columns = np.r_[rows, fixed_rows[chained]], np.r_[columns, fixed_columns[chained]]
        products = self._products(all_rows, all_columns)
        direct = (rows <= n) & (columns < 2 * n)
        cells = np.array(self._tree_cells, dtype=np.intp).reshape(-1, 2)
        placed = np.array(products, dtype=np.intp).reshape(-1, 5)
        return Pattern(
            n, np.r_[np.where(direct, rows, n), cells[:, 0], placed[:, 0]], np.r_[columns, cells[:, 1], placed[:, 1]],
            placed[:, 2:].T.copy(), values[chained], fixed_rows[~chained], fixed_columns[~chained], values[~chained],
        )  # fmt: skip

    def _products(self, rows: Index, columns: Index) -> list[tuple[int, int, int, int, int]]:
        """(row, column, left factor, value, right factor) of every product; factor 0 is 1, factor f + 1 value f of the trees."""
        found = []
        for v in np.flatnonzero(((rows > self.n) | (columns >= 2 * self.n)) & (rows != self.n) & (columns >= 0)):
            row, column = int(rows[v]), int(columns[v])
            left = [(r, f + 1) for r, f in self._left[row]] if row > self.n else [(row, 0)]
            right = [(c, f + 1) for c, f in self._right[column]] if column >= 2 * self.n else [(column, 0)]
            found += [(r, c, a, int(v), b) for r, a in left for c, b in right]
        return found


class Pattern:
    """Finished entries: rows and columns of values of kernels, values of trees, products, and constants."""

    def __init__(self, n: int, rows: Index, columns: Index, factors: Index, chained: Array, fixed_rows: Index,
                 fixed_columns: Index, fixed: Array) -> None:  # fmt: skip
        self.cells, self.dotted = _cells(n, rows, columns), columns >= n
        self.left, self.value, self.right = factors
        self.chained = chained
        self.fixed_cells, self.fixed_dotted, self.fixed = _cells(n, fixed_rows, fixed_columns), fixed_columns >= n, fixed


def _cells(n: int, rows: Index, columns: Index) -> Index:
    """Number column * n + row of every entry; n * n where it is left out."""
    return np.where((rows >= n) | (columns < 0), n * n, columns % max(n, 1) * n + rows)
