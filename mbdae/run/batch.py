"""Runs of one scene from many starts, or with many values of parameters of laws, each with an estimate of its error.

States of one scene that are taken from step to step by a loop of the user's own (`stepper`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import ListsAttributes, NotReadError, OptionError, SceneError
from mbdae.formulations import system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.batch import Batch, Together, refuse_watched, solve_batch
from mbdae.integrators.dop853 import DOP853
from mbdae.integrators.loop import StepLoop
from mbdae.results import archive
from mbdae.results.accuracy import plausible
from mbdae.run.choice import choose, prepared_from
from mbdae.run.control import ATTEMPTS, FINER
from mbdae.run.estimate import measure_of
from mbdae.scene.control import problems
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array, System
from mbdae.system.model.moved_bodies import Timeline
from mbdae.system.sampling import Sampler

LOOKED_AT = 5  #: number of states at which the rates of two systems of equations are compared
COMPARED = 32  #: number of equal parts of the run at whose ends, besides the outputs, a run is compared with its companion


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of k points. names (n,): of the unknowns; batch: values at the outputs; estimate (k,): estimated error of each run,
    nan where it failed; warnings: {number of a point: sentence} where the accuracy is missed or the run failed."""

    names: tuple[str, ...]
    batch: Batch
    estimate: Array
    warnings: dict[int, str]


def run_batch(scene: SceneData, t_end: float, accuracy: float = 1e-6, *, starts: Any = None,
              numbers: Mapping[str, Any] | None = None, outputs: Any = None, max_wall: float | None = None) -> Runs:
    """Run every point as `Scene.simulate` does: at ten times the tolerance and at the tolerance. Their difference gives the
    estimated error; where it is above the accuracy, the point is run again with a smaller tolerance. Arguments as in
    `solve_batch`.

    Raises OptionError for scenes for which `simulate` would not choose DOP853, such as stiff ones or those with contact."""
    return Batches(scene, t_end, accuracy, outputs, numbers or ()).run(starts, numbers, max_wall)


