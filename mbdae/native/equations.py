"""Equations as the integrators in C call them: compiled equations of a scene by address, a user's DAE in Python by callbacks.

An exception in a callback is stored, C returns with a negative code, and `raise_error` then raises the exception. The handlers of
signals such as that of Ctrl-C are not called while C runs (`Signals`), but by the next callback, which finds them in `Caught`.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from mbdae.errors import SolverError, WallClockError
from mbdae.process import Signals

Pointer, Number, Whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
RESIDUAL = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer, Pointer)
RATES = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer)
RATE_JACOBIAN = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Number, Pointer, Pointer, Pointer)
VALUE = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Whole, Number, Pointer, Pointer)
ALONG = ctypes.CFUNCTYPE(ctypes.c_int, Pointer, Whole, Pointer, Pointer)
SINGULAR, RAISED = 2, -1
#: wall time (s) after which a call of a step loop in C returns at the end of a step, so that Python handles signals, progress and
#: limits of the run
SLICE = 0.05
#: largest number of addresses for which a callback keeps a NumPy array (`_Call.at`); before one more is kept, all are discarded.
#: An integrator uses only a few addresses
MOST_SEEN = 64
#: function (system, t, y, y') that returns df/dy (n, n) of y' = f(t, y)
RateJacobian = Callable[[Any, float, Any, Any], Any]


class CEquations(ctypes.Structure):
    """The C struct `Equations` of core.h, with the same members in the same order."""

    _fields_ = (("self", Pointer), ("n", Whole), ("nnz", Whole), ("residual", Pointer), ("jacobian", Pointer),
                ("rates", Pointer), ("rate_jacobian", Pointer))


class Stretches(ctypes.Structure):
    """The C struct `Stretches` of core.h, with the same members in the same order."""

    _fields_ = (("edges", Pointer), ("count", Whole), ("share", Number), ("kinks", Pointer), ("kink_count", Whole))

    kept: tuple[Any, Any]

    @classmethod
    def of(cls, edges: Any, share: float, kinks: Any = ()) -> Stretches:
        """Stretches that limit the length of steps to a share of the interval between two edges (k,), s, in which they lie, and
        let steps end at the kinks (l,), s: instants at which a derivative of an input jumps. `kept` are its arrays."""
        kept = np.array(edges, dtype=float), np.array(kinks, dtype=float)
        made = cls(kept[0].ctypes.data, len(kept[0]), share, kept[1].ctypes.data, len(kept[1]))
        made.kept = kept
        return made


class Caught:
    """error: the first exception that a callback raised, or None; signals: those whose handlers the callbacks have to call."""

    def __init__(self) -> None:
        self.error: BaseException | None = None
        self.signals: Signals | None = None


class Equations:
    """The table by which C calls the equations of a system, and the objects to which it holds addresses (`kept`).

    caught: exceptions of callbacks; make: function that compiles those of "residual", "jacobian" and "rates" that are about to be
    called, None where nothing has to be compiled."""

    def __init__(self, table: CEquations, *kept: Any, caught: Caught | None = None,
                 make: Callable[..., None] | None = None) -> None:
        self.table, self._kept, self.caught, self._make = table, kept, caught or Caught(), make

    def made(self, *parts: str) -> Self:
        """These equations, after compiling the parts that are about to be called."""
        if self._make is not None:
            self._make(*parts)
        return self

    @property
    def called(self) -> bool:
        """Whether the equations are Python callbacks."""
        return not self.table.self

    @property
    def address(self) -> int:
        """Address of the table, which C functions take as an argument."""
        return ctypes.addressof(self.table)

    def raise_error(self) -> None:
        """Raise the exception of a callback, if one was raised."""
        error, self.caught.error = self.caught.error, None
        if error is not None:
            raise error


class Listening:
    """Context manager of a method whose C functions call equations. Where the equations are Python callbacks, handlers of signals
    are delayed while C runs, see `Signals`."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._signals: Signals | None = None

    def __enter__(self) -> Self:
        if self.equations.called:  # compiled equations run no Python that a handler could interrupt
            self.equations.caught.signals = self._signals = Signals().__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        signals, self._signals, self.equations.caught.signals = self._signals, None, None
        if signals is not None:
            signals.__exit__(*error)

    def native(self, function: Any, *args: Any) -> int:
        """Call a function of C, with handlers of signals delayed meanwhile; returns its code."""
        if self._signals is None:
            return int(function(*args))
        self._signals.inside = True
        code = int(function(*args))
        self._signals.inside = False
        return code


class Stepping(Listening):
    """A method that makes many steps in one call of C; its table has a member `stretches` that limits them."""

    table: Any

    def bound(self, edges: Any, share: float, kinks: Any = ()) -> None:
        """Limit the length of steps, see `Stretches.of`."""
        found = Stretches.of(edges, share, kinks)
        (self._edges, self._kinks), self.table.stretches = found.kept, found


def equations_of(system: Any) -> Equations:
    """F(t, y, y') = 0 of a System: its own compiled evaluation where it has one, else callbacks."""
    own: Equations | None = getattr(system, "native", None)
    return own.made("residual", "jacobian") if own is not None and own.table.residual else called(system)


