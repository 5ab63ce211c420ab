"""The state of a method between two steps, collected from its objects, so that a new object continues with equal results.

State are the numbers, texts, arrays, lists, tuples and further objects that an object of `integrators` holds. Of an object of
`native` only its arrays and the numbers of its table are state; its other numbers are addresses. Constants (frozen data, systems,
equations, functions) are taken from the new object. Objects with other state have methods `snapshot` and `go_back`.

A stored run: its stretches (calls of a method's `integrate`), their steps, and the method's state inside the last stretch.

A method that calls `StepLoop.keep` between its steps is continued from any of them with results equal to the last bit. All others
(IDA and CVODE, whose history stays inside SUNDIALS) begin anew after a fixed number of steps, in uninterrupted runs too, so that
results are equal to the last bit. Stretches that have ended are passed through without steps: breaks of inputs and changes of the
rows in force are found again.
"""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from inspect import isroutine
from typing import Any, Protocol

import numpy as np

from mbdae.errors import AccuracyWarning, SolverError, Stopping, WallClockError
from mbdae.integrators.matrices import keep_order, kept_order
from mbdae.integrators.solution import Stats
from mbdae.integrators.stored_runs import DamagedError, Keeper, NotPlainError, Tree, packed
from mbdae.native import Entries, Order
from mbdae.native.collocation import Contacts
from mbdae.native.equations import Equations, Number, Whole
from mbdae.system.base import System

#: classes whose objects are not part of the state; `Contacts` are made again from `ContactSteps`
CONSTANT = (System, Equations, Stats, Contacts, Entries, Order)
OWN = ("mbdae.integrators.", "mbdae.native.")
OBJECT = "object"


def snapshot(method: Any) -> Tree:
    """The state of a method (an object that makes steps) as plain values and arrays in nested dictionaries and lists."""
    return _of_object(method, set())


def _of_object(thing: Any, seen: set[int]) -> Tree:
    seen.add(id(thing))
    if hasattr(thing, "snapshot"):
        return {OBJECT: thing.snapshot()}
    found = {name: _of_value(value, seen, _native(thing)) for name, value in vars(thing).items()}
    return {OBJECT: {name: kept for name, kept in found.items() if kept is not Ellipsis}}


def _of_value(value: Any, seen: set[int], native: bool) -> Tree:
    """A value as part of the tree; Ellipsis where it is not part of the state. seen: ids of objects that are in the tree already;
    native: whether the value belongs to an object of `native`."""
    if id(value) in seen:
        return ...
    if isinstance(value, ctypes.Structure):
        seen.add(id(value))
        return {OBJECT: {name: getattr(value, name) for name in _numbers(value)}}
    if isinstance(value, list) and value and all(_is_object(part) for part in value):
        return [_of_object(part, seen) for part in value]
    if _is_object(value):
        return _of_object(value, seen)
    if native and not isinstance(value, np.ndarray):
        return ...
    try:
        packed(value, {})
    except NotPlainError:
        return ...
    return value


def go_back(method: Any, state: Tree) -> None:
    """Set the state of a new method to a stored one, so that it makes the same steps as the method that was stored."""
    kept = state[OBJECT]
    if hasattr(method, "snapshot"):
        method.go_back(kept)
        return
    plain = {name: value for name, value in kept.items() if not _holds_object(value)}
    for name, value in plain.items():
        _put(method, name, value)
    if hasattr(method, "revive"):
        method.revive(kept)
    for name in kept.keys() - plain.keys():
        _go_back_inside(getattr(method, name), kept[name])


def _go_back_inside(there: Any, kept: Tree) -> None:
    if isinstance(kept, list):
        for one, state in zip(there, kept, strict=True):
            go_back(one, state)
    elif isinstance(there, ctypes.Structure):
        for name, value in kept[OBJECT].items():
            setattr(there, name, value)
    else:
        go_back(there, kept)


def _put(thing: Any, name: str, value: Tree) -> None:
    """Set an attribute of `thing`; arrays are filled in place, because C code and other objects have their address."""
    there = getattr(thing, name, None)
    if isinstance(there, np.ndarray) and isinstance(value, np.ndarray) and there.shape == value.shape and there.flags.writeable:
        there[...] = value
        return
    if isinstance(there, np.ndarray) and isinstance(value, np.ndarray):
        value.setflags(write=there.flags.writeable)
    setattr(thing, name, _like(value, there))


def _like(value: Tree, there: Any) -> Any:
    """A stored value in the types of `there`, the value of a new object: lists become named tuples where `there` has them."""
    if isinstance(value, list) and isinstance(there, list) and there:
        return [_like(part, there[0]) for part in value]
    if isinstance(value, tuple) and hasattr(there, "_fields"):
        return type(there)(*value)
    return value


def _is_object(value: Any) -> bool:
    kind = type(value)
    constant = isinstance(value, CONSTANT) or (is_dataclass(value) and kind.__dataclass_params__.frozen)
    named = isinstance(value, tuple | type) or isroutine(value)
    return kind.__module__.startswith(OWN) and not constant and not named and not hasattr(value, "run_end")


def _holds_object(value: Tree) -> bool:
    if isinstance(value, list):
        return bool(value) and _holds_object(value[0])
    return isinstance(value, dict) and OBJECT in value


def _native(thing: Any) -> bool:
    return any(kind.__module__.startswith(OWN[1]) for kind in type(thing).__mro__)


def _numbers(table: ctypes.Structure) -> list[str]:
    return [field[0] for field in table._fields_ if field[1] in (Number, Whole)]


#: why a stretch ended: end of a part of the run (a break), replaced equations, planned restart of the method
END, RENEWED, PLANNED = "end", "renewed", "planned"


class StepLoop(Protocol):
    """The interface of `integrators.loop.StepLoop` that a `RunRecord` needs (that module imports this one)."""

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


class RunRecord:
    """One run in the folder of a keeper. restarts: whether the method begins anew at checkpoints; what: description of the run in
    words, by which a stored run is recognised."""

    def __init__(self, keeper: Keeper, restarts: bool, what: str) -> None:
        self.keeper, self.restarts, self.what = keeper, restarts, what
        self._files = keeper.next_run()
        self._stored = stored = self._files.read()
        if stored is not None and stored["what"] != what:
            raise DamagedError(f"the folder holds a run by {stored['what']}, where this call runs {what}: the folder was written "
                               "by another version, or is damaged; delete it, or name another one")
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
                "method": method, "failure": failure}

    def _write(self, loop: StepLoop, state: dict[str, Tree]) -> None:
        """Store a state of the run, and the steps until then that are not stored yet."""
        if state["count"] > self._saved:
            self._files.write_chunk(self._chunks, loop.steps_between(self._saved, state["count"]))
            self._chunks, self._saved = self._chunks + 1, state["count"]
        self._files.write(state, self._chunks, None)
