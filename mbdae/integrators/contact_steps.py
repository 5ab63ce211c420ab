"""Steps around contacts: none is stepped over, none is entered by a step that is long against the impact.

Nothing of this exists where a system has no guards. A contact apart has gap > 0, one that is in contact gap < 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from mbdae.integrators.solution import Stats
from mbdae.system.base import Array, System

#: part of the way to the surface one step may go, and part of an impact one step may cover
APPROACH, IMPACT = 0.5, 0.2
#: part by which the penetration may change in a step longer than IMPACT: what lies at rest costs nothing
REST = 0.1
#: part by which a penetration may change before the Jacobian is of no use
CHANGE = 0.2
#: a minimum between two points apart below this part of the smaller gap may be a contact
MARGIN = 0.1
#: largest weight of a slope in a cubic Hermite polynomial on [0, 1]
SLOPE = 4 / 27
#: steps taken back at one place before what is found is taken as it is
RETRIES = 4
#: part of a step at either end within which a zero counts as met
MET = 1e-2
#: a step shorter than ROUND times the time is none
ROUND = 1e3 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Point:
    """Contacts at one time t (s): gap (m), its rate (m/s), duration (s) of an impact at this speed, each (nc,)."""

    t: float
    gap: Array
    rate: Array
    duration: Array

    def calm(self) -> Array:
        """(nc,) time in which the gap would change by itself, s."""
        return np.asarray(np.abs(self.gap) / (np.abs(self.rate) + 1e-300))


class ContactSteps:
    """The contacts of one run: how far the next step may go, and whether the step just made may be kept.

    A solver asks `bound` before a step, `hidden` (and `landing`) after it, and then calls `keep` or tries a shorter one.
    """

    def __init__(self, system: System, stats: Stats) -> None:
        self.system, self.stats = system, stats
        self._start = self._end = self._before = self._point(system.t0, system.y0)
        inside = self._start.gap < 0
        self._inside = np.where(inside, 1, 0)  # accepted points inside the present contact
        self._entered = np.zeros(len(inside), dtype=bool)  # and whether its beginning was seen
        self._stiff = np.minimum(self._start.gap, 0.0)  # penetrations the Jacobian in use is of
        self._retries = 0

    def _point(self, t: float, y: Array) -> Point:
        assert self.system.guards is not None
        gap, rate, duration = self.system.guards(t, y)
        return Point(t, np.asarray(gap, float), np.asarray(rate, float), np.asarray(duration, float))

    def bound(self) -> float:
        """Largest step from the last accepted point, s: half the way to the surface or a fifth of an impact."""
        here, before = self._start, self._before
        short = IMPACT * np.minimum(here.duration, before.duration)  # the speed, so the duration, turns in an impact
        calm = here.calm()
        inside = np.maximum(REST * np.minimum(calm, before.calm()), short)
        approaching = np.where(here.rate < 0, np.maximum(APPROACH * calm, short), inf)
        bound = float(np.min(np.where(here.gap < 0, inside, approaching), initial=inf))
        return max(bound, ROUND * abs(here.t))

    def look(self, t: float, y: Array) -> None:
        """Take the end of a step that was just made."""
        self._end = self._point(t, y)

    def hidden(self) -> float | None:
        """Time (s) at which the step should have ended: it hides a contact, or went deep into one. None: keep it."""
        found = self._first_hidden()
        if found is None:
            return None
        when, surely = found
        if self._retries >= RETRIES or when - self._start.t <= ROUND * abs(when):
            self.stats.missed_dips += surely
            return None
        self._retries += 1
        self.stats.dips += 1
        return when

    def count_hidden(self, inner: list[tuple[float, Array]]) -> None:
        """Count the contacts that came and went inside a constant step; inner: times and states between its ends."""
        a, b = self._start, self._end
        apart = (a.gap > 0) & (b.gap > 0)
        touched = np.zeros(len(apart), dtype=bool)
        for t, y in inner:
            touched |= self._point(t, y).gap < 0
        for i in np.flatnonzero(apart & ~touched & self._suspect(0.0)).tolist():
            touched[i] = hermite_minimum(*self._cubic(i))[1] < 0
        self.stats.missed_dips += int(np.count_nonzero(apart & touched))

    def shorter(self, h: float, inside: Callable[[float], Array]) -> float | None:
        """Width (s) the step of width h should have had, to end at what it hides or where a contact is made or lost.

        inside: y (n,) on the polynomial of the step after a part of it. None: keep the step.
        """
        when = self.hidden()
        if when is not None:
            return when - self._start.t
        crossed = np.flatnonzero((self._start.gap < 0) != (self._end.gap < 0))
        if not len(crossed) or self._retries >= RETRIES:
            return None
        parts = [self._zero(int(i), h, inside) for i in crossed]
        part = min((p for p in parts if MET < p < 1 - MET), default=0.0)
        if part == 0.0:
            return None
        self._retries += 1
        return part * h

    def _zero(self, i: int, h: float, inside: Callable[[float], Array]) -> float:
        """Part of the step at which contact i is made or lost, on the polynomial of the step."""

        def gap(part: float) -> float:
            point = self._start if part == 0.0 else self._end if part == 1.0 else self._point(t + part * h, inside(part))
            return float(point.gap[i])

        t = self._start.t
        return 0.0 if gap(0.0) == 0.0 else float(brentq(gap, 0.0, 1.0, xtol=0.01 * MET, rtol=1e-12))

    def keep(self) -> None:
        """The step is accepted: count."""
        self._before, self._start, self._retries = self._start, self._end, 0
        was, now = self._before.gap < 0, self._start.gap < 0
        if not (was.any() or now.any()):
            return
        made, lost = now & ~was, was & ~now & self._entered
        self.stats.contacts += int(np.count_nonzero(made))
        if lost.any():
            least = int(self._inside[lost].min())
            self.stats.shortest_contact = min(least, self.stats.shortest_contact or least)
        self._entered = (self._entered | made) & now
        self._inside = np.where(now, self._inside + 1, 0)

    def stiffness_changed(self) -> bool:
        """Whether a penetration has changed since this was last true: a Jacobian from before serves no more.

        The stiffness of a contact, kept after its end, makes every correction and every error estimate look small.
        """
        now, was = np.minimum(self._start.gap, 0.0), self._stiff
        if not (np.abs(now - was) > CHANGE * np.maximum(-now, -was)).any():
            return False
        self._stiff = now
        return True

    def nearest(self) -> str:
        """The contact a failure is about: the one that is reached first or is deepest in terms of its own speed."""
        here = self._start
        if not len(here.gap):
            return ""
        time = np.where(here.gap < 0, here.gap, here.calm() + np.where(here.rate < 0, 0.0, inf))
        i = int(np.argmin(time))
        names = self.system.guard_names
        name = names[i] if i < len(names) else f"contact[{i}]"
        return f"; nearest contact: {name}, gap {here.gap[i]:.2e} m, changing by {here.rate[i]:.2e} m/s"

    def _cubic(self, i: int) -> tuple[float, float, float, float, float]:
        """Width (s), gaps (m) and rates (m/s) at both ends of the step, of one contact."""
        a, b = self._start, self._end
        return b.t - a.t, float(a.gap[i]), float(b.gap[i]), float(a.rate[i]), float(b.rate[i])

    def _suspect(self, margin: float) -> NDArray[np.bool_]:
        """(nc,) whether the cubic can come below margin times the smaller gap; no other one can."""
        a, b = self._start, self._end
        drop = SLOPE * (b.t - a.t) * (np.maximum(-a.rate, 0) + np.maximum(b.rate, 0))
        return np.asarray((1 - margin) * np.minimum(a.gap, b.gap) < drop)

    def _first_hidden(self) -> tuple[float, bool] | None:
        """Earliest time at which a contact may be hidden, and whether one surely is."""
        a, b = self._start, self._end
        long = b.t - a.t > IMPACT * np.minimum(a.duration, b.duration)
        if not long.any():
            return None
        found: list[tuple[float, bool]] = []
        for i in np.flatnonzero(long & (a.gap > 0) & self._suspect(MARGIN)).tolist():
            cubic = self._cubic(i)
            part, least = (1.0, cubic[2]) if cubic[2] < 0 else hermite_minimum(*cubic)
            if least < MARGIN * min(cubic[1], cubic[2]) if cubic[2] >= 0 else True:
                part = hermite_zero(*cubic, part) if least < 0 else part
                if cubic[2] >= 0 or (1 - part) * cubic[0] > IMPACT * b.duration[i]:
                    found.append((a.t + part * cubic[0], least < 0))
        return min(found, default=None)


def hermite(s: float, h: float, g0: float, g1: float, r0: float, r1: float) -> float:
    """Cubic with values g0, g1 and slopes r0, r1 at the ends of a step h, at the part s of it."""
    return g0 + s * s * (3 - 2 * s) * (g1 - g0) + h * s * (1 - s) * ((1 - s) * r0 - s * r1)


def hermite_minimum(h: float, g0: float, g1: float, r0: float, r1: float) -> tuple[float, float]:
    """Part of the step and value of the lowest point inside; the lower end where there is none."""
    d0, d1, rise = h * r0, h * r1, g1 - g0
    a, b = d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1
    square = b * b - 3 * a * d0
    if square > 0:
        root = sqrt(square)
        s = -d0 / (b + root) if b > 0 else (root - b) / (3 * a) if a != 0 else 0.0
        if 0 < s < 1:
            return s, hermite(s, h, g0, g1, r0, r1)
    return (0.0, g0) if g0 < g1 else (1.0, g1)


def hermite_zero(h: float, g0: float, g1: float, r0: float, r1: float, upto: float) -> float:
    """Part of the step at which the cubic, positive at its start, vanishes before `upto`, where it is negative."""
    low, high = 0.0, upto
    for _ in range(30):
        middle = 0.5 * (low + high)
        if hermite(middle, h, g0, g1, r0, r1) > 0:
            low = middle
        else:
            high = middle
    return high


def contact_steps(system: System, stats: Stats) -> ContactSteps | None:
    """The contacts of a run, None where the system has none."""
    return None if system.guards is None else ContactSteps(system, stats)
