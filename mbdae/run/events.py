"""One condition on one solution: when it begins and ceases to hold.

Events of a run: instants at which conditions on sensors begin or cease to hold, found on its interpolated solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import OptionError, SolverError, WallClockError, warn
from mbdae.inputs.breaks import beyond
from mbdae.inputs.sensed import paths
from mbdae.integrators.base import Solver, output_times
from mbdae.integrators.dense import cut
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Event
from mbdae.results.result import Result
from mbdae.run.conditions import Condition
from mbdae.run.estimate import Controlled
from mbdae.run.event_roots import SAME, Course, Root
from mbdae.run.job import Job
from mbdae.run.pieces import Signals, may_be_observed, probe
from mbdae.scene.components import Connection
from mbdae.scene.control import of_time
from mbdae.scene.models import keeping
from mbdae.scene.sensed import found as sensed
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared


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
                f"which does not end the run: it ends where the condition begins to hold again"]

    def near_misses(self) -> list[str]:
        """A note where an inequality comes so near to its limit that the accuracy does not decide whether it is passed."""
        near = [root.time for of_one, equation in zip(self._zeros, self.condition.equations, strict=True) if not equation
                for root in of_one if root.before == root.after != 0]
        return [f"'{self.condition.name}' comes so near to its limit at t = {near[0]:.9g} s that the accuracy does not decide "
                f"whether it is passed: ask for a smaller accuracy, or another limit"] if near else []

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
                         for root, equation, value in zip(here, self.condition.equations, values, strict=True)])


def _sense(root: Root) -> int:
    """1 where the function rises through 0, -1 where it falls, 0 where it touches 0, begins or ends there."""
    return (root.after > root.before) - (root.after < root.before) if root.before * root.after <= 0 else 0


#: a run continues after its event for this fraction of the time until the event; NARROW where the run fails with BEYOND
BEYOND, NARROW = 0.02, 1e-6


MORE_POINTS = "give it more points, or outside=\"hold\" to keep its first and last values"


class Watched:
    """Conditions of a run: the first event of `until` ends it, the events of `record` are kept in its result; one of `left`, that
    a curve is read where it has no points, ends it with an error."""

    def __init__(self, until: list[Condition], record: list[Condition], left: list[Condition]) -> None:
        self.until, self.record, self._left, self._ending = until, record, left, [*until, *left]

    def __bool__(self) -> bool:
        return bool(self._ending or self.record)

    @property
    def _paths(self) -> list[str]:
        """The sensors that conditions read."""
        return sorted({path for c in (*self._ending, *self.record) for g in c.functions for path in paths(g)})

    def end(self, prepared: Prepared, solution: Solution, touch: float = 0.0) -> Event | None:
        """The first event that ends the run; OptionError where its condition holds from the start on. touch: see
        `roots.roots`."""
        found, _ = _events(self._ending, prepared, solution, touch, until=True)
        first = min(found, key=lambda event: event.time, default=None)
        if first is not None and first.time <= solution.t[0]:
            if self._is_left(first):
                raise SolverError(f"{first.name}, at the start t = {first.time:g} s; {MORE_POINTS}", first.time)
            raise OptionError(f"until = '{first.name}': it holds already at the start t = {solution.t[0]:g} s; give a condition "
                              f"that becomes true later, or start from another state")
        return first

    def with_turns(self, prepared: Prepared, prepare_again: Callable[[Any], Prepared]) -> Prepared:
        """The scene with joint angles as further unknowns, where conditions read them in space: the rotation of a body gives an
        angle only up to whole turns. prepare_again: prepares the changed scene."""
        model = prepared.model
        read = {path for path in self._paths if may_be_observed(model.scene, path)}
        sensors = [sensed(model.scene, path) for path in sorted(read)]
        hidden = [s for s in sensors if isinstance(s.item, Connection) and s.item.unit(s.quantity) == "rad" and not s.item.loose
                  and model.coordinate_node(s.item.name, s.quantity) is None]
        prepared = prepared if model.planar or not hidden else prepare_again(keeping(model.scene, sorted(read)))
        probe(prepared, self._paths)
        return prepared

    def result(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]], outputs: Any,
               verify: bool) -> Result:
        """The result of a run up to its event, or to its end without one, with all recorded events. made: function that executes
        a job; outputs: as the user gave them."""
        self._check_tables(job.prepared.start.t, job.asked.t_end)
        run, job, event = self._to_event(job, solver, made) if self._ending else (*made(job), None)
        if event is not None:
            job = replace(job, asked=replace(job.asked, t_end=event.time), times=_times(job, outputs, event.time))
            others = tuple(other.until(event.time) for other in run.others)
            run = replace(run, solution=ended(run.solution, event.time), others=others)
        events, notes = self.events(job.prepared, run.solution, event, job.accuracy)
        found = job.result(run, verify)
        found.info = replace(found.info, events=events, warnings=(*found.info.warnings, *notes))
        for note in notes:
            warn(f"scene '{job.prepared.model.scene.name}': {note}")
        if event is not None and self._is_left(event):
            raise SolverError(f"{event.name}, from t = {event.time:.6g} s on; {MORE_POINTS}", event.time, solution=found)
        return found

    def _is_left(self, event: Event) -> bool:
        return any(event.name == one.name for one in self._left)

    def _check_tables(self, begin: float, end: float) -> None:
        """Raise OptionError where a condition reads a table where it has no values, between two times (s)."""
        for condition in (*self._ending, *self.record):
            parts = (part for g in condition.functions for part in of_time(g))
            span_and_remedy = next((text for part in parts if (text := beyond(part, begin, end))), "")
            if span_and_remedy:
                raise OptionError(f"'{condition.name}' in until= or record= reads a table where it has no values: "
                                  f"{span_and_remedy}")

    def _to_event(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]]
                  ) -> tuple[Controlled, Job, Event | None]:
        """A run that continues a little after its event, its job, and the event; without an event the run to its end, and
        None."""
        begin, end = job.prepared.start.t, job.asked.t_end
        near = job.until(solver, self.end)
        beyond = BEYOND
        while True:
            stop = end if near is None else min(end, begin + (1 + beyond) * (near - begin))
            try:
                times = np.append(job.times[job.times < stop], stop)
                run, done = made(replace(job, asked=replace(job.asked, t_end=stop), times=times))
            except WallClockError:
                raise
            except SolverError as error:
                known = getattr(error.solution, "solution", None)
                event = self.end(job.prepared, known, job.accuracy) if isinstance(known, Solution) else None
                if event is None or beyond <= NARROW:
                    raise
                near, beyond = event.time, NARROW  # the run fails soon after the event, so that it has to stop closer to it
                continue
            event = self.end(done.prepared, run.solution, job.accuracy)
            if event is not None or stop == end:
                return run, done, event
            near, beyond = stop, 1.0

    def events(self, prepared: Prepared, solution: Solution, end: Event | None,
               accuracy: float) -> tuple[tuple[Event, ...], list[str]]:
        """Recorded events in the order of time, with `end`, the one that ended the run; and notes on conditions that the accuracy
        leaves undecided."""
        found, notes = _events(self.record, prepared, solution, accuracy)
        notes += _events(self._ending, prepared, solution, accuracy, until=True)[1]
        same = 0.0 if end is None else SAME * (solution.t[-1] - solution.t[0])
        if end is not None:  # a recorded event at the end gets exactly the time of the end
            found = [event._replace(time=end.time) if abs(event.time - end.time) <= same else event for event in found]
            found.append(end)
        return tuple(sorted(dict.fromkeys(found), key=lambda event: event.time)), notes


def _times(job: Job, outputs: Any, end: float) -> Array:
    """Times of a result that ends at an event: as many as asked for, or those asked for until then and the end."""
    if np.ndim(outputs) == 0:
        return output_times(job.prepared.start.t, end, outputs)
    return np.append(job.times[job.times < end], end)


def _events(conditions: list[Condition], prepared: Prepared, solution: Solution, touch: float,
            until: bool = False) -> tuple[list[Event], list[str]]:
    """Events of conditions on a solution, and notes on conditions that are missed by less than the accuracy `touch`. until:
    whether only events are asked for at which a condition begins to hold; the start is one where it holds there."""
    found, notes = list[Event](), list[str]()
    for condition in conditions:
        signals = Signals(prepared, solution, condition.functions)
        seen = Seen(condition, [Course(signals, g) for g in condition.functions], solution, touch)
        found += seen.beginnings() if until else seen.events()
        notes += [*seen.near_misses(), *(seen.at_start() if until else [])]
    return found, notes


def ended(solution: Solution, t: float) -> Solution:
    """The solution up to a time (s) inside it."""
    times = np.array([t])
    count = int(np.searchsorted(solution.t, t, side="left"))
    y, yp = solution.interpolant.value(times), solution.interpolant.derivative(times)
    steps, rows, rates = (np.concatenate([part[:count], last]) for part, last in
                          ((solution.t, times), (solution.y, y), (solution.yp, yp)))
    systems = tuple(entry for entry in solution.systems if entry[0] <= t)
    return replace(solution, t=steps, y=rows, yp=rates, interpolant=cut(solution.interpolant, t), complete=True, systems=systems)
