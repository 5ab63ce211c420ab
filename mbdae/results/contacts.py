"""The largest magnitude of a quantity in a run, between the result's times too, and its mean, with their errors.

The contacts of a run: when they begin and end, how deep they go.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from mbdae.deferred import Later, distinct
from mbdae.integrators.solution import Solution
from mbdae.results.quantities import Quantity, magnitudes, named, unit_of, value
from mbdae.results.states import inside
from mbdae.system.base import Array
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared
from mbdae.system.start_with_contacts import ExpectedContact

if TYPE_CHECKING:
    from mbdae.integrators.contact_steps import Cubic
else:
    Cubic = Later("mbdae.integrators.contact_steps", "Cubic")

INSIDE = 6  #: equal parts of every step; the quantity is evaluated at the begin of each and just before the end of the step
BEST = 5  #: largest number of maxima among the values so far around which the largest one is sought more closely
#: a closer search: WHOLE times over what is left and NARROW times around the top of the parabola through the three highest, over
#: the part CLOSE of what is left; at most so many ROUNDS, until values differ by the fraction FLAT, which is near their round-off
WHOLE, NARROW, CLOSE, ROUNDS, FLAT = 9, 8, 1 / 64, 12, 1e-12
JUST = 1e-9  #: distance from the end of a step, over its length, of the last time read inside it: accelerations may jump there
#: with more than MANY steps those alone are looked into in which a larger value can be. A parabola rises above the ends of a step
#: by an eighth of its second difference; CURVED is four times that
MANY, CURVED = 1000, 0.5
GAUSS = 5  #: number of points in a step at which a mean reads its quantity
MOST = 4096  #: largest number of times that are read at once
#: of the tolerance, with which errors of runs with contact are taken to fall: at most the root. Two companions of a pin with play
#: showed a power of 1 or more, where the run was 4.6 times as far off as that power says
POWERS = np.linspace(0.15, 0.5, 40)
DIGITS, FEWEST, LONGEST = 6, 3, 12  #: number of digits of a value printed alone, smallest and largest one beside its error


class _Peak(NamedTuple):
    value: float
    t: float
    unit: str = ""
    sensor: str = ""


class Peak(_Peak):
    """value: the largest magnitude (of a vector its length); t: its time, s; unit; sensor: what was asked for;
    error: estimated error of the value, in its unit, from the runs made beside this one; None where there were none; lacks: what
    that does not contain, "mesh" or "". They are no part of the tuple."""

    error: float | None
    lacks: str

    def __new__(cls, value: float, t: float, unit: str = "", sensor: str = "", error: Any = None, lacks: str = "") -> Self:
        made = super().__new__(cls, value, t, unit, sensor)
        made.error, made.lacks = error, lacks
        return made

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        found = f"{with_error(self.value, self.error)}{unit} at t = {self.t:.6g} s"
        return f"<Peak of {self.sensor}: {found}{_known(self.error, self.lacks)}>"


def _known(error: float | None, lacks: str) -> str:
    return ", its error is not known" if error is None else f" without the error of the {lacks}" if lacks else ""


def with_error(value: float, error: float | None) -> str:
    """A value with as many digits as its error leaves, at least three, and the error: "26.60 +- 0.02"; alone where that is 0."""
    if not error or not math.isfinite(value) or not math.isfinite(error):
        return f"{value:.{DIGITS}g}" + (f" +- {error:.1g}" if error else "")
    last = math.floor(math.log10(float(f"{error:.0e}")))  # decimal place of the first digit of the error
    first = math.floor(math.log10(abs(value))) if value else last
    digits = min(max(first - last + 1, FEWEST), LONGEST)
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


@dataclass(frozen=True, repr=False)
class Mean:
    """value: mean of a quantity over an interval (of a vector its components), or root of the mean of its squares (a number);
    error: its estimated error, of a vector that of its length, None where no runs were made beside this one; unit; sensor;
    lacks: as of `Peak`."""

    value: Any
    error: float | None
    unit: str
    sensor: str
    lacks: str = ""

    def __repr__(self) -> str:
        value = with_error(self.value, self.error) if np.ndim(self.value) == 0 else f"{self.value} +- {self.error or 0.0:.2g}"
        return f"<{self.sensor}: {value}{f' {self.unit}' if self.unit else ''}{_known(self.error, self.lacks)}>"


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
    error = result._judge_part(quantity, _called("largest value", result), "of_peak", *found) if math.isfinite(found[0]) else None
    return Peak(*found, unit, name, error, (result.info and result.info.accuracy.lacks) or "")


def mean(result: Any, quantity: Quantity, power: int) -> Mean:
    """The mean of a quantity (power 1) or the root of the mean of its squares (2) from the first of the result's times to the
    last, by Gauss' rule in every step of the run; what a rule of lower order differs by counts to the error."""
    first, last, steps = float(result.t[0]), float(result.t[-1]), result.solution.t
    steps = distinct(np.r_[first, steps[(steps > first) & (steps < last)], last])
    with result._silently():
        found = [_mean(result, quantity, power, steps, points) for points in (GAUSS, GAUSS - 1)]
        size = float(np.max(sizes(result, quantity, np.r_[steps, (steps[1:] + steps[:-1]) / 2])))
    name = "mean" if power == 1 else "root mean square"
    error = result._judge_part(quantity, _called(name, result), "of_mean", size, power) if math.isfinite(size) else None
    error = None if error is None else error + float(np.linalg.norm(found[0] - found[1]))
    value = float(found[0]) if np.ndim(found[0]) == 0 else found[0]
    lacks = (result.info and result.info.accuracy.lacks) or ""
    return Mean(value, error, unit_of(result, quantity), f"{name} of {named(quantity)}", lacks)


