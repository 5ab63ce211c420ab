"""Steps of constant length: what all methods that take them share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import ceil, inf
from typing import Any, Protocol

import numpy as np

from mbdae.integrators.loop import StepLoop
from mbdae.integrators.watched.arguments import Inside
from mbdae.integrators.watched.watch import StepWatch
from mbdae.system.base import Array, System

#: changes of an unknown over its magnitude that constant steps are not expected to follow
FOLLOWED = 1e-9


class StepFailedError(Exception):
    """A step could not be solved; culprit: name of the unknown or equation that resists."""

    def __init__(self, message: str, culprit: str = "") -> None:
        super().__init__(message)
        self.culprit = culprit


class Stepping(Protocol):
    """The state of an integration: time, and the unknowns at the end of the step just solved."""

    t: float

    def reached(self) -> Array:
        """y (n,) at the end of the step."""


def constant_steps(system: System, loop: StepLoop, h: float, step: Stepping, solve: Callable[[float], Any],
                   advance: Callable[[float, float], tuple[Any, ...]],
                   inside: Callable[[float], Inside],
                   inner: Callable[[float], list[tuple[float, Array]]] = lambda _: []) -> None:  # fmt: skip
    """Steps of h to the end; a last one that differs from h by round-off counts as equal. Steps that an input of time does not
    allow are divided.

    solve(h): solve a step; advance(h, t1): take it, what `loop.accept` wants; inside(h): the polynomial of the step just
    solved; inner(h): times and states within it, where hidden contacts are looked for.
    """
    count = max(1, ceil((loop.t_end - float(system.t0)) / h - 1e-6))
    watch = StepWatch.of(loop, lambda y: FOLLOWED * (np.abs(y) + system.scale))
    for t1, width, whole in _steps(system, loop, h, count, step):
        try:
            solve(width)
        except StepFailedError as error:
            text = f"a step of {width:g} s fails, try another step: {error}"
            raise loop.failure(text, error.culprit) from error
        loop.stats.shortened += not whole
        if watch is not None:
            watch.look(t1, step.reached(), inside(width))
            watch.count_hidden(partial(inner, width))
            watch.keep()
        if not loop.accept(*advance(width, t1)):
            return


def first_width(system: System, loop: StepLoop, h: float) -> float:
    """Length (s) of the first step from system.t0."""
    bound = inf if system.longest_step is None else system.longest_step(float(system.t0))
    return min(h, bound, loop.t_end - float(system.t0))


def _steps(system: System, loop: StepLoop, h: float, count: int, step: Stepping) -> Iterator[tuple[float, float, bool]]:
    """(end, width, whether it is a step of h) of every step; those longer than an input of time allows are divided."""
    t0 = float(system.t0)
    for k in range(1, count + 1):
        last = k == count
        goal = loop.t_end if last else t0 + k * h
        while (bound := inf if system.longest_step is None else system.longest_step(step.t)) < (goal - step.t) * (1 - 1e-6):
            width = (goal - step.t) / ceil((goal - step.t) / bound)
            yield step.t + width, width, False
        rest = goal - step.t
        whole = abs(rest - h) <= 1e-6 * h
        yield goal, h if whole else rest, whole
