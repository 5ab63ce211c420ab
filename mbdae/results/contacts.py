"""The contacts of a run: when they begin and end, how deep they go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbdae.integrators.solution import Solution
from mbdae.system.base import Array
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared
from mbdae.system.start.contacts import ExpectedContact


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
    t, y = solution.t, solution.y
    turning = [time for pair in _places(prepared, t, y, expected) for time in _turning(t, *pair)]
    if turning:
        inside = np.unique(turning)
        t, y = np.concatenate([t, inside]), np.concatenate([y, solution(inside)])
        order = np.argsort(t, kind="stable")
        t, y = t[order], y[order]
    found = [contacts_of(t, *pair) for pair in _places(prepared, t, y, expected)]
    begin, end, peak = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(begin, kind="stable")
    return Contacts(begin[order], end[order], peak[order])


def _places(prepared: Prepared, t: Array, y: Array, expected: Sequence[ExpectedContact]) -> list[tuple[Array, Array]]:
    """Gaps and their rates (steps,) at every place of the laws."""
    gaps = gaps_of(prepared.mechanics, t, *prepared.states(t, y)[:2])
    return [(gap, rate) for one in expected for gap, rate in zip(*(part.T for part in gaps[one.place]), strict=True)]


def _turning(t: Array, gap: Array, rate: Array) -> list[float]:
    """Times (s) inside steps at which the cubic through a gap that is open at both ends is closed and smallest."""
    found = []
    for i in np.flatnonzero((gap[:-1] >= 0) & (gap[1:] >= 0) & (rate[:-1] < 0) & (rate[1:] > 0)):
        part, least = _minimum(_hermite(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]))
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
            for a, b in zip(begin, end, strict=True)]  # fmt: skip
    return begin, end, np.array(peak)


def _hermite(t: Array, g: Array, r: Array) -> Array:
    """Coefficients (4,) of the cubic through values and rates at both ends, highest power first, over 0..1."""
    h = t[1] - t[0]
    a, b = r[0] * h, r[1] * h
    return np.array([2 * (g[0] - g[1]) + a + b, 3 * (g[1] - g[0]) - 2 * a - b, a, g[0]])


def _zero(t: Array, g: Array, r: Array) -> float:
    """Time between two steps at which the gap changes sign, s."""
    roots = np.roots(_hermite(t, g, r))
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real >= 0) & (real <= 1)]
    share = float(inside[0]) if len(inside) else float(g[0] / (g[0] - g[1]))
    return float(t[0] + share * (t[1] - t[0]))


def _deepest(t: Array, gap: Array, rate: Array) -> Array:
    """(steps,) largest penetration inside every step."""
    depth = np.maximum(-gap[:-1], -gap[1:])
    for i in np.flatnonzero((rate[:-1] < 0) & (rate[1:] > 0) & (np.minimum(gap[:-1], gap[1:]) < 0)):
        depth[i] = max(depth[i], -_minimum(_hermite(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]))[1])
    return np.maximum(depth, 0.0)


def _minimum(c: Array) -> tuple[float, float]:
    """Place inside 0 to 1 and value of the least turning point of a cubic (4,); infinite where there is none."""
    turning = np.roots(np.polyder(c))
    inside = turning[(np.abs(turning.imag) < 1e-9) & (turning.real > 0) & (turning.real < 1)].real
    return min(((float(x), float(np.polyval(c, x))) for x in inside), key=lambda found: found[1], default=(0.5, np.inf))