def averaged(t: Array, values: Array, begin: float, length: float) -> float:
    """The largest integral of values (k, n) at times t (k,), s, from `begin` up to any of them, over at least `length` (s)."""
    sums = np.cumsum((values + np.r_[values[:1], values[:-1]]) * np.diff(np.r_[begin, t])[:, None] / 2, axis=0)
    return float(np.max(np.linalg.norm(sums, axis=1)) / max(length, t[-1] - begin))


def _called(read: str, result: Any) -> str:
    """What was read, with the part of the run in which, where it is not the whole."""
    (first, last), ends = result.t[[0, -1]], result.solution.t[[0, -1]]
    return read if (first, last) == tuple(ends) else f"{read} from {first:.6g} to {last:.6g} s"


def _mean(result: Any, quantity: Quantity, power: int, steps: Array, points: int) -> Any:
    at, weights = np.polynomial.legendre.leggauss(points)
    half = np.diff(steps)[:, None] / 2
    values = _read(result, quantity, ((steps[:-1] + steps[1:])[:, None] / 2 + half * at).ravel())
    values = values if power == 1 else magnitudes(values) ** power
    found = np.tensordot((half * weights).ravel() / (steps[-1] - steps[0]), values, 1)
    return found if power == 1 else found ** (1 / power)


def largest(result: Any, quantity: Quantity, first: float, last: float) -> tuple[float, float]:
    """The largest magnitude of a quantity between two times (s), and its time; nan where it has no finite value."""
    steps, last = result.solution.t, inside(first, last, result.solution)
    steps = distinct(np.r_[first, steps[(steps > first) & (steps < last)], last])
    times = _inside(steps, _where_it_may_be(result, quantity, steps))
    found = sizes(result, quantity, times)
    if not np.isfinite(found).any():
        return float("nan"), float("nan")
    top = int(np.nanargmax(found))
    best = float(found[top]), float(times[top])
    known = np.nan_to_num(found, nan=-np.inf)
    around = np.pad(known, 1, constant_values=-np.inf)
    near = np.flatnonzero((known >= around[:-2]) & (known >= around[2:]))
    near = near[np.argsort(known[near])[::-1][:BEST]]
    grid, seen, k, column = times[:, None], known[:, None], near, np.zeros(len(near), np.intp)
    for _ in range(ROUNDS):
        three = np.clip(k + np.array([[-1], [0], [1]]), 0, len(grid) - 1)
        (low, _, high), at = grid[three, column], _top(grid[three, column], seen[three, column])
        closely = at + CLOSE * (high - low) * np.linspace(-1, 1, NARROW)[:, None]
        grid = np.sort(np.clip(np.concatenate([np.linspace(low, high, WHOLE), closely]), low, high), axis=0)
        seen = np.nan_to_num(sizes(result, quantity, grid.ravel()).reshape(grid.shape), nan=-np.inf)
        k, column = np.argmax(seen, axis=0), np.arange(grid.shape[1])  # one column around each of the best
        i = int(np.argmax(seen[k, column]))
        best = max(best, (float(seen[k[i], i]), float(grid[k[i], i])))
        differ = np.ptp(seen, axis=0)
        open_ = (seen[k, column] + differ >= best[0]) & (differ > FLAT * best[0])  # the others are lower, or found
        if not open_.any():
            break
        k, column = k[open_], column[open_]
    return best


