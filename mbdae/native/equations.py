"""Equations as the native methods of integration call them: those of a scene by address, those of a user's DAE by call back.

A call back that raises keeps its exception; what called it ends with a negative code, and `raise_error` raises it then. A method
lets signals wait while it runs (`Signals`) and gives them to `Caught`: a call back is the next place where they are noticed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from mbdae.errors import SolverError
from mbdae.native.signals import Signals

Pointer, Number, Whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
RESIDUAL = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer, Pointer)
RATES = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer)
RATE_JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
SINGULAR, RAISED = 2, -1
SLICE = 0.05  #: s of wall time after which a call returns, so that signals, progress and limits are looked at
#: addresses of which a call back keeps arrays: a method works with few
MOST_SEEN = 64
#: (system, t, y, y') -> df/dy (n, n) of y' = f(t, y)
RateJacobian = Callable[[Any, float, Any, Any], Any]


class Table(ctypes.Structure):
    """`Equations` of core.h."""

    _fields_ = (("self", Pointer), ("n", Whole), ("nnz", Whole), ("residual", Pointer), ("jacobian", Pointer),
                ("rates", Pointer), ("rate_jacobian", Pointer))  # fmt: skip


class Stretches(ctypes.Structure):
    """`Stretches` of core.h."""

    _fields_ = (("edges", Pointer), ("count", Whole), ("share", Number), ("kinks", Pointer), ("kink_count", Whole))


class Caught:
    """What call backs raise, and the signals they notice. error: what one raised, None otherwise."""

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self.signals: Signals | None = None


class Equations:
    """The table of a system and what it refers to; caught: by its call backs; make: compiles the parts ("residual", "jacobian",
    "rates") that are about to be called, None where all are ready."""

    def __init__(self, table: Table, *kept: Any, caught: Caught | None = None, make: Callable[..., None] | None = None) -> None:
        self.table, self._kept, self.caught, self._make = table, kept, caught or Caught(), make

    def made(self, *parts: str) -> Self:
        """These equations, of which some parts are about to be called."""
        if self._make is not None:
            self._make(*parts)
        return self

    @property
    def called(self) -> bool:
        """Whether they are calls of Python."""
        return not self.table.self

    @property
    def address(self) -> int:
        """Address of the table."""
        return ctypes.addressof(self.table)

    def raise_error(self) -> None:
        """Raise what a call back raised, if one did."""
        error, self.caught.error = self.caught.error, None
        if error is not None:
            raise error


class Listening:
    """Context of a method that calls equations from C. Where these are calls of Python, signals wait while C runs."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._signals: Signals | None = None

    def __enter__(self) -> Self:
        if self.equations.called:  # else no Python runs inside
            self.equations.caught.signals = self._signals = Signals().__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        signals, self._signals, self.equations.caught.signals = self._signals, None, None
        if signals is not None:
            signals.__exit__(*error)

    def native(self, function: Any, *args: Any) -> int:
        """Result of a function of C."""
        if self._signals is None:
            return int(function(*args))
        self._signals.inside = True
        code = int(function(*args))
        self._signals.inside = False
        return code


class Stepping(Listening):
    """A method that makes many steps in a call; its table holds `stretches`."""

    table: Any

    def bound(self, edges: Any, share: float, kinks: Any = ()) -> None:
        """Bound steps to a share of the stretches between edges (k,), s, and end them at kinks (l,), s."""
        self._edges, self._kinks = np.array(edges, dtype=float), np.array(kinks, dtype=float)
        self.table.stretches = Stretches(self._edges.ctypes.data, len(self._edges), share, self._kinks.ctypes.data,
                                         len(self._kinks))  # fmt: skip


def equations_of(system: Any) -> Equations:
    """F(t, y, y') = 0 of a System: its own native evaluation where it has one, else by call back."""
    own: Equations | None = getattr(system, "native", None)
    return own.made("residual", "jacobian") if own is not None and own.table.residual else called(system)


