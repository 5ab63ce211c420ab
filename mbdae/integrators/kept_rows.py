"""The steps of a run as they are made, row by row: in memory, and on disk where they are many.

What does not fit into `IN_MEMORY` bytes goes to a folder for temporary files (TMPDIR says where), in files 000001.npy, 000002.npy
and so on, each of which is there as a whole or not at all. In the end they become one file that is mapped into memory, so that a
result reads from disk what is asked of it; the folder is removed when Python ends, on most systems as soon as the file is mapped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

import numpy as np

from mbdae.errors import SolverError
from mbdae.files import replacing
from mbdae.system.base import Array

BLOCK = 1000  #: rows that are kept together
FEW = 8  #: rows that are kept one by one, not as a block of their own
IN_MEMORY = 2**26  #: bytes of rows in memory, of each of the arrays of a run


class Rows:
    """Arrays of one shape one behind the other, in blocks: a small array of its own takes many times the memory of its numbers.

    Rows that are no arrays (None: a step without a polynomial of its own) stay in a list."""

    def __init__(self, name: str, *first: Array) -> None:
        self.name = name
        self._blocks: list[Any] = []  # arrays, or lists where a row is no array
        self.tail: list[Any] = list(first)  #: rows in no block yet, the last of all among them
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
        """Keep rows as a block, and write all blocks to disk where they are too large together."""
        if not len(rows):
            return
        if any(not isinstance(row, np.ndarray) for row in rows):
            self._blocks.append(list(rows))
            return
        self._blocks.append(np.array(rows) if isinstance(rows, list) else rows)
        arrays = [block for block in self._blocks if isinstance(block, np.ndarray)]
        if len(arrays) == len(self._blocks) and sum(block.nbytes for block in arrays) > IN_MEMORY:
            self._write(np.concatenate(arrays))
            self._blocks = []

    def _write(self, rows: Array) -> None:
        if self._folder is None:
            self._folder = Path(mkdtemp(prefix=f"mbdae-{self.name}-"))
            self._remove = finalize(self, rmtree, self._folder, ignore_errors=True)
        path = self._folder / f"{len(self._chunks) + 1:06d}.npy"
        with replacing(path) as part, part.open("wb") as file:
            np.save(file, rows)
        self._chunks.append((path, rows.shape))

    def array(self, count: int) -> Any:
        """The first `count` rows (count, ...), a list of them where some are no arrays."""
        if not self._of_arrays:
            return [row for block in (*self._blocks, self.tail) for row in block][:count]
        parts = [np.array(self.tail)] if self.tail else []
        found = self._joined(parts) if self._chunks else np.concatenate([*self._blocks, *parts])
        self._blocks, self.tail = [found[:-1]], [found[-1]]  # not kept twice
        return found[:count]

    def since(self, first: int) -> list[Any]:
        """The rows from number `first` on."""
        parts: list[Any] = [self.tail]
        begin = len(self) - len(self.tail)
        for block in reversed(self._blocks):
            if begin <= first:
                break
            parts, begin = [block, *parts], begin - len(block)
        for path, shape in reversed(self._chunks):
            if begin <= first:
                break
            parts, begin = [read_chunk(path, shape), *parts], begin - shape[0]
        return [row for part in parts for row in part][first - begin :]

    @property
    def _of_arrays(self) -> bool:
        """Whether there are rows, all of them arrays."""
        rows = [row for block in (*self._blocks, self.tail) if isinstance(block, list) for row in block]
        return bool(self._chunks or self._blocks or rows) and all(isinstance(row, np.ndarray) for row in rows)

    def __len__(self) -> int:
        return sum(shape[0] for _, shape in self._chunks) + sum(map(len, (*self._blocks, self.tail)))

    def _joined(self, last: list[Array]) -> Array:
        """All rows as one file mapped into memory."""
        assert self._folder is not None
        parts = [*self._blocks, *last]
        rows = sum(shape[0] for _, shape in self._chunks) + sum(map(len, parts))
        whole, shape = self._folder / "all.npy", (rows, *self._chunks[0][1][1:])
        head = {"descr": np.lib.format.dtype_to_descr(np.dtype(float)), "fortran_order": False, "shape": shape}
        with whole.open("wb") as file:
            np.lib.format.write_array_header_2_0(file, head)
            for path, of_chunk in self._chunks:
                read_chunk(path, of_chunk).tofile(file)
                path.unlink()
            for part in parts:
                np.ascontiguousarray(part, dtype=float).tofile(file)
        found = np.load(whole, mmap_mode="c")
        self._remove()  # what is mapped stays
        self._chunks, self._folder = [], None
        return np.asarray(found)


def _nothing() -> None:
    """No folder is to be removed."""


def read_chunk(path: Path, shape: tuple[int, ...]) -> Array:
    """The rows of a file that this run wrote; SolverError, which names it, where it is damaged or gone."""
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise SolverError(f"the file '{path}' with steps of the run cannot be read: {error}; leave the folder for temporary "
                          f"files alone while a run is made, and see that its disk is not full", 0.0) from error  # fmt: skip
    if found.shape != shape or found.dtype != float:
        raise SolverError(f"the file '{path}' with steps of the run holds {found.dtype} {found.shape} instead of {shape}: "
                          f"another program changed it", 0.0)  # fmt: skip
    return np.asarray(found)
