"""Processes that are forked while other threads work.

A forked process has the thread that forked alone. Locks that other threads held stay locked in it for ever, so they are made anew
(`in_forked_process`); a module that another thread is importing would stay half imported, so forking waits until none is.

Memory while modules are imported and scenes prepared: no passes of Python's collector, and freed memory is used again.

Handlers of signals: what they raise leaves a call of mbdae as it is.

Python calls the handler of a signal, such as that of Ctrl-C, between any two instructions. Where an Exception of a handler of the
user's, such as the TimeoutError of an alarm, would come inside of a `try`, it would be taken for a fault of what is done there:
it is raised as `RaisedError`, which none of these catch, and made itself again where the call ends (`ended`).

Where the next instruction is that of a callback from C, its `try` block has not begun yet: ctypes then prints an exception of the
handler and drops it, and C goes on with a result that was never written. So handlers wait while C runs (`Signals`).

CPU time (s) by kind of work, and caches of what is made once per process: derived laws, planned and compiled kernels.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]
import gc
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, wraps
from threading import RLock, active_count, get_ident
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

PATIENCE, LOOK = 10.0, 0.001  #: largest time (s) that forking waits for imports of other threads, and between two looks
_forked: list[Callable[[], None]] = []
_several = [False]  # whether there were other threads when the process was forked


def in_forked_process(function: Callable[[], None]) -> Callable[[], None]:
    """Decorator: the function is called in every process that is forked from this one while other threads are there."""
    _forked.append(function)
    return function


def _wait_for_imports() -> None:
    _several[0] = active_count() > 1
    end = time.perf_counter() + PATIENCE
    while _several[0] and _others_import() and time.perf_counter() < end:
        time.sleep(LOOK)


def _others_import() -> bool:
    """Whether another thread holds the lock of a module that it imports."""
    locks = getattr(getattr(importlib, "_bootstrap", None), "_module_locks", {})
    owners = [getattr(lock(), "owner", None) for lock in list(locks.values())]
    return any(owner not in (None, get_ident()) for owner in owners)


def _begin_anew() -> None:
    if _several[0]:
        for function in _forked:
            function()


@in_forked_process
def _unlock_properties() -> None:
    """Until Python 3.11 every cached_property has a lock, which is held while a value is made."""
    if sys.version_info < (3, 12):
        for name, module in list(sys.modules.items()):
            for cls in list(vars(module).values()) if name.startswith("mbdae.") else ():
                for member in list(vars(cls).values()) if isinstance(cls, type) else ():
                    if isinstance(member, cached_property):
                        member.lock = RLock()  # type: ignore[attr-defined]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_wait_for_imports, after_in_child=_begin_anew)


P = ParamSpec("P")
T = TypeVar("T")
FREED = 31 * 2**20  #: bytes; the memory of freed arrays up to this size is used again: glibc does so up to 32 MB at most


@contextmanager
def collector_paused() -> Iterator[None]:
    """Context without passes of Python's collector of circular garbage. It looks for garbage wherever many objects have been
    made; modules, equations and tables are many and stay, so that it finds none, and a pass through all that was imported
    takes as long as preparing a scene."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def building(function: Callable[P, T]) -> Callable[P, T]:
    """A function that builds objects and arrays, with the collector paused."""

    @wraps(function)
    def paused(*args: P.args, **kwargs: P.kwargs) -> T:
        _use_again()
        with collector_paused():
            return function(*args, **kwargs)

    return paused


@lru_cache(maxsize=1)
def _use_again() -> None:
    """Make the allocator of glibc use the memory of large freed arrays again. At first it returns freed arrays above 128 kB to
    the system, and takes memory for the next one anew, page by page. Once a larger array was freed, it keeps the memory of freed
    arrays up to that size (mallopt(3), M_MMAP_THRESHOLD): such an array is made and freed here; it takes no memory, since nothing
    is written to it. Then two more arrays are made together and freed: what they leave is marked by NumPy for large pages, so
    that memory comes in parts of 2 MB where the system has these (2 MB in pages of 4 kB cost 1 ms)."""
    import numpy as np

    np.empty(FREED, np.uint8)
    _together = [np.empty(FREED - 2**20, np.uint8) for _ in range(2)]


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


def of_user(found: TracebackType | None) -> TracebackType | None:
    """A traceback without the lines of mbdae, which say nothing of what the user did; with them where MBDAE_TRACEBACK is set."""
    if "MBDAE_TRACEBACK" in os.environ:
        return found
    kept = list[TracebackType]()
    while found is not None:
        kept += [found] if not found.tb_frame.f_code.co_filename.startswith(os.path.dirname(__file__)) else []
        found = found.tb_next
    made = None
    for part in reversed(kept):
        made = TracebackType(made, part.tb_frame, part.tb_lasti, part.tb_lineno)
    return made


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


_local = threading.local()
#: for every cache a list with one entry, the cached function in use, and a function that makes it anew with an empty cache
_made: list[tuple[list[Any], Callable[[], Any]]] = []


def spends(kind: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator: the CPU time (s) of the calls is added to `kind` in `measured`, less the time of other kinds inside of them."""

    def decorated(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def counted(*args: P.args, **kwargs: P.kwargs) -> T:
            found: dict[str, float] | None = getattr(_local, "found", None)
            if found is None:
                return function(*args, **kwargs)
            inside, begin = _local.inside, time.process_time()
            _local.inside = 0.0
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.process_time() - begin
                found[kind] = found.get(kind, 0.0) + whole - _local.inside
                _local.inside = inside + whole

        return counted

    return decorated


def made_once(kind: str, most: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator: a cache of at most `most` results; the CPU time of computing a result counts as `kind`."""

    def decorated(function: Callable[P, T]) -> Callable[P, T]:
        body = spends(kind)(function)
        cell = [lru_cache(maxsize=most)(body)]
        _made.append((cell, lambda: lru_cache(maxsize=most)(body)))

        @wraps(function)
        def once(*args: P.args, **kwargs: P.kwargs) -> T:
            return cell[0](*args, **kwargs)  # type: ignore[arg-type]

        once.cache_clear = lambda: cell[0].cache_clear()  # type: ignore[attr-defined]
        return once

    return decorated


@contextmanager
def measured() -> Iterator[dict[str, float]]:
    """CPU time (s) by kind of the work in this thread inside of the context; "other" is the rest."""
    found: dict[str, float] = {}
    _local.found, _local.inside, begin = found, 0.0, time.process_time()
    try:
        yield found
    finally:
        found["other"] = time.process_time() - begin - _local.inside
        _local.found = None


@contextmanager
def cold() -> Iterator[None]:
    """Context that begins with empty caches, as a new process does; afterwards the earlier caches are in use again."""
    before = [cell[0] for cell, _ in _made]
    for cell, empty in _made:
        cell[0] = empty()
    try:
        yield
    finally:
        for (cell, _), kept in zip(_made, before, strict=True):
            cell[0] = kept


def unchanging(value: T) -> T:
    """The value, whose arrays cannot be changed from now on."""
    for part in filter(lambda part: hasattr(part, "flags"), value if isinstance(value, tuple) else (value,)):
        part.flags.writeable = False
    return value


def keep_unchanged(cls: type) -> None:
    """Make arrays that properties of a class compute once such that cannot be changed: all who read them get the same ones."""
    def unchanged(found: Callable[[Any], T]) -> Callable[[Any], T]:
        return lambda owner: unchanging(found(owner))
    for member in vars(cls).values():
        if isinstance(member, cached_property):
            member.func = unchanged(member.func)
