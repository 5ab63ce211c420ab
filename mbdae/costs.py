"""CPU seconds by what they are spent on, and what is made once per process: laws derived, kernels planned and compiled."""

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
_made: list[tuple[list[Any], Callable[[], Any]]] = []  #: caches in use, and how an empty one is made


def spends(kind: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator: CPU s of the calls count as `kind` in `measured`, without those of other kinds inside."""

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
    """Decorator: results are kept, at most so many, and count as `kind` where they are made."""

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
    """CPU s by kind of what is done inside in this thread; the rest of it is "other"."""
    found: dict[str, float] = {}
    _local.found, _local.inside, begin = found, 0.0, time.process_time()
    try:
        yield found
    finally:
        found["other"] = time.process_time() - begin - _local.inside
        _local.found = None


@contextmanager
def cold() -> Iterator[None]:
    """Inside, nothing is made yet, as in a new process; afterwards everything is as it was."""
    before = [cell[0] for cell, _ in _made]
    for cell, empty in _made:
        cell[0] = empty()
    try:
        yield
    finally:
        for (cell, _), kept in zip(_made, before, strict=True):
            cell[0] = kept
