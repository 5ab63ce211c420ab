"""The largest magnitude of a quantity in a run, between the result's times too."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import distinct
from mbdae.results.quantities import Quantity, named, unit_of, value
from mbdae.system.base import Array

#: number of equal parts of every step; the quantity is evaluated at the begin of each and just before the end of the step
INSIDE = 6
#: largest number of times, of those at which the quantity was evaluated, around which its largest value is sought more closely
BEST = 5
FINER, ROUNDS = 9, 12  #: number of times per round of a closer search, and of its rounds
#: distance from the end of a step, over its length, of the last time read inside it: accelerations may jump at its end
JUST = 1e-9
MOST = 4096  #: largest number of times that are read at once


class Peak(NamedTuple):
    """value: the largest magnitude (of a vector its length); t: its time, s; unit; sensor: what was asked for."""

    value: float
    t: float
    unit: str = ""
    sensor: str = ""

    def __repr__(self) -> str:
        return f"<Peak of {self.sensor}: {self.value:.6g}{f' {self.unit}' if self.unit else ''} at t = {self.t:.6g} s>"


def peak(result: Any, quantity: Quantity) -> Peak:
    """The largest magnitude of a quantity from the first of the result's times to the last, evaluated inside every step of the
    run and then searched more closely where it is largest."""
    first, last = float(result.t[0]), float(result.t[-1])
    steps = result.solution.t
    steps = distinct(np.r_[first, steps[(steps > first) & (steps < last)], last])
    shares = np.r_[np.arange(INSIDE) / INSIDE, 1 - JUST]
    times = distinct(np.r_[(steps[:-1, None] + np.diff(steps)[:, None] * shares).ravel(), last])
    found = _sizes(result, quantity, times)
    if not np.isfinite(found).any():
        return Peak(float("nan"), float("nan"), unit_of(result, quantity), named(quantity))
    top = int(np.nanargmax(found))
    best = float(found[top]), float(times[top])
    for i in np.argsort(np.nan_to_num(found, nan=-np.inf))[::-1][:BEST]:
        low, high = times[max(i - 1, 0)], times[min(i + 1, len(times) - 1)]
        for _ in range(ROUNDS):
            near = np.linspace(low, high, FINER)
            sizes = _sizes(result, quantity, near)
            k = int(np.nanargmax(sizes)) if np.isfinite(sizes).any() else 0
            best = max(best, (float(sizes[k]), float(near[k])))
            low, high = near[max(k - 1, 0)], near[min(k + 1, FINER - 1)]
    return Peak(*best, unit_of(result, quantity), named(quantity))


def _sizes(result: Any, quantity: Quantity, times: Array) -> Array:
    """(k,) magnitudes at times (k,)."""
    parts = []
    for i in range(0, len(times), MOST):
        found = value(result(times[i : i + MOST]), quantity)
        parts.append(np.abs(found) if found.ndim == 1 else np.linalg.norm(found.reshape(len(found), -1), axis=1))
    return np.concatenate(parts)