class Batches:
    """A scene prepared for several batches of runs, one after the other; arguments as in `run_batch`."""

    def __init__(self, scene: SceneData, t_end: float, accuracy: float = 1e-6, outputs: Any = None,
                 numbers: Iterable[str] = ()) -> None:
        """numbers: names of law parameters that will vary; some cannot, because the equations have them as constants."""
        self.accuracy, self.t_end = plausible(accuracy), t_end
        prepared = prepared_from(scene, t_end=t_end, default=True)
        choice = choose(prepared, scene, self.accuracy)
        if not isinstance(choice.solver, DOP853):
            raise OptionError(f"scene '{scene.name}': a batch is solved by DOP853, but mbdae solves this scene by {choice}; run "
                              "its points one by one")
        self.system, self._known = system_for(prepared, choice.form, 0), dict[str, bool]()
        try:
            left = [name for name in numbers if not self._read(name)]
            written = prepared.all_bodies.moved.written(prepared.model) if left else ()
            fixed = any(f"{item}.{name}" in left for item, name in written)
        except OptionError:
            fixed = True
        if fixed:
            self.system, self._known = system_for(prepared, choice.form, 0, open=True), {}
        if numbers:
            refuse_watched(self.system, t_end)
        times = Asked.of(self.system, t_end, outputs).times
        self.times = np.array([float(t_end)]) if times is None else times
        self._every = distinct(np.r_[self.times, np.linspace(self.system.t0, t_end, COMPARED + 1)])
        self._measure = partial(measure_of(self.system, prepared), self._every)
        self._solver, self._limit = choice.solver.at_accuracy(self.accuracy, self.system.label), choice.solver.tightest[""]

    def read(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """The given parameters of laws without those that the equations do not depend on; OptionError for one on which they
        depend but which cannot be varied."""
        return {name: values for name, values in numbers.items() if self._read(name)}

    def _read(self, name: str) -> bool:
        if name not in self._known:
            try:
                self.system.numbers([name])
                self._known[name] = True
            except NotReadError:
                self._known[name] = False
        return self._known[name]

    def rates_apart(self, own: System, numbers: Mapping[str, float]) -> float:
        """Largest difference between y' of this system with the parameters `numbers` of laws and y' of the system `own`, relative
        to the largest y', at LOOKED_AT states near the start."""
        read = self.read(numbers)
        at, rng, here, there = self.system.numbers(list(read)), np.random.default_rng(0), np.empty(own.n), np.empty(own.n)
        before, apart = at.W[at.slots].copy(), 0.0
        at.W[at.slots] = np.array(list(read.values()))[at.of]
        try:
            for _ in range(LOOKED_AT):
                y = own.y0 + own.scale * rng.uniform(-1, 1, own.n)
                self.system.rhs(own.t0, y, here)
                own.rhs(own.t0, y, there)
                apart = max(apart, float(np.max(np.abs(here - there)) / np.max(np.abs(there), initial=1e-300)))
        finally:
            at.W[at.slots] = before
        return apart

    def run(self, starts: Any = None, numbers: Mapping[str, Any] | None = None, max_wall: float | None = None) -> Runs:
        """Run a batch; see `run_batch`."""
        begin, accuracy = time.perf_counter(), self.accuracy

        def solved(rtol: float, some: NDArray[np.intp] | None = None) -> Batch:
            """Run the points `some` (None: all) at a tolerance."""
            left = None if max_wall is None else max(max_wall - (time.perf_counter() - begin), 1e-9)
            given = {name: _some(np.atleast_1d(v), some) for name, v in (numbers or {}).items()}
            own = None if starts is None else _some(np.atleast_2d(starts), some)
            return solve_batch(self.system, self.t_end, replace(self._solver, rtol=rtol), starts=own, numbers=given,
                               outputs=self._every, max_wall=left)

        tight = self._solver.tolerance
        coarse, fine = solved(min(tight * self._solver.companion, 0.1)), solved(tight)
        made, estimate, cpu = fine, np.full(len(fine.errors), np.nan), coarse.cpu_s + fine.cpu_s
        some = np.arange(len(fine.errors))
        for _ in range(ATTEMPTS):
            # the whole difference counts as the error: not at every point does it fall with the tolerance as it is assumed to
            estimate[some] = [float(np.max(self._measure(a, b))) if fine.errors[i] is None else np.nan
                              for i, (a, b) in enumerate(zip(coarse.y, fine.y, strict=True))]
            made = fine if len(some) == len(estimate) else _with(made, fine, some)
            missed = np.flatnonzero(estimate[some] > accuracy)
            if not len(missed) or tight <= self._limit:
                break
            coarse, some = _rows(fine, missed), some[missed]
            wanted = tight * float(np.clip((0.5 * accuracy / np.max(estimate[some])) ** (1 / 0.9), *FINER))
            tight = max(wanted, self._limit)
            fine = solved(tight, some)
            cpu += fine.cpu_s
        at = np.searchsorted(self._every, self.times)
        done = replace(made, t=self.times, y=made.y[:, at], cpu_s=cpu, wall_s=time.perf_counter() - begin)
        return Runs(self.system.names, done, estimate, _warnings(done, estimate, accuracy))


@dataclass(frozen=True, eq=False)
class State(ListsAttributes):
    """The state of a stepper at a time t (s): y (k, n) the unknowns of all k states, inputs (k, m) held from there on.

    It does not change when the stepper goes on, and can be pickled, and stored by `save`."""

    t: float
    y: Array
    inputs: Array
    _yp: Array = field(repr=False)
    _grid: tuple[float, int] = field(repr=False)
    _controllers: list[Any] = field(repr=False)  # of the scene's own: first instant, calls, memory and outputs
    _memory: list[Any] = field(repr=False)

    def save(self, path: Any) -> None:
        """Write the state to a file (.npz) that `reset` of a stepper of the same scene reads. OptionError where the scene has
        controllers of its own, whose memories are objects of the user's."""
        if any(self._controllers):
            raise OptionError("save: the scene has sampled controllers of its own, whose memories no file holds: keep the state "
                              "in this process, or pickle it")
        t = np.array([self.t, *self._grid])
        archive.write(path, "mbdae state", {"t": t, "y": self.y, "inputs": self.inputs, "yp": self._yp})


class Window:
    """What inputs of time require of steps, looked at once for `span` (s). A call as `System.timeline`."""

    def __init__(self, scene: SceneData, timeline: Callable[..., Any], span: float) -> None:
        self.scene, self.timeline, self.span = scene, timeline, span
        self.begin, self.end = math.inf, -math.inf
        self.line: Timeline | None = None

    def __call__(self, t0: float, t1: float, accuracy: float | None = None) -> Timeline | None:
        if t1 > self.end or t0 < self.begin:
            end = max(t1, t0 + self.span)
            if problems(self.scene, t0, end, True):  # such as a table that ends there: only what is stepped over has to be known
                end = t1
                if found := problems(self.scene, t0, end, True):
                    raise SceneError(found)
            self.begin, self.end, self.line = t0, end, self.timeline(t0, end, accuracy)
        if self.line is None:
            return None
        breaks = self.line.breaks
        return replace(self.line, edges=np.r_[t0, breaks[(breaks > t0) & (breaks < t1)], t1])


class States:
    """k states of one scene that a solver takes from step to step. y, yp (k, n): unknowns and, where the loop of a run takes
    them, derivatives; now: the inputs that the controller called `mine` returns."""

    together: Together | None = None  #: the native method, where nothing has to be watched within a step

    def __init__(self, system: System, solver: Solver, asked: Asked, k: int, now: list[float], mine: str) -> None:
        self.solver, self.asked, self.now, self.mine, self.t = solver, asked, now, mine, float(system.t0)
        self._first, self.systems = system, [system] * k
        self.samplers: list[Sampler] = [system.sampled(system.t0) for _ in range(k) if system.sampled]
        self._own = any(c.controller.name != mine for sampler in self.samplers[:1] for c in sampler.called)
        if isinstance(solver, DOP853) and not (self._own or system.guards or system.switches or system.looks_at_steps):
            self.together = Together(system, solver, k).bounded(asked.share if self.samplers else None)
        self.y = np.tile(system.y0, (k, 1)) if self.together is None else self.together.y
        self.yp = np.tile(system.yp0, (k, 1))
        self.memory: list[Any] = [] if self.together else [system.memory()] * k

    def to(self, end: float, grid: tuple[float, int, float], inputs: Array, slots: NDArray[np.intp]) -> None:
        """Take all states to the time `end` (s) with inputs (k, m) at the places `slots` of y. grid: first instant (s) of the
        controller that holds them, number of this one, and the time between two (s)."""
        begin, line = self.t, None
        if self._first.timeline is not None:
            line = self._first.timeline(begin, end, self.solver.aimed(self._first.label))
        if self.together is not None and line is None:
            self.y[:, slots] = inputs
        if self.together is None or line is not None or not self.together.to(begin, end):  # one that stops says why, alone
            before, systems = self.state(grid[:2], inputs), list(self.systems)
            try:
                for i, values in enumerate(inputs):
                    self._alone(i, begin, end, grid, values)
            except BaseException:
                self.take(before)
                self.systems[:] = systems
                raise
        self.t = end

    def _alone(self, i: int, begin: float, end: float, grid: tuple[float, int, float], values: Array) -> None:
        """Take state i to `end` by the loop of a run."""
        system, y = self.systems[i], self.y[i].copy()
        start = system.starting(begin, y, self.yp[i].copy() if self.together is None else system.restarted(begin, y)[1])
        if self.samplers:
            sampler, self.now[:] = self.samplers[i], values.tolist()
            for called in sampler.called:
                if called.controller.name == self.mine:
                    (called.begin, called.count, every), called.held = grid, []
                    called.controller = replace(called.controller, every=every)
            start = start.sampling(lambda _: sampler)
        if self.memory:
            start.remember(self.memory[i])
        asked = replace(self.asked, t_end=end)
        with system.owner.running(), StepLoop(start, self.solver, end, None, None, None, impacts=asked.impacts) as loop:
            self.solver.between_breaks(loop, asked)
        (self.y[i], self.yp[i]), self.systems[i] = loop.state, loop.system
        if self.memory:
            self.memory[i] = loop.system.memory()

    def state(self, grid: tuple[float, int], inputs: Array) -> State:
        """The present state, with the memories of the scene's own controllers."""
        own = [[(c.begin, c.count, deepcopy(c.memory), list(c.held)) for c in one.called] for one in self.samplers if self._own]
        return State(self.t, self.y.copy(), inputs.copy(), self.yp.copy(), grid, own, list(self.memory))

    def take(self, state: State) -> None:
        """Go on from a state."""
        self.t, self.systems[:] = state.t, [self._first] * len(self.systems)
        self.y[:], self.yp[:] = state.y, state._yp
        self.memory[:] = state._memory or self.memory
        for sampler, own in zip(self.samplers, state._controllers, strict=False):
            for c, (begin, count, memory, held) in zip(sampler.called, own, strict=True):
                c.begin, c.count, c.memory, c.held = begin, count, deepcopy(memory), list(held)


def _some(values: Any, some: NDArray[np.intp] | None) -> Any:
    return values if some is None or len(values) == 1 else values[some]


def _rows(batch: Batch, some: NDArray[np.intp]) -> Batch:
    """The points `some` (indices) of a batch."""
    rows = {name: getattr(batch, name)[some] for name in ("y", "last", "steps", "rejected", "evaluations")}
    return replace(batch, errors=tuple(batch.errors[i] for i in some), **rows)


def _with(batch: Batch, other: Batch, some: NDArray[np.intp]) -> Batch:
    """A batch whose points `some` (indices) are replaced by those of another batch, in their order."""
    rows = {name: getattr(batch, name).copy() for name in ("y", "last", "steps", "rejected", "evaluations")}
    errors = list(batch.errors)
    for j, i in enumerate(some):
        errors[i] = other.errors[j]
        for name, row in rows.items():
            row[i] = getattr(other, name)[j]
    return replace(batch, errors=tuple(errors), **rows)


def _warnings(batch: Batch, estimate: Array, accuracy: float) -> dict[int, str]:
    found = {i: str(error) for i, error in enumerate(batch.errors) if error is not None}
    missed = np.flatnonzero(estimate > accuracy)
    return found | {int(i): f"accuracy {accuracy:g} asked, estimated error {estimate[i]:.1e}" for i in missed}
