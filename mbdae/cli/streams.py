"""Standard output and error stream of a command, made usable where they are closed or not read; redirection for --json; signals
that end a command, and its error for wrong usage."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import threading
from argparse import Namespace
from collections.abc import Iterator
from types import FrameType
from typing import Any, Self

# -- The error for wrong usage of the command line, and the suffixes of reports


REPORTS = (".html", ".md", ".tex")


class UsageError(Exception):
    """Wrong words on the command line, or an unusable file among them; usage: the words that the command takes."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage


# -- Signals that end a command as Ctrl-C does, so that what was computed is saved


#: signals that end a process: the first is Ctrl-C, the second is sent by `kill`, `timeout` and batch systems, the third by a
#: terminal that is closed, the fourth by Ctrl-Break
NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


class StoppedBySignal(KeyboardInterrupt):
    """A signal came. Where KeyboardInterrupt itself leaves code that was given to `exec` as text, as by dataclasses while they
    are imported, Python ends its process by SIGINT in the end, whatever its exit code is."""


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
                if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                    self._before[number] = signal.signal(number, self._stop)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        raise StoppedBySignal


READER_GONE = 141  #: exit code of a process that SIGPIPE ends, as in `mbdae ... | head -1`


class OutputLostError(Exception):
    """Standard output cannot be written: its reader has closed it (reader_gone), or there is no space on the disk."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output cannot be written: {error.strerror}")
        self.reader_gone = isinstance(error, BrokenPipeError)


class _Checked:
    """A stream that raises OutputLostError where it cannot be written."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return int(self._stream.write(text))
        except OSError as error:
            raise OutputLostError(error) from None

    def flush(self) -> None:
        try:
            with contextlib.suppress(ValueError):  # FILE may have closed the stream
                self._stream.flush()
        except OSError as error:
            raise OutputLostError(error) from None


@contextlib.contextmanager
def usable_streams() -> Iterator[None]:
    """Make both streams writable: closed ones discard what is written, characters they cannot encode are escaped.

    A stream that cannot be written all the same ends the command with OutputLostError."""
    with contextlib.ExitStack() as stack:
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:
                stack.enter_context(_instead(name, stack.enter_context(open(os.devnull, "w", encoding="utf-8"))))
            elif isinstance(getattr(sys, name), io.TextIOWrapper):
                getattr(sys, name).reconfigure(errors="backslashreplace")
        stack.enter_context(_instead("stdout", _Checked(sys.stdout)))
        try:
            try:
                yield
            finally:
                sys.stdout.flush()
        except OutputLostError:
            # discard buffered output, so that Python does not try to write it at exit
            with contextlib.suppress(OSError, ValueError, AttributeError):
                nothing = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nothing, sys.stdout.fileno())
                os.close(nothing)
            raise


@contextlib.contextmanager
def _instead(name: str, stream: Any) -> Iterator[None]:
    before = getattr(sys, name)
    setattr(sys, name, stream)
    try:
        yield
    finally:
        setattr(sys, name, before)


@contextlib.contextmanager
def json_alone(a: Namespace) -> Iterator[None]:
    """With --json: make `a.stdout` the standard output, and send all else that is printed, also by FILE and its processes, to the
    error stream."""
    a.stdout = sys.stdout
    if not a.json:
        yield
        return
    with contextlib.ExitStack() as stack:
        try:
            number, other = sys.stdout.fileno(), sys.stderr.fileno()
        except (OSError, ValueError, AttributeError):  # the stream is not a file: only what Python prints can be redirected
            pass
        else:
            sys.stdout.flush()
            a.stdout = _Checked(os.fdopen(os.dup(number), "w", encoding="utf-8"))
            os.dup2(other, number)
            stack.callback(_put_back, a, number)
        with contextlib.redirect_stdout(sys.stderr):
            yield


def _put_back(a: Namespace, number: int) -> None:
    """Restore standard output, whose file descriptor is `number`, as it was before `json_alone`."""
    stream, a.stdout = a.stdout, sys.stdout
    try:
        stream.flush()
    finally:
        os.dup2(stream.fileno(), number)
        with contextlib.suppress(OSError):
            stream.close()
