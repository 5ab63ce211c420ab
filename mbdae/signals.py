"""Handlers of signals: what they raise leaves a call of mbdae as it is.

Python calls the handler of a signal, such as that of Ctrl-C, between any two instructions. Where an Exception of a handler of the
user's, such as the TimeoutError of an alarm, would come inside of a `try`, it would be taken for a fault of what is done there:
it is raised as `RaisedError`, which none of these catch, and made itself again where the call ends (`ended`).

Where the next instruction is that of a callback from C, its `try` block has not begun yet: ctypes then prints an exception of the
handler and drops it, and C goes on with a result that was never written. So handlers wait while C runs (`Signals`).
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self, TypeVar

from mbdae.forks import in_forked_process

T = TypeVar("T")
NUMBERS = tuple(signal.valid_signals())
OWN = __name__.partition(".")[0]


class RaisedError(BaseException):
    """An Exception that a handler of the user's raised inside a call. error: that; solution: what was computed until then."""

    solution: Any = None

    def __init__(self, error: Exception) -> None:
        super().__init__(str(error))
        self.error = error


class Heard:
    """A handler of the user's during a call: raises its Exceptions as `RaisedError`."""

    def __init__(self, handler: Any) -> None:
        self.handler, self.raised = handler, list[RaisedError]()

    def __call__(self, number: int, frame: Any) -> None:
        try:
            self.handler(number, frame)
        except Exception as error:
            self.raised.append(RaisedError(error))
            raise self.raised[-1] from None


def from_user(level: int) -> bool:
    """Whether a function was called by code outside of mbdae. level: as of `sys._getframe`, counted from the caller."""
    return not sys._getframe(level + 1).f_globals.get("__name__", "").startswith(f"{OWN}.")


def heard() -> dict[int, Heard]:
    """Replace the handlers of the user's in the main thread; by number, those that were replaced."""
    found: dict[int, Heard] = {}
    if threading.get_ident() == threading.main_thread().ident:
        for number in NUMBERS:
            handler = _signal.getsignal(number)
            own = (getattr(handler, "__module__", None) or "").startswith(f"{OWN}.")  # of this package, those of `Heard` too
            if callable(handler) and handler is not signal.default_int_handler and not own:
                found[number] = Heard(handler)
                signal.signal(number, found[number])
    return found


def ended(call: Callable[..., T], replaced: dict[int, Heard], args: Any, given: Any) -> T:
    """A call, after which the handlers are set again that `heard` replaced; an Exception that one of them raised leaves it as it
    is, with what was computed attached as `solution`."""
    raised = None
    try:
        return call(*args, **given)
    except RaisedError as found:
        raised = found
    finally:
        for number, one in replaced.items():
            if _signal.getsignal(number) is one:
                signal.signal(number, one.handler)
            raised = one.raised[-1] if one.raised and raised is None else raised  # Python drops what comes in a __del__
        if raised is not None:
            with suppress(Exception):  # an exception of the user's that takes no attributes
                vars(raised.error).update({} if raised.solution is None else {"solution": raised.solution})
            raise raised.error from raised.error.__cause__


class Signals:
    """Context manager that replaces the handlers of all signals: while `inside` is true (C runs), signals are put into the list
    `waiting`, and `deliver` calls their handlers later. In other threads than the main one, which get no signals, it does
    nothing."""

    def __init__(self) -> None:
        self.inside = False
        self.waiting: list[tuple[int, Any]] = []
        self._before: dict[int, Any] = {}
        self._thread = 0

    def __enter__(self) -> Self:
        self._thread = threading.get_ident()
        if threading.current_thread() is threading.main_thread():
            _present.append(self)
            for number in NUMBERS:
                handler = signal.getsignal(number)
                if callable(handler):
                    self._before[number] = handler
                    signal.signal(number, self._handle)
        return self

    def __exit__(self, *error: object) -> None:
        self.inside = False
        if self in _present:
            _present.remove(self)
        self.restore()
        self.deliver()

    def restore(self) -> None:
        """Set the handlers that were there before."""
        for number, handler in self._before.items():
            if signal.getsignal(number) == self._handle:
                signal.signal(number, handler)

    def _handle(self, number: int, frame: Any) -> None:
        if self.inside:
            self.waiting.append((number, frame))
        else:
            self._before[number](number, frame)

    def deliver(self) -> None:
        """Call the handlers of the signals in `waiting`."""
        while self.waiting:
            number, frame = self.waiting.pop(0)
            self._before[number](number, frame)


_present: list[Signals] = []  #: those that have replaced handlers, in order


@in_forked_process
def _handled_again() -> None:
    """In a process forked by another thread than the main one, C does not run: signals are handled at once."""
    for signals in reversed(_present):
        if signals._thread != threading.get_ident():
            signals.restore()
    _present.clear()
