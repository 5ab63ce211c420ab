"""What Newton's method asks of a factorised iteration matrix dF/dy + (lambda/h) dF/dy', whatever the factors are.

Unknowns of index k enter divided by h^-(k-1) times their scale, rows are equilibrated: without it the condition
number grows like h^-4 (index 3) and the Newton iteration stops on round-off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs, zgetrf, zgetrs
from scipy.sparse import csc_matrix

from mbdae.system.base import Array, System


class SingularMatrixError(Exception):
    """An iteration matrix could not be factorised; `unknown` is the column at fault, or -1."""

    def __init__(self, unknown: int = -1) -> None:
        super().__init__("iteration matrix is singular or not finite")
        self.unknown = unknown


class LapackFactors:
    """LU factors of a dense matrix (n, n), real or complex, which may be overwritten."""

    def __init__(self, matrix: NDArray[Any]) -> None:
        factor, self._solve = (zgetrf, zgetrs) if np.iscomplexobj(matrix) else (dgetrf, dgetrs)
        self._lu, self._swaps, info = factor(matrix, overwrite_a=1)
        if info > 0 or not np.isfinite(self._lu[-1, -1]):
            raise SingularMatrixError(info - 1)

    def solve(self, b: NDArray[Any]) -> Any:
        """Solution (n,); b may be overwritten."""
        return self._solve(self._lu, self._swaps, b, overwrite_b=1)[0]


class IterationMatrix(ABC):
    """dF/dy and dF/dy' at one point, and the factors for one step size.

    `refresh` sets the point, `factor` the step; then `solve_real(j, b)` and `solve_pair(j, b)` solve with the
    j-th real or complex lambda for a right-hand side b (n,) already multiplied by `row`, in scaled unknowns:
    multiply the result by `column`.
    """

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128]) -> None:
        self.system, self.real, self.pairs = system, real, pairs
        self.scale = np.asarray(system.scale, dtype=float)
        self.order = np.asarray(system.index) - 1.0
        self.column = self.scale.copy()
        self.row = np.ones(system.n)
        self.real_factors: list[Any] = []
        self.pair_factors: list[Any] = []
        self._fy: Array = np.empty(0)
        self._fyp: Array = np.empty(0)

    def refresh(self, t: float, y: Array, yp: Array) -> None:
        """Evaluate both Jacobian parts."""
        self._fy, self._fyp = self.system.jacobian_parts(t, y, yp)

    def factor(self, h: float) -> None:
        """Scale and factorise for the step h."""
        self.column = self.scale * h**-self.order
        a, b = self._scaled(h)
        self.real_factors = [self._factored(a + value * b) for value in self.real]
        self.pair_factors = [self._factored(a + value * b) for value in self.pairs]

    @abstractmethod
    def _scaled(self, h: float) -> tuple[Array, Array]:
        """Set `row` and return dF/dy and dF/dy' / h, both scaled."""

    def _factored(self, matrix: NDArray[Any]) -> Any:
        """Factors of what `_scaled` returns the parts of, real or complex, with a method `solve`."""
        return LapackFactors(matrix)

    def solve_real(self, j: int, b: Array) -> Array:
        """Solution (n,) for the j-th real lambda; b may be overwritten."""
        return np.asarray(self.real_factors[j].solve(b))

    def solve_pair(self, j: int, b: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Solution (n,) for the j-th complex lambda; b may be overwritten."""
        return np.asarray(self.pair_factors[j].solve(b))

    @abstractmethod
    def mass(self, x: Array) -> Array:
        """dF/dy' x, shape (n,)."""

    @abstractmethod
    def magnitudes(self, y: Array, yp: Array) -> Array:
        """|dF/dy| |y| + |dF/dy'| |y'|, shape (n,): the terms each row cancels."""

    def noise(self, y: Array, yp: Array) -> Array:
        """|increment| (n,) that round-off of the residual alone produces at (y, y')."""
        rhs = np.finfo(float).eps * self.magnitudes(np.abs(y), np.abs(yp)) * self.row
        alternating = rhs * np.where(np.arange(len(rhs)) % 2, -1.0, 1.0)
        found = [np.abs(self._solve_first(b)) for b in (rhs, alternating)]
        return np.asarray(np.maximum(*found) * self.column)

    def _solve_first(self, b: Array) -> Array:
        if self.real_factors:
            return self.solve_real(0, b)
        if not self.pair_factors:  # never factorised: nothing is known
            return np.zeros_like(b)
        return np.asarray(self.solve_pair(0, b.astype(complex)))


class EntriesMatrix(IterationMatrix):
    """Jacobian parts as the data of a CSC pattern."""

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128], pattern: Any) -> None:
        super().__init__(system, real, pairs)
        self._indices = pattern.indices.astype(np.intp)
        self._columns = np.repeat(np.arange(system.n), np.diff(pattern.indptr))

    def _scaled(self, h: float) -> tuple[Array, Array]:
        column = self.column.take(self._columns)
        a, b = self._fy * column, self._fyp * (column / h)
        largest = np.zeros(self.system.n)
        np.maximum.at(largest, self._indices, np.abs(a) + np.abs(b))
        self.row = inverse_or_one(largest)
        row = self.row.take(self._indices)
        return a * row, b * row

    def _sums(self, terms: Array) -> Array:
        """Sums (n,) of the entries' terms in each row."""
        return np.asarray(np.bincount(self._indices, terms, self.system.n), dtype=float)

    def mass(self, x: Array) -> Array:
        return self._sums(self._fyp * x.take(self._columns))

    def magnitudes(self, y: Array, yp: Array) -> Array:
        return self._sums(np.abs(self._fy) * y.take(self._columns) + np.abs(self._fyp) * yp.take(self._columns))


def inverse_or_one(largest: Array) -> Array:
    """1 / largest, and 1 where a row is empty or not finite (the factorisation then reports it)."""
    usable = (largest > 0) & np.isfinite(largest)
    return np.divide(1.0, largest, out=np.ones_like(largest), where=usable)


def as_csc(system: System, data: Array) -> csc_matrix:
    """Jacobian data of a sparse system as a matrix (n, n)."""
    return csc_matrix((data, system.sparsity.indices, system.sparsity.indptr), shape=(system.n, system.n))
