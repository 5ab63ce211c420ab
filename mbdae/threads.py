"""One BLAS thread for small matrices; equations that one thread runs at a time.

Matrices of a hundred unknowns gain nothing from several threads, and where the machine is busy the threads wait for
each other: a run of 0.1 s was seen to take 13 s of CPU on two loaded cores.

The present call of `Scene.simulate` in this thread: how long it may take, and the run that came furthest.

How processes start: without the working directory on their path, and without signals.

The limit of wall time holds in every phase: whatever may take long calls `check` now and then, or makes runs, which do. A run
that is complete is noted by `came`, so that it is not lost where Ctrl-C comes while its error is estimated.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache, partial, wraps
from math import inf
from threading import Lock, RLock, local
from typing import Any, ParamSpec, TypeVar, cast

from mbdae.errors import OptionError, WallClockError
from mbdae.process import in_forked_process

SAFE_PATH = "PYTHONSAFEPATH"
EVALUATION = 0.1  #: time (s) after which a thread that waits for an evaluation by another one looks whether that makes a run
P = ParamSpec("P")
T = TypeVar("T")


@lru_cache(maxsize=2)
def _controller(with_scipy: bool) -> Any:
    """Controller of the BLAS libraries loaded so far; SciPy loads one of its own, for which a new controller is made."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


class _OneThread:
    """Nested contexts in which BLAS uses one thread; the limit is removed at the end of the outermost one."""

    def __init__(self) -> None:
        self.depth, self.limits, self.lock = 0, list[Any](), Lock()
        self._limited: Any = None  # what was limited since the outermost context was entered
        self._here = local()  # depth of this thread

    def __enter__(self) -> None:
        with self.lock:
            self.depth += 1
            self._here.depth = getattr(self._here, "depth", 0) + 1
            self.limit()

    def forked(self) -> None:
        """Go on in a forked process, without the other threads."""
        self.lock, self.depth = Lock(), getattr(self._here, "depth", 0)

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self.depth -= 1
            self._here.depth -= 1
            while self.limits and not self.depth:
                self.limits.pop().restore_original_limits()

    def limit(self) -> None:
        """Limit the libraries loaded so far."""
        controller = _controller("scipy.linalg" in sys.modules)
        if self.depth > 1 and controller is self._limited:
            return
        self._limited = controller
        if any(library.num_threads != 1 for library in controller.lib_controllers if library.user_api == "blas"):
            self.limits.append(controller.limit(limits=1, user_api="blas"))  # only where needed: takes as long as a short run


_INSIDE = _OneThread()


def one_thread() -> _OneThread:
    """Context in which BLAS uses one thread."""
    return _INSIDE


def limit_what_was_loaded() -> None:
    """Inside of `one_thread`, limit the BLAS of a library that has just been imported too."""
    with _INSIDE.lock:
        if _INSIDE.depth:
            _INSIDE.limit()


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """The function with BLAS on one thread."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        with one_thread():
            return function(*args, **kwargs)

    return limited


def keep_one_thread() -> None:
    """One BLAS thread for the rest of this process, in libraries that are loaded already and in those that will be."""
    from threadpoolctl import threadpool_limits

    os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
    threadpool_limits(limits=1, user_api="blas")


class Owner:
    """The thread that runs or evaluates equations: runs of one System write to the same arrays. A copy of the equations by pickle
    or deepcopy has an owner of its own."""

    def __init__(self, what: str) -> None:
        """what: name of the equations in messages."""
        self.what = what
        self._begin()

    def _begin(self) -> None:
        self._lock, self._process, self._runs = RLock(), os.getpid(), 0  # runs: those inside each other

    def __reduce__(self) -> tuple[Any, ...]:
        return Owner, (self.what,)

    def taken(self) -> Any:
        """The lock of the equations, taken, to be released: it waits while another thread evaluates them. OptionError where
        another thread runs them."""
        if self._process != os.getpid():  # a thread that had taken it is in the process that this one was forked from
            self._begin()
        lock = self._lock
        while not lock.acquire(timeout=0 if self._runs else EVALUATION):
            if self._runs:
                raise OptionError(f"{self.what} is run by another thread: runs of one System at the same time would write to the "
                                  f"same arrays. Give every thread its own, by scene.system() or mb.DAE(...), or call "
                                  f"scene.simulate, which makes its own")
        return lock

    def alone(self, function: Callable[..., T], *args: Any) -> T:
        """An evaluation, which other threads wait for; WallClockError where the time of the present call is over."""
        check("the equations were evaluated")
        return self.waiting(function, *args)

    def waiting(self, function: Callable[..., T], *args: Any) -> T:
        """An evaluation, which other threads wait for."""
        lock = self.taken()
        try:
            return function(*args)
        finally:
            lock.release()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context of a run of the equations; OptionError where another thread runs them."""
        lock, before = self.taken(), self._runs
        self._runs = before + 1
        try:
            yield
        finally:
            self._runs = before
            lock.release()


def alone(method: Callable[P, T]) -> Callable[P, T]:
    """Decorator: an evaluation of a System that other threads wait for; refused where another thread runs it."""

    @wraps(method)
    def evaluated(*args: P.args, **kwargs: P.kwargs) -> T:
        system: Any = args[0]
        return cast(T, system.owner.alone(partial(method, **kwargs) if kwargs else method, *args))

    return evaluated


in_forked_process(_INSIDE.forked)


@dataclass
class Call:
    """max_wall: largest wall time (s); begin: of time.perf_counter(), which nobody sets; solution: the run that came furthest."""

    max_wall: float = inf
    begin: float = field(default_factory=lambda: time.perf_counter())
    solution: Any = None


_present: ContextVar[Call | None] = ContextVar("call", default=None)


@contextmanager
def limited(max_wall: float | None) -> Iterator[None]:
    """Context of a call that may take `max_wall` (s); None: as long as it needs, or as the call around it may."""
    outer = _present.get()
    call = Call() if max_wall is None else Call(max_wall)
    if outer is not None and outer.begin + outer.max_wall < call.begin + call.max_wall:
        call.begin, call.max_wall = outer.begin, outer.max_wall
    token = _present.set(call)
    try:
        yield
    finally:
        _present.reset(token)


def check(doing: str) -> None:
    """WallClockError where the time of the present call is over. doing: what goes on, in words."""
    call = _present.get()
    if call is not None and time.perf_counter() - call.begin > call.max_wall:
        reached = 0.0 if call.solution is None else float(call.solution.t[-1])
        raise WallClockError(f"max_wall = {call.max_wall:g} s of wall time is used up while {doing}: raise max_wall, or simplify "
                             f"what is asked", reached, "", call.solution)


def came(solution: Any) -> None:
    """Note a run that is complete: the one that came furthest from the start of the first one, of equals the last."""
    call = _present.get()
    if call is not None:
        best = call.solution
        if best is None or (solution.t[0] == best.t[0] and solution.t[-1] >= best.t[-1] and solution.names == best.names):
            call.solution = solution


def furthest() -> Any:
    """The run that came furthest in the present call; None where none is complete."""
    call = _present.get()
    return None if call is None else call.solution


# -- the start of a process


@contextmanager
def safe_path() -> Iterator[None]:
    """Context in which new Python processes start without the working directory on their path, where a file random.py would
    replace Python's module of this name."""
    before = os.environ.get(SAFE_PATH)
    set_variable(SAFE_PATH, "1")
    try:
        yield
    finally:
        set_variable(SAFE_PATH, before)


def set_variable(name: str, value: str | None) -> None:
    """Set an environment variable; remove it where the value is None."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


@contextmanager
def not_interrupted() -> Iterator[None]:
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
