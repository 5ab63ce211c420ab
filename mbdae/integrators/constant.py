"""Steps of constant length: what all methods that take them share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Any, Protocol

import numpy as np

from mbdae.integrators.loop import StepLoop
from mbdae.integrators.watched.watch import StepWatch
from mbdae.system.base import Array

#: changes of an unknown over its magnitude that constant steps are not expected to follow
FOLLOWED = 1e-9
#: parts of a step: lengths that differ by less are equal; a kink so near to the end of a step ends it in its stead
SAME, CLOSE = 1e-6, 1e-3


class StepFailedError(Exception):
    """A step could not be solved; culprit: name of the unknown or equation that resists."""

    def __init__(self, message: str = "a step cannot be solved", culprit: str = "") -> None:
        super().__init__(message)
        self.culprit = culprit


class Stepping(Protocol):
    """The state of an integration: time, and the unknowns at the end of the step just solved."""

    t: float

    def reached(self) -> Array:
        """y (n,) at the end of the step."""

    def inside(self, part: Array) -> Array:
        """y (k, n) on the polynomial of the step after parts (k,) of it, or (n,) after one."""

    def advance(self, h: float, t1: float) -> tuple[Any, ...]:
        """Take the step; returns what `loop.accept` wants."""


@dataclass
class Going:
    """Where a run with constant steps is."""

    step: Stepping
    watch: StepWatch | None


def constant_steps(loop: StepLoop, h: float, step: Stepping, solve: Callable[[float], Any], parts: Iterable[float] = ()) -> None:
    """Steps of h to the end; a last one that differs from h by round-off counts as equal. Steps that an input of time does not
    allow are divided.

    solve(h): solve a step; parts of it after which hidden contacts are looked for.
    """
    watch = StepWatch.of(loop, lambda y: FOLLOWED * (np.abs(y) + loop.system.scale))
    t0, going = step.t, Going(step, watch)
    loop.goes_on(going)

    def inner(width: float) -> list[tuple[float, Array]]:
        return [(step.t + part * width, step.inside(np.asarray(part))) for part in parts]

    for t1, width, whole in _steps(loop, h, step, t0):
        try:
            solve(width)
        except StepFailedError as error:
            text = f"a step of {width:g} s fails, try another step: {error}"
            raise loop.failure(text, error.culprit) from error
        loop.stats.shortened += not whole
        if watch is not None:
            watch.look(t1, step.reached(), step.inside)
            watch.count_hidden(partial(inner, width))
            watch.keep()
        if not loop.accept(*step.advance(width, t1)):
            return
        loop.keep(going)


def _steps(loop: StepLoop, h: float, step: Stepping, t0: float) -> Iterator[tuple[float, float, bool]]:
    """(end, width, whether it is a step of h) of every step that is left of those from t0; those longer than an input of time
    allows are divided, and end at kinks of tables."""
    longest = loop.system.longest_step
    count = max(1, ceil((loop.t_end - t0) / h - SAME))
    for k in range(1, count + 1):
        goal, least = (loop.t_end, 0.0) if k == count else (t0 + k * h, CLOSE * h)
        while goal - step.t > least:
            end, parts = goal, 1
            if longest is not None:
                kink = longest.kink_after(step.t, SAME * h)
                end = kink if kink < goal + (least or -SAME * h) else goal
                parts = max(1, ceil((end - step.t) / longest.of_stretches(step.t) - SAME))
            width = (end - step.t) / parts
            whole = abs(width - h) <= SAME * h
            yield end if parts == 1 else step.t + width, h if whole else width, whole
