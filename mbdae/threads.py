"""One BLAS thread for small matrices.

Matrices of a hundred unknowns gain nothing from several threads, and where the machine is busy the threads wait for
each other: a run of 0.1 s was seen to take 13 s of CPU on two loaded cores.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar

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

    def __enter__(self) -> None:
        with self.lock:
            self.depth += 1
            self.limit()

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self.depth -= 1
            while self.limits and not self.depth:
                self.limits.pop().restore_original_limits()

    def limit(self) -> None:
        """Limit the libraries loaded so far."""
        controller = _controller("scipy.linalg" in sys.modules)
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
