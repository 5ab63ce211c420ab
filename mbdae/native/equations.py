"""Equations as the native methods of integration call them: those of a scene by address, those of a user's DAE by call back.

A call back that raises keeps its exception in `error`; what called it ends with a negative code, and Python raises it then.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

Pointer, Number, Whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
RESIDUAL = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer, Pointer)
RATES = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer)
RATE_JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
NOT_FINITE, SINGULAR, RAISED = 1, 2, -1


class Table(ctypes.Structure):
    """`Equations` of core.h."""

    _fields_ = (("self", Pointer), ("n", Whole), ("nnz", Whole), ("residual", Pointer), ("jacobian", Pointer),
                ("rates", Pointer), ("rate_jacobian", Pointer))  # fmt: skip


class Equations:
    """The table of a system and what it refers to. error: what a call back raised, None otherwise."""

    def __init__(self, table: Table, *kept: Any) -> None:
        self.table, self._kept = table, kept
        self.error: BaseException | None = None

    @property
    def address(self) -> int:
        """Address of the table."""
        return ctypes.addressof(self.table)

    def raise_error(self) -> None:
        """Raise what a call back raised, if one did."""
        error, self.error = self.error, None
        if error is not None:
            raise error


def equations_of(system: Any) -> Equations:
    """The equations of a System: those of its own native evaluation where it has one, else by call back."""
    own = getattr(system, "native", None)
    return own if own is not None else called(system)


def called(system: Any) -> Equations:
    """The equations of a System that is evaluated in Python."""
    n = system.n
    pattern = system.sparsity
    nnz = n * n if pattern is None else pattern.nnz
    made = Equations(Table(None, n, nnz, None, None, None, None))

    def guarded(kind: Any, function: Any) -> Any:
        """The function as a call back that keeps what it raises."""

        def call(_: Any, *args: Any) -> int:
            try:
                function(*args)
            except BaseException as error:  # C cannot pass it on; `raise_error` does
                made.error = made.error or error
                return RAISED
            return 0

        return kind(call)

    def residual(t: float, y: int, yp: int, out: int) -> None:
        system.residual(t, seen(y, n).copy(), seen(yp, n).copy(), seen(out, n))

    def jacobian(t: float, y: int, yp: int, fy: int, fyp: int) -> None:
        by_y, by_yp = system.jacobian_parts(t, seen(y, n).copy(), seen(yp, n).copy())
        seen(fy, nnz)[:], seen(fyp, nnz)[:] = by_y.ravel(order="F"), by_yp.ravel(order="F")

    def rates(t: float, y: int, out: int) -> None:
        system.rhs(t, seen(y, n).copy(), seen(out, n))

    calls = [guarded(RESIDUAL, residual), guarded(JACOBIAN, jacobian)]
    if system.rhs is not None:
        calls.append(guarded(RATES, rates))
    addresses = [ctypes.cast(call, Pointer).value for call in calls]
    made.table.residual, made.table.jacobian = addresses[0], addresses[1]
    made.table.rates = addresses[2] if len(addresses) > 2 else None
    made._kept = (calls, system)
    return made


def seen(address: int, size: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The numbers (size,) at an address, not copied."""
    return np.ctypeslib.as_array((Number * size).from_address(address))
