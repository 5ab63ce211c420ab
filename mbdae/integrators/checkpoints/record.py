"""A stored run: its stretches (calls of a method's `integrate`), their steps, and the method's state inside the last stretch.

A method that calls `StepLoop.keep` between its steps is continued from any of them with results equal to the last bit. All others
(IDA and CVODE, whose history stays inside SUNDIALS) begin anew after a fixed number of steps, in uninterrupted runs too, so that
results are equal to the last bit. Stretches that have ended are passed through without steps: breaks of inputs and changes of the
rows in force are found again.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, Protocol

from mbdae.errors import AccuracyWarning, SolverError, WallClockError
from mbdae.integrators.checkpoints.keeper import Keeper, Stopping
from mbdae.integrators.checkpoints.snapshot import go_back, snapshot
from mbdae.integrators.checkpoints.trees import DamagedError, Tree
from mbdae.integrators.matrices.iteration import keep_order, kept_order
from mbdae.integrators.solution import Stats
from mbdae.system.base import System

#: why a stretch ended: end of a part of the run (a break), replaced equations, planned restart of the method
END, RENEWED, PLANNED = "end", "renewed", "planned"


class StepLoop(Protocol):
    """The interface of `integrators.loop.StepLoop` that a `Record` needs (that module imports this one)."""

    t_end: float
    system: System

    @property
    def t(self) -> float:
        """Time of the last accepted step."""

    @property
    def count(self) -> int:
        """Number of accepted steps."""

    @property
    def systems(self) -> list[System]:
        """The equations at the beginning of the run, and those that replaced them (`System.renewed`), in order."""

    @property
    def first_system(self) -> System:
        """The equations at the beginning of the run."""

    def give_back(self, parts: Any, count: int) -> None:
        """Append steps that an earlier process has made, up to `count` steps in all. parts: their arrays, as of
        `steps_between`."""

    def end_again(self, renewed: bool, planned: bool) -> None:
        """End a stretch in the way it ended in an earlier process."""

    def go_on_counting(self, counts: dict[str, Any]) -> None:
        """Add the counts of an earlier process."""

    def counted(self) -> Stats:
        """Counts (`Stats`) until now."""

    def steps_between(self, first: int, last: int) -> dict[str, Any]:
        """The arrays of the steps with numbers from `first` to `last` - 1, for a file."""

    def solution(self) -> Any:
        """The steps accepted so far."""


class Record:
    """One run in the folder of a keeper. restarts: whether the method begins anew at checkpoints; what: description of the run in
    words, by which a stored run is recognised."""

    def __init__(self, keeper: Keeper, restarts: bool, what: str) -> None:
        self.keeper, self.restarts, self.what = keeper, restarts, what
        self._files = keeper.next_run()
        self._stored = stored = self._files.read()
        if stored is not None and stored["what"] != what:
            raise DamagedError(f"the folder holds a run by {stored['what']}, where this call runs {what}: the folder was written "
                               "by another version, or is damaged; delete it, or name another one")  # fmt: skip
        self._pending = list(stored["ends"]) if stored is not None else []
        self._ends: list[tuple[int, str]] = []
        self._chunks: int = 0 if stored is None else stored["chunks"]
        self._saved: int = 0 if stored is None else stored["count"]
        self._failed_before = False
        self._boundary: dict[str, Tree] | None = None
        self._caught: list[warnings.WarningMessage] = []

    @contextmanager
    def guarding(self, loop: StepLoop) -> Iterator[None]:
        """Context around a run that stores how it ends, complete or with a SolverError. Warnings of the run are stored too, and
        issued at its end."""
        self.keeper.inside += 1
        try:
            with warnings.catch_warnings(record=True) as self._caught:
                warnings.simplefilter("always")
                yield
                self._finish(loop)
        except WallClockError:
            raise
        except SolverError as error:
            self._finish(loop, error)
            raise
        finally:
            self.keeper.inside -= 1
            for warning in self._caught:
                warnings.warn(warning.message, warning.category, stacklevel=5)
        if self.keeper.stop:
            raise Stopping

    # -- what was made before

    def made_before(self, loop: StepLoop) -> bool:
        """Whether an earlier process has completed the next stretch (call of `integrate`). Its steps, or those of an incomplete
        stretch, are appended to the loop."""
        stored = self._stored
        if stored is None:
            return False
        if self._pending:
            count, kind = end = self._pending.pop(0)
            loop.give_back(stored["steps"], count)
            self._ends.append(end)
            loop.end_again(kind == RENEWED, kind == PLANNED)
            return True
        loop.give_back(stored["steps"], stored["count"])
        self._give_back_orders(loop)
        if stored["method"] is None:
            self._take_over(loop)
        if stored["failure"] is not None:
            self._failed_before = True
            message, time, culprit, attached = stored["failure"]
            raise SolverError(message, time, culprit, loop.solution() if attached else None)
        return False

    def goes_on(self, loop: StepLoop, method: Any) -> None:
        """Restore the stored state of a method before its first step in this process."""
        if self._stored is not None:
            go_back(method, self._stored["method"])
            self._take_over(loop)

    def _take_over(self, loop: StepLoop) -> None:
        """Restore what is needed before new steps are made: counts, warnings, and what systems remember besides y."""
        stored, self._stored = self._stored, None
        assert stored is not None
        loop.go_on_counting(stored["stats"])
        self._give_back_orders(loop, stored)
        for system, memory in zip((loop.first_system, loop.system), stored["memory"], strict=True):
            system.remember(memory)
        for text in stored["warned"]:
            warnings.warn(text, AccuracyWarning, stacklevel=6)

    def _give_back_orders(self, loop: StepLoop, stored: dict[str, Tree] | None = None) -> None:
        stored = stored or self._stored
        assert stored is not None
        for system, order in zip(loop.systems, stored["orders"], strict=False):
            keep_order(system, order)

    # -- what is made now

    @property
    def room(self) -> int:
        """Number of accepted steps, counted from the start of the run, after which the method is restarted next."""
        begin = self._ends[-1][0] if self._ends else 0
        return begin + self.keeper.every

    def planned(self, loop: StepLoop) -> bool:
        """Whether the method is to be restarted after the step just accepted."""
        if not self.restarts:
            return False
        if self.keeper.stop:
            if self._boundary is not None:
                self._write(loop, self._boundary)
            raise Stopping
        return loop.t < loop.t_end and loop.count >= self.room

    def ended(self, loop: StepLoop, renewed: bool, planned: bool) -> None:
        """To be called when a stretch (call of `integrate`) has ended: remembers its end, and stores the run where that is
        due."""
        self._ends.append((loop.count, RENEWED if renewed else PLANNED if planned else END))
        if planned:
            self._boundary = self._captured(loop, None)
            if self.keeper.due:
                self._write(loop, self._boundary)

    def keep(self, loop: StepLoop, method: Any) -> None:
        """Store the run between two steps of a method, where a checkpoint is due."""
        if self.keeper.due and (self.keeper.stop or loop.count - self._saved >= self.keeper.every):
            self._write(loop, self._captured(loop, snapshot(method)))
        if self.keeper.stop:
            raise Stopping

    def _finish(self, loop: StepLoop, error: SolverError | None = None) -> None:
        if self._stored is not None:  # no step was made here: an earlier process had completed the run
            self._take_over(loop)
        elif not self._failed_before:
            failure = None if error is None else (str(error), error.time, error.culprit, error.solution is not None)
            state = self._captured(loop, None, failure)
            self._files.write(state, self._chunks, loop.steps_between(self._saved, state["count"]))

    def _captured(self, loop: StepLoop, method: Tree, failure: Tree = None) -> dict[str, Tree]:
        warned = [str(w.message) for w in self._caught if issubclass(w.category, AccuracyWarning)]
        return {"what": self.what, "ends": list(self._ends), "count": loop.count, "stats": asdict(loop.counted()),
                "memory": [system.memory() for system in (loop.first_system, loop.system)],
                "orders": [kept_order(system) for system in loop.systems], "warned": list(dict.fromkeys(warned)),
                "method": method, "failure": failure}  # fmt: skip

    def _write(self, loop: StepLoop, state: dict[str, Tree]) -> None:
        """Store a state of the run, and the steps until then that are not stored yet."""
        if state["count"] > self._saved:
            self._files.write_chunk(self._chunks, loop.steps_between(self._saved, state["count"]))
            self._chunks, self._saved = self._chunks + 1, state["count"]
        self._files.write(state, self._chunks, None)
