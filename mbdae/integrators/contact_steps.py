"""Step sizes near contacts: no step passes over a contact, and a step that begins a contact is short compared with the impact.

Used where a system has `guards` (gap, rate of the gap and duration of an impact for every contact). A contact is open where its
gap is positive, closed where it is negative. The contacts of one time are an array (contacts, 3): of each its gap (m or rad), the
rate of the gap, and the duration (s) of an impact at this rate.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np

from mbdae.integrators.solution import Stats
from mbdae.integrators.watched_arguments import IMPACT, ROUND, zero_between
from mbdae.native.collocation import Contacts
from mbdae.system.base import Array, System

#: fraction of an open gap that closes, which the next step may pass through at the present rate; a longer step is still allowed
#: where IMPACT allows it
APPROACH = 0.5
#: fraction by which a penetration may change, at its present rate, in a next step longer than IMPACT allows: a body at rest on a
#: contact needs no short steps
REST = 0.1
#: after this number of durations of an impact a contact counts as lasting: the motion is smooth then, and the error test alone
#: bounds the step. With a further bound BDF of higher order lets a body at rest oscillate, at 2 to 3 times the evaluations
LASTING = 3.0
CHANGE = 0.2  #: change of a penetration, relative to the larger of both values, above which the Jacobian is evaluated anew
#: a minimum of the gap inside a step may be a contact where it is below this fraction of the smaller gap at the ends
MARGIN = 0.1
#: largest weight of a slope in a cubic Hermite polynomial on [0, 1]: bounds how far a gap can fall below its values at the ends
SLOPE = 4 / 27
#: number of times a step is repeated with a shorter length at one place before it is accepted
RETRIES = 4
#: fractions of a step; a zero of the gap nearer than this to its beginning, or to its end, counts as being there, by default
MET = 1e-2, 1e-2
EXACT = 1e-7  #: share of an impact's duration that counts as none: 3e-11 of its change of speed, for a force of the power 1.5


def calm(contacts: Array) -> Array:
    """Times (contacts,) in which gaps would change by their own size at their rates, s; inf where a rate is 0."""
    gap, rate = contacts[:, 0], contacts[:, 1]
    times: Array = np.abs(np.divide(gap, rate, out=np.full(len(gap), inf), where=rate != 0))
    return times


def suspect(here: Array, end: Array, h: float, margin: float) -> Any:
    """Which gaps (contacts,) can fall below `margin` times the smaller of their values at both ends inside a step of length h, s:
    a cheap bound on the cubic polynomial that rules out most steps."""
    drop = np.maximum(-here[:, 1], 0) + np.maximum(end[:, 1], 0)
    return (1 - margin) * np.minimum(here[:, 0], end[:, 0]) < SLOPE * h * drop


def guard_name(system: System, i: int) -> str:
    """Name of a contact."""
    return system.guard_names[i] if i < len(system.guard_names) else f"contact[{i}]"


def cubic(s: Any, h: Any, g0: Any, g1: Any, r0: Any, r1: Any) -> Any:
    """Value at the fraction s of a step of length h (s) of the cubic polynomial with the values g0, g1 and rates r0, r1 at its
    ends: of one gap or, as arrays, of many."""
    bend = h * s * (1 - s) * ((1 - s) * r0 - s * r1)
    return g0 + s * s * (3 - 2 * s) * (g1 - g0) + bend


class Cubic(NamedTuple):
    """Cubic polynomial of a gap over a step: length h (s), gaps g0, g1 (m or rad) and their rates r0, r1 at both ends."""

    h: float
    g0: float
    g1: float
    r0: float
    r1: float

    def value(self, s: float) -> float:
        """Gap at the fraction s of the step."""
        found: float = cubic(s, *self)
        return found

    def minimum(self) -> tuple[float, float]:
        """Fraction of the step and gap at the minimum inside; at the end with the smaller gap where there is no minimum
        inside."""
        d0, d1, rise = self.h * self.r0, self.h * self.r1, self.g1 - self.g0
        a, b = d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1
        square = b * b - 3 * a * d0
        if square > 0:
            root = sqrt(square)
            s = -d0 / (b + root) if b > 0 else (root - b) / (3 * a) if a else 0.0
            if 0 < s < 1:
                return s, self.value(s)
        return (0.0, self.g0) if self.g0 < self.g1 else (1.0, self.g1)

    def zero(self, upto: float) -> float:
        """Fraction of the step at which the gap vanishes, which is positive at the start and negative at the fraction `upto`."""
        low, high = 0.0, upto
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.value(middle) > 0 else (low, middle)
        return high


class ContactSteps:
    """The contacts of one run: bounds of the next step, and whether the last step has to be repeated with a shorter length.

    A solver calls `bound` before a step and `look` after it; `hidden` or `shorter` then return a shorter step to try, and `keep`
    is called when the step is accepted.
    """

    def __init__(self, system: System, stats: Stats, impact: float = IMPACT, meets: tuple[float, float] = MET) -> None:
        """impact: longest step during an impact, as a fraction of its duration; meets: fractions of a step, a zero of the
        gap nearer than this to its beginning, or to its end, counts as being there."""
        self.system, self.stats, self.impact, self.meets = system, stats, impact, meets
        self._t = self._t_end = float(system.t0)
        self._end = self._contacts(system.t0, system.y0)
        self._here, self._before = self._end.copy(), self._end.copy()
        # accepted steps in the present contact, if it began in this run
        self._inside = np.zeros(len(self._here), dtype=np.int64)
        # time (s) for each contact after which it counts as lasting
        self._lasting = self._t + LASTING * self._here[:, 2]
        self._stiff = np.minimum(self._here[:, 0], 0.0)  # gaps (0 where open) at which the present Jacobian was evaluated
        self._retries = 0

    def _contacts(self, t: float, y: Array) -> Array:
        assert self.system.guards is not None
        return np.array(self.system.guards(t, y), dtype=float).T

    def _gaps(self, t: float, y: Array) -> Array:
        """The gaps alone, which take much less time where the system has a function for them."""
        assert self.system.guards is not None
        gaps: Callable[[float, Array], Array] | None = getattr(self.system.guards, "gaps", None)
        return np.asarray(self.system.guards(t, y)[0] if gaps is None else gaps(t, y))

    def bound(self) -> float:
        """Largest step from the last accepted point, s: the time in which half of an open gap closes, or a fraction of the
        duration of an impact."""
        here, before = self._here, self._before
        # the shorter of the durations by the last two speeds, because at the turning point of an impact the speed is 0
        short, closed, own = self.impact * np.minimum(here[:, 2], before[:, 2]), here[:, 0] < 0, calm(here)
        struck, nearing = closed & (self._t < self._lasting), ~closed & (here[:, 1] < 0)
        reach = np.where(struck, REST * np.minimum(own, calm(before)), np.where(nearing, APPROACH * own, inf))
        return max(float(np.min(np.maximum(reach, short), initial=inf)), ROUND * abs(self._t))

    # -- many steps at a time

    @cached_property
    def native(self) -> Contacts | None:
        """The contacts as tables for native methods, which check contacts after every step of a block; None for guards that are
        Python functions."""
        made = getattr(self.system.guards, "native", None)
        return None if made is None else made({"impact": self.impact, "approach": APPROACH, "rest": REST, "margin": MARGIN,
                                               "slope": SLOPE, "change": CHANGE, "round": ROUND})

    def given(self) -> Contacts | None:
        """The tables `native`, after the contacts at the last accepted step have been written to them; None for guards in
        Python."""
        native = self.native
        if native is not None:
            native.here[:], native.before[:] = self._here, self._before
            native.lasting[:], native.stiff[:], native.inside[:] = self._lasting, self._stiff, self._inside
            self.system.guards.hold(native)  # type: ignore[union-attr]
        return native

    def take(self, t: Array, y: Array, dropped: int) -> None:
        """Take over the state of the contacts from `native` after a block of steps. y (2, n): the last two accepted states, at
        times t (2,); dropped: number of steps after these that were made but not accepted."""
        native = self.native
        assert native is not None
        self._t, self._retries = float(t[1]), 0
        self._lasting, self._stiff, self._inside = native.lasting.copy(), native.stiff.copy(), native.inside.copy()
        self._here, self._before = native.here.copy(), native.before.copy()
        if dropped:
            self._before, self._here = (self._contacts(float(at), state) for at, state in zip(t, y, strict=True))
            shut = (self._inside > 0) & (self._here[:, 0] < 0)
            self._inside[shut] = np.maximum(self._inside[shut] - dropped, 1)

    # -- one step at a time

    def look(self, t: float, y: Array) -> None:
        """Evaluate the contacts at the end (t, y) of the last step."""
        self._t_end, self._end = t, self._contacts(t, y)

    def hidden(self) -> float | None:
        """Time (s) at which the step should have ended, because it hides a contact or a deep penetration. None: accept it."""
        here, end, h = self._here, self._end, self._t_end - self._t
        asked = (here[:, 0] > 0) & (h > self.impact * np.minimum(here[:, 2], end[:, 2]))
        asked &= (end[:, 0] < 0) | suspect(here, end, h, MARGIN)
        found = [place for i in np.flatnonzero(asked).tolist() if (place := self._hidden(i)) is not None]
        if not found:
            return None
        part, surely = min(found)
        if self._retries >= RETRIES or part * h <= ROUND * max(abs(self._t), abs(self._t_end)):
            self.stats.missed_dips += surely
            return None
        self._retries += 1
        self.stats.dips += 1
        return self._t + part * h

    def _hidden(self, i: int) -> tuple[float, bool] | None:
        """Fraction of the step at which contact i may close, and whether it certainly does; None where it does not close, or
        where the step ends soon enough after it. The contact is open at the start of the step."""
        cubic, short = self._cubic(i), self.impact * float(min(self._here[i, 2], self._end[i, 2]))
        if cubic.g1 < 0:
            part = max(cubic.zero(1.0), short / cubic.h)
            return (part, True) if (1 - part) * cubic.h > short else None
        part, least = cubic.minimum()
        if not (0 < part < 1 and least < MARGIN * min(cubic.g0, cubic.g1)):
            return None
        part = cubic.zero(part) if least < 0 else part
        # a step as short as `short` is never repeated, so that none shorter than that is asked for
        return max(part, short / cubic.h), least < 0

    def count_hidden(self, inner: list[tuple[float, Array]]) -> None:
        """Count the contacts that open and close inside a constant step; inner: times (s) and states inside it."""
        here, end = self._here, self._end
        shut = np.any([self._gaps(t, y) < 0 for t, y in inner], axis=0) if inner else np.zeros(len(here), dtype=bool)
        asked = suspect(here, end, self._t_end - self._t, 0.0)
        for i in np.flatnonzero((here[:, 0] >= 0) & (end[:, 0] >= 0) & (asked | shut)).tolist():
            self.stats.missed_dips += bool(shut[i]) or self._cubic(i).minimum()[1] < 0

    def shorter(self, h: float, inside: Callable[[float], Array]) -> float | None:
        """Length (s) that the step of length h should have had, so that it ends where a contact closes or opens, also one that
        does so inside the step only. None: accept the step. inside: fraction of the step -> y (n,) on its polynomial.
        """
        when = self.hidden()
        if when is not None:
            return when - self._t
        was = self._here[:, 0] < 0
        crossed = np.flatnonzero((self._end[:, 0] < 0) != was).tolist()
        if not crossed or self._retries >= RETRIES:
            return None
        part, gaps = None, None
        for i in crossed:
            if gaps is not None and (gaps[i] < 0) == was[i]:
                continue  # where the first one found closes or opens, this one has not done so yet: it does later
            found, (first, last) = self._zero(i, h, inside), self._met(i, h)
            if first < found < 1 - last and (part is None or found < part):
                part, gaps = found, self._gaps(self._t + found * h, inside(found))
        if part is None:
            return None
        self._retries += 1
        return part * h

    def _met(self, i: int, h: float) -> tuple[float, float]:
        """Fractions of a step of length h (s): a zero of gap i nearer than these to its beginning, or to its end, is there."""
        short = float(min(self._here[i, 2], self._end[i, 2]))
        least = max(EXACT * min(short / h, 1.0), ROUND * max(abs(self._t), abs(self._t_end)) / h)
        return max(self.meets[0], least), max(self.meets[1], least)

    def _zero(self, i: int, h: float, inside: Callable[[float], Array]) -> float:
        """Fraction of the step at which contact i closes or opens, on the polynomial of the step."""

        def gap(part: float) -> float:
            if part in (0.0, 1.0):
                return float((self._end if part else self._here)[i, 0])
            return float(self._gaps(self._t + part * h, inside(part))[i])

        return 0.0 if gap(0.0) == 0.0 else zero_between(gap, 0.01 * min(self._met(i, h)))

    def keep(self) -> None:
        """To be called when the last step is accepted: counts its contacts."""
        self._before, self._here, self._t, self._retries = self._here, self._end, self._t_end, 0
        shut, inside = self._here[:, 0] < 0, self._inside
        begun, opened = shut & (self._before[:, 0] >= 0), ~shut & (inside > 0)
        inside[shut & (inside > 0)] += 1
        if begun.any():
            self.stats.contacts += int(np.count_nonzero(begun))
            inside[begun] = 1
            self._lasting[begun] = self._t + LASTING * np.minimum(self._before[begun, 2], self._here[begun, 2])
        if opened.any():
            fewest = int(np.min(inside[opened]))
            self.stats.shortest_contact = min(fewest, self.stats.shortest_contact or fewest)
            inside[opened] = 0

    def jacobian_at(self, t: float, y: Array) -> None:
        """To be called when the Jacobian was evaluated at (t, y): remembers the penetrations there for `stiffness_changed`."""
        self._stiff = np.minimum(self._contacts(t, y)[:, 0], 0.0)

    def stiffness_changed(self) -> bool:
        """Whether a penetration at the last accepted point differs much from the one at which the Jacobian was evaluated.

        With the stiffness of a contact that has opened, all corrections and error estimates would be too small.
        """
        now, was = np.minimum(self._here[:, 0], 0.0), self._stiff
        return bool(np.any(np.abs(now - was) > -CHANGE * np.minimum(now, was)))

    def nearest(self) -> str:
        """Part of a message: the contact that is closed, or will close first."""
        here = self._here
        if not len(here):
            return ""
        remaining = np.where(here[:, 0] < 0, here[:, 0], np.where(here[:, 1] < 0, calm(here), inf))
        i = int(np.argmin(remaining))
        name, units = guard_name(self.system, i), self.system.guard_units
        unit = units[i] if i < len(units) else "m"
        return f"; nearest contact: {name}, gap {here[i, 0]:.2e} {unit}, changing by {here[i, 1]:.2e} {unit}/s"

    def _cubic(self, i: int) -> Cubic:
        (g0, r0, _), (g1, r1, _) = self._here[i].tolist(), self._end[i].tolist()
        return Cubic(self._t_end - self._t, g0, g1, r0, r1)
