"""The largest magnitude of a quantity in a run, between the result's times too, with its error."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

import numpy as np

from mbdae.deferred import distinct
from mbdae.results.quantities import Quantity, magnitudes, named, unit_of, value
from mbdae.system.base import Array

#: number of equal parts of every step; the quantity is evaluated at the begin of each and just before the end of the step
INSIDE = 6
#: largest number of times, of those at which the quantity was evaluated, around which its largest value is sought more closely
BEST = 5
FINER, ROUNDS = 9, 12  #: number of times per round of a closer search, and of its rounds
#: distance from the end of a step, over its length, of the last time read inside it: accelerations may jump at its end
JUST = 1e-9
#: with more than MANY steps those alone are looked into in which a larger value can be. A parabola rises above the ends of a step
#: by an eighth of its second difference; CURVED is four times that
MANY, CURVED = 1000, 0.5
MOST = 4096  #: largest number of times that are read at once
DIGITS, FEWEST = 6, 3  #: largest and smallest number of digits of a value printed with its error


class _Peak(NamedTuple):
    value: float
    t: float
    unit: str = ""
    sensor: str = ""


class Peak(_Peak):
    """value: the largest magnitude (of a vector its length); t: its time, s; unit; sensor: what was asked for.

    error: estimated error of the value, in its unit, from the runs made beside this one; None where there were none. It is no
    part of the tuple."""

    error: float | None

    def __new__(cls, value: float, t: float, unit: str = "", sensor: str = "", error: float | None = None) -> Self:
        made = super().__new__(cls, value, t, unit, sensor)
        made.error = error
        return made

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        known = "" if self.error is not None else ", its error is not known"
        return f"<Peak of {self.sensor}: {with_error(self.value, self.error)}{unit} at t = {self.t:.6g} s{known}>"


def with_error(value: float, error: float | None) -> str:
    """A value with as many digits as its error leaves, at least three, and the error: "26.60 +- 0.02"; alone where that is 0."""
    if not error or not math.isfinite(value) or not math.isfinite(error):
        return f"{value:.{DIGITS}g}" + (f" +- {error:.1g}" if error else "")
    last = math.floor(math.log10(float(f"{error:.0e}")))  # decimal place of the first digit of the error
    first = math.floor(math.log10(abs(value))) if value else last
    digits = min(max(first - last + 1, FEWEST), DIGITS)
    short = f"{error:.1g}" if digits > FEWEST else f"{error:.2g}"
    plain = "e" not in short or not -4 <= last < DIGITS
    return f"{_padded(value, digits)} +- {short if plain else f'{float(short):.{max(-last, 0)}f}'}"


def _padded(value: float, digits: int) -> str:
    """A value with so many significant digits, zeros at their end too."""
    first = math.floor(math.log10(abs(value))) if value else 0
    places = digits - 1 - first
    if not -4 <= first < DIGITS:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, places):.{max(places, 0)}f}"


def peak(result: Any, quantity: Quantity) -> Peak:
    """The largest magnitude of a quantity from the first of the result's times to the last, evaluated inside every step of the
    run and then searched more closely where it is largest."""
    unit, name = unit_of(result, quantity), named(quantity)
    found: tuple[float, float] | None = result._peaks.get(quantity) if isinstance(quantity, str) else None
    if found is None:
        with result._silently():
            found = largest(result, quantity, float(result.t[0]), float(result.t[-1]))
        if isinstance(quantity, str):  # what a function reads may change
            result._peaks[quantity] = found
    error = result._judge_peak(quantity, *found) if math.isfinite(found[0]) else None
    return Peak(*found, unit, name, error)


def largest(result: Any, quantity: Quantity, first: float, last: float) -> tuple[float, float]:
    """The largest magnitude of a quantity between two times (s), and its time; nan where it has no finite value."""
    steps = result.solution.t
    steps = distinct(np.r_[first, steps[(steps > first) & (steps < last)], last])
    times = _inside(steps, _where_it_may_be(result, quantity, steps))
    found = sizes(result, quantity, times)
    if not np.isfinite(found).any():
        return float("nan"), float("nan")
    top = int(np.nanargmax(found))
    best = float(found[top]), float(times[top])
    near = np.argsort(np.nan_to_num(found, nan=-np.inf))[::-1][:BEST]
    low, high = times[np.maximum(near - 1, 0)], times[np.minimum(near + 1, len(times) - 1)]
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, FINER)  # one column around each of the best
        seen = np.nan_to_num(sizes(result, quantity, grid.ravel()).reshape(grid.shape), nan=-np.inf)
        k, column = np.argmax(seen, axis=0), np.arange(len(near))
        i = int(np.argmax(seen[k, column]))
        best = max(best, (float(seen[k[i], i]), float(grid[k[i], i])))
        low, high = grid[np.maximum(k - 1, 0), column], grid[np.minimum(k + 1, FINER - 1), column]
    return best


def _where_it_may_be(result: Any, quantity: Quantity, steps: Array) -> Any:
    """(k,) numbers of the steps in which the largest magnitude may be: with many of them those whose values at the begin and the
    end, with CURVED times what the quantity bends in the step or its neighbours, reach the largest value seen there."""
    every, h = np.arange(len(steps) - 1), np.diff(steps)
    if len(every) <= MANY:
        return every
    values = _read(result, quantity, np.c_[steps[:-1], steps[1:] - JUST * h].ravel())
    size = np.nan_to_num(magnitudes(values), nan=np.inf)  # what is not known is looked at
    slope = (np.diff(values, axis=0)[::2].T / h).T
    turned = np.pad(np.nan_to_num(magnitudes(np.diff(slope, axis=0)), nan=np.inf), 1)
    reached = size.reshape(-1, 2).max(axis=1) + CURVED * h * np.maximum(turned[:-1], turned[1:])
    return every[reached >= np.max(size, where=np.isfinite(size), initial=0.0)]


def _inside(steps: Array, of: Any) -> Array:
    """Times at which a quantity is evaluated in the steps with the numbers `of`."""
    shares = np.r_[np.arange(INSIDE) / INSIDE, 1 - JUST]
    return np.asarray(distinct(np.r_[(steps[of, None] + (steps[of + 1] - steps[of])[:, None] * shares).ravel(), steps[of + 1]]))


def sizes(result: Any, quantity: Quantity, times: Array) -> Array:
    """(k,) magnitudes at times (k,)."""
    return magnitudes(_read(result, quantity, times))


def _read(result: Any, quantity: Quantity, times: Array) -> Array:
    """(k, ...) values at times (k,)."""
    return np.concatenate([value(result(times[i : i + MOST]), quantity) for i in range(0, len(times), MOST)])
