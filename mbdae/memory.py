"""Memory while modules are imported and scenes prepared: no passes of Python's collector, and freed memory is used again."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
FREED = 31 * 2**20  #: bytes of an array up to which its memory is used again: what glibc takes at most, 32 MB


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
    """Free large arrays that were never touched, which takes no memory. From the first the allocator of glibc concludes that
    arrays of its size come and go, and keeps the memory of freed ones for the next (mallopt(3), M_MMAP_THRESHOLD); before that
    it returns all above 128 kB to the system and takes them anew, page by page. The others, which are there at the same time,
    leave room that NumPy has declared for large pages: where the system has them, memory comes in parts of 2 MB; in pages of
    4 kB every 2 MB cost 1 ms."""
    import numpy as np

    np.empty(FREED, np.uint8)
    _together = [np.empty(FREED - 2**20, np.uint8) for _ in range(2)]
