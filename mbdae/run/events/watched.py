"""Events of a run: instants at which conditions on sensors begin or cease to hold, found on its interpolated solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SolverError, WallClockError, warn
from mbdae.inputs.breaks import beyond
from mbdae.inputs.sensed import paths
from mbdae.integrators.base import Solver, output_times
from mbdae.integrators.dense import cut
from mbdae.integrators.solution import Solution
from mbdae.results.result import Result
from mbdae.results.run_info import Event
from mbdae.run.control import Controlled
from mbdae.run.events.conditions import Condition
from mbdae.run.events.course import Course
from mbdae.run.events.roots import SAME
from mbdae.run.events.seen import Seen
from mbdae.run.events.signals import Signals, may_be_observed, probe
from mbdae.run.job import Job
from mbdae.scene.components import Connection
from mbdae.scene.prescribed import of_time
from mbdae.scene.sensed import found as sensed
from mbdae.scene.variants import keeping
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: a run continues after its event for this fraction of the time until the event; NARROW where the run fails with BEYOND
BEYOND, NARROW = 0.02, 1e-6


class Watched:
    """Conditions of a run: the first event of `until` ends it, the events of `record` are kept in its result."""

    def __init__(self, until: list[Condition], record: list[Condition]) -> None:
        self.until, self.record = until, record

    def __bool__(self) -> bool:
        return bool(self.until or self.record)

    @property
    def _paths(self) -> list[str]:
        """The sensors that conditions read."""
        return sorted({path for c in (*self.until, *self.record) for g in c.functions for path in paths(g)})

    def end(self, prepared: Prepared, solution: Solution, touch: float = 0.0) -> Event | None:
        """The first event that ends the run; OptionError where its condition holds from the start on. touch: see
        `roots.roots`."""
        found, _ = _events(self.until, prepared, solution, touch, until=True)
        first = min(found, key=lambda event: event.time, default=None)
        if first is not None and first.time <= solution.t[0]:
            raise OptionError(f"until = '{first.name}': it holds already at the start t = {solution.t[0]:g} s; give a condition "
                              f"that becomes true later, or start from another state")  # fmt: skip
        return first

    def with_turns(self, prepared: Prepared, prepare_again: Callable[[Any], Prepared]) -> Prepared:
        """The scene with joint angles as further unknowns, where conditions read them in space: the rotation of a body gives an
        angle only up to whole turns. prepare_again: prepares the changed scene."""
        model = prepared.model
        read = {path for path in self._paths if may_be_observed(model.scene, path)}
        sensors = [sensed(model.scene, path) for path in sorted(read)]
        hidden = [s for s in sensors if isinstance(s.item, Connection) and s.item.unit(s.quantity) == "rad" and not s.item.loose
                  and model.coordinate_node(s.item.name, s.quantity) is None]  # fmt: skip
        prepared = prepared if model.planar or not hidden else prepare_again(keeping(model.scene, sorted(read)))
        probe(prepared, self._paths)
        return prepared

    def result(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]], outputs: Any,
               verify: bool) -> Result:  # fmt: skip
        """The result of a run up to its event, or to its end without one, with all recorded events. made: function that executes
        a job; outputs: as the user gave them."""
        self._check_tables(job.prepared.start.t, job.asked.t_end)
        run, job, event = self._to_event(job, solver, made) if self.until else (*made(job), None)
        if event is not None:
            job = replace(job, asked=replace(job.asked, t_end=event.time), times=_times(job, outputs, event.time))
            others = tuple(other.until(event.time) for other in run.others)
            run = replace(run, solution=ended(run.solution, event.time), others=others)
        events, notes = self.events(job.prepared, run.solution, event, job.accuracy)
        found = job.result(run, verify)
        found.info = replace(found.info, events=events, warnings=(*found.info.warnings, *notes))
        for note in notes:
            warn(f"scene '{job.prepared.model.scene.name}': {note}")
        return found

    def _check_tables(self, begin: float, end: float) -> None:
        """Raise OptionError where a condition reads a table where it has no values, between two times (s)."""
        for condition in (*self.until, *self.record):
            parts = (part for g in condition.functions for part in of_time(g))
            span_and_remedy = next((text for part in parts if (text := beyond(part, begin, end))), "")
            if span_and_remedy:
                raise OptionError(f"'{condition.name}' in until= or record= reads a table where it has no values: "
                                  f"{span_and_remedy}")

    def _to_event(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]]
                  ) -> tuple[Controlled, Job, Event | None]:  # fmt: skip
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
               accuracy: float) -> tuple[tuple[Event, ...], list[str]]:  # fmt: skip
        """Recorded events in the order of time, with `end`, the one that ended the run; and notes on conditions that the accuracy
        leaves undecided."""
        found, notes = _events(self.record, prepared, solution, accuracy)
        notes += _events(self.until, prepared, solution, accuracy, until=True)[1]
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
            until: bool = False) -> tuple[list[Event], list[str]]:  # fmt: skip
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
                          ((solution.t, times), (solution.y, y), (solution.yp, yp)))  # fmt: skip
    systems = tuple(entry for entry in solution.systems if entry[0] <= t)
    return replace(solution, t=steps, y=rows, yp=rates, interpolant=cut(solution.interpolant, t), complete=True, systems=systems)
