"""The steps of a run, stored row by row: in memory, and on disk where they take much memory.

What does not fit into `IN_MEMORY` bytes goes to a temporary file (TMPDIR says where; on most systems it has no name, and goes
with the process), which is mapped into memory in the end, so that a result reads from disk what is asked of it. Where there is
no room or no folder for it, all rows stay in memory.

Ctrl-C may come between any two instructions. So what is stored is one tuple, `_state`, which is replaced as a whole after what it
names is complete: rows are in it once, at every instant.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import say
from mbdae.system.base import Array

BLOCK = 1000  #: largest number of single rows that are collected before they become part of a block
SPARE = 8  #: a block that is full grows to 1 + 1 / SPARE times the rows needed, so that it is not resized for every row
FEW = 8  #: up to this number of rows `extend` adds rows one by one to `tail`, not as a block
IN_MEMORY = 2**24  #: bytes of memory that each array of a run (y, y', ...) may take before its rows are written to disk
AT_ONCE = 2**22  #: bytes that are written to the disk at once: a signal waits for them


class Room:
    """An array that grows in place, for rows that are joined. Joining many small arrays instead would leave their memory free,
    but in pieces too small to be used again. given: whether other objects read the array, which is then never changed."""

    def __init__(self, own: Array, given: bool = False) -> None:
        self.own, self.given = own, given

    def resize(self, count: int, rows: int) -> None:
        """Make room for `rows` rows, of which the first `count` are kept: in place, or in a new array where other objects hold
        the present one."""
        if not self.given:
            try:
                self.own.resize(rows, *self.own.shape[1:])
                return
            except ValueError:  # another object, such as a debugger, refers to the array
                pass
        own = np.empty((rows, *self.own.shape[1:]), self.own.dtype)
        own[:count] = self.own[:count]
        self.own, self.given = own, False


@dataclass(frozen=True)
class Block:
    """The first `count` rows in a room."""

    room: Room
    count: int

    @property
    def rows(self) -> Array:
        """The rows (count, ...), to be used before more rows are added."""
        return self.room.own[: self.count]

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Any]:
        return iter(self.rows)

    def extended(self, rows: Any) -> Block:
        """The block with further rows (m, ...); this one stays as it is."""
        count = self.count + len(rows)
        if self.room.given or count > len(self.room.own):
            self.room.resize(self.count, count + count // SPARE)
        self.room.own[self.count : count] = rows
        return Block(self.room, count)

    def given(self) -> Array:
        """The rows (count, ...) for other objects to keep: later changes go to a copy."""
        if not self.room.given:
            self.room.resize(self.count, self.count)
        self.room.given = True
        return self.rows


class Spill:
    """A temporary file for rows of one shape, of the process that made it: one that is forked from it shares the file. given:
    whether other objects read it."""

    def __init__(self, name: str) -> None:
        self.file = TemporaryFile(prefix=f"mbdae-{name}-", buffering=0)  # noqa: SIM115 - open as long as its rows are read
        self.process, self.given = os.getpid(), False

    def __del__(self) -> None:
        if hasattr(self, "file"):
            self.file.close()

    @property
    def ours(self) -> bool:
        """Whether it may be written to."""
        return not self.given and self.process == os.getpid()

    def mapped(self, rows: int, shape: tuple[int, ...], dtype: Any) -> Array:
        """The first rows (rows, ...), mapped into memory."""
        return np.asarray(np.memmap(self.file, dtype, "r", 0, (rows, *shape)))


class FileState(NamedTuple):
    """Number of rows in the file; parts behind them, each a Block, or a list where rows are not arrays; rows that are in no part
    yet, the last one always among them."""

    saved: int
    parts: tuple[Any, ...]
    tail: list[Any]


class Rows:
    """A growing list of arrays of one shape (y of every step, for example), stored as rows of large blocks, because many small
    arrays take several times the memory of their numbers.

    Rows that are not arrays (None: a step without a polynomial of its own) stay in a list. name: for the name of its file."""

    def __init__(self, name: str, *first: Array) -> None:
        self.name = name
        self._state = FileState(0, (), list(first))
        self._row: tuple[tuple[int, ...], Any] = (), float  # shape and type of the rows in the file
        self._spill: Spill | None = None
        self._memory_only = False

    @property
    def tail(self) -> list[Any]:
        """Rows that are not in a block yet; always includes the last row."""
        return self._state.tail

    def append(self, row: Any) -> None:
        """Add a row."""
        saved, parts, tail = self._state
        if len(tail) < BLOCK and not (isinstance(row, np.ndarray) and len(tail) * row.nbytes > IN_MEMORY):
            tail.append(row)
            return
        self._state = FileState(saved, _joined(parts, tail), [row])
        self._relieve()

    def extend(self, rows: Any) -> None:
        """Add rows (m, ...)."""
        if len(rows) <= FEW:
            for row in rows:
                self.append(row)
            return
        saved, parts, tail = self._state
        self._state = FileState(saved, _joined(_joined(parts, tail), rows[:-1]), [rows[-1]])
        self._relieve()

    def _relieve(self) -> None:
        """Move rows to the disk where they take more than `IN_MEMORY` bytes."""
        saved, parts, tail = self._state
        if self._memory_only or len(parts) != 1 or not isinstance(parts[0], Block) or parts[0].rows.nbytes <= IN_MEMORY:
            return
        try:
            self._write(saved, parts[0].rows)
        except OSError as error:
            self._memory_only = True
            _say_full(str(error.strerror or error))
            return
        self._state = FileState(saved + len(parts[0]), (), tail)

    def _write(self, saved: int, rows: Array) -> None:
        """Write rows behind the first `saved` ones of the file; not flushed to the disk (fsync), since the file goes with this
        process."""
        self._row = rows.shape[1:], rows.dtype
        if self._spill is None or not self._spill.ours:
            spill = Spill(self.name)
            if saved:
                _put(spill.file, 0, self._mapped(saved))
            self._spill = spill
        _put(self._spill.file, saved * rows[0].nbytes, rows)

    def _mapped(self, saved: int) -> Array:
        """The first `saved` rows of the file, mapped into memory."""
        assert self._spill is not None
        return self._spill.mapped(saved, *self._row)

    def array(self, count: int) -> Any:
        """The first `count` rows as an array (count, ...), or as a list where some are not arrays."""
        saved, parts, tail = self._state
        if not self._of_arrays:
            return [row for part in (*parts, tail) for row in part][:count]
        block = _joined(parts, tail)[0]
        found, mapped = self._on_disk(saved, block) if saved else (block.given(), False)
        # views of the result, so that rows are not stored twice
        before = len(found) - 1
        own = (Block(Room(found, True), before),)
        self._state = FileState(before, (), [found[-1]]) if mapped else FileState(0, own, [found[-1]])
        return found[:count]

    def _on_disk(self, saved: int, block: Block) -> tuple[Array, bool]:
        """All rows, and whether they are mapped from the file: in memory where the disk is full."""
        try:
            self._write(saved, block.rows)
        except OSError:
            return np.concatenate([self._mapped(saved), block.rows]), False
        assert self._spill is not None
        self._spill.given = True
        return self._mapped(saved + len(block)), True

    def since(self, first: int) -> list[Any]:
        """The rows from number `first` on."""
        saved, parts, tail = self._state
        wanted: list[Any] = [tail]
        begin = len(self) - len(tail)
        for part in reversed(parts):
            if begin <= first:
                break
            wanted, begin = [part, *wanted], begin - len(part)
        if saved and begin > first:
            wanted, begin = [np.array(self._mapped(saved)[first:]), *wanted], first
        return [row for part in wanted for row in part][first - begin :]

    @property
    def _of_arrays(self) -> bool:
        """Whether there are rows, and all of them are arrays."""
        saved, parts, tail = self._state
        rows = [row for part in (*parts, tail) if isinstance(part, list) for row in part]
        return bool(saved or parts or rows) and all(isinstance(row, np.ndarray) for row in rows)

    def __len__(self) -> int:
        return self._state.saved + sum(map(len, (*self._state.parts, self._state.tail)))


def _joined(parts: tuple[Any, ...], rows: Sequence[Any]) -> tuple[Any, ...]:
    """Parts with further rows behind them."""
    if not len(rows):
        return parts
    if any(not isinstance(row, np.ndarray) for row in rows):
        return (*parts, list(rows))
    if parts and isinstance(parts[-1], Block):
        return (*parts[:-1], parts[-1].extended(rows))
    return (*parts, Block(Room(np.empty((BLOCK, *rows[0].shape), rows[0].dtype)), 0).extended(rows))


@lru_cache(maxsize=16)
def _say_full(reason: str) -> None:
    """Once in a process for every reason, not for every array of every run."""
    say(f"steps of runs stay in memory: they cannot be written to the folder for temporary files ({reason}); let TMPDIR name a "
        f"folder on a disk with room")


def _put(file: Any, place: int, rows: Array) -> None:
    """Write rows to a file without buffer, from a place (bytes) on."""
    left = memoryview(np.ascontiguousarray(rows).data).cast("B")
    file.seek(place)
    while len(left):
        left = left[file.write(left[:AT_ONCE]) :]


def leave(*arrays: Array) -> None:
    """Give back the memory of pages that were read of arrays mapped from a file, where the operating system allows it; pages are
    read again when they are needed."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)