def _top(t: Array, values: Array) -> Array:
    """Times (k,) of the tops of parabolas through three values each (3, k); that of the second value where there is none."""
    with np.errstate(all="ignore"):
        slope = np.diff(values, axis=0) / np.diff(t, axis=0)
        at = (t[0] + t[1]) / 2 - slope[0] * (t[2] - t[0]) / (2 * (slope[1] - slope[0]))
    return np.asarray(np.where((slope[0] >= 0) & (slope[1] < 0) & np.isfinite(at), at, t[1]))


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
    """Times at which a quantity is evaluated in the steps with the numbers `of`; the last one also where there is no step."""
    shares = np.r_[np.arange(INSIDE) / INSIDE, 1 - JUST]
    inner = (steps[of, None] + (steps[of + 1] - steps[of])[:, None] * shares).ravel()
    return np.asarray(distinct(np.r_[inner, steps[of + 1], steps[-1]]))


def sizes(result: Any, quantity: Quantity, times: Array) -> Array:
    """(k,) magnitudes at times (k,)."""
    return magnitudes(_read(result, quantity, times))


def _read(result: Any, quantity: Quantity, times: Array) -> Array:
    """(k, ...) values at times (k,)."""
    return np.concatenate([value(result(times[i : i + MOST]), quantity) for i in range(0, len(times), MOST)])


def fallen(far: tuple[float, float], near: tuple[float, float]) -> float:
    """The error e of a run from its differences to two companions, each with its tolerance over that of the run: with r times the
    tolerance it is r^p e, where p follows from both; where none fits both, the larger e counts; at most the larger difference."""
    (wide, far_ratio), (close, near_ratio) = max(far, near, key=lambda one: one[1]), min(far, near, key=lambda one: one[1])
    if close <= 0 or near_ratio <= 1:
        return 0.0 if close <= 0 else max(wide, close)
    shown = (far_ratio**POWERS - 1) / (near_ratio**POWERS - 1)  # rises with the power
    p = POWERS[int(np.clip(np.searchsorted(shown, wide / close), 0, len(POWERS) - 1))]
    return float(min(max(close / (near_ratio**p - 1), wide / (far_ratio**p - 1)), max(wide, close)))


@dataclass(frozen=True, repr=False)
class Contacts:
    """All contacts of a run in order of time, also those between the result's times: begin, end (s), peak penetration (m; rad at
    limits of an angle), (n,).

    A contact that lasts to the end of the run ends there; contacts at the two ends of a bearing are counted each."""

    begin: Array
    end: Array
    peak: Array

    def __len__(self) -> int:
        return len(self.begin)

    def __repr__(self) -> str:
        if not len(self):
            return "<0 contacts>"
        return f"<{len(self)} contacts, the first at {self.first:g} s, deepest {self.deepest:.3g}; begin, end, peak>"

    @property
    def first(self) -> float:
        """Time of the first contact, s; nan where there is none."""
        return float(self.begin[0]) if len(self.begin) else float("nan")

    @property
    def deepest(self) -> float:
        """Largest penetration, m or rad; 0 where there is none."""
        return float(np.max(self.peak, initial=0.0))


