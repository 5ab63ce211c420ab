"""Rows of a sweep, and the file that keeps them: each is written as soon as it is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from mbdae.errors import DiskError, OptionError
from mbdae.files import read_file, write_file
from mbdae.sweep.resume import check_same, computed_again, damage_refused, digest, is_sound, key_of, resume_path
from mbdae.values import BadValueError, shown, whole

FORMAT = "mbdae sweep 2"


@dataclass(frozen=True)
class SweepRow:
    """A point and the values that the job returned there, or its error (type and text). died: whether its worker process
    ended; warnings: AccuracyWarnings of the job there, such as that about a peak that is not within the accuracy."""

    point: dict[str, Any]
    values: dict[str, Any] | None
    error: str | None = None
    died: bool = False
    warnings: tuple[str, ...] = ()


def as_line(value: Any) -> str:
    """Plain values and arrays as JSON text on one line."""
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray) and not np.iscomplexobj(value):
        return value.tolist()
    raise TypeError(f"{value!r} of type {type(value).__name__} cannot be written to a file")


class Kept:
    """The file of a sweep: a JSON line with job and grid, then one for every row. path None: no file."""

    def __init__(self, path: Any, statement: Callable[[], dict[str, Any]], points: list[dict[str, Any]], again: bool) -> None:
        self.statement, self.points, self.again = statement, points, again
        self.path, self.key = path, ""
        self.rows: dict[int, SweepRow] = {}
        self.file: TextIO | None = None
        where = resume_path(path)
        if where is not None:
            self._open(where)

    def _open(self, path: Path) -> None:
        try:
            head = as_line(self.statement())
        except TypeError as error:
            raise OptionError(f"resume = '{path}': points cannot be kept: {error}; let them have numbers or texts") from error
        try:
            lines = read_file(path).splitlines(keepends=True) if path.exists() else []
        except (OSError, ValueError) as error:
            raise OptionError(f"resume = '{path}' cannot be read as text ({error}); name another file, or delete it") from error
        self.key = key_of(json.loads(head))
        if lines:
            self._read(path, lines, json.loads(head))
        rows = [self._line(i, row) for i, row in self.rows.items()]
        write_file(path, "\n".join([head, *rows]) + "\n")  # without an incomplete last line and rows to be computed again
        self.file = path.open("a", encoding="utf-8")

    def _read(self, path: Path, lines: list[str], meant: dict[str, Any]) -> None:
        try:
            said = json.loads(lines[0])
        except (ValueError, RecursionError):
            said = None
        if not isinstance(said, dict) or said.get("format") != FORMAT:
            raise OptionError(f"resume = '{path}' is not a sweep kept by resume; name another file")
        check_same(path, "sweep", said, meant)
        for i, line in enumerate(lines[1:], 2):
            try:
                data = json.loads(line)
            except (ValueError, RecursionError):
                data = None
            if not is_sound(self.key, data):
                # a last line without an end is that of a process that ended while it wrote it
                if line.endswith("\n"):
                    computed_again(path, f"the row of {self._point(data)} (line {i})")
                continue
            with damage_refused(path):
                number = whole(data["number"], least=0, most=len(self.points) - 1)
                told = tuple(data.get("warnings", ()))
                row = SweepRow(self.points[number], data["values"], data["error"], data["died"], told)
                if not (isinstance(row.values, dict | None) and isinstance(row.error, str | None) and isinstance(row.died, bool)):
                    raise BadValueError(f"in the row of a point, values, error or died is of a wrong type: {shown(data)}")
            if not (row.died or (self.again and row.error)):
                self.rows[number] = row

    def add(self, i: int, row: SweepRow) -> None:
        """Append the row of point number i to the file, so that it is there if the process ends."""
        if self.file is not None:
            try:
                self.file.write(self._line(i, row) + "\n")
                self.file.flush()
            except OSError as error:
                raise DiskError(f"resume = '{self.path}': the row of point {i} cannot be written: {error.strerror or error}; the "
                                f"rows before it are there: make room, and the same call goes on from there") from error

    def _line(self, i: int, row: SweepRow) -> str:
        data = {"number": i, "values": row.values, "error": row.error, "died": row.died, "warnings": list(row.warnings)}
        return as_line(data | {"digest": digest(self.key, data)})

    def _point(self, data: Any) -> str:
        """The point of a damaged row, in words."""
        number = data.get("number") if isinstance(data, dict) else None
        known = isinstance(number, int) and 0 <= number < len(self.points)
        return f"point {number}, {shown(self.points[number])}," if known else "a point"  # type: ignore[index]

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        if self.file is not None:
            with suppress(OSError):  # a row that did not fit on the disk is still to be written
                self.file.close()
