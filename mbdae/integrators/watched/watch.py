"""Bounds of the step in addition to the error test: contacts, kinks of the equations, and functions with narrow peaks."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Self

import numpy as np

from mbdae.errors import ChatteringError
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.watched.arguments import Inside, cubic_of_step
from mbdae.integrators.watched.chattering import Chattering
from mbdae.integrators.watched.contact_steps import IMPACT, ROUND, ContactSteps
from mbdae.integrators.watched.switching import SwitchingSteps
from mbdae.system.base import Array

Tolerance = Callable[[Array], Array]  #: y (n,) -> tolerance of every unknown (n,)


class StepWatch:
    """Contacts and switches of one run, where the system has some.

    A solver calls `bound` before a step and `look` after it; `shorter` then returns a shorter step to try, or None; `keep` is
    called when the step is accepted.
    """

    #: longest step during an impact, as a fraction of its duration
    impact: float = IMPACT

    def __init__(self, loop: StepLoop, tolerance: Tolerance) -> None:
        self.loop, system = loop, loop.system
        self.contacts = None if system.guards is None else ContactSteps(system, loop.stats, self.impact * loop.impacts)
        self.switching = None if system.switches is None else SwitchingSteps(system, loop.stats, tolerance)
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
                  None if self.switching is None else self.switching.shorter()]  # fmt: skip
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


def stop_time(loop: StepLoop, watch: SundialsWatch | None) -> float:
    """Time (s) that the next step must not pass, by the end of the part of the run, the watch and the inputs of time."""
    stop = loop.t_end if watch is None else watch.stop()
    longest = loop.system.longest_step
    return stop if longest is None else min(stop, loop.t + max(longest(loop.t), ROUND * abs(loop.t)))
