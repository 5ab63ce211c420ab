"""Events of a run: instants at which conditions on sensors begin or cease to hold, found on its interpolated solution."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.inputs.sensed import paths
from mbdae.integrators.base import Solver, output_times
from mbdae.integrators.dense import cut
from mbdae.integrators.solution import Solution
from mbdae.results.result import Event, Result
from mbdae.run.control import Controlled
from mbdae.run.events.conditions import Condition
from mbdae.run.events.roots import SAME, Root, roots
from mbdae.run.job import Job
from mbdae.scene.components import Connection
from mbdae.scene.sensed import found as sensed
from mbdae.scene.variants import keeping
from mbdae.system.assembled.observed import Observer
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

BEYOND, NARROW = 0.02, 1e-6  #: how far a run reaches beyond its event, over the time until then; where it fails behind it


class Watched:
    """Conditions of a run: `until` ends it, `record` are kept."""

    def __init__(self, until: list[Condition], record: list[Condition]) -> None:
        self.until, self.record = until, record

    def __bool__(self) -> bool:
        return bool(self.until or self.record)

    def end(self, prepared: Prepared, solution: Solution, touch: float = 0.0) -> Event | None:
        """The first event that ends the run; OptionError where it holds from the start on. touch: see `roots`."""
        found, _ = _events(self.until, prepared, solution, touch, until=True)
        first = min(found, key=lambda event: event.time, default=None)
        if first is not None and first.time <= solution.t[0]:
            raise OptionError(f"until = '{first.name}': it holds from the start t = {solution.t[0]:g} s on; give a condition "
                              f"that does not, or start from another state")  # fmt: skip
        return first

    def with_turns(self, prepared: Prepared, prepare_again: Callable[[Any], Prepared]) -> Prepared:
        """The scene with the angles that conditions read as unknowns of their own, where bodies show them up to whole turns."""
        model = prepared.model
        read = {path for c in (*self.until, *self.record) for g in c.functions for path in paths(g)}
        sensors = [sensed(model.scene, path) for path in sorted(read)]
        hidden = [s for s in sensors if isinstance(s.item, Connection) and s.item.unit(s.quantity) == "rad" and not s.item.loose
                  and model.coordinate_node(s.item.name, s.quantity) is None]  # fmt: skip
        return prepared if model.planar or not hidden else prepare_again(keeping(model.scene, sorted(read)))

    def result(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]], outputs: Any,
               verify: bool) -> Result:  # fmt: skip
        """The result of a run up to its event, with what is recorded. made: runs a job."""
        run, job, event = self._to_event(job, solver, made) if self.until else (*made(job), None)
        if event is not None:
            job = replace(job, asked=replace(job.asked, t_end=event.time), times=_times(job, outputs, event.time))
            others = tuple(replace(other, states=other.states.until(event.time)) for other in run.others)
            run = replace(run, solution=ended(run.solution, event.time), others=others)
        events, notes = self.events(job.prepared, run.solution, event, job.accuracy)
        found = job.result(run, verify)
        found.info = replace(found.info, events=events, warnings=(*found.info.warnings, *notes))
        for note in notes:
            warnings.warn(f"scene '{job.prepared.model.scene.name}': {note}", AccuracyWarning, stacklevel=4)
        return found

    def _to_event(self, job: Job, solver: Solver, made: Callable[[Job], tuple[Controlled, Job]]
                  ) -> tuple[Controlled, Job, Event | None]:  # fmt: skip
        """A run that reaches a little beyond its event, and that event; to the end where there is none."""
        begin, end = job.prepared.start.t, job.asked.t_end
        near = job.until(solver, self.end)
        beyond = BEYOND
        while True:
            stop = end if near is None else min(end, begin + (1 + beyond) * (near - begin))
            try:
                times = np.append(job.times[job.times < stop], stop)
                run, done = made(replace(job, asked=replace(job.asked, t_end=stop), times=times))
            except SolverError as error:
                known = getattr(error.solution, "solution", None)
                event = self.end(job.prepared, known, job.accuracy) if isinstance(known, Solution) else None
                if event is None or beyond <= NARROW:
                    raise
                near, beyond = event.time, NARROW  # behind the event the motion ends
                continue
            event = self.end(done.prepared, run.solution, job.accuracy)
            if event is not None or stop == end:
                return run, done, event
            near, beyond = stop, 1.0

    def events(self, prepared: Prepared, solution: Solution, end: Event | None,
               accuracy: float) -> tuple[tuple[Event, ...], list[str]]:  # fmt: skip
        """What is recorded, in the order of time, with the event that ended the run, and what accuracy leaves undecided."""
        found, notes = _events(self.record, prepared, solution, accuracy)
        notes += _events(self.until, prepared, solution, accuracy, until=True)[1]
        same = 0.0 if end is None else SAME * (solution.t[-1] - solution.t[0])
        if end is not None:  # recorded conditions that are met at the end are met there too
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
    """Events of conditions on a solution, and sentences on conditions that are missed by less than the accuracy `touch`; until:
    only those at which they begin to hold, the start among them."""
    found, notes = list[Event](), list[str]()
    for condition in conditions:
        observer = Observer(prepared.model, prepared.all_bodies.moved, condition.functions)
        zeros = [roots(lambda t, i=i, o=observer: o(t, solution.interpolant.value(t))[:, i], solution.t, touch, e)  # type: ignore[misc]
                 for i, e in enumerate(condition.equations)]  # fmt: skip
        found += _of(condition, observer, zeros, solution, until)
        notes += _near_misses(condition, zeros)
    return found, notes


def _near_misses(condition: Condition, zeros: list[list[Root]]) -> list[str]:
    """Where an inequality is nearly met, or nearly ceases to be, within the accuracy."""
    near = [root.time for of_one, equation in zip(zeros, condition.equations, strict=True) if not equation
            for root in of_one if root.before == root.after]  # fmt: skip
    return [f"'{condition.name}' comes so near to its limit at t = {near[0]:.9g} s that the accuracy does not decide whether it "
            f"is passed: ask for a higher accuracy, or another limit"] if near else []  # fmt: skip


def _of(condition: Condition, observer: Observer, zeros: list[list[Root]], solution: Solution, until: bool) -> list[Event]:
    instants = np.unique([root.time for of_one in zeros for root in of_one])
    instants = instants[np.diff(instants, prepend=-np.inf) > SAME * (solution.t[-1] - solution.t[0])]
    truth = _truth(condition, observer, solution, instants)
    found = []
    for n, t in enumerate(instants.tolist()):
        here = _at(condition, zeros, t, SAME * (solution.t[-1] - solution.t[0]))
        before, after = truth[n], truth[n + 1]
        if len(condition.functions) == 1 and condition.equations[0]:
            root = here[0]
            assert root is not None
            found.append(Event(t, condition.name, _sense(root)))
        elif before != after and not (t <= solution.t[0]):
            found.append(Event(t, condition.name, 1 if after else -1))
        elif not before and condition.holds(_during(condition, observer, solution, t, here)):
            found.append(Event(t, condition.name, 0))
    if until:
        found = [event for event in found if event.direction >= 0 or _is_equation(condition)]
        if truth[0] and not _is_equation(condition):
            found.insert(0, Event(float(solution.t[0]), condition.name, 1))
    return found


def _is_equation(condition: Condition) -> bool:
    return len(condition.functions) == 1 and condition.equations[0]


def _sense(root: Root) -> int:
    """1 where the function rises through 0, -1 where it falls, 0 where it touches 0, begins or ends there."""
    return (root.after > root.before) - (root.after < root.before) if root.before * root.after <= 0 else 0


def _at(condition: Condition, zeros: list[list[Root]], t: float, same: float) -> list[Root | None]:
    """The zero of every function at an instant, None where it has none there."""
    return [next((root for root in of_one if abs(root.time - t) <= same), None) for of_one in zeros]


def _truth(condition: Condition, observer: Observer, solution: Solution, instants: Array) -> list[bool]:
    """Whether the condition holds between instants: before the first, ..., after the last."""
    edges = np.concatenate([solution.t[:1], instants, solution.t[-1:]])
    middle = (edges[1:] + edges[:-1]) / 2
    values = observer(middle, solution.interpolant.value(middle))
    holds = (values > 0) & ~np.array(condition.equations)
    found = [condition.holds(atoms) for atoms in holds]
    if edges[1] == edges[0] and len(found) > 1:  # an instant at the start: nothing is before it
        found[0] = found[1]
    if edges[-1] == edges[-2] and len(found) > 1:
        found[-1] = found[-2]
    return found


def _during(condition: Condition, observer: Observer, solution: Solution, t: float, here: list[Root | None]) -> Any:
    """Which comparisons hold at an instant: equations that are met there, and what is positive."""
    values = observer(np.array([t]), solution.interpolant.value(np.array([t])))[0]
    return np.array([(root is not None) if equation else (root is None and value > 0)
                     for root, equation, value in zip(here, condition.equations, values, strict=True)])  # fmt: skip


def ended(solution: Solution, t: float) -> Solution:
    """The solution up to a time (s) inside it."""
    times = np.array([t])
    count = int(np.searchsorted(solution.t, t, side="left"))
    y, yp = solution.interpolant.value(times), solution.interpolant.derivative(times)
    steps, rows, rates = (np.concatenate([part[:count], last]) for part, last in
                          ((solution.t, times), (solution.y, y), (solution.yp, yp)))  # fmt: skip
    systems = tuple(entry for entry in solution.systems if entry[0] <= t)
    return replace(solution, t=steps, y=rows, yp=rates, interpolant=cut(solution.interpolant, t), complete=True, systems=systems)
