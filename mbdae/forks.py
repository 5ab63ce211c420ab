"""Processes that are forked while other threads work.

A forked process has the thread that forked alone. Locks that other threads held stay locked in it for ever, so they are made anew
(`in_forked_process`); a module that another thread is importing would stay half imported, so forking waits until none is.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable
from functools import cached_property
from threading import RLock, active_count, get_ident

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
