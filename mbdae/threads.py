"""One BLAS thread for small matrices.

Matrices of a hundred unknowns gain nothing from several threads, and where the machine is busy the threads wait for
each other: a run of 0.1 s was seen to take 13 s of CPU on two loaded cores.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@lru_cache(maxsize=2)
def _controller(with_scipy: bool) -> Any:
    """The BLAS libraries loaded so far; SciPy brings one of its own, loaded later."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread() -> Any:
    """Context in which BLAS uses one thread."""
    controller = _controller("scipy.linalg" in sys.modules)
    if all(library.num_threads == 1 for library in controller.lib_controllers if library.user_api == "blas"):
        return nullcontext()  # a limit costs as much as a short run
    return controller.limit(limits=1, user_api="blas")


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