def rates_of(system: Any, rate_jacobian: RateJacobian | None = None) -> Equations:
    """The same with y' = f(t, y). rate_jacobian: called where the equations have no Jacobian of the rates."""
    own: Equations | None = getattr(system, "native", None)
    if own is None or not own.table.rates:
        return called(system, rate_jacobian)
    own.made("rates")
    if rate_jacobian is None:
        return own
    call = _RateJacobian(system, rate_jacobian).guarded(own.caught)
    table = Table.from_buffer_copy(own.table)
    table.rate_jacobian = ctypes.cast(call, Pointer).value
    return Equations(table, call, own, caught=own.caught)


def called(system: Any, rate_jacobian: RateJacobian | None = None) -> Equations:
    """The equations of a System that is evaluated in Python."""
    caught, parts = Caught(), [_Residual(system), _Jacobian(system)]
    if system.rhs is not None:
        parts.append(_Rates(system))
        parts += [] if rate_jacobian is None else [_RateJacobian(system, rate_jacobian)]
    calls = [part.guarded(caught) for part in parts]
    addresses = [ctypes.cast(call, Pointer).value for call in calls]
    table = Table(None, system.n, parts[0].nnz, *addresses, *[None] * (4 - len(addresses)))
    return Equations(table, calls, system, caught=caught)


class _Call:
    """A function of a System as C calls it. Arrays are copies where a user's function could keep or change them."""

    kind: Any

    def __init__(self, system: Any) -> None:
        self.system, self.n = system, system.n
        self.nnz = system.n**2 if system.sparsity is None else system.sparsity.nnz
        self._seen: dict[tuple[int, int], Any] = {}

    def __call__(self, *args: Any) -> None:
        raise NotImplementedError

    def at(self, address: int, size: int | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
        """`seen`, kept: it takes longer than a small residual."""
        key = address, self.n if size is None else size
        found = self._seen.get(key)
        if found is None:
            if len(self._seen) >= MOST_SEEN:
                self._seen.clear()
            found = self._seen[key] = seen(*key)
        return found

    def guarded(self, caught: Caught) -> Any:
        """The function as a call back that keeps what it raises."""

        def call(_: Any, *args: Any) -> int:
            try:
                if caught.signals is not None and caught.signals.waiting:
                    caught.signals.deliver()
                self(*args)
            except SolverError:  # nothing can be computed there: a method may shorten its step, and asks again where it ends
                return SINGULAR
            except BaseException as error:  # C cannot pass it on; `raise_error` does
                caught.error = caught.error or error
                return RAISED
            return 0

        return self.kind(call)


class _Residual(_Call):
    kind = RESIDUAL

    def __call__(self, t: float, y: int, yp: int, out: int) -> None:
        self.at(out).fill(np.nan)  # what a function leaves out is not a number
        self.system.residual(t, self.at(y).copy(), self.at(yp).copy(), self.at(out))


class _Jacobian(_Call):
    kind = JACOBIAN

    def __call__(self, t: float, y: int, yp: int, fy: int, fyp: int) -> None:
        by_y, by_yp = self.system.jacobian_parts(t, self.at(y).copy(), self.at(yp).copy())
        self.at(fy, self.nnz)[:], self.at(fyp, self.nnz)[:] = by_y.ravel(order="F"), by_yp.ravel(order="F")


class _Rates(_Call):
    kind = RATES

    def __call__(self, t: float, y: int, out: int) -> None:
        self.at(out).fill(np.nan)
        self.system.rhs(t, self.at(y).copy(), self.at(out))


class _RateJacobian(_Call):
    kind = RATE_JACOBIAN

    def __init__(self, system: Any, function: RateJacobian) -> None:
        super().__init__(system)
        self.function = function

    def __call__(self, t: float, y: int, yp: int, out: int) -> None:
        full = self.function(self.system, t, self.at(y).copy(), self.at(yp).copy())
        self.at(out, self.n**2)[:] = full.ravel(order="F")


def seen(address: int, size: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The numbers (size,) at an address, not copied."""
    return np.ctypeslib.as_array((Number * size).from_address(address))
