"""Step sizes where equations switch (kinks) or vary within a narrow range (peaks): no step passes over a kink or a peak.

PHI is an argument of a law, measured in widths of the law's function (`arguments.py`). A step over which it varies by more than
`LIMIT` is repeated with a shorter length; one that crosses a kink is repeated so that it ends there. Used where a system has
`switches`.

Bounds of the step in addition to the error test: contacts, kinks of the equations, and functions with narrow peaks.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Self

import numpy as np

from mbdae.deferred import Later
from mbdae.errors import ChatteringError
from mbdae.integrators.chattering import Chattering
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Stats
from mbdae.integrators.watched_arguments import IMPACT, MARGIN, ROUND, Course, Inside, StepArguments, cubic_of_step
from mbdae.system.base import Array, System

if TYPE_CHECKING:
    from mbdae.integrators.contact_steps import ContactSteps
else:
    ContactSteps = Later("mbdae.integrators.contact_steps", "ContactSteps")

#: largest variation of a scaled argument PHI: LIMIT over an accepted step; REACH over the next step (predicted by the rate of
#: PHI); AGAIN over the shorter step with which a step that exceeds LIMIT is repeated
LIMIT, REACH, AGAIN = 2.5, 1.0, 1.25
#: number of times a step is repeated with a shorter length at one place before it is accepted
RETRIES = 10
#: fraction of a step: a kink nearer to the end of the step counts as being at the end, if it is the only one in the step; one
#: that is as near to the start was the end of the step before
MET = 1e-2
#: while something grows that the error test does not see, a step ends before a kink by this fraction of itself, and the next one
#: crosses it by as little: no other step has stages on both sides. The unknowns count as known to this part of themselves instead
#: of to their tolerance. What is made there is in all that follows: of y'' = y + 1.5e-7 for .01 s from rest, whose kinks were met
#: as others are, the error was 400 times the accuracy
CLOSE = 1e-8
#: fraction of a constant step up to which a kink counts as being at its start: what starts on a kink as drawn is off it by
#: rounding, which its motion crosses in 1e-9 s
BEGUN = 1e-5
#: an argument whose largest magnitude in a step is below this many times its change by the tolerance of the unknowns counts as 0,
#: so that its changes of sign are no kinks
NOISE = 3.0
#: TINY: smallest fraction of a step at which a kink is placed
TINY = 1e-9

KinkInStep = tuple[float, int, bool]  #: fraction of a step, number of an argument, whether it certainly has a kink or peak there


class SwitchingSteps:
    """The switches of one run: bounds of the next step, and where the last step should have ended."""

    def __init__(self, system: System, stats: Stats, tolerance: Callable[[Array], Array], crosses: bool = True) -> None:
        """tolerance: function of y (n,) -> tolerance of every unknown (n,); crosses: whether short steps across kinks are made,
        see CLOSE."""
        assert system.switches is not None
        self.arguments, self.stats, self.tolerance = StepArguments(system.switches), stats, tolerance
        self._retries, self._bound, self._near = 0, inf, 0.0  # near (s): how near to a kink a step is to end
        self._unseen = -inf if system.longest_step is None or not crosses else system.longest_step.unseen
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
        if self._closely and self.arguments.kinks[i]:
            self._near = max(self._near, CLOSE * h, ROUND * abs(t))
            part = max(part * h - self._near, 2 * self._near) / h
        if self._retries >= RETRIES or part * h <= ROUND * abs(t) or part >= 1:
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
        if self._reached < 0:
            self._near = 0.0
        elif self._near:
            self._bound = min(self._bound, 2 * self._near)
        self.crossed = bool((((U[0] < 0) != (U[-1] < 0)) & self.arguments.kinks).any())

    def quiet(self, t: Array, y: Callable[[Array, slice], Array], n: int) -> int:
        """Number of steps, of those between times t (m+1,), before the first that may hide a kink or peak; these are accepted. y,
        n: as for `StepArguments.quiet`."""
        calm, rate = self.arguments.quiet(t, y, n, LIMIT)
        calm[1:] = calm[1:] & (np.diff(t)[1:] * rate[:-1] <= REACH * (1 + 1e-9))
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

    @property
    def _closely(self) -> bool:
        """Whether the last step is one in which something grows that the error test does not see."""
        return self.arguments.t < self._unseen

    def _uncertainty(self, y: Array) -> Array:
        """To what the unknowns y (n,) are known, (n,)."""
        return CLOSE * np.abs(y) if self._closely else self.tolerance(y)

    def _found(self, constant: bool = False) -> KinkInStep | None:
        """The first place in the step at which the step should have ended, or None; constant: whether it is a constant step."""
        asked = self.arguments.suspects(LIMIT)
        if not asked.any():
            return None
        kinks = self.arguments.kinks
        found = [place for i in np.flatnonzero(asked & ~kinks).tolist() if (place := self._scale(i)) is not None]
        begun = BEGUN if constant else -1.0
        crossings = [(part, i) for i in np.flatnonzero(asked & kinks).tolist() for part in self._crossings(i) if part > begun]
        if len(crossings) > 1 or (len(crossings) == 1 and not constant
                                   and (self._closely or crossings[0][0] <= 1 - MET)):
            found += [(part, i, len(crossings) > 1) for part, i in crossings]
        if not constant and not crossings:
            found += [(part, i, False) for i in np.flatnonzero(asked & kinks).tolist() for part in self._near_misses(i)]
        return min(found, default=None)

    def _scale(self, i: int) -> KinkInStep | None:
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
        return part, i, arguments.noise(i, self._uncertainty)[1] < 1

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
        return found[1:] if self._reached == i and found[0] < MET and not self._closely else found

    def _near_misses(self, i: int) -> list[float]:
        """Fractions of the step at which argument i has an extremum so near to 0 that it may cross 0."""
        course = self.arguments.course(i)
        s, u = course
        rise = np.diff(u)
        near = [float(s[j]) for j in np.flatnonzero(rise[:-1] * rise[1:] < 0) + 1
                if MET < s[j] < 1 - MET and (u[j] - u[j - 1]) * u[j] < 0 and abs(u[j]) < MARGIN * np.ptp(u)]
        return [] if near and self._is_noise(i, course) else near

    def _is_noise(self, i: int, course: Course) -> bool:
        """Whether argument i stays so near to 0 that the tolerance does not determine its sign."""
        return float(np.max(np.abs(course.u))) < NOISE * self.arguments.noise(i, self._uncertainty)[0]


Tolerance = Callable[[Array], Array]  #: y (n,) -> tolerance of every unknown (n,)


class StepWatch:
    """Contacts and switches of one run, where the system has some.

    A solver calls `bound` before a step and `look` after it; `shorter` then returns a shorter step to try, or None; `keep` is
    called when the step is accepted.
    """

    #: longest step during an impact, as a fraction of its duration
    impact: float = IMPACT
    crosses = True  #: whether the method takes a short step across a kink; one of several steps makes its next ones from it

    def __init__(self, loop: StepLoop, tolerance: Tolerance) -> None:
        self.loop, system = loop, loop.system
        self.contacts = None if system.guards is None else ContactSteps(system, loop.stats, self.impact * loop.impacts,
                                                                          *loop.meets)
        self.switching = None if system.switches is None else SwitchingSteps(system, loop.stats, tolerance, self.crosses)
        arguments = None if self.switching is None else self.switching.arguments
        self.chattering = None if arguments is None else Chattering(system, arguments, tolerance, loop.switched)

    @classmethod
    def of(cls, loop: StepLoop, tolerance: Tolerance) -> Self | None:
        """The watch of a run; None where the system has neither contacts nor switches."""
        needed = loop.system.guards is not None or loop.system.switches is not None
        return cls(loop, tolerance) if needed else None

    def bound(self) -> float:
        """Largest step from the last accepted point, s."""
        bounds = [part.bound() for part in (self.contacts, self.switching) if part is not None]
        return max(min(bounds), ROUND * abs(self.loop.t))

    def bound_of_switches(self) -> float:
        """Largest step (s) by switches and not by contacts, for native methods, which bound the step by contacts themselves."""
        return inf if self.switching is None else max(self.switching.bound(), ROUND * abs(self.loop.t))

    def look(self, t: float, y: Array, inside: Inside) -> None:
        """Evaluate contacts and switches over the last step, which ends at (t, y). inside: fractions (k,) of the step -> y (k, n)
        on its polynomial."""
        if self.contacts is not None:
            self.contacts.look(t, y)
        if self.switching is not None:
            self.switching.look(self.loop.t, t - self.loop.t, inside)

    def shorter(self, h: float, inside: Inside) -> float | None:
        """Length (s) that the step of length h should have had; None: accept the step."""
        widths = [None if self.contacts is None else self.contacts.shorter(h, lambda part: inside(np.array(part))),
                  None if self.switching is None else self.switching.shorter()]
        return min((width for width in widths if width is not None), default=None)

    @property
    def one_by_one(self) -> bool:
        """Whether steps have to be made one at a time, because the system's contacts have no native tables."""
        return self.contacts is not None and self.contacts.native is None

    def kept(self, t: Array, y: Array, inside: Callable[..., Array], closely: bool) -> tuple[int, float]:
        """How many of m steps, made already, can be accepted, and the largest length (s) of the next step, finite only where a
        single step hides a contact or switch. t (m+1,), y (m, n): times and states at the ends of the steps; inside: fractions
        (k,) of a step, a slice of the steps (default all) -> y (m, k, n) on their polynomials.

        closely: it is a single step, in which contacts and switches are sought; else the native method has checked the contacts
        of all steps."""
        if not closely:
            return (len(y) if self.switching is None else self.switching.quiet(t, inside, y.shape[1])), inf

        def single(parts: Array) -> Array:
            found: Array = inside(np.atleast_1d(parts))[0]
            return found if np.ndim(parts) else found[0]

        self.look(float(t[1]), y[0], single)
        shorter = self.shorter(float(t[1] - t[0]), single)
        if shorter is not None:
            return 0, shorter
        self.keep_adaptive()
        return 1, inf

    def keep(self) -> None:
        """To be called when a step is accepted."""
        for part in (self.contacts, self.switching):
            if part is not None:
                part.keep()

    def keep_adaptive(self) -> None:
        """Accept a step of a solver with error control; raises ChatteringError where equations switch without end."""
        self.keep()
        loop = self.loop
        chattering = None if self.chattering is None else self.chattering.endless(loop.run_end - float(loop.first_system.t0))
        if chattering is not None:
            raise loop.failure(chattering.message(), "", ChatteringError)

    def count_hidden(self, inner: Callable[[], list[tuple[float, Array]]]) -> None:
        """Count contacts, kinks and peaks that a constant step passes over; inner: function that returns times (s) and states
        inside the step."""
        if self.contacts is not None:
            self.contacts.count_hidden(inner())
        if self.switching is not None:
            self.switching.count_hidden()

    def jacobian_at(self, t: float, y: Array) -> None:
        """To be called when the Jacobian was evaluated at (t, y): remembers the penetrations there for `stiffness_changed`."""
        if self.contacts is not None:
            self.contacts.jacobian_at(t, y)

    def stiffness_changed(self) -> bool:
        """Whether contacts or kinks at the last accepted point differ from those at which the Jacobian was evaluated."""
        of_contacts = self.contacts is not None and self.contacts.stiffness_changed()
        return of_contacts or (self.switching is not None and self.switching.crossed)

    def nearest(self) -> str:
        """A clause for messages: the contact that is closed, or will close first."""
        return "" if self.contacts is None else self.contacts.nearest()


