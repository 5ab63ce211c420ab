"""CPU time (s) by kind of work, and caches of what is made once per process: derived laws, planned and compiled kernels."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
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
