"""Signals while C runs: their handlers are called later, where an exception that they raise can be passed on.

Python runs the handler of a signal, Ctrl-C among them, before the first instruction of the next Python function. Where that is a
callback from C, no `try` in it is active yet: ctypes prints the exception, drops it, and C reads a result never written.
"""

from __future__ import annotations

import signal
import threading
from typing import Any, Self

NUMBERS = tuple(signal.valid_signals())


class Signals:
    """Context in which handlers of signals wait while `inside` is true; `deliver` calls those that wait. Threads other than the
    main one get no signals: nothing is done there."""

    def __init__(self) -> None:
        self.inside = False
        self.waiting: list[tuple[int, Any]] = []
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in NUMBERS:
                handler = signal.getsignal(number)
                if callable(handler):
                    self._before[number] = handler
                    signal.signal(number, self._handle)
        return self

    def __exit__(self, *error: object) -> None:
        self.inside = False
        for number, handler in self._before.items():
            if signal.getsignal(number) == self._handle:
                signal.signal(number, handler)
        self.deliver()

    def _handle(self, number: int, frame: Any) -> None:
        if self.inside:
            self.waiting.append((number, frame))
        else:
            self._before[number](number, frame)

    def deliver(self) -> None:
        """Call the handlers that wait."""
        while self.waiting:
            number, frame = self.waiting.pop(0)
            self._before[number](number, frame)