def rates_of(system: Any, rate_jacobian: RateJacobian | None = None) -> Equations:
    """y' = f(t, y) of a System: its own compiled evaluation where it has one, else callbacks. rate_jacobian: used for df/dy."""
    own: Equations | None = getattr(system, "native", None)
    if own is None or not own.table.rates:
        return called(system, rate_jacobian)
    own.made("rates")
    if rate_jacobian is None:
        return own
    call = _RateJacobian(system, rate_jacobian).guarded(own.caught)
    table = CEquations.from_buffer_copy(own.table)
    table.rate_jacobian = ctypes.cast(call, Pointer).value
    return Equations(table, call, own, caught=own.caught)


def called(system: Any, rate_jacobian: RateJacobian | None = None) -> Equations:
    """The equations of a System that is evaluated in Python, with callbacks for C. rate_jacobian: as in `rates_of`."""
    caught, parts = Caught(), [_Residual(system), _Jacobian(system)]
    if system.rhs is not None:
        parts.append(_Rates(system))
        parts += [] if rate_jacobian is None else [_RateJacobian(system, rate_jacobian)]
    calls = [part.guarded(caught) for part in parts]
    addresses = [ctypes.cast(call, Pointer).value for call in calls]
    table = CEquations(None, system.n, parts[0].nnz, *addresses, *[None] * (4 - len(addresses)))
    return Equations(table, calls, system, caught=caught)


class _Call:
    """A function of a System as a callback of C. It passes copies of C's arrays, because a user's function could store or change
    them."""

    kind: Any

    def __init__(self, system: Any) -> None:
        self.system, self.n = system, system.n
        self.nnz = math.prod(system.jacobian_shape)
        self._seen: dict[tuple[int, int], Any] = {}

    def __call__(self, *args: Any) -> None:
        raise NotImplementedError

    def at(self, address: int, size: int | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The array of `size` numbers (None: n) at an address, a view without a copy. Arrays are stored for later calls, because
        making one takes longer than evaluating a small residual."""
        key = address, self.n if size is None else size
        found = self._seen.get(key)
        if found is None:
            if len(self._seen) >= MOST_SEEN:
                self._seen.clear()
            found = self._seen[key] = seen(*key)
        return found

    def guarded(self, caught: Caught) -> Any:
        """The function as a C callback that stores an exception in `caught` and returns a code: 0, SINGULAR or RAISED."""

        def call(_: Any, *args: Any) -> int:
            try:
                if caught.signals is not None and caught.signals.waiting:
                    caught.signals.deliver()
                self(*args)
            except SolverError as error:  # there is no value at this state: the integrator may try a shorter step
                if not isinstance(error, WallClockError):
                    return SINGULAR
                caught.error = caught.error or error
                return RAISED
            except BaseException as error:  # cannot pass through C: `raise_error` raises it afterwards
                caught.error = caught.error or error
                return RAISED
            return 0

        return self.kind(call)


class _Residual(_Call):
    kind = RESIDUAL

    def __call__(self, t: float, y: int, yp: int, out: int) -> None:
        self.at(out).fill(np.nan)  # so that entries that the user's function does not set are NaN
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
        self.at(out, self.n**2)[:] = self.function(self.system, t, self.at(y).copy(), self.at(yp).copy()).ravel(order="F")


def seen(address: int, size: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The array (size,) of double precision numbers at an address, a view without a copy."""
    return np.ctypeslib.as_array((Number * size).from_address(address))


class TwinTable(ctypes.Structure):
    """The C struct `Twin` of core.h, with the same members in the same order."""

    _fields_ = (("self", Pointer), ("n", Whole), ("columns", Whole), ("value", Pointer), ("along", Pointer), ("back", Pointer))


class Called:
    """Derivatives of y' = f(t, y) in Python, `columns` at a time: an object with the functions value(at, t, y) -> y', along(at,
    dy) -> (n, P) and back(at, weight) -> (n,). error: the exception that one of them raised."""

    def __init__(self, of: Any, n: int, columns: int) -> None:
        self.error: BaseException | None = None

        def view(address: int, *shape: int) -> Any:
            return np.ctypeslib.as_array((ctypes.c_double * int(np.prod(shape))).from_address(address)).reshape(shape)

        def guarded(function: Callable[..., None]) -> Callable[..., int]:
            def call(_: Any, *args: Any) -> int:
                try:
                    function(*args)
                except BaseException as error:  # cannot pass through C
                    self.error = error
                    return RAISED
                return 0
            return call

        def value(at: int, t: float, y: int, out: int) -> None:
            view(out, n)[:] = of.value(at, t, view(y, n))

        def along(at: int, dy: int, out: int) -> None:
            view(out, n, columns)[:] = of.along(at, view(dy, n, columns))

        def back(at: int, weight: int, out: int) -> None:
            view(out, n)[:] = of.back(at, view(weight, n))

        self._kept = VALUE(guarded(value)), ALONG(guarded(along)), ALONG(guarded(back))
        self.twin = TwinTable(None, n, columns, *(ctypes.cast(call, Pointer).value for call in self._kept))
