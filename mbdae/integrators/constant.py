"""Steps of constant length: what Radau IIA and generalised-alpha share."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import ceil
from typing import Any, Protocol

import numpy as np

from mbdae.integrators.arguments import Inside
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.radau_step import StepFailedError
from mbdae.integrators.watch import watch_of
from mbdae.system.base import Array, System

#: changes of an unknown over its magnitude that constant steps are not expected to follow
FOLLOWED = 1e-9


class Stepping(Protocol):
    """The state of an integration: time, and the unknowns at the end of the step just solved."""

    t: float

    def reached(self) -> Array:
        """y (n,) at the end of the step."""


def constant_steps(system: System, loop: StepLoop, h: float, step: Stepping, solve: Callable[[float], Any],
                   advance: Callable[[float, float], tuple[Any, ...]],
                   inside: Callable[[float], Inside],
                   inner: Callable[[float], list[tuple[float, Array]]] = lambda _: []) -> None:  # fmt: skip
    """Steps of h to the end; a last one that differs from h by round-off counts as equal.

    solve(h): solve a step; advance(h, t1): take it, what `loop.accept` wants; inside(h): the polynomial of the step just
    solved; inner(h): times and states within it, where hidden contacts are looked for.
    """
    t0 = float(system.t0)
    count = max(1, ceil((loop.t_end - t0) / h - 1e-6))
    watch = watch_of(system, loop.stats, lambda y: FOLLOWED * (np.abs(y) + system.scale))
    for k in range(1, count + 1):
        last = k == count
        rest = loop.t_end - step.t
        width = rest if last and abs(rest - h) > 1e-6 * h else h
        try:
            solve(width)
        except StepFailedError as error:
            text = f"Newton's method fails with step = {h:g} s, try another one: {error}"
            raise loop.failure(text, error.culprit) from error
        t1 = loop.t_end if last else t0 + k * h
        if watch is not None:
            watch.look(t1, step.reached(), inside(width))
            watch.count_hidden(partial(inner, width))
            watch.keep()
        if not loop.accept(*advance(width, t1)):
            return
