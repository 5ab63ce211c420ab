"""What Newton's method asks of a factorised iteration matrix dF/dy + (lambda/h) dF/dy', whatever the factors are.

Unknowns of index k enter divided by h^-(k-1) times their scale, rows are equilibrated: without it the condition
number grows like h^-4 (index 3) and the Newton iteration stops on round-off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from mbdae.system.base import Array, System


class SingularMatrixError(Exception):
    """An iteration matrix could not be factorised; `unknown` is the column at fault, or -1."""

    def __init__(self, unknown: int = -1) -> None:
        super().__init__("iteration matrix is singular or not finite")
        self.unknown = unknown


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
        self.real_factors = [self._factor_real(a + value * b) for value in self.real]
        self.pair_factors = [self._factor_pair(a + value * b) for value in self.pairs]

    @abstractmethod
    def _scaled(self, h: float) -> tuple[Array, Array]:
        """Set `row` and return dF/dy and dF/dy' / h, both scaled."""

    @abstractmethod
    def _factor_real(self, matrix: Array) -> Any: ...

    @abstractmethod
    def _factor_pair(self, matrix: Array) -> Any: ...

    @abstractmethod
    def solve_real(self, j: int, b: Array) -> Array:
        """Solution (n,) for the j-th real lambda; b may be overwritten."""

    @abstractmethod
    def solve_pair(self, j: int, b: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Solution (n,) for the j-th complex lambda; b may be overwritten."""

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


def inverse_or_one(largest: Array) -> Array:
    """1 / largest, and 1 where a row is empty or not finite (the factorisation then reports it)."""
    usable = (largest > 0) & np.isfinite(largest)
    return np.divide(1.0, largest, out=np.ones_like(largest), where=usable)


def as_csc(system: System, data: Array) -> csc_matrix:
    """Jacobian data of a sparse system as a matrix (n, n)."""
    return csc_matrix((data, system.sparsity.indices, system.sparsity.indptr), shape=(system.n, system.n))
