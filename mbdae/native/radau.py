"""Newton's iteration for the stages of a collocation step, with starting values and local error: the Python side of radau.c."""

from __future__ import annotations

import ctypes
from math import inf
from typing import Any

import numpy as np

from mbdae.errors import internal
from mbdae.native.elimination import Array, address
from mbdae.native.equations import Equations, Number, Pointer, Whole
from mbdae.native.library import declared
from mbdae.native.sparse import Matrix

#: Newton's iteration in Python also counts as converged where a correction is more than half of the one before and at most this
#: share of the tolerance: round-off keeps it from shrinking. STAGNATION in radau.c has the same value
STAGNATION = 0.03
NAMES = ("c", "A_inv", "T", "T_inv", "V_inv", "end", "e")


class Table(ctypes.Structure):
    """The C struct `Radau` of radau.c, with the same members in the same order."""

    _fields_ = (("equations", Pointer), ("matrix", Pointer), ("s", Whole), ("n", Whole), ("reals", Whole), ("pairs", Whole),
                *((name, Pointer) for name in NAMES), ("gamma0", Number),
                *((name, Pointer) for name in ("Z", "Y", "Yp", "R", "D", "correction", "w", "error", "scaled")),
                ("rate", Number), ("iterations", Whole), ("theta", Number), ("norm", Number), ("estimate", Number),
                ("residuals", Whole))  # fmt: skip


#: function that opens the library and states the types of the functions of radau.c for ctypes
functions = declared(
    ("radau_slopes", None, (Pointer, Number)),
    ("radau_predict", None, (Pointer, Pointer, Number, Number, Pointer)),
    ("radau_noise", Number, (Pointer, Pointer)),
    ("radau_solve", ctypes.c_int, (Pointer, Number, Pointer, Number, Pointer, Number, Whole)),
    ("radau_error", ctypes.c_int, (Pointer, Number, Pointer, Pointer, Number, Pointer, Whole)),
    ("run_predict", None, (Pointer, Number)),
    ("run_factored", None, (Pointer, Number)),
    ("run_solve", ctypes.c_int, (Pointer, Number, Number)),
    ("run_advance", ctypes.c_int, (Pointer, Number, Number)),
    ("run_steps", ctypes.c_int, (Pointer, Number, Number, Whole, Number, Number, Whole, *[Pointer] * 6)),
)


class Stages:
    """Solves F(t0 + c_i h, y0 + Z_i, sum_j A_inv[i, j] Z_j / h) = 0 for the increments Z (s, n) of the s stages.

    Z, Y, Yp, R, correction (s, n): increments y - y0, values y and y', residuals and last correction of the stages; Z holds the
    starting values on entry to `solve`. error, scaled (n,): the last estimate of the local error, absolute and in units of the
    tolerance. coefficients: a `CollocationTable`; matrix: the iteration matrices, whose lambda are the eigenvalues of A_inv
    (further ones may follow); `estimate` needs a real eigenvalue.
    """

    def __init__(self, equations: Equations, coefficients: Any, matrix: Matrix) -> None:
        s, n = len(coefficients.c), matrix.entries.n
        reals, pairs = len(coefficients.real), len(coefficients.pairs)
        kept = {name: np.array(getattr(coefficients, name), dtype=float, order="C") for name in NAMES}
        square = {"A_inv", "T", "T_inv", "V_inv"}
        if any(array.shape != ((s, s) if name in square else (s,)) for name, array in kept.items()) or s < 1:
            raise internal(f"the coefficients of a collocation method of {s} stages need the shape ({s},) or ({s}, {s}): "
                           f"{({name: array.shape for name, array in kept.items()})}")
        if reals + 2 * pairs != s or len(matrix.real) < reals or len(matrix.pairs) != pairs:
            raise internal(f"a collocation method of {s} stages needs {s} eigenvalues, a complex pair counts as two, and a "
                           f"factorised matrix for each: there are {reals} real ones, {pairs} pairs and "
                           f"{len(matrix.factors)} factorised matrices")
        if not (np.array_equal(matrix.real[:reals], coefficients.real) and np.array_equal(matrix.pairs, coefficients.pairs)):
            raise internal("the factorised matrices of a collocation method were made for other eigenvalues than those of its "
                           "coefficients")  # fmt: skip
        if equations.table.n != n or not equations.table.residual:
            raise internal(f"a collocation method was given {equations.table.n} equations, or none as a residual, and an "
                           f"iteration matrix of {n} unknowns: it needs equations as a residual, as many as unknowns")
        self.s, self.n, self.equations, self.matrix = s, n, equations, matrix
        self.Z, self.Y, self.Yp, self.R, self._D, self.correction = (np.zeros((s, n)) for _ in range(6))
        self._w, (self.error, self.scaled) = np.zeros((2, n)), np.zeros((2, n))
        self._last = np.zeros((s, n))
        self._y, self._yp, self._weights = np.zeros((3, n))
        self._inputs = address(self._y), address(self._yp), address(self._weights)
        arrays = (self.Z, self.Y, self.Yp, self.R, self._D, self.correction, self._w, self.error, self.scaled)
        self._kept = kept
        self.table = Table(equations.address, matrix.address, s, n, reals, pairs, *map(address, kept.values()),
                           coefficients.gamma0, *map(address, arrays), inf)  # fmt: skip
        self._at, self._c = ctypes.addressof(self.table), functions()

    def predict(self, yp: Array, h: float, last_h: float, last: Array | None) -> None:
        """Compute starting values of the increments for a step of h (s): by extrapolation of the collocation polynomial of the
        last step, of length last_h (s) with increments last (s, n), or along the slope yp (n,) where last_h is 0."""
        self._yp[:] = yp
        if last_h:
            self._last[:] = last
        self._c.radau_predict(self._at, self._inputs[1], h, last_h, address(self._last))

    def slopes(self, h: float) -> None:
        """Compute the slopes y' of the stages, Yp, from the increments Z."""
        self._c.radau_slopes(self._at, h)

    def solve(self, t0: float, y0: Array, h: float, weights: Array, target: float, limit: int) -> bool:
        """Newton's iteration with the present LU factors, until its remaining error, estimated from the rate of convergence, is
        below target. Returns whether it has converged.

        weights (n,): those of the norm, in which 1 is the tolerance; limit: largest number of iterations. Afterwards `table` has
        the number of `iterations`, the last rate of convergence `theta` and the `norm` of the last correction.
        """
        self._y[:], self._weights[:] = y0, weights
        code = self._c.radau_solve(self._at, t0, self._inputs[0], h, self._inputs[2], target, limit)
        if code < 0:
            self.equations.raise_error()
        return bool(code > 0)

    def noise(self, weights: Array) -> float:
        """Norm of the Newton correction that round-off of the residual alone can cause."""
        self._weights[:] = weights
        return float(self._c.radau_noise(self._at, self._inputs[2]))

    def estimate(self, t: float, y: Array, yp: Array, h: float, weights: Array, careful: bool) -> float:
        """Embedded estimate of the local error of the step from (t, y, yp), in units of the tolerance; a solution with the
        iteration matrix filters out stiff components. careful: filter once more where the estimate is 1 or larger."""
        if not len(self.matrix.real):
            raise internal("the error estimate of a collocation method needs a real eigenvalue of its coefficients, these have "
                           "none")  # fmt: skip
        self._y[:], self._yp[:], self._weights[:] = y, yp, weights
        if self._c.radau_error(self._at, t, *self._inputs[:2], h, self._inputs[2], careful) < 0:
            self.equations.raise_error()
        return float(self.table.estimate)
