"""The loop around the steps of a method: stored steps, limits of time and work, progress, solution of an interrupted run."""

from __future__ import annotations

import sys
import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import fields
from math import inf
from typing import Any, Self

import numpy as np

from mbdae.errors import ENDS, OptionError, SolverError, WallClockError, interrupted, keeping
from mbdae.integrators.dense import piecewise
from mbdae.integrators.kept_rows import Rows
from mbdae.integrators.record import RunRecord
from mbdae.integrators.solution import Method, Outputs, Solution, Stats
from mbdae.system.base import Array, System
from mbdae.threads import check, one_thread

PROGRESS_PERIOD = 0.1
FIRST_LOOK = 16  #: number of steps after which `stop` is asked for the first time whether a run may end early
STALL = 2000  #: number of steps after which it is asked for the first time whether a run hardly advances (`chattering.stalled`)


class StepLoop:
    """Collects the accepted steps of one run and checks its limits.

    t_end: end of the present part (a break of the inputs, or the end of the run); run_end: the end of the run, s.
    """

    def __init__(
        self,
        system: System,
        solver: Method,
        t_end: float,
        output_times: Array | None,
        max_wall: float | None,
        progress: Callable[[float, float, Stats], None] | None,
        max_residuals: float = inf,
        begin: float | None = None,
        stop: Callable[[Solution], bool] | None = None,
        record: RunRecord | None = None,
        impacts: float = 1.0, meets: tuple[float, float] | None = None,
    ) -> None:
        self.impacts, self.record = impacts, record  # impacts: factor on the longest step during an impact
        self.meets = () if meets is None else (meets,)  # how near to its ends a step counts as ending on a touch, of itself
        # whether the stretch ends for a planned restart; CPU and wall time (s) of this run in earlier processes
        self._planned, self._before = False, (0.0, 0.0)
        self.system, self.solver, self.t_end, self.run_end = system, solver, t_end, t_end
        self.stats = Stats()
        self._output_times = output_times
        self._max_wall = np.inf if max_wall is None else max_wall
        self._max_residuals, self._begin = max_residuals, begin
        self._stop, self.stopped, self.next_look = stop, False, FIRST_LOOK if stop is not None else float("inf")
        self._progress, self._next_progress, self._next_stall = progress, 0.0, STALL + 1
        self._t = array("d", [float(system.t0)])
        self._y = Rows("y", np.array(system.y0, dtype=float))
        self._yp = Rows("yp", np.array(system.yp0, dtype=float))
        self._pieces = Rows("inner")
        self._renewed: System | None = None  # where the last step ended with new equations: the system to continue with
        self._systems: list[tuple[float, System]] = [(float(system.t0), system)]
        self.method: Any = None  #: the native part of a method, which it may use again in the next part of the run
        self._restarted = 0  # number of the step at which the run was restarted last
        self._breaks: dict[int, tuple[Array, Array]] = {}  # number of a step -> y and yp before the restart there
        #: number of a kink -> sign changes of its argument in the run, and time of the first (`watched.chattering`)
        self.switched: dict[int, tuple[float, float]] = {}
        self._anew: dict[int, tuple[Array, Array]] = {}  # the same after restarts that an earlier process made

    @property
    def t(self) -> float:
        """Time of the last accepted step."""
        return self._t[-1]

    @property
    def last_step(self) -> float:
        """Length of the last accepted step, s; 0 before the first."""
        return self._t[-1] - self._t[-2] if len(self._t) > 1 else 0.0

    @property
    def state(self) -> tuple[Array, Array]:
        """y and yp (n,) of the last accepted step."""
        return self._y.tail[-1], self._yp.tail[-1]

    def __enter__(self) -> Self:
        self._threads = one_thread()
        self._threads.__enter__()
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._threads.__exit__(kind, error, trace)
        self._clock()
        if isinstance(error, MemoryError):
            raise self.failure("the memory is used up: loosen the accuracy, or make the run shorter", "") from error
        if isinstance(error, ENDS):
            self._interrupted(error)
        elif isinstance(error, SolverError):
            error.solution = self.solution() if error.solution is None else error.solution
        elif error is not None:
            error.add_note(f"raised in {self.solver.label} after t = {self.t:.9g} s (steps made: {self.stats.steps})")

    def _interrupted(self, error: BaseException) -> None:
        """Attach the solution so far to an exception that ends the call (Ctrl-C, one raised by a user's handler, a full disk)."""
        with keeping(None, "a second time, while what was computed was put together: it is lost"):
            solution = self.solution()
        where = f"{self.solver.label} was interrupted at t = {self.t:.9g} s of {self.run_end:.9g} s"
        interrupted(error, f"{where}: the attribute `solution` of this exception is what was computed", solution)

    def _clock(self) -> None:
        self.stats.wall_s = time.perf_counter() - self._wall + self._before[1]
        self.stats.cpu_s = time.process_time() - self._cpu + self._before[0]

    def accept(self, t: float, y: Array, yp: Array, piece: Any = None) -> bool:
        """Store a step that ends at (t, y, yp), arrays that are not copied; False where the method has to stop. piece: data of
        the step for `Solver.dense`."""
        h = t - self._t[-1]
        stats = self.stats
        if t < self.t_end or stats.steps == 0:
            stats.h_min = min(stats.h_min, h) if stats.steps else h
            stats.h_max = max(stats.h_max, h)
        stats.steps += 1
        self._t.append(t)
        self._y.append(y)
        self._yp.append(yp)
        self._pieces.append(piece)
        self.system.accept(t, y)
        self._renewed = self.system.renewed(t, y)
        self.guard()
        return t < self.t_end and self._renewed is None and not self._may_stop() and not self._begins_anew()

    def accept_many(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> bool:
        """Store steps t (m,), y and yp (m, n) of a system whose steps need not be made one by one (`System.one_by_one`); arrays
        are not copied. False where the loop has to end."""
        try:
            self.system.accept_many(t, y)
        except SolverError as error:
            last = int(np.searchsorted(t, error.time, side="right"))
            self._store(t[:last], y[:last], yp[:last], pieces[:last])
            raise
        self._store(t, y, yp, pieces)
        self.guard()
        return self.t < self.t_end and not self._may_stop() and not self._begins_anew()

    def _store(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> None:
        stats, widths = self.stats, t - np.concatenate([self._t[-1:], t[:-1]])
        counted = widths if stats.steps == 0 and len(t) == 1 else widths[t < self.t_end]
        if len(counted):
            stats.h_min = min(stats.h_min, float(counted.min())) if stats.steps else float(counted.min())
            stats.h_max = max(stats.h_max, float(counted.max()))
        stats.steps += len(t)
        self._t.frombytes(t.tobytes())
        for kept, rows in ((self._y, y), (self._yp, yp), (self._pieces, pieces)):
            kept.extend(rows)

    def _may_stop(self) -> bool:
        """Whether the run may end early, by the function `stop` of `Asked`, called when there are a third more steps."""
        if self._stop is not None and not self.stopped and len(self._t) >= self.next_look:
            self.next_look = len(self._t) * 4 // 3
            self.stopped = self._stop(self.solution())
        return self.stopped

    @property
    def evaluations_left(self) -> float:
        """Number of residual evaluations left until `max_residuals` is reached."""
        return self._max_residuals - self.stats.residuals

    def renew(self) -> bool:
        """Continue with other equations where constraint rows are about to become dependent, or after a planned restart; returns
        whether the system was replaced."""
        if self._renewed is None and len(self._t) == 1:
            self._renewed = self.system.renewed(self.t, self.state[0])
        if self._renewed is None and self._planned:
            self.system, self._planned = self.system.starting(self.t, *self.state, self.system.longest_step), False
            return True
        if self._renewed is None:
            return False
        self._planned = False
        self.system, self._renewed = self._renewed, None
        if self.count in self._anew:
            self.system = self.system.starting(self.t, *self._anew[self.count], self.system.longest_step)
        self._systems.append((self.t, self.system))
        self.restart(self.system.y0, self.system.yp0)
        return True

    def consistent(self, y: Array) -> tuple[Array, Array]:
        """Consistent y and yp (n,) to restart with at a break, from y before it. Where an earlier process has restarted there,
        its values are used: the last digit of values found by iteration depends on the evaluations before."""
        return self._anew[self.count] if self.count in self._anew else self.system.restarted(self.t, y)

    def restart(self, y: Array, yp: Array) -> None:
        """Replace the values at the end of the last step, since accelerations and multipliers jump at a break of the inputs."""
        self._restarted = len(self._t) - 1
        if len(self._t) > 1:
            self._breaks.setdefault(self._restarted, self.state)
        self._y.tail[-1], self._yp.tail[-1] = y, yp

    def guard(self) -> None:
        """Check the wall time and the number of evaluations, and report progress."""
        now = time.perf_counter()
        if now - (self._wall if self._begin is None else self._begin) > self._max_wall:
            raise self.failure(f"max_wall = {self._max_wall:g} s of wall time is used up: raise max_wall, or loosen the "
                               "accuracy", "", WallClockError)
        try:
            check("steps were made")
            if self.stats.residuals > self._max_residuals:
                raise self.failure(f"the budget of {self._max_residuals:.0f} residual evaluations is used up: the steps are too "
                                   "small to reach the end in it; loosen the accuracy or, if max_residuals was given, raise it",
                                   "")
            if len(self._t) >= self._next_stall and not self.solver.fixed:
                self._look_for_a_stall()
        except WallClockError as over:
            raise self.failure(str(over), "", WallClockError) from None
        if self._progress is not None and now - self._wall >= self._next_progress:
            self._next_progress = now - self._wall + PROGRESS_PERIOD
            self._clock()
            self._progress(self.t, self.run_end, self.stats)

    def _look_for_a_stall(self) -> None:
        """Raise an error where the run hardly advances, by jumps or unbounded growth; asked whenever steps have grown by half."""
        from mbdae.integrators.chattering import without_end

        first, self._next_stall = len(self._t) - STALL - 1, len(self._t) * 3 // 2
        y, yp = (np.array(part.since(first)[: STALL + 1]) for part in (self._y, self._yp))
        ends = float(self.first_system.t0), self.run_end
        if (found := without_end(self.system, np.array(self._t[first:]), y, yp, ends, self.first_system.y0)) is not None:
            raise self.failure(*found)

    def failure(self, message: str, culprit: str, kind: type[SolverError] = SolverError) -> SolverError:
        """A SolverError with the time, the culprit (name of an unknown or equation) and the solution so far."""
        t = self.t
        self._clock()
        resists = f" (resisting most: unknown or equation {culprit})" if culprit else ""
        text = f"{self.solver.label} stopped at t = {t:.9g} s of {self.run_end:.9g} s: {message}{resists}"
        return kind(text, t, culprit, self.solution())

    # -- runs that are stored on disk

    @property
    def count(self) -> int:
        """Number of accepted steps."""
        return len(self._pieces)

    @property
    def systems(self) -> list[System]:
        """The equations at the beginning of the run, and those that replaced them, in order."""
        return [system for _, system in self._systems]

    @property
    def first_system(self) -> System:
        """The equations at the beginning of the run."""
        return self._systems[0][1]

    @property
    def room(self) -> int:
        """Number of steps until the method is restarted for a checkpoint; sys.maxsize where it is not restarted."""
        return sys.maxsize if self.record is None or not self.record.restarts else max(self.record.room - self.count, 1)

    def goes_on(self, method: Any) -> None:
        """To be called before the first step by a method that calls `keep`: restores its state where the run was stored."""
        if self.record is not None:
            self.record.goes_on(self, method)

    def keep(self, method: Any) -> None:
        """To be called by a method between its steps: stores the run where a checkpoint is due. The attributes of the object are
        its state (`checkpoints.snapshot`)."""
        if self.record is not None:
            self.record.keep(self, method)

    def made_before(self) -> bool:
        """Whether an earlier process made the stretch that is about to begin; its steps have been appended then."""
        return self.record is not None and self.record.made_before(self)

    def ended(self) -> None:
        """To be called when a call of `integrate` has ended; tells the record why, where the run is stored on disk."""
        if self.record is not None:
            self.record.ended(self, self._renewed is not None, self._planned)

    def end_again(self, renewed: bool, planned: bool) -> None:
        """End a stretch of an earlier process in the way it ended then."""
        self._planned = planned
        if renewed:
            self.system.forget()
            self._renewed = self.system.renewed(self.t, self.state[0])

    def _begins_anew(self) -> bool:
        self._planned = self.record is not None and self.record.planned(self)
        return self._planned

    def counted(self) -> Stats:
        """Counts of this run until now."""
        self._clock()
        return self.stats

    def go_on_counting(self, counts: dict[str, Any]) -> None:
        """Add the counts (`Stats`) of an earlier process, which has made the first steps of this run."""
        for field in fields(Stats):
            setattr(self.stats, field.name, counts[field.name])
        self._before = self.stats.cpu_s, self.stats.wall_s

    def steps_between(self, first: int, last: int) -> dict[str, Any]:
        """Steps with numbers from `first` to `last` - 1, with the values before and after restarts of the run there."""
        y, yp = (np.array(rows.since(first + 1)[: last - first]) for rows in (self._y, self._yp))
        for number, (own_y, own_yp) in self._breaks.items():
            if first < number <= last:
                y[number - first - 1], yp[number - first - 1] = own_y, own_yp
        anew = [number for number in self._breaks if first <= number < last]
        after = [[rows.since(number)[0] for number in anew] for rows in (self._y, self._yp)]
        pieces = self._pieces.since(first)[: last - first]
        have = np.array([piece is not None for piece in pieces], dtype=bool)
        if not all(isinstance(piece, np.ndarray) for piece in pieces if piece is not None):
            raise OptionError(f"checkpoint: {self.solver.label} keeps data of its steps (for `dense`) that are not "
                              f"arrays, so they cannot be stored: let it keep arrays, or run it without checkpoint=")
        inner = np.array([piece for piece in pieces if piece is not None])
        return {"t": np.array(self._t[first + 1 : last + 1]), "y": y, "yp": yp, "have": have, "inner": inner,
                "anew": anew, "after": after}

    def give_back(self, parts: Sequence[dict[str, Any] | None], count: int) -> None:
        """Append steps of an earlier process, up to `count` steps in all. parts: their arrays, as of `steps_between`."""
        begin = 0
        for part in parts:
            if part is None:
                continue
            self._anew |= dict(zip(part["anew"], zip(*part["after"], strict=True), strict=True))
            some = slice(max(self.count - begin, 0), max(count - begin, 0))
            begin += len(part["t"])
            t = part["t"][some]
            if not len(t):
                continue
            self._t.frombytes(t.tobytes())
            self._y.extend(part["y"][some])
            self._yp.extend(part["yp"][some])
            inner = iter(part["inner"][np.count_nonzero(part["have"][: some.start]) :])
            self._pieces.extend([next(inner) if have else None for have in part["have"][some]])

    def solution(self) -> Solution:
        """The steps accepted so far; one of which only t or y was stored when an exception came is dropped."""
        del self._t[len(self._pieces) + 1 :]
        t = np.array(self._t)
        y, yp = self._y.array(len(t)), self._yp.array(len(t))
        interpolant = piecewise(self.solver.dense, self._breaks, t, y, yp, self._pieces.array(len(t) - 1))
        outputs = None
        if self._output_times is not None:
            times = self._output_times[self._output_times <= t[-1]]
            outputs = Outputs(times, interpolant.value(times), interpolant.derivative(times))
        complete = bool(t[-1] >= self.run_end)
        names = tuple(self._systems[0][1].names)
        return Solution(t, y, yp, outputs, self.stats, self.solver, names, complete, interpolant, tuple(self._systems))
