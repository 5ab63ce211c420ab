"""Memory while modules are imported and scenes prepared: no passes of Python's collector, and freed memory is used again."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
REUSED = 2**24  #: bytes of an array up to which its memory is used again; larger ones that are freed go back to the system


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
    """Free one large array that was never touched. The allocator of glibc concludes that arrays of this size come and go, and
    keeps the memory of freed ones for the next (mallopt(3), M_MMAP_THRESHOLD); before that it returns all above 128 kB to the
    system and takes them anew, page by page, 0.5 ms for each MB."""
    import numpy as np

    np.empty(REUSED, np.uint8)
