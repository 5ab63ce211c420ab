"""Many runs ("points") of the same equations in one native call: from many starts, or with many values of parameters of laws.

Every point makes the same steps as a single run of DOP853; stages of the interpolant are evaluated only in steps with an output.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import ENDS, ListsAttributes, MbdaeError, OptionError, WallClockError, interrupted
from mbdae.integrators.base import DEFAULT_ACCURACY, Asked, absolute_tolerance
from mbdae.integrators.dop853 import DOP853, METHOD
from mbdae.native.equations import Equations, rates_of
from mbdae.native.explicit import Batch as Kept
from mbdae.native.explicit import Explicit
from mbdae.system.base import Array, Numbers, System
from mbdae.threads import one_thread
from mbdae.values import array, function, of_class, option, optional, shown

Progress = Callable[[int, int], None]  #: function of the number of points done and of all points
PERIOD = 0.1  #: shortest wall time (s) between two calls of a progress function, the last one excepted
NOT_RUN = "not run"


@dataclass(frozen=True, eq=False)
class Batch(ListsAttributes):
    """Runs of k points: t (m,) s, y (k, m, n) the unknowns there, last (k, n) those at the end of each run; nan after a failure.

    errors: message of every point that failed or was not run, else None; steps, rejected, evaluations (k,); cpu_s, wall_s."""

    t: Array
    y: Array
    last: Array
    errors: tuple[str | None, ...]
    steps: NDArray[np.int64]
    rejected: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    cpu_s: float
    wall_s: float

    @property
    def failures(self) -> list[int]:
        """Numbers of the points that failed."""
        return [i for i, error in enumerate(self.errors) if error is not None]

    def __repr__(self) -> str:
        return f"<Batch: {len(self.errors)} points, {len(self.failures)} failed, {self.cpu_s:.3g} s CPU>"


def is_watched(s: System, t_end: float) -> bool:
    """Whether a run to t_end (s) has contacts, switches, controllers or inputs for which its steps are shortened or end early."""
    line = s.timeline(s.t0, t_end) if s.timeline is not None else None
    return any(part is not None for part in (line, s.guards, s.switches, s.longest_step, s.sampled))


def refuse_watched(system: System, t_end: float) -> None:
    """Raise OptionError for a batch of runs to t_end (s) with different numbers of laws where `is_watched`: contacts, switches
    and inputs are watched with the numbers of the scene."""
    if is_watched(system, t_end):
        raise OptionError("numbers: the contacts, switching laws, sampled controllers or breaks of inputs of this scene are "
                          "watched with the numbers stated in the scene, so these cannot vary in a batch; build a scene for "
                          "every value, and solve them one by one")


def solve_batch(system: System, t_end: float, solver: Any = None, *, starts: Any = None,
                numbers: Mapping[str, Any] | None = None, outputs: Any = None, max_wall: float | None = None,
                progress: Progress | None = None) -> Batch:
    """Integrate the same equations at k points, one after the other, from system.t0 to t_end (s).

    solver: mb.DOP853 with its tolerances, which hold at all points; starts: y (k, n) or (n,) at t0, by default that of the
    system; numbers: {name: values (k,), or one value} of parameters of laws, such as "elbow.mass" (in all laws of that item);
    outputs: number of equally spaced times, or the times, by default the end; max_wall: wall time (s) of all points, after which
    a WallClockError is raised;
    progress(done, all): called at most 10 times per second.
    A point that fails has its message in `errors`; all others are run. Ctrl-C, and the end of max_wall, raise
    exceptions whose attribute `solution` is the Batch so far. OptionError where the system has no right-hand side, or a number
    cannot be varied. Starts have to satisfy the constraints of the system, if it has some.
    Systems with contacts, switching laws, sampled controllers or breaks of inputs run point by point, as by `solver.solve`.
    """
    method = option("solver", DOP853() if solver is None else solver, of_class, "give mb.DOP853(...)", base=DOP853)
    tell = optional("progress", progress, function, "give a function progress(done, all), or None", takes="done, all")
    asked = Asked.of(system, t_end, outputs, max_wall=max_wall)
    method = method if method.rtol is not None else method.at_accuracy(DEFAULT_ACCURACY, system.label)
    method.check(system)
    with system.owner.running(), one_thread():
        points = _Points.of(system, starts, {} if numbers is None else numbers)
        with points.restored():
            return _Run(system, method, asked, points, tell).result()


class Together:
    """k states of the same equations, which DOP853 takes from one instant to the next in a native call, every one by the steps of
    a run of its own. y (k, n): the states."""

    def __init__(self, system: System, solver: DOP853, k: int) -> None:
        self._equations, self._edges = rates_of(system), np.array([0.0, 1.0])
        atol = absolute_tolerance(system, solver.tolerance, solver.atol)
        self._method = Explicit(self._equations, METHOD, np.zeros(0), solver.tolerance, atol)
        none = np.zeros(0, dtype=np.int64)
        self._kept = Kept(0.0, 1.0, np.tile(system.y0, (k, 1)), np.zeros(0), np.zeros(1), none, np.zeros((k, 0)))
        self.y = self._kept.starts

    def bounded(self, share: float | None) -> Self:
        """Steps are at most this part of the time between two instants; None: they are not bounded."""
        if share is not None:
            self._method.bound(self._edges, share)
            self._edges = self._method._edges
        return self

    def to(self, begin: float, end: float) -> bool:
        """Take all from `begin` to `end` (s), and return whether none stopped; where one does, y stays as it was."""
        kept = self._kept
        self._edges[:] = begin, end
        kept.again(begin, end)
        while kept.done < len(self.y):
            self._method.go_on(kept)
            self._equations.raise_error()
        if kept.code.any():
            return False
        self.y[:] = kept.last
        return True


@dataclass(frozen=True)
class _Points:
    """Starts (k, n), and values (k, m) of parameters of laws; at: where these are in the array that the equations read."""

    starts: Array
    values: Array
    at: Numbers | None

    @classmethod
    def of(cls, system: System, starts: Any, numbers: Any) -> _Points:
        """Read and check the arguments of a user."""
        if not isinstance(numbers, Mapping):
            raise OptionError(f"numbers = {shown(numbers)}: give a mapping of names such as 'elbow.mass' to their values")
        remedy = f"give an array of shape (points, {system.n}) or ({system.n},)"
        y = np.atleast_2d(option("starts", system.y0 if starts is None else starts, array, remedy))
        if y.ndim != 2 or y.shape[1] != system.n:
            raise OptionError(f"starts has shape {y.shape}: {remedy}")
        rows = [np.atleast_1d(option(f"numbers: {name}", values, array, "give its values, one per point"))
                for name, values in numbers.items()]
        counts = {len(part) for part in (y, *rows)} - {1} or {1}
        if len(counts) > 1 or 0 in counts or any(row.ndim != 1 for row in rows):
            shapes = ", ".join([f"starts {y.shape}", *(f"{name} {row.shape}" for name, row in zip(numbers, rows, strict=True))])
            raise OptionError("a batch needs of starts and of every number either one for all points, or one per point and "
                              f"equally many of each; the shapes given are: {shapes}")
        k = counts.pop()
        at = system.numbers(list(numbers)) if rows else None
        values = np.array([np.broadcast_to(row, k) for row in rows]).reshape(len(rows), k)
        values = values[at.of] if at is not None else values
        return cls(np.array(np.broadcast_to(y, (k, system.n))), np.ascontiguousarray(values.T), at)

    def __len__(self) -> int:
        return len(self.starts)

    @contextmanager
    def restored(self) -> Iterator[None]:
        """Context after which the laws of the system have their own parameters again."""
        before = None if self.at is None else self.at.W[self.at.slots]
        try:
            yield
        finally:
            if self.at is not None:
                self.at.W[self.at.slots] = before

    def take(self, i: int) -> None:
        """Write the parameters of laws of point i to the array that the equations read."""
        if self.at is not None and i < len(self):
            self.at.W[self.at.slots] = self.values[i]

    def system(self, system: System, i: int) -> System:
        """The system with the start and the parameters of laws of point i."""
        self.take(i)
        rate = np.empty(system.n)
        system.rhs(system.t0, self.starts[i], rate)
        return system.starting(system.t0, self.starts[i], rate)


class _Run:
    """A batch while it runs, with the arrays of its result, of which the native method fills one row per point."""

    def __init__(self, system: System, solver: DOP853, asked: Asked, points: _Points, tell: Progress | None) -> None:
        self.system, self.solver, self.asked, self.points, self.tell = system, solver, asked, points, tell
        self.times = np.array([asked.t_end]) if asked.times is None else asked.times
        at = points.at or Numbers(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
        self.kept = kept = Kept(system.t0, asked.t_end, points.starts, self.times, at.W, at.slots, points.values)
        self.y, self.last, self.counts = kept.y, kept.last, kept.counts
        self.errors: list[str | None] = [NOT_RUN] * len(points)
        self.done, self.told = 0, 0.0

    def result(self) -> Batch:
        """Run all points, and return the batch."""
        self.wall, self.cpu = time.perf_counter(), time.process_time()
        try:
            if self._plain():
                self._native()
            else:
                for i in range(len(self.points)):
                    self._alone(i)
                    self._look(i + 1)
        except ENDS as error:
            how_far = f"interrupted: {self.done} of {len(self.points)} points are done"
            interrupted(error, f"{how_far}; the attribute `solution` of this exception has them", self._made())
            raise
        return self._made()

    def _made(self) -> Batch:
        wall, cpu = time.perf_counter() - self.wall, time.process_time() - self.cpu
        steps, rejected, evaluations = self.counts
        return Batch(self.times, self.y, self.last, tuple(self.errors), steps, rejected, evaluations, cpu, wall)

    def _plain(self) -> bool:
        """Whether nothing has to be watched between the steps of a run, so that the native method can run all points by
        itself."""
        if self.points.at is not None:
            refuse_watched(self.system, self.asked.t_end)
        return not (is_watched(self.system, self.asked.t_end) or self.system.looks_at_steps)

    def _native(self) -> None:
        equations, p, rtol = rates_of(self.system), self.points, self.solver.tolerance
        atol = absolute_tolerance(self.system, rtol, self.solver.atol)
        with Explicit(equations, METHOD, np.zeros(0), rtol, atol) as method:
            while self.done < len(p):
                method.go_on(self.kept)
                self._ended(equations)
                self._look(self.done)

    def _ended(self, equations: Equations) -> None:
        """Read the results of the points that have ended; points that failed are run again alone to obtain their message."""
        done = self.kept.done
        raised, equations.caught.error = equations.caught.error, None
        stops = raised is not None and not isinstance(raised, Exception)
        if stops:  # Ctrl-C came while the last of these points was run, which is not complete
            done -= 1
            self.y[done] = self.last[done] = np.nan
        for i in range(self.done, done):
            self.errors[i] = None
            if self.kept.code[i]:
                self._alone(i)
        self.points.take(done)  # running a point alone has overwritten the parameters of the point to continue with
        self.done = done
        if raised is not None and stops:
            raise raised

    def _alone(self, i: int) -> None:
        """Run point i as a single run; its values, or the message of its failure, are stored."""
        self.y[i], self.last[i] = np.nan, np.nan
        left = None if self.asked.max_wall is None else self.asked.max_wall - (time.perf_counter() - self.wall)
        try:
            found = self.solver.run(self.points.system(self.system, i), replace(self.asked, times=self.times, max_wall=left))
        except WallClockError:
            self._look(i, ended=True)
        except Exception as error:
            self.errors[i] = str(error) if isinstance(error, MbdaeError) else f"{type(error).__name__}: {error}"
            return
        assert found.outputs is not None
        self.errors[i], self.y[i], self.last[i] = None, found.outputs.y, found.y[-1]
        self.counts[:, i] = found.stats.steps, found.stats.rejected, found.stats.residuals

    def _look(self, done: int, ended: bool = False) -> None:
        """Check the wall time, and report that `done` points are done; ended: whether the time is known to be used up."""
        self.done, spent = done, time.perf_counter() - self.wall
        if ended or (self.asked.max_wall is not None and spent > self.asked.max_wall and done < len(self.points)):
            raise WallClockError(f"max_wall = {self.asked.max_wall:g} s of wall time is used up: {done} of {len(self.points)} "
                                 "points are done; raise max_wall or loosen the tolerance",
                                 self.system.t0, "", self._made())
        if self.tell is not None and (spent - self.told > PERIOD or done == len(self.points)):
            self.told = spent
            self.tell(done, len(self.points))
