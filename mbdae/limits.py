"""The present call of `Scene.simulate` in this thread: how long it may take, and the run that came furthest.

The limit of wall time holds in every phase: whatever may take long calls `check` now and then, or makes runs, which do. A run
that is complete is noted by `came`, so that it is not lost where Ctrl-C comes while its error is estimated."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from math import inf
from typing import Any

from mbdae.errors import WallClockError


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
                             f"what is asked", reached, "", call.solution)  # fmt: skip


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