class SundialsWatch(StepWatch):
    """The watch of a run with SUNDIALS, which is given a stop time before each step, and is restarted to repeat a step."""

    #: longest step during an impact with SUNDIALS, as a fraction of its duration: smaller than IMPACT. Measured with a tolerance
    #: too coarse for an impact (rtol 1e-3): the body loses 45 % of its speed with 0.2, 28 % with 0.1; a body coming to rest had
    #: 250 contacts with 0.2 and 28 with 0.1 when this was chosen, and has 37 with 0.1 now. With finer tolerances 0.1 and 0.2 cost
    #: the same
    impact = 0.1
    crosses = False

    def __init__(self, loop: StepLoop, tolerance: Tolerance) -> None:
        super().__init__(loop, tolerance)
        self._until = -inf

    def stop(self) -> float:
        """Time (s) that the next step must not pass."""
        loop = self.loop
        until = self._until if self._until - loop.t > ROUND * abs(self._until) else inf
        return float(min(loop.t_end, loop.t + self.bound(), until))

    def refuses(self, t: float, y: Array, yp: Array) -> bool:
        """Whether the last step, which ends at (t, y, yp), has to be repeated; the next steps then do not pass the contact or
        kink that it hid."""
        self.look(t, y, cubic_of_step(t - self.loop.t, self.loop.state, (y, yp)))
        hidden = None if self.contacts is None else self.contacts.hidden()
        shorter = None if self.switching is None else self.switching.shorter()
        times = [time for time in (hidden, None if shorter is None else self.loop.t + shorter) if time is not None]
        if not times:
            self.keep_adaptive()
            return False
        self._until = min(times)
        return True
