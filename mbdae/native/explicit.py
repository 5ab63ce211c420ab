"""Steps of an explicit Runge-Kutta method with its estimates and its interpolant: the table of explicit.c."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.native.equations import Equations, Number, Pointer, Whole
from mbdae.native.library import declared
from mbdae.native.signals import Signals

Array = NDArray[np.float64]
STAGES, ALL, ORDER = 12, 16, 7
SLICE = 0.05  #: s of wall time after which a call returns, so that signals, progress and limits are looked at


class _Coefficients(ctypes.Structure):
    _fields_ = (("row", Pointer), ("column", Pointer), ("value", Pointer))


class Table(ctypes.Structure):
    """`Explicit` of explicit.c."""

    _fields_ = (("e", Pointer), *((name, _Coefficients) for name in ("stages", "errors", "dense")),
                *((name, Pointer) for name in ("c", "nodes", "atol")), ("inner", Whole),
                *((name, Number) for name in ("rtol", "h", "longest")),
                *((name, Pointer) for name in ("K", "y", "next", "F")),
                *((name, Whole) for name in ("evaluations", "rejected", "after_rejection")))  # fmt: skip


Entries = Sequence[tuple[int, int, float]]


class Method:
    """Coefficients of a method as (row, column, value), row by row: of its stages, its two estimates and its interpolant.

    Raises ValueError where one has no place."""

    def __init__(self, stages: Entries, errors: Entries, dense: Entries) -> None:
        self._kept: list[Any] = []
        self.stages, self.errors = self._rows(stages, ALL, ALL), self._rows(errors, 2, STAGES + 1)
        self.dense = self._rows(dense, 4, ALL)
        self._c = np.zeros(ALL)
        np.add.at(self._c, [i for i, _, _ in stages], [a for _, _, a in stages])
        self.c = self._c.ctypes.data

    def _rows(self, entries: Entries, rows: int, columns: int) -> _Coefficients:
        i, j = (np.array([entry[k] for entry in entries], dtype=np.int64) for k in (0, 1))
        if not (i.min() >= 0 and i.max() < rows and j.min() >= 0 and j.max() < columns and (np.diff(i) >= 0).all()):
            raise ValueError(f"coefficients of {rows} rows and {columns} columns, in the order of rows")
        starts = np.searchsorted(i, np.arange(rows + 1)).astype(np.int64)
        arrays = starts, j, np.array([v for *_, v in entries])
        self._kept.append(arrays)
        return _Coefficients(*(array.ctypes.data for array in arrays))


class Steps(NamedTuple):
    """Steps made: times (m,), values and slopes (m, n), increments at inner nodes (m, inner, n), and what ended them."""

    t: Array
    y: Array
    yp: Array
    inner: Array
    code: int


#: the library with the function of explicit.c
_functions = declared(("explicit_steps", ctypes.c_int, (Pointer, *[Number] * 4, Whole, *[Pointer] * 5)))


class Explicit:
    """A run of a method; nodes: parts of a step where the interpolant is kept."""

    def __init__(self, equations: Equations, method: Method, nodes: Array, rtol: float, atol: Array) -> None:
        n = int(equations.table.n)
        if not equations.table.rates or atol.shape != (n,):
            raise ValueError(f"{n} equations with rates, and as many tolerances: not {atol.shape}")
        self.n, self.equations = n, equations
        self._K, self._y, self._next, self._F = np.zeros((ALL, n)), np.zeros(n), np.zeros(n), np.zeros((ORDER + 1, n))
        self._kept = method, np.array(nodes, dtype=float), np.array(atol, dtype=float)
        self.table = Table(
            equations.address, method.stages, method.errors, method.dense, method.c, *(a.ctypes.data for a in self._kept[1:]),
            len(nodes), rtol, 0.0, np.inf, *(a.ctypes.data for a in (self._K, self._y, self._next, self._F)), 0, 0, 0,
        )  # fmt: skip
        self.inner = len(nodes)
        self._signals: Signals | None = None

    def __enter__(self) -> Self:
        if self.equations.called:  # else no Python runs inside
            self.equations.caught.signals = self._signals = Signals().__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        signals, self._signals, self.equations.caught.signals = self._signals, None, None
        if signals is not None:
            signals.__exit__(*error)

    def begin(self, y: Array, rate: Array, h: float) -> None:
        """Start from y (n,) with slope rate (n,) and a first step of h (s)."""
        self._y[:], self._K[0], self.table.h, self.table.after_rejection = y, rate, h, 0

    def advance(self, t: float, end: float, most: float, rows: int, longest: float = np.inf) -> Steps:
        """Steps from t towards end, at most so many rows, until more than `most` evaluations were made, for a slice of time."""
        times, y, yp = np.empty(rows), np.empty((rows, self.n)), np.empty((rows, self.n))
        inner, made = np.empty((rows, self.inner, self.n)), Whole()
        self.table.longest = longest
        if self._signals is not None:
            self._signals.inside = True
        code = _functions().explicit_steps(
            ctypes.byref(self.table), t, end, self.table.evaluations + most, SLICE, rows, times.ctypes.data, y.ctypes.data,
            yp.ctypes.data, inner.ctypes.data, ctypes.byref(made))  # fmt: skip
        if self._signals is not None:
            self._signals.inside = False
        m = made.value
        return Steps(times[:m], y[:m], yp[:m], inner[:m], code)
