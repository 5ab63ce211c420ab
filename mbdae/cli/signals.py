"""Signals that end a command as Ctrl-C does, so that what was computed is saved."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self

#: signals that end a process: the first is sent by `kill`, `timeout` and batch systems, the second by a terminal that is closed,
#: the third by Ctrl-Break
NAMES = ("SIGTERM", "SIGHUP", "SIGBREAK")


class Stops:
    """Within `with Stops():` these signals raise KeyboardInterrupt, unless a handler is set or they are ignored already.

    number: number of the last of these signals that came, that of Ctrl-C (SIGINT) where none came
    """

    def __init__(self) -> None:
        self.number = int(signal.SIGINT)
        self._before: dict[int, Any] = {}

    @property
    def name(self) -> str:
        """Name of the signal that came last."""
        return signal.Signals(self.number).name

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
                if signal.getsignal(number) == signal.SIG_DFL:
                    self._before[number] = signal.signal(number, self._stop)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        raise KeyboardInterrupt
