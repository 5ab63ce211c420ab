"""Memory while modules are imported and scenes prepared: no passes of Python's collector, and freed memory is used again."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

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
