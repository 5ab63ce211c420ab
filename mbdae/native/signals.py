"""Signals while C runs: their handlers are called later, where an exception that they raise can be passed on.

Python calls the handler of a signal, such as that of Ctrl-C, before the first instruction of the next Python function. Where this
function is a callback from C, its `try` block has not begun yet: ctypes then prints an exception of the handler and drops it, and
C goes on with a result that was never written.
"""

from __future__ import annotations

import signal
import threading
from typing import Any, Self

from mbdae.forks import in_forked_process

NUMBERS = tuple(signal.valid_signals())


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
