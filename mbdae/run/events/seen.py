"""One condition on one solution: when it begins and ceases to hold."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.integrators.solution import Solution
from mbdae.results.run_info import Event
from mbdae.run.events.conditions import Condition
from mbdae.run.events.course import Course
from mbdae.run.events.roots import SAME, Root
from mbdae.system.base import Array


class Seen:
    """When a condition holds on a solution. courses: values of its functions over the solution; touch: as for `roots.roots`."""

    def __init__(self, condition: Condition, courses: list[Course], solution: Solution, touch: float) -> None:
        self.condition, self._courses = condition, courses
        self._begin, self._end = float(solution.t[0]), float(solution.t[-1])
        self._same = SAME * (self._end - self._begin)
        found = [course.zeros(touch, equation) for course, equation in zip(courses, condition.equations, strict=True)]
        self._zeros, self._noise = [one.roots for one in found], np.array([one.noise for one in found])

    def events(self) -> list[Event]:
        """The events of the condition in the order of time."""
        found = (self._event(n, float(t)) for n, t in enumerate(self._instants))
        return [event for event in found if event is not None]

    def beginnings(self) -> list[Event]:
        """Events at which the condition begins to hold: the start, if it holds there, and later ones; of an equation, all events
        after the start."""
        if self.condition.is_equation:
            return [event for event in self.events() if event.time > self._begin]
        holds = [Event(self._begin, self.condition.name, 1)] if self._holds_at_start else []
        return holds + [event for event in self.events() if event.direction >= 0]

    def at_start(self) -> list[str]:
        """A note where the condition begins to hold at the start itself, which does not end the run."""
        if self.condition.is_equation or self._holds_at_start or not self._truth[0]:
            return []
        return [f"until = '{self.condition.name}' is not met at the start t = {self._begin:g} s but immediately after it, "
                f"which does not end the run: it ends where the condition begins to hold again"]  # fmt: skip

    def near_misses(self) -> list[str]:
        """A note where an inequality comes so near to its limit that the accuracy does not decide whether it is passed."""
        near = [root.time for of_one, equation in zip(self._zeros, self.condition.equations, strict=True) if not equation
                for root in of_one if root.before == root.after != 0]  # fmt: skip
        return [f"'{self.condition.name}' comes so near to its limit at t = {near[0]:.9g} s that the accuracy does not decide "
                f"whether it is passed: ask for a smaller accuracy, or another limit"] if near else []  # fmt: skip

    @cached_property
    def _instants(self) -> Array:
        """Times (k,) at which a function of the condition vanishes."""
        found = distinct([root.time for of_one in self._zeros for root in of_one])
        return np.asarray(found[np.diff(found, prepend=-np.inf) > self._same])

    @cached_property
    def _times(self) -> list[Array]:
        return [np.array([root.time for root in of_one]) for of_one in self._zeros]

    def _event(self, n: int, t: float) -> Event | None:
        here, name = self._at(t), self.condition.name
        before, after = self._truth[n], self._truth[n + 1]
        if self.condition.is_equation:
            assert here[0] is not None
            return Event(t, name, _sense(here[0]))
        if before != after and not t <= self._begin:
            return Event(t, name, 1 if after else -1)
        if not before and any(root is not None for root in here) and self.condition.holds(self._during(t, here)):
            return Event(t, name, 0)
        return None

    def _at(self, t: float) -> list[Root | None]:
        """The zero of every function at an instant, None where it has none there."""
        found: list[Root | None] = []
        for times, of_one in zip(self._times, self._zeros, strict=True):
            i = int(np.searchsorted(times, t - self._same))
            found.append(of_one[i] if i < len(times) and times[i] <= t + self._same else None)
        return found

    @cached_property
    def _truth(self) -> list[bool]:
        """Whether the condition holds before the first of the instants, between every two of them, and after the last."""
        edges = np.concatenate([[self._begin], self._instants, [self._end]])
        atoms = self._atoms((edges[1:] + edges[:-1]) / 2)
        found = [self.condition.holds(row) for row in atoms]
        if edges[1] == edges[0] and len(found) > 1:  # an instant at the start, before which there is no time to evaluate
            found[0] = found[1]
        if edges[-1] == edges[-2] and len(found) > 1:
            found[-1] = found[-2]
        return found

    def _values(self, t: Array) -> Array:
        """Values of the condition's functions, (k, number of functions), at times (k,)."""
        return np.stack([course(t) for course in self._courses], axis=1)

    def _atoms(self, t: Array) -> NDArray[np.bool_]:
        """Whether each comparison holds, (k, number of comparisons), at times (k,) at which none of them changes."""
        values = self._values(t)
        zero = np.abs(values) <= self._noise
        return np.asarray(np.where(zero, np.array(self.condition.meeting), (values > 0) & ~np.array(self.condition.equations)))

    @cached_property
    def _holds_at_start(self) -> bool:
        return self.condition.holds(self._atoms(np.array([self._begin]))[0])

    def _during(self, t: float, here: list[Root | None]) -> Any:
        """Which comparisons hold at an instant t: equations g = 0 with a zero there, and comparisons g > 0 where g is positive.
        here: the zero of every function at t, or None."""
        values = self._values(np.array([t]))[0]
        return np.array([(root is not None) if equation else (root is None and value > 0)
                         for root, equation, value in zip(here, self.condition.equations, values, strict=True)])  # fmt: skip


def _sense(root: Root) -> int:
    """1 where the function rises through 0, -1 where it falls, 0 where it touches 0, begins or ends there."""
    return (root.after > root.before) - (root.after < root.before) if root.before * root.after <= 0 else 0
