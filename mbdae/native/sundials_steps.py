"""Arguments and results of the loop over the steps of SUNDIALS, which is in sundials.c."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.native.equations import Number, Pointer, Whole

Array = NDArray[np.float64]

#: largest number of steps in a `Block`, and largest size in bytes of their y, y' and dense output, of which one step always fits
MOST_ROWS, BLOCK_BYTES = 4096, 2**22


class Run(ctypes.Structure):
    """The C struct `Run` of sundials.c, with the same members in the same order."""

    _fields_ = (
        ("e", Pointer), ("array", Pointer), ("data", Pointer), ("columns", Pointer), ("rows", Pointer), ("ida", Pointer),
        ("cvode", Pointer), ("until", Pointer), ("interpolant", Pointer), ("memory", Pointer), ("y_vector", Pointer),
        ("yp_vector", Pointer), ("inner_vector", Pointer), ("own_columns", Pointer), ("own_rows", Pointer),
        ("columns_bytes", Whole), ("rows_bytes", Whole), ("place", Pointer), ("fy", Pointer), ("fyp", Pointer),
        ("nodes", Pointer), ("atol", Pointer), ("rtol", Number), ("tame", Number), ("smooth", Whole), ("most", Number),
        ("toward", Number), ("evaluations", Whole), ("rejected", Whole), ("jacobians", Whole), ("choosing", Whole),
        ("renew", Whole), ("renewing", Whole), ("fresh", Whole), ("t", Number), ("cj", Number), ("y", Pointer), ("yp", Pointer),
        ("values", Pointer), ("jacobian_t", Number), ("jacobian_y", Pointer), ("from_t", Number), ("last_step", Number),
        ("from_y", Pointer), ("from_yp", Pointer), ("inner", Pointer), ("pieces", Whole),
        ("errors", Pointer), ("wider", Pointer), ("window", Whole), ("before", Whole),
        ("relaxed", Whole), ("least", Number), ("most_of_window", Number), ("most_of_run", Number),
    )  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """Settings of IDA and CVODE: tolerances (atol (n,)), highest order, first step (s; 0: chosen by the solver)."""

    rtol: float
    atol: Array
    order: int
    first_step: float = 0.0


@dataclass(frozen=True)
class Steps:
    """Steps made in one call: times t (m,) at their ends, y and yp (m, n) there; pieces: of each step the dense output inside it
    (inner, n), or None where none is stored.

    code: negative, or STUCK, where the method could not continue after the last step."""

    t: Array
    y: Array
    yp: Array
    pieces: list[Any]
    code: int


class Block:
    """Arrays that C fills with steps of n unknowns, each with `inner` points of dense output; the arrays in `Steps` are views of
    them."""

    def __init__(self, n: int, inner: int) -> None:
        self.room = max(1, min(MOST_ROWS, BLOCK_BYTES // (8 * n * (2 + inner))))
        self.t, self.y, self.yp = np.empty(self.room), np.empty((self.room, n)), np.empty((self.room, n))
        self.stored = np.zeros(self.room, dtype=np.int64)
        self.inner = np.empty((self.room, inner, n))
        self.made = 0
        self._addresses = [(a.ctypes.data, a.strides[0]) for a in (self.t, self.y, self.yp, self.stored)]

    def addresses(self) -> list[int]:
        """Addresses of the first rows of t, y, yp and stored that have no step yet, where C writes the next ones."""
        return [first + self.made * stride for first, stride in self._addresses]
