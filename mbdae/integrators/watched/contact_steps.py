"""Step sizes near contacts: no step passes over a contact, and none that enters one is long against the impact.

Used where a system has `guards`. A contact is apart where its gap is positive, made where it is negative. Python's numbers are
four times faster here than arrays, because contacts are few.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from mbdae.integrators.solution import Stats
from mbdae.integrators.watched.zero import zero_between
from mbdae.native.contacts import Contacts
from mbdae.system.base import Array, System

#: part of the way to the surface one step may go
APPROACH = 0.5
#: part of an impact one step may cover; with 0.1 Radau needs up to twice the steps for the same error
IMPACT = 0.2
#: part by which the penetration may change in a longer step: a body at rest on a contact needs no short steps
REST = 0.1
#: durations of an impact after which a contact counts as lasting: its motion is smooth, and the error test alone bounds the step.
#: With a bound the higher orders of BDF keep a body at rest trembling: 2 to 3 times the evaluations
LASTING = 3.0
#: part by which a penetration may change before the Jacobian is evaluated anew
CHANGE = 0.2
#: a minimum between two points apart that is below this part of the smaller gap may be a contact
MARGIN = 0.1
#: largest weight of a slope in a cubic Hermite polynomial on [0, 1]
SLOPE = 4 / 27
#: times a step is repeated shorter at one place; then it is accepted as it is
RETRIES = 4
#: part of a step at either end within which a zero of the gap counts as being at that end
MET = 1e-2
#: shortest step over the time: shorter ones are round-off of the time
ROUND = 1e3 * float(np.finfo(float).eps)


class Contact(NamedTuple):
    """One contact at one time: gap (m or rad), its rate, duration (s) of an impact at this speed."""

    gap: float
    rate: float
    duration: float

    @property
    def calm(self) -> float:
        """Time (s) in which the gap would change by its own size at this rate."""
        return abs(self.gap / self.rate) if self.rate else inf


class Cubic(NamedTuple):
    """Cubic of a gap over a step: width (s), gaps (m or rad) and their rates at both ends."""

    h: float
    g0: float
    g1: float
    r0: float
    r1: float

    def value(self, s: float) -> float:
        """Gap after the part s of the step."""
        bend = self.h * s * (1 - s) * ((1 - s) * self.r0 - s * self.r1)
        return self.g0 + s * s * (3 - 2 * s) * (self.g1 - self.g0) + bend

    def suspect(self, margin: float) -> bool:
        """Whether it can come below margin times the smaller gap inside: a cheap test, false for nearly every step."""
        drop = max(-self.r0, 0.0) + max(self.r1, 0.0)
        return (1 - margin) * min(self.g0, self.g1) < SLOPE * self.h * drop

    def minimum(self) -> tuple[float, float]:
        """Part of the step and gap of the lowest point inside; the lower end where there is none."""
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
        """Part of the step after which the gap, positive at the start and negative at `upto`, vanishes."""
        low, high = 0.0, upto
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.value(middle) > 0 else (low, middle)
        return high


class ContactSteps:
    """The contacts of one run: how long the next step may be, and whether the last one is to be repeated shorter.

    A solver calls `bound` before a step and `look` after it; `hidden` or `shorter` then return a shorter step to try, and `keep`
    is called when the step is accepted.
    """

    def __init__(self, system: System, stats: Stats, impact: float = IMPACT) -> None:
        """impact: part of an impact one step may cover."""
        self.system, self.stats, self.impact = system, stats, impact
        self._t = self._t_end = float(system.t0)
        self._here = self._before = self._end = self._contacts(system.t0, system.y0)
        self._inside = [0] * len(self._here)  # accepted steps that ended inside the present contact, if it began in this run
        self._lasting = [self._t + LASTING * c.duration for c in self._here]  # times (s) after which the contact is no impact
        self._stiff = [min(c.gap, 0.0) for c in self._here]  # gaps the Jacobian in use belongs to
        self._retries = 0

    def _contacts(self, t: float, y: Array) -> list[Contact]:
        assert self.system.guards is not None
        parts = (np.asarray(part).tolist() for part in self.system.guards(t, y))
        return [Contact(*values) for values in zip(*parts, strict=True)]

    def _gaps(self, t: float, y: Array) -> Array:
        """The gaps alone, which are much cheaper where the system gives them by themselves."""
        assert self.system.guards is not None
        gaps: Callable[[float, Array], Array] | None = getattr(self.system.guards, "gaps", None)
        return np.asarray(self.system.guards(t, y)[0] if gaps is None else gaps(t, y))

    def bound(self) -> float:
        """Largest step from the last accepted point, s: half the way to the surface, or a small part of an impact."""
        bound = inf
        for here, before, lasting in zip(self._here, self._before, self._lasting, strict=True):
            short = self.impact * min(here.duration, before.duration)  # of both: at its turning point an impact has no speed
            if here.gap < 0:
                if self._t < lasting:
                    bound = min(bound, max(short, REST * min(here.calm, before.calm)))
            elif here.rate < 0:
                bound = min(bound, max(short, APPROACH * here.calm))
        return max(bound, ROUND * abs(self._t))

    # -- many steps at a time

    @cached_property
    def native(self) -> Contacts | None:
        """The contacts as native methods look at them between closer looks; None where the system has only a function."""
        made = getattr(self.system.guards, "native", None)
        return None if made is None else made({"impact": self.impact, "approach": APPROACH, "rest": REST, "margin": MARGIN,
                                               "slope": SLOPE, "change": CHANGE, "round": ROUND})  # fmt: skip

    def given(self) -> Contacts | None:
        """`native` with what is known of the last accepted step."""
        native = self.native
        if native is not None:
            native.here[:], native.before[:] = self._here, self._before
            native.lasting[:], native.stiff[:], native.inside[:] = self._lasting, self._stiff, self._inside
            self.system.guards.hold(native)  # type: ignore[union-attr]
        return native

    def take(self, t: Array, y: Array, dropped: int) -> None:
        """Learn from `native`, which kept steps; the last two states (2, n) are those at t (2,); some later ones were dropped."""
        native = self.native
        assert native is not None
        self._t, self._retries = float(t[1]), 0
        self._lasting, self._stiff, self._inside = native.lasting.tolist(), native.stiff.tolist(), native.inside.tolist()
        self._here, self._before = ([Contact(*row) for row in rows.tolist()] for rows in (native.here, native.before))
        if dropped:
            self._before, self._here = (self._contacts(float(at), state) for at, state in zip(t, y, strict=True))
            self._inside = [max(n - dropped, 1) if n and c.gap < 0 else n for n, c in zip(self._inside, self._here, strict=True)]

    # -- one step at a time

    def look(self, t: float, y: Array) -> None:
        """Evaluate the contacts at the end (t, y) of the last step."""
        self._t_end, self._end = t, self._contacts(t, y)

    def hidden(self) -> float | None:
        """Time (s) at which the step should have ended, because it hides a contact or goes deep into one. None: accept it."""
        found = [place for i in range(len(self._end)) if (place := self._hidden(i)) is not None]
        if not found:
            return None
        part, surely = min(found)
        h = self._t_end - self._t
        if self._retries >= RETRIES or part * h <= ROUND * max(abs(self._t), abs(self._t_end)):
            self.stats.missed_dips += surely
            return None
        self._retries += 1
        self.stats.dips += 1
        return self._t + part * h

    def _hidden(self, i: int) -> tuple[float, bool] | None:
        """Part of the step after which contact i may be made, unless the end shows it well, and whether that is certain."""
        here, end, cubic = self._here[i], self._end[i], self._cubic(i)
        short = self.impact * min(here.duration, end.duration)
        if not (here.gap > 0 and cubic.h > short):
            return None
        if end.gap < 0:
            part = max(cubic.zero(1.0), short / cubic.h)
            return (part, True) if (1 - part) * cubic.h > short else None
        if not cubic.suspect(MARGIN):
            return None
        part, least = cubic.minimum()
        if not (0 < part < 1 and least < MARGIN * min(here.gap, end.gap)):
            return None
        part = cubic.zero(part) if least < 0 else part
        return max(part, short / cubic.h), least < 0  # steps of this length are never repeated, so none has to be shorter

    def count_hidden(self, inner: list[tuple[float, Array]]) -> None:
        """Count the contacts that came and went inside a constant step; inner: times (s) and states between its ends."""
        between = [self._contacts(t, y) for t, y in inner]
        for i, (here, end) in enumerate(zip(self._here, self._end, strict=True)):
            if here.gap >= 0 and end.gap >= 0:
                cubic = self._cubic(i)
                dips = cubic.suspect(0.0) and cubic.minimum()[1] < 0
                self.stats.missed_dips += dips or any(contacts[i].gap < 0 for contacts in between)

    def shorter(self, h: float, inside: Callable[[float], Array]) -> float | None:
        """Width (s) that the step of width h should have: it then ends at the contact it hides, or where one is made or lost.

        inside: y (n,) on the polynomial of the step after a part of it. None: accept the step.
        """
        when = self.hidden()
        if when is not None:
            return when - self._t
        crossed = [i for i, end in enumerate(self._end) if (end.gap < 0) != (self._here[i].gap < 0)]
        if not crossed or self._retries >= RETRIES:
            return None
        part, gaps = None, None
        for i in crossed:
            if gaps is not None and (gaps[i] < 0) == (self._here[i].gap < 0):
                continue  # made or lost later than the first one found
            found = self._zero(i, h, inside)
            if MET < found < 1 - MET and (part is None or found < part):
                part, gaps = found, self._gaps(self._t + found * h, inside(found))
        if part is None:
            return None
        self._retries += 1
        return part * h

    def _zero(self, i: int, h: float, inside: Callable[[float], Array]) -> float:
        """Part of the step after which contact i is made or lost, on the polynomial of the step."""

        def gap(part: float) -> float:
            if part in (0.0, 1.0):
                return (self._end if part else self._here)[i].gap
            return float(self._gaps(self._t + part * h, inside(part))[i])

        return 0.0 if gap(0.0) == 0.0 else zero_between(gap, 0.01 * MET)

    def keep(self) -> None:
        """Count the contacts of the step that is accepted."""
        self._before, self._here, self._t, self._retries = self._here, self._end, self._t_end, 0
        for i, (before, here) in enumerate(zip(self._before, self._here, strict=True)):
            if here.gap < 0:
                if before.gap >= 0:
                    self.stats.contacts += 1
                    self._inside[i] = 1
                    self._lasting[i] = self._t + LASTING * min(before.duration, here.duration)
                elif self._inside[i]:
                    self._inside[i] += 1
            elif self._inside[i]:
                self.stats.shortest_contact = min(self._inside[i], self.stats.shortest_contact or self._inside[i])
                self._inside[i] = 0

    def jacobian_at(self, t: float, y: Array) -> None:
        """The Jacobian in use is of (t, y)."""
        self._stiff = [min(c.gap, 0.0) for c in self._contacts(t, y)]

    def stiffness_changed(self) -> bool:
        """Whether a penetration at the last accepted point differs from that where the Jacobian was evaluated.

        The stiffness of a contact, kept after its end, makes every correction and every error estimate look small.
        """
        gaps = (min(here.gap, 0.0) for here in self._here)
        return any(abs(now - was) > -CHANGE * min(now, was) for now, was in zip(gaps, self._stiff, strict=True))

    def nearest(self) -> str:
        """For a message: the contact that is made, or will be made first."""
        if not self._here:
            return ""
        remaining = [c.gap if c.gap < 0 else c.calm if c.rate < 0 else inf for c in self._here]
        i = int(np.argmin(remaining))
        names, units = self.system.guard_names, self.system.guard_units
        name, unit = names[i] if i < len(names) else f"contact[{i}]", units[i] if i < len(units) else "m"
        return f"; nearest contact: {name}, gap {self._here[i].gap:.2e} {unit}, changing by {self._here[i].rate:.2e} {unit}/s"

    def _cubic(self, i: int) -> Cubic:
        here, end = self._here[i], self._end[i]
        return Cubic(self._t_end - self._t, here.gap, end.gap, here.rate, end.rate)
