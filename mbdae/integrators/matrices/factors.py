"""Factorisations of the iteration matrix for real and complex lambda: dense, sparse, and coupled over all stages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, csc_matrix
from scipy.sparse.linalg import splu

from mbdae.integrators.matrices.condensed import CondensedMatrix, plan_of
from mbdae.integrators.matrices.iteration import EntriesMatrix, IterationMatrix, SingularMatrixError, as_csc, inverse_or_one
from mbdae.integrators.matrices.ordering import THRESHOLD, elimination_order
from mbdae.system.base import Array, System


class DenseMatrix(IterationMatrix):
    """LAPACK factorisations."""

    def _scaled(self, h: float) -> tuple[Array, Array]:
        a = np.asfortranarray(self._fy * self.column)
        b = np.asfortranarray(self._fyp * (self.column / h))
        self.row = inverse_or_one((np.abs(a) + np.abs(b)).max(axis=1))
        return a * self.row[:, None], b * self.row[:, None]

    def mass(self, x: Array) -> Array:
        return np.asarray(self._fyp @ x)

    def magnitudes(self, y: Array, yp: Array) -> Array:
        return np.asarray(np.abs(self._fy) @ y + np.abs(self._fyp) @ yp)


class _Ordered:
    """A factorisation of rows and columns in an order that keeps it sparse."""

    def __init__(self, factors: Any, order: NDArray[np.intp]) -> None:
        self.factors, self.order = factors, order

    def solve(self, b: Array) -> Array:
        """Solution in the order of the unknowns."""
        x = np.empty_like(b)
        x[self.order] = self.factors.solve(b[self.order])
        return x


class SparseMatrix(EntriesMatrix):
    """SuperLU factorisations of CSC data in the system's pattern; the order of elimination is found once."""

    def __init__(self, system: System, real: Array, pairs: NDArray[np.complex128]) -> None:
        super().__init__(system, real, pairs, system.sparsity)
        self._sought = False
        self._ordered: tuple[Any, ...] | None = None  #: data, indices and indptr in the order of elimination, and that order

    def _factored(self, matrix: NDArray[Any]) -> Any:
        if not np.isfinite(matrix).all():
            raise SingularMatrixError
        if not self._sought:
            self._seek(as_csc(self.system, matrix))
        try:
            if self._ordered is not None:
                data, indices, indptr, order = self._ordered
                ordered = csc_matrix((matrix[data], indices, indptr), shape=(self.system.n, self.system.n))
                options = {"SymmetricMode": True}
                factors = splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=THRESHOLD, options=options)
                return _Ordered(factors, order)
            return splu(as_csc(self.system, matrix), permc_spec="COLAMD")
        except RuntimeError as error:  # SuperLU reports exactly singular factors this way
            raise SingularMatrixError from error

    def _seek(self, matrix: csc_matrix) -> None:
        """Find the order once: it is most of the time of a factorisation by COLAMD, and a worse one."""
        self._sought = True
        order = elimination_order(matrix, self.system.kinds)
        if order is None:
            return
        numbered = as_csc(self.system, np.arange(1.0, len(matrix.data) + 1))[order][:, order].tocsc()
        numbered.sort_indices()
        self._ordered = numbered.data.astype(np.intp) - 1, numbered.indices, numbered.indptr, order


def coupled_correction(system: System, A_inv: Array, h: float, times: Array, Y: Array, Yp: Array, R: Array) -> Array:
    """Newton correction (s, n) of all stages together, every Jacobian taken at its own stage: exact but dear.

    times (s,), Y, Yp, R (s, n): the present stages and their residual.
    """
    s, n = R.shape
    parts = [system.jacobian_parts(times[i], Y[i], Yp[i]) for i in range(s)]
    blocks = [[A_inv[i, j] / h * fyp + (fy if i == j else 0.0) for j in range(s)] for i, (fy, fyp) in enumerate(parts)]
    column = np.tile(np.asarray(system.scale, dtype=float) * h ** (1.0 - np.asarray(system.index)), s)
    try:
        if system.sparsity is None:
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


def iteration_matrix(system: System, real: Array, pairs: NDArray[np.complex128]) -> IterationMatrix:
    """The condensed one where most unknowns can be condensed, else the dense or the sparse one, as the Jacobian is."""
    plan = plan_of(system)
    if plan is not None:
        return CondensedMatrix(system, real, pairs, plan)
    kind = DenseMatrix if system.sparsity is None else SparseMatrix
    return kind(system, real, pairs)
