"""The folder of a call whose runs are kept, and the runs in it: one file of its state per run, and numbered ones of its steps.

A call makes its runs in an order that depends on their results alone. So runs are known by their number: those that ended are
read instead of made, the one that was under way goes on. Every file is written as a whole: whenever the process is killed, the
folder holds what was kept last.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TypeVar

from mbdae.integrators.checkpoints.trees import DamagedError, Tree, read_tree, write_tree

T = TypeVar("T")
PAUSE = 1.0  #: s of wall time between two times a run is kept, at least


class Stopping(BaseException):
    """What is under way is kept; the process was asked to end."""


class Keeper:
    """A folder; every: accepted steps between two checkpoints.

    inside: whether a run is under way, which `stop` lets finish its step."""

    def __init__(self, folder: Path, every: int) -> None:
        self.folder, self.every = folder, every
        self.stop, self.inside = False, 0
        self._runs = self._values = 0
        self._kept_at = time.perf_counter()

    def next_run(self) -> RunFiles:
        """The files of the run that begins."""
        self._runs += 1
        return RunFiles(self, f"run{self._runs:05d}")

    def next_value(self) -> tuple[bool, Tree]:
        """Whether the next long evaluation of the call was made before, and what it returned, as a tree."""
        self._values += 1
        if not self._place.exists():
            return False, None
        found, self._runs = read_tree(self._place)
        return True, found

    def keep_value(self, plain: Tree) -> None:
        """Keep what the evaluation asked for last returned. SIGTERM waits for the file: an archive that is left in the middle
        of a member raises another error."""
        self.inside += 1
        try:
            write_tree(self._place, [plain, self._runs])
        finally:
            self.inside -= 1
        if self.stop:
            raise Stopping

    @property
    def _place(self) -> Path:
        return self.folder / f"value{self._values:05d}.npz"

    @property
    def due(self) -> bool:
        """Whether it is time to write again."""
        return self.stop or time.perf_counter() - self._kept_at >= PAUSE

    def written(self) -> None:
        """Something was written now."""
        self._kept_at = time.perf_counter()


class RunFiles:
    """The files of one run."""

    def __init__(self, keeper: Keeper, name: str) -> None:
        self.keeper, self.name = keeper, name
        self._state = keeper.folder / f"{name}.state.npz"

    def read(self) -> dict[str, Tree] | None:
        """The state that was kept last, with all `steps` until then; None where there is none."""
        if not self._state.exists():
            return None
        state: dict[str, Tree] = read_tree(self._state)
        try:
            state["steps"] = [read_tree(self._chunk(i)) for i in range(state["chunks"])] + [state["steps"]]
        except KeyError as error:
            raise DamagedError(f"file '{self._state}' is damaged: delete it with its folder, or name another folder") from error
        return state

    def write(self, state: dict[str, Tree], chunks: int, steps: Tree) -> None:
        """Keep a state after `chunks` files of steps, and further steps that are kept with it."""
        write_tree(self._state, state | {"chunks": chunks, "steps": steps})
        self.keeper.written()

    def write_chunk(self, i: int, steps: Tree) -> None:
        """Keep steps in file i; they count from the next `write` on."""
        write_tree(self._chunk(i), steps)

    def _chunk(self, i: int) -> Path:
        return self.keeper.folder / f"{self.name}.{i:06d}.npz"


_active: ContextVar[Keeper | None] = ContextVar("keeper", default=None)


def active() -> Keeper | None:
    """The keeper of the call under way in this thread."""
    return _active.get()


@contextmanager
def keeping_runs(keeper: Keeper | None) -> Iterator[None]:
    """Keep every run made inside; None: none of them."""
    token = _active.set(keeper)
    try:
        yield
    finally:
        _active.reset(token)
