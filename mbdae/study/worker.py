"""A worker process: it answers one message at a time, and ends when the process that started it ends.

A thread of the worker waits on a handle of its parent that the operating system signals however the parent ends, and then ends
the worker. While C code holds Python's global lock the thread cannot run; on Linux the kernel kills the worker even then.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from mbdae.threads import keep_one_thread

READY = b""
PR_SET_PDEATHSIG = 1  #: of prctl(2): the signal a process gets when the thread that started it ends
SAFE_PATH = "PYTHONSAFEPATH"
LOOK = 1.0  #: time (s) between two checks whether the parent process still runs, in case its end does not signal its handle


class WorkerDiedError(Exception):
    """A worker process ended before it answered; own_fault: whether by an error or exit of its own, not by a signal."""

    def __init__(self, text: str, own_fault: bool) -> None:
        super().__init__(text)
        self.own_fault = own_fault


class Worker:
    """One process that answers messages (bytes) by `answer`, a function at the top level of a module."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, answer, os.getpid(), os.environ.get(SAFE_PATH)))
        with _safe_path(), _not_interrupted():
            self._process.start()
        theirs.close()

    def wait_until_ready(self) -> None:
        """Wait until the process has begun; WorkerDiedError where it ended before."""
        self._received()

    def send(self, message: bytes) -> None:
        """Send a message; where the worker has died, `receive` raises the error."""
        with suppress(OSError):
            self.connection.send_bytes(message)

    def receive(self) -> Any:
        """The next answer, unpickled; None where the worker says that it has begun. WorkerDiedError where it has ended."""
        data = self._received()
        return pickle.loads(data) if data != READY else None

    def _received(self) -> bytes:
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            self.connection.close()
            raise WorkerDiedError(_ended(code), code >= 0) from None

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _ended(code: int) -> str:
    """How a process ended, in words."""
    if code >= 0:
        return f"its process ended itself with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    memory = ", as the system does where memory runs out" if name == "SIGKILL" else ""
    return f"its process was killed by {name}{memory}"


@contextmanager
def _safe_path() -> Iterator[None]:
    """Context in which new Python processes start without the working directory on their path, where a file random.py would
    replace Python's module of this name."""
    before = os.environ.get(SAFE_PATH)
    _set(SAFE_PATH, "1")
    try:
        yield
    finally:
        _set(SAFE_PATH, before)


def _set(name: str, value: str | None) -> None:
    """Set an environment variable; remove it where the value is None."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Context that delays signals while a process starts, because Ctrl-C, or an exception of a handler in its parent, would make
    Python print a traceback of its start-up."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, answer: Callable[[bytes], bytes], parent: int, safe_path: str | None) -> None:
    """The main loop of a worker."""
    _die_with(parent)
    _set(SAFE_PATH, safe_path)
    signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C reaches all processes; it is the parent that ends workers
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
    keep_one_thread()
    connection.send_bytes(READY)
    with suppress(EOFError, OSError):
        while True:
            connection.send_bytes(answer(connection.recv_bytes()))


def _die_with(parent: int) -> None:
    """End this process as soon as its parent has ended."""
    process = multiprocessing.parent_process()
    assert process is not None

    def watch() -> None:
        while not wait([process.sentinel], LOOK):
            if hasattr(os, "getppid") and os.getppid() != parent and sys.platform != "win32":
                break
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
