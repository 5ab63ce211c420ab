"""Trees of plain values and arrays, each in one .npz file that is replaced as a whole.

The folder in which a call stores its runs: for each run one file with its state and numbered files with its steps.

A call makes its runs in an order that depends on their results alone. So runs are known by their number: complete runs are read,
the interrupted one is continued. Every file is replaced as a whole: whenever the process is killed, the folder holds a complete
earlier state.
"""

from __future__ import annotations

import hashlib
import json
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mbdae.deferred import csc_matrix, issparse
from mbdae.errors import DiskError, OptionError, Stopping
from mbdae.files import regular, replacing

TEXT, DIGEST = "tree", "digest"
Tree = Any  #: None, booleans, numbers, texts, arrays, sparse matrices (CSC), and lists, tuples and dictionaries of these


class DamagedError(Exception):
    """A stored file cannot be read. The call fails, and no other solver is tried (as it is where a run fails)."""


class NotPlainError(Exception):
    """A value is none of the plain values and arrays that a tree can hold."""


def write_tree(path: Path, tree: Tree) -> None:
    """Replace a file by a tree, which is on the disk when this returns."""
    arrays: dict[str, Any] = {}
    text = json.dumps(packed(tree, arrays))
    arrays[DIGEST] = np.frombuffer(_digest(text, arrays), dtype=np.uint8)
    arrays[TEXT] = np.frombuffer(text.encode(), dtype=np.uint8)
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def read_tree(path: Path) -> Tree:
    """Read the tree in a file; raises DamagedError where it is damaged."""
    from zipfile import BadZipFile

    try:
        with regular(path) as file, np.load(file, allow_pickle=False) as stored:
            text, arrays = stored[TEXT].tobytes().decode(), {name: stored[name] for name in stored.files if name != TEXT}
            if arrays.pop(DIGEST).tobytes() != _digest(text, arrays):
                raise ValueError("its numbers are not those that were stored")
            return unpacked(json.loads(text), arrays)
    except (OSError, ValueError, KeyError, TypeError, BadZipFile, zlib.error, EOFError) as error:
        raise DamagedError(f"file '{path}' cannot be read or is damaged ({error}): delete it with its folder, or name another "
                           "folder") from error


def _digest(text: str, arrays: dict[str, Any]) -> bytes:
    found = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        found.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape}".encode())
        found.update(np.ascontiguousarray(arrays[name]).data)
    return found.digest()


