"""The steps of a run, stored row by row: in memory, and on disk where they take much memory.

What does not fit into `IN_MEMORY` bytes goes to a folder for temporary files (TMPDIR says where), in files 000001.npy, 000002.npy
and so on, each of which is there as a whole or not at all. In the end they become one file that is mapped into memory, so that a
result reads from disk what is asked of it; the folder is removed when Python ends, on most systems as soon as the file is mapped.
"""

from __future__ import annotations

import mmap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

import numpy as np

from mbdae.errors import OptionError, SolverError
from mbdae.system.base import Array

BLOCK = 1000  #: largest number of single rows that are collected before they become part of a block
SPARE = 8  #: a block that is full grows to 1 + 1 / SPARE times the rows needed, so that it is not resized for every row
FEW = 8  #: up to this number of rows `extend` adds rows one by one to `tail`, not as a block
IN_MEMORY = 2**24  #: bytes of memory that each array of a run (y, y', ...) may take before its rows are written to disk


class Block:
    """Rows (count, ...) in one array that grows in place. Joining many small arrays instead would leave their memory free, but in
    pieces too small to be used again."""

    def __init__(self, row: Array) -> None:
        """row: an array with the shape and type of all rows."""
        self._own, self.count, self._given = np.empty((BLOCK, *row.shape), row.dtype), 0, False

    @classmethod
    def of(cls, rows: Array) -> Block:
        """A block that begins with rows (m, ...) which other objects read too."""
        found = cls.__new__(cls)
        found._own, found.count, found._given = rows, len(rows), True
        return found

    def extend(self, rows: Any) -> None:
        """Add rows (m, ...)."""
        count = self.count + len(rows)
        if self._given or count > len(self._own):
            self._resize(count + count // SPARE)
        self._own[self.count : count] = rows
        self.count = count

    def _resize(self, count: int) -> None:
        """Make room for `count` rows: in place, or in a new array where other objects hold the present one."""
        shape = count, *self._own.shape[1:]
        if not self._given:
            try:
                self._own.resize(shape)
                return
            except ValueError:  # another object, such as a debugger, refers to the array
                pass
        own, self._given = np.empty(shape, self._own.dtype), False
        own[: self.count] = self.rows
        self._own = own

    @property
    def rows(self) -> Array:
        """The rows (count, ...), to be used before more rows are added."""
        return self._own[: self.count]

    @property
    def nbytes(self) -> int:
        """Bytes of the rows."""
        return self.rows.nbytes

    def given(self) -> Array:
        """The rows (count, ...) for other objects to keep: later changes of this block go to a copy."""
        if not self._given:
            self._resize(self.count)
        self._given = True
        return self.rows

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Array]:
        return iter(self.rows)