def contacts_at(prepared: Prepared, solution: Solution, expected: Sequence[ExpectedContact]) -> Contacts:
    """The contacts of one or several one-sided laws, found on the steps of a run and where a gap may turn inside a step."""
    return _in_order([(c.begin, c.end, c.peak) for c in contacts_of_each(prepared, solution, expected).values()])


def _in_order(found: Sequence[tuple[Array, Array, Array]]) -> Contacts:
    begin, end, peak = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(begin, kind="stable")
    return Contacts(begin[order], end[order], peak[order])


def contacts_of_each(prepared: Prepared, solution: Solution,
                     expected: Sequence[ExpectedContact]) -> dict[tuple[int, int], Contacts]:
    """Place of a law in its model -> its contacts, as `contacts_at` finds them; each gap is evaluated once for all laws."""
    t, y = solution.t, solution.y
    turning = [time for one in _places(prepared, t, y, expected).values() for pair in one for time in _turning(t, *pair)]
    if turning:
        inside = np.unique(turning)
        t, y = np.concatenate([t, inside]), np.concatenate([y, solution(inside)])
        order = np.argsort(t, kind="stable")
        t, y = t[order], y[order]
    return {place: _in_order([contacts_of(t, *pair) for pair in pairs])
            for place, pairs in _places(prepared, t, y, expected).items()}


def _places(prepared: Prepared, t: Array, y: Array,
            expected: Sequence[ExpectedContact]) -> dict[tuple[int, int], list[tuple[Array, Array]]]:
    """Gaps and their rates (steps,) at every place of every law."""
    gaps = gaps_of(prepared.mechanics, t, *prepared.states(t, y)[:2])
    return {one.place: list(zip(*(part.T for part in gaps[one.place]), strict=True)) for one in expected}


def _turning(t: Array, gap: Array, rate: Array) -> list[float]:
    """Times (s) inside steps at which the cubic through a gap that is open at both ends is closed and smallest."""
    found = []
    for i in np.flatnonzero((gap[:-1] >= 0) & (gap[1:] >= 0) & (rate[:-1] < 0) & (rate[1:] > 0)):
        part, least = _cubic(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]).minimum()
        if least < 0:
            found.append(float(t[i] + part * (t[i + 1] - t[i])))
    return found


def contacts_of(t: Array, gap: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Begin, end and peak penetration (n,) of the contacts at one place, from gap and rate (steps,) by cubic interpolation."""
    touching = gap < 0
    change = np.flatnonzero(np.diff(touching.astype(int)))
    times = np.array([_zero(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]) for i in change])
    begin = np.r_[t[:1] if touching[0] else [], times[touching[change + 1]]] if len(change) else t[:1] if touching[0] else t[:0]
    end = times[~touching[change + 1]] if len(change) else t[:0]
    end = np.r_[end, t[-1:]] if touching[-1] else end
    depth = _deepest(t, gap, rate)
    peak = [np.max(depth[max(np.searchsorted(t, a, "right") - 1, 0) : max(np.searchsorted(t, b, "left"), 1)], initial=0.0)
            for a, b in zip(begin, end, strict=True)]
    return begin, end, np.array(peak)


def _cubic(t: Array, g: Array, r: Array) -> Cubic:
    """The cubic through gaps and their rates at both ends of a step."""
    return Cubic(float(t[1] - t[0]), *g.tolist(), *r.tolist())


def _zero(t: Array, g: Array, r: Array) -> float:
    """Time between two steps at which the gap changes sign, s."""
    opens = g[0] < 0  # the same seen from the end of the step
    share = 1 - _cubic(-t[::-1], g[::-1], -r[::-1]).zero(1.0) if opens else _cubic(t, g, r).zero(1.0)
    return float(t[0] + share * (t[1] - t[0]))


def _deepest(t: Array, gap: Array, rate: Array) -> Array:
    """(steps,) largest penetration inside every step."""
    depth = np.maximum(-gap[:-1], -gap[1:])
    for i in np.flatnonzero((rate[:-1] < 0) & (rate[1:] > 0) & (np.minimum(gap[:-1], gap[1:]) < 0)):
        depth[i] = max(depth[i], -_cubic(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]).minimum()[1])
    return np.maximum(depth, 0.0)
