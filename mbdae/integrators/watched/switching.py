"""Step sizes where equations switch (kinks) or vary within a narrow range (peaks): no step passes over a kink or a peak.

PHI is an argument of a law, measured in widths of the law's function (`arguments.py`). A step over which it varies by more than
`LIMIT` is repeated with a shorter length; one that crosses a kink is repeated so that it ends there. Used where a system has
`switches`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np

from mbdae.integrators.solution import Stats
from mbdae.integrators.watched.arguments import MARGIN, Course, Inside, StepArguments
from mbdae.system.base import Array, System

#: largest variation of a scaled argument PHI: LIMIT over an accepted step; REACH over the next step (predicted by the rate of
#: PHI); AGAIN over the shorter step with which a step that exceeds LIMIT is repeated
LIMIT, REACH, AGAIN = 2.5, 1.0, 1.25
#: number of times a step is repeated with a shorter length at one place before it is accepted
RETRIES = 10
#: fraction of a step: a kink nearer to the end of the step counts as being at the end, if it is the only one in the step; one
#: that is as near to the start was the end of the step before
MET = 1e-2
#: an argument whose largest magnitude in a step is below this many times its change by the tolerance of the unknowns counts as 0,
#: so that its changes of sign are no kinks
NOISE = 3.0
#: TINY: smallest fraction of a step at which a kink is placed; ROUND: shortest step relative to the time t (shorter is round-off)
TINY, ROUND = 1e-9, 1e3 * float(np.finfo(float).eps)

Found = tuple[float, int, bool]  #: fraction of a step, number of an argument, whether it certainly has a kink or peak there


class SwitchingSteps:
    """The switches of one run: bounds of the next step, and where the last step should have ended."""

    def __init__(self, system: System, stats: Stats, tolerance: Callable[[Array], Array]) -> None:
        """tolerance: function of y (n,) -> tolerance of every unknown (n,)."""
        assert system.switches is not None
        self.arguments, self.stats, self.tolerance = StepArguments(system.switches), stats, tolerance
        self._retries, self._bound = 0, inf
        self.crossed = False  #: whether the last accepted step crossed a kink, so that the Jacobian is out of date
        # number of the kink at which the present step is to end, and of the one at which the last step ended; -1: none
        self._goal = self._reached = -1

    def bound(self) -> float:
        """Largest step from the last accepted point, s."""
        return self._bound

    def look(self, t: float, h: float, inside: Inside) -> None:
        """Evaluate the arguments over the last step, of length h from t."""
        self.arguments.look(t, h, inside)

    def shorter(self) -> float | None:
        """Length (s) that the step should have had; None: accept the step."""
        found = self._found()
        if found is None:
            return None
        part, i, surely = found
        t, h = self.arguments.t, self.arguments.h
        if self._retries >= RETRIES or part * h <= ROUND * abs(t):
            if surely:
                self._count(i, part)
            return None
        self._retries += 1
        self.stats.retaken += 1
        self._goal = i if self.arguments.kinks[i] else -1
        return part * h

    def keep(self) -> None:
        """Accept the step, and bound the next one by the rate at which arguments vary at its end."""
        self._retries, self._reached, self._goal = 0, self._goal, -1
        rate, U = self.arguments.rate(), self.arguments.at_nodes
        self._bound = REACH / rate if rate > 0 else inf
        self.crossed = bool((((U[0] < 0) != (U[-1] < 0)) & self.arguments.kinks).any())

    def quiet(self, t: Array, y: Callable[[Array, slice], Array], n: int) -> int:
        """Number of steps, of those between times t (m+1,), before the first that may hide a kink or peak; these are accepted. y,
        n: as for `StepArguments.quiet`."""
        calm, rate = self.arguments.quiet(t, y, n, LIMIT)
        h = np.diff(t)
        calm[1:] = calm[1:] & (h[1:] * rate[:-1] <= REACH * (1 + 1e-9))
        count = len(calm) if calm.all() else int(np.argmin(calm))
        if count:
            self._retries, self._reached, self._goal, self.crossed = 0, -1, -1, False
            self._bound = REACH / float(rate[count - 1]) if rate[count - 1] > 0 else inf
        return count

    def count_hidden(self) -> None:
        """Count a constant step that passed over a peak, or over several kinks. A kink that is crossed once does not count,
        because the end of the step shows it."""
        found = self._found(constant=True)
        if found is not None and found[2]:
            self._count(found[1], found[0])

    def _count(self, i: int, part: float) -> None:
        name, wanted = self.arguments.switches.names[i], part * self.arguments.h
        self.stats.unresolved[name] = self.stats.unresolved.get(name, 0) + 1
        self.stats.resolving_step = min(wanted, self.stats.resolving_step or wanted)

    # -- what a step hides

    def _found(self, constant: bool = False) -> Found | None:
        """The first place in the step at which the step should have ended, or None; constant: whether it is a constant step."""
        asked = self.arguments.suspects(LIMIT)
        if not asked.any():
            return None
        kinks = self.arguments.kinks
        found = [place for i in np.flatnonzero(asked & ~kinks).tolist() if (place := self._scale(i)) is not None]
        crossings = [(part, i) for i in np.flatnonzero(asked & kinks).tolist() for part in self._crossings(i)]
        if len(crossings) > 1 or (len(crossings) == 1 and not constant and crossings[0][0] <= 1 - MET):
            found += [(part, i, len(crossings) > 1) for part, i in crossings]
        if not constant and not crossings:
            found += [(part, i, False) for i in np.flatnonzero(asked & kinks).tolist() for part in self._near_misses(i)]
        return min(found, default=None)

    def _scale(self, i: int) -> Found | None:
        """The place in the step until which PHI of argument i has varied by AGAIN; None where it varies by less than LIMIT over
        the whole step."""
        arguments, course = self.arguments, self.arguments.course(i)
        if arguments.switches.kinds[i] == "power":
            course = self._with_zeros(i, course)
        change = np.abs(np.diff(arguments.stretch(i, course.u)))
        if not change.sum() > LIMIT:
            return None
        before = np.cumsum(change)
        k = int(np.searchsorted(before, AGAIN))
        start, left = arguments.stretch(i, course.u[k]), AGAIN - (before[k] - change[k])
        part = arguments.place(i, course, k, lambda v: np.abs(arguments.stretch(i, v) - start) > left)[1]
        return part, i, arguments.noise(i, self.tolerance)[1] < 1

    def _with_zeros(self, i: int, course: Course) -> Course:
        """The course of argument i (the base of a power) with its zeros as further points, because ln|u| has its minimum
        there."""
        s, u = course
        for k in reversed(course.changes()):
            s, u = np.insert(s, k + 1, self.arguments.zero(i, course, k)), np.insert(u, k + 1, 0.0)
        return Course(s, u)

    def _crossings(self, i: int) -> list[float]:
        """Fractions of the step at which argument i changes its sign, without the kink at which the last step was made to end."""
        course = self.arguments.course(i)
        changes = course.changes()
        if not len(changes) or self._is_noise(i, course):
            return []
        found = [max(self.arguments.zero(i, course, k), TINY) for k in changes]
        return found[1:] if self._reached == i and found[0] < MET else found

    def _near_misses(self, i: int) -> list[float]:
        """Fractions of the step at which argument i has an extremum so near to 0 that it may cross 0."""
        course = self.arguments.course(i)
        s, u = course
        rise = np.diff(u)
        near = [float(s[j]) for j in np.flatnonzero(rise[:-1] * rise[1:] < 0) + 1
                if MET < s[j] < 1 - MET and (u[j] - u[j - 1]) * u[j] < 0 and abs(u[j]) < MARGIN * np.ptp(u)]  # fmt: skip
        return [] if near and self._is_noise(i, course) else near

    def _is_noise(self, i: int, course: Course) -> bool:
        """Whether argument i stays so near to 0 that the tolerance does not determine its sign."""
        return float(np.max(np.abs(course.u))) < NOISE * self.arguments.noise(i, self.tolerance)[0]
