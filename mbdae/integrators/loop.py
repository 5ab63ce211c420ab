"""The services every step loop needs: stored steps, limits of time and work, progress, and the solution of an interrupted run."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable
from math import inf
from typing import Any, Self

import numpy as np

from mbdae.errors import SolverError, WallClockError, interrupted
from mbdae.integrators.dense import BLOCK, joined
from mbdae.integrators.solution import Interpolant, Method, Outputs, Solution, Stats
from mbdae.system.base import Array, System
from mbdae.threads import one_thread

PROGRESS_PERIOD = 0.1
FIRST_LOOK = 16  #: steps after which it is asked for the first time whether a run may stop
FEW = 8  #: rows that are kept one by one, not as a block of their own


class _Rows:
    """Arrays (n,) one behind the other, in blocks: a small array of its own takes many times the memory of its numbers."""

    def __init__(self, first: Array) -> None:
        self._blocks: list[Array] = []
        self.tail = [first]  #: rows in no block yet, the last of all among them

    def append(self, row: Array) -> None:
        """Add a row."""
        if len(self.tail) == BLOCK:
            self._blocks.append(np.array(self.tail))
            self.tail = []
        self.tail.append(row)

    def extend(self, rows: Array) -> None:
        """Add rows (m, n)."""
        if len(rows) <= FEW:
            for row in rows:
                self.append(row)
            return
        self._blocks, self.tail = [*self._blocks, np.array(self.tail), rows[:-1]], [rows[-1]]

    def array(self, count: int) -> Array:
        """The first `count` rows (count, n)."""
        rows = np.concatenate([*self._blocks, np.array(self.tail)])
        self._blocks, self.tail = [rows[:-1]], [rows[-1]]  # not kept twice
        return rows[:count]


class StepLoop:
    """Collects the accepted steps of one run and watches over it.

    t_end: where the method stops now, a break of the inputs or the end of the run; run_end: the end of the run, s.
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
    ) -> None:
        self.system, self.solver, self.t_end, self.run_end = system, solver, t_end, t_end
        self.stats = Stats()
        self._output_times = output_times
        self._max_wall = np.inf if max_wall is None else max_wall
        self._max_residuals = max_residuals
        self._begin = begin
        self._stop, self.stopped, self._next_look = stop, False, FIRST_LOOK
        self._progress = progress
        self._next_progress = 0.0
        self._t = array("d", [float(system.t0)])
        self._y = _Rows(np.array(system.y0, dtype=float))
        self._yp = _Rows(np.array(system.yp0, dtype=float))
        self._pieces: list[Any] = []
        self._renewed: System | None = None  # the system to continue with
        self._systems: list[tuple[float, System]] = [(float(system.t0), system)]
        self._restarted = 0  # number of the step at which the run was restarted last
        self._breaks: dict[int, tuple[Array, Array]] = {}  # number of a step -> y and yp before the run was restarted there

    @property
    def t(self) -> float:
        """Time of the last accepted step."""
        return self._t[-1]

    @property
    def last_step(self) -> float:
        """Length of the last accepted step, s; 0 before the first."""
        return self._t[-1] - self._t[-2] if len(self._t) > 1 else 0.0

    @property
    def longest(self) -> float | None:
        """Longest step since the last restart, s; None where there was none."""
        steps = np.diff(self._t[self._restarted :])
        return float(steps.max()) if len(steps) else None

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
        if isinstance(error, KeyboardInterrupt | SystemExit):
            self._interrupted(error)
        elif error is not None and not isinstance(error, SolverError):
            error.add_note(f"raised in {self.solver.label} after t = {self.t:.9g}, {self.stats.steps} steps")

    def _interrupted(self, error: KeyboardInterrupt | SystemExit) -> None:
        """Give what ends the process (Ctrl-C, or what a handler of the user's raises) the solution so far."""
        whole = len(self._pieces) + 1  # a step that was only half stored is left out
        del self._t[whole:]
        where = f"{self.solver.label} was interrupted at t = {self.t:.9g} of {self.run_end:.9g}"
        interrupted(error, f"{where}: the attribute `solution` of this exception is what was computed", self.solution())

    def _clock(self) -> None:
        self.stats.wall_s = time.perf_counter() - self._wall
        self.stats.cpu_s = time.process_time() - self._cpu

    def accept(self, t: float, y: Array, yp: Array, piece: Any = None) -> bool:
        """Keep a step (arrays are kept, not copied); False when the loop has to end."""
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
        return t < self.t_end and self._renewed is None and not self._may_stop()

    def accept_many(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> bool:
        """Keep steps t (m,), y and yp (m, n) of a system that does not look at them one by one (`System.looks_at_steps`); arrays
        are kept, not copied. False when the loop has to end."""
        stats, widths = self.stats, np.diff(t, prepend=self.t)
        counted = widths if stats.steps == 0 and len(t) == 1 else widths[t < self.t_end]
        if len(counted):
            stats.h_min = min(stats.h_min, float(counted.min())) if stats.steps else float(counted.min())
            stats.h_max = max(stats.h_max, float(counted.max()))
        stats.steps += len(t)
        self._t.frombytes(t.tobytes())
        self._y.extend(y)
        self._yp.extend(yp)
        self._pieces += pieces
        self.guard()
        return self.t < self.t_end and not self._may_stop()

    def _may_stop(self) -> bool:
        """Whether the run may end before its end; asked each time when it has grown by a third."""
        if self._stop is not None and not self.stopped and len(self._t) >= self._next_look:
            self._next_look = len(self._t) * 4 // 3
            self.stopped = self._stop(self.solution())
        return self.stopped

    @property
    def evaluations_left(self) -> float:
        """Evaluations until the budget is used up."""
        return self._max_residuals - self.stats.residuals

    def renew(self) -> bool:
        """Continue with other equations where constraints are about to depend on each other; returns whether that is so."""
        if self._renewed is None and len(self._t) == 1:
            self._renewed = self.system.renewed(self.t, self.state[0])
        if self._renewed is None:
            return False
        self.system, self._renewed = self._renewed, None
        self._systems.append((self.t, self.system))
        self.restart(self.system.y0, self.system.yp0)
        return True

    def restart(self, y: Array, yp: Array) -> None:
        """Continue from the last step with other values: accelerations and multipliers jump at a break of the inputs."""
        self._restarted = len(self._t) - 1
        if len(self._t) > 1:
            self._breaks[len(self._t) - 1] = self.state
        self._y.tail[-1], self._yp.tail[-1] = y, yp

    def guard(self) -> None:
        """Watch the wall clock and the budget of evaluations, report progress."""
        now = time.perf_counter()
        if now - (self._wall if self._begin is None else self._begin) > self._max_wall:
            other = getattr(self.solver, "alternative", "")
            advice = f"raise max_wall, loosen the accuracy, or look at what makes the step small{other}"
            raise self.failure(f"max_wall = {self._max_wall:g} s of wall time is used up: {advice}", "", WallClockError)
        if self.stats.residuals > self._max_residuals:
            raise self.failure(f"the budget of {self._max_residuals:.0f} residual evaluations is used up: the step crawls", "")
        if self._progress is not None and now - self._wall >= self._next_progress:
            self._next_progress = now - self._wall + PROGRESS_PERIOD
            self._clock()
            self._progress(self.t, self.run_end, self.stats)

    def failure(self, message: str, culprit: str, kind: type[SolverError] = SolverError) -> SolverError:
        """A SolverError that carries the time, the culprit and the solution so far."""
        t = self.t
        self._clock()
        resists = f" (resisting most: {culprit})" if culprit else ""
        text = f"{self.solver.label} stopped at t = {t:.9g} of {self.run_end:.9g}: {message}{resists}"
        return kind(text, t, culprit, self.solution())

    def solution(self) -> Solution:
        """The steps accepted so far."""
        t = np.array(self._t)
        y, yp = self._y.array(len(t)), self._yp.array(len(t))
        interpolant = self._interpolant(t, y, yp)
        outputs = None
        if self._output_times is not None:
            times = self._output_times[self._output_times <= t[-1]]
            outputs = Outputs(times, interpolant.value(times), interpolant.derivative(times))
        complete = bool(t[-1] >= self.run_end)
        names = tuple(self._systems[0][1].names)
        return Solution(t, y, yp, outputs, self.stats, self.solver, names, complete, interpolant, tuple(self._systems))

    def _interpolant(self, t: Array, y: Array, yp: Array) -> Interpolant:
        """The polynomials of all steps; those before a break end with the values from before it."""
        ends = [*self._breaks, len(t) - 1]
        parts, first = [], 0
        for last in ends:
            piece = slice(first, last + 1)
            own_y, own_yp = y[piece], yp[piece]
            if last in self._breaks:
                own_y, own_yp = own_y.copy(), own_yp.copy()
                own_y[-1], own_yp[-1] = self._breaks[last]
            parts.append(self.solver.dense(t[piece], own_y, own_yp, self._pieces[first:last]))
            first = last
        return parts[0] if len(parts) == 1 else joined(parts)