def packed(value: Tree, arrays: dict[str, Any]) -> Any:
    """A tree as JSON values, with its arrays moved to `arrays`; NotPlainError where it holds another value."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "bifc":
        arrays[f"a{len(arrays)}"] = value
        return {"array": f"a{len(arrays) - 1}"}
    if issparse(value) and value.format == "csc":
        return {"csc": [packed(part, arrays) for part in (value.data, value.indices, value.indptr)], "shape": list(value.shape)}
    if isinstance(value, list):
        return [packed(part, arrays) for part in value]
    if isinstance(value, tuple):
        return {"tuple": [packed(part, arrays) for part in value]}
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {"dict": {key: packed(part, arrays) for key, part in value.items()}}
    raise NotPlainError(type(value).__name__)


def unpacked(value: Any, arrays: Any) -> Tree:
    """The tree from JSON values and arrays: the inverse of `packed`."""
    if isinstance(value, list):
        return [unpacked(part, arrays) for part in value]
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "csc" in value:
        return csc_matrix(tuple(unpacked(part, arrays) for part in value["csc"]), shape=tuple(value["shape"]))
    if "tuple" in value:
        return tuple(unpacked(part, arrays) for part in value["tuple"])
    return {key: unpacked(part, arrays) for key, part in value["dict"].items()}


T = TypeVar("T")
PAUSE = 1.0  #: shortest wall time (s) between two checkpoints, unless the process is asked to end


class Keeper:
    """The folder in which a call stores its runs; every: accepted steps between two checkpoints.

    stop: whether the process was asked to end; inside: number of runs that are under way (one run may make others): where it is
    not 0, the present step is finished and stored before the process ends."""

    def __init__(self, folder: Path, every: int) -> None:
        self.folder, self.every = folder, every
        self.stop, self.inside = False, 0
        self._runs = self._values = 0
        self._kept_at = time.perf_counter()

    def next_run(self) -> RunFiles:
        """The files of the next run that the call makes; runs are numbered in the order in which they are made."""
        self._runs += 1
        return RunFiles(self, f"run{self._runs:05d}")

    def next_value(self) -> tuple[bool, Tree]:
        """(whether it is stored, its value as plain data) for the next long evaluation of the call that is no run of a solver,
        such as the checks after a run. The runs made by a stored one are passed over."""
        self._values += 1
        if not self._place.exists():
            return False, None
        found, self._runs = read_tree(self._place)
        return True, found

    def keep_value(self, plain: Tree) -> None:
        """Store the value of the long evaluation just made. SIGTERM ends the process only after the file is written, because
        writing an interrupted zip archive would raise another error."""
        self.inside += 1
        try:
            _write(self._place, [plain, self._runs])
        finally:
            self.inside -= 1
        if self.stop:
            raise Stopping

    @property
    def _place(self) -> Path:
        return self.folder / f"value{self._values:05d}.npz"

    @property
    def due(self) -> bool:
        """Whether a checkpoint is due: PAUSE after the last one, or because the process was asked to end."""
        return self.stop or time.perf_counter() - self._kept_at >= PAUSE

    def written(self) -> None:
        """To be called after a checkpoint was written: the next one is due PAUSE later."""
        self._kept_at = time.perf_counter()


class RunFiles:
    """The files of one run: one with its state and its last steps, and numbered ones with the steps before."""

    def __init__(self, keeper: Keeper, name: str) -> None:
        self.keeper, self.name = keeper, name
        self._state = keeper.folder / f"{name}.state.npz"

    def read(self) -> dict[str, Tree] | None:
        """The state that was stored last, with all steps until then under "steps"; None where none was stored."""
        if not self._state.exists():
            return None
        state: dict[str, Tree] = read_tree(self._state)
        try:
            state["steps"] = [read_tree(self._chunk(i)) for i in range(state["chunks"])] + [state["steps"]]
        except KeyError as error:
            raise DamagedError(f"file '{self._state}' is damaged: delete it with its folder, or name another folder") from error
        return state

    def write(self, state: dict[str, Tree], chunks: int, steps: Tree) -> None:
        """Store a state of the run in one file, with the number `chunks` of files that hold the steps before, and further
        steps."""
        _write(self._state, state | {"chunks": chunks, "steps": steps})
        self.keeper.written()

    def write_chunk(self, i: int, steps: Tree) -> None:
        """Store steps in the numbered file i. `read` returns them only after the next `write`, which states the number of
        files."""
        _write(self._chunk(i), steps)

    def _chunk(self, i: int) -> Path:
        return self.keeper.folder / f"{self.name}.{i:06d}.npz"


def _write(path: Path, tree: Tree) -> None:
    """Replace a file of the folder; DiskError where the system refuses."""
    try:
        write_tree(path, tree)
    except OptionError as error:
        raise DiskError(f"checkpoint: {error}; the folder holds an earlier state, from which the same call goes on") from error


_active: ContextVar[Keeper | None] = ContextVar("keeper", default=None)


def active() -> Keeper | None:
    """The `Keeper` of the present call of `Scene.simulate` in this thread; None where its runs are not stored."""
    return _active.get()


@contextmanager
def keeping_runs(keeper: Keeper | None) -> Iterator[None]:
    """Context in which every run of a solver is stored by the keeper; None: no run is stored."""
    token = _active.set(keeper)
    try:
        yield
    finally:
        _active.reset(token)