class Rows:
    """A growing list of arrays of one shape (y of every step, for example), stored as rows of large blocks, because many small
    arrays take several times the memory of their numbers.

    Rows that are not arrays (None: a step without a polynomial of its own) stay in a list. name: for the folder of its files."""

    def __init__(self, name: str, *first: Array) -> None:
        self.name = name
        self._blocks: list[Any] = []  # each a Block, or a list where rows are not arrays
        self.tail: list[Any] = list(first)  #: rows that are not in a block yet; always includes the last row
        self._chunks: list[tuple[Path, tuple[int, ...]]] = []
        self._folder: Path | None = None
        self._remove: Callable[[], Any] = _nothing

    def append(self, row: Any) -> None:
        """Add a row."""
        if len(self.tail) >= BLOCK or (isinstance(row, np.ndarray) and len(self.tail) * row.nbytes > IN_MEMORY):
            self._close(self.tail)
            self.tail = []
        self.tail.append(row)

    def extend(self, rows: Any) -> None:
        """Add rows (m, ...)."""
        if len(rows) <= FEW:
            for row in rows:
                self.append(row)
            return
        self._close(self.tail)
        self._close(rows[:-1])
        self.tail = [rows[-1]]

    def _close(self, rows: Sequence[Any]) -> None:
        """Move rows to a block, and write the block to disk where it is larger than `IN_MEMORY`."""
        if not len(rows):
            return
        if any(not isinstance(row, np.ndarray) for row in rows):
            self._blocks.append(list(rows))
            return
        if not (self._blocks and isinstance(self._blocks[-1], Block)):
            self._blocks.append(Block(rows[0]))
        self._blocks[-1].extend(rows)
        if len(self._blocks) == 1 and self._blocks[0].nbytes > IN_MEMORY:
            self._write(self._blocks.pop().rows)

    def _write(self, rows: Array) -> None:
        if self._folder is None:
            self._folder = Path(mkdtemp(prefix=f"mbdae-{self.name}-"))
            self._remove = finalize(self, rmtree, self._folder, ignore_errors=True)
        path = self._folder / f"{len(self._chunks) + 1:06d}.npy"
        part = path.with_suffix(".part")
        try:
            with part.open("wb") as file:  # not flushed to the disk (fsync), because the file is removed when this process ends
                np.save(file, rows)
            part.replace(path)
        except OSError as error:
            raise OptionError(f"'{path}' with steps of the run cannot be written: {error.strerror or error}; let TMPDIR name a "
                              f"folder on a disk with room") from error  # fmt: skip
        self._chunks.append((path, rows.shape))

    def array(self, count: int) -> Any:
        """The first `count` rows as an array (count, ...), or as a list where some are not arrays."""
        if not self._of_arrays:
            return [row for block in (*self._blocks, self.tail) for row in block][:count]
        self._close(self.tail)
        found = self._joined() if self._chunks else self._blocks[0].given()
        self._blocks, self.tail = [Block.of(found[:-1])], [found[-1]]  # views of the result, so that rows are not stored twice
        return found[:count]

    def since(self, first: int) -> list[Any]:
        """The rows from number `first` on."""
        parts: list[Any] = [self.tail]
        begin = len(self) - len(self.tail)
        for block in reversed(self._blocks):
            if begin <= first:
                break
            parts, begin = [block.rows if isinstance(block, Block) else block, *parts], begin - len(block)
        for path, shape in reversed(self._chunks):
            if begin <= first:
                break
            parts, begin = [read_chunk(path, shape), *parts], begin - shape[0]
        return [row for part in parts for row in part][first - begin :]

    @property
    def _of_arrays(self) -> bool:
        """Whether there are rows, and all of them are arrays."""
        rows = [row for block in (*self._blocks, self.tail) if isinstance(block, list) for row in block]
        return bool(self._chunks or self._blocks or rows) and all(isinstance(row, np.ndarray) for row in rows)

    def __len__(self) -> int:
        return sum(shape[0] for _, shape in self._chunks) + sum(map(len, (*self._blocks, self.tail)))

    def _joined(self) -> Array:
        """All rows as an array that is mapped from one file, which takes the place of all files and blocks."""
        assert self._folder is not None
        parts = [block.rows for block in self._blocks]
        rows = sum(shape[0] for _, shape in self._chunks) + sum(map(len, parts))
        whole, shape = self._folder / "all.npy", (rows, *self._chunks[0][1][1:])
        head = {"descr": np.lib.format.dtype_to_descr(np.dtype(float)), "fortran_order": False, "shape": shape}
        with whole.open("wb") as file:
            np.lib.format.write_array_header_2_0(file, head)
            for path, of_chunk in self._chunks:
                read_chunk(path, of_chunk).tofile(file)
                path.unlink()
            for part in parts:
                part.tofile(file)
        found = np.load(whole, mmap_mode="r")
        self._remove()  # the folder is removed here where the system allows that (Linux); the mapped file remains readable
        self._chunks, self._folder = [], None
        return np.asarray(found)


def leave(*arrays: Array) -> None:
    """Give back the memory of pages that were read of arrays mapped from a file, where the operating system allows it; pages are
    read again when they are needed."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            base.madvise(mmap.MADV_DONTNEED)


def _nothing() -> None:
    """In place of the function that removes a folder, where there is none."""


def read_chunk(path: Path, shape: tuple[int, ...]) -> Array:
    """The rows of a file that this run wrote; SolverError, which names it, where it is damaged or gone."""
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise SolverError(f"the file '{path}' with steps of the run cannot be read: {error}; leave the folder for temporary "
                          f"files alone while a run is made, and see that its disk is not full", 0.0) from error  # fmt: skip
    if found.shape != shape or found.dtype != float:
        raise SolverError(f"the file '{path}' with steps of the run holds {found.dtype} of shape {found.shape} instead of "
                          f"float64 of shape {shape}: "
                          "another program changed it; run again, and leave the folder for temporary files alone", 0.0)
    return np.asarray(found)
