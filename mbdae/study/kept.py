"""The file that a user names by `resume=`: it stores what is finished, so that the same call continues after an interruption.

Every row has a digest of itself and of the call that it belongs to. A row that was changed, cut or taken from another file is
computed again, and a warning names it."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, TextIO, TypeVar

import numpy as np

from mbdae.errors import ENDS, DiskError, OptionError, interrupted, warn
from mbdae.files import first_difference, read_file, write_file
from mbdae.system.base import Array
from mbdae.values import BadValueError, file_to_write, optional, shown, whole

T = TypeVar("T")
_TYPES = {"str": (str,), "int": (int,), "float": (int, float), "bool": (bool,), "None": (type(None),)}


@dataclass
class ResumeFile:
    """A JSON file at `path` (None: nothing is stored). identity: plain data that say what is computed; a file with another
    identity is refused."""

    path: Path | None
    identity: dict[str, Any]

    kind: ClassVar[str]  #: word for what the file stores, in messages
    file_format: ClassVar[str]
    in_order: ClassVar[bool] = False  #: whether rows are known by their order, so that those behind a damaged one go with it

    @contextmanager
    def stored(self) -> Iterator[dict[str, Any] | None]:
        """Context with the data of the file, None where there is no file; errors inside it mean that the file is damaged, and are
        raised as OptionError."""
        if self.path is None or not self.path.exists():
            yield None
            return
        try:
            data = json.loads(read_file(self.path))
        except (OSError, ValueError, RecursionError) as error:
            raise OptionError(f"resume = '{self.path}' cannot be read as a file that an earlier call with resume wrote "
                              f"({error}); name another file, or delete this one") from error
        if not isinstance(data, dict) or data.get("format") != self.file_format:
            raise OptionError(f"resume = '{self.path}' is not a {self.kind} kept by resume; name another file")
        check_same(self.path, self.kind, data.get("statement"), self.identity)
        with damage_refused(self.path):
            rest = {name: value for name, value in data.items() if name != "rows"}
            if rest.pop("digest") != digest(key_of(self.identity), rest):
                raise BadValueError("its entries beside the rows are not those that were stored")
            yield data | {"rows": self._sound(data["rows"])}

    def _sound(self, rows: list[Any]) -> list[Any]:
        """The rows that are as they were stored."""
        key = key_of(self.identity)
        sound = [is_sound(key, row) for row in rows]
        for i, row in enumerate(rows):
            if not sound[i]:
                computed_again(self.path, f"{self.row_name(row)} (row {i + 1})")
        last = sound.index(False) if self.in_order and False in sound else len(rows)
        return [{name: value for name, value in row.items() if name != "digest"}
                for row, good in zip(rows[:last], sound[:last], strict=True) if good]

    def row_name(self, row: Any) -> str:
        """What a row is of, in words, for messages; the row may be damaged."""
        return "what was computed"

    def store(self, data: dict[str, Any]) -> None:
        """Replace the file as a whole, so that it is valid whenever the run stops."""
        if self.path is not None:
            rest = {"format": self.file_format, "statement": self.identity, **data}
            key = key_of(self.identity)
            rows = [row | {"digest": digest(key, row)} for row in rest.pop("rows")]
            content = rest | {"digest": digest(key, rest), "rows": rows}
            try:
                write_file(self.path, json.dumps(content, indent=1) + "\n")
            except OptionError as error:
                raise DiskError(f"resume: {error}; what was stored before is there: make room, and the call goes on") from error


@dataclass
class Readings(ResumeFile):
    """What was read of runs, by the numbers p (k,) of each, so that no run is made again."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    def load(self) -> None:
        """Take over what is stored in the file, where there is one."""
        with self.stored() as data:
            self.rows = [] if data is None else data["rows"]

    def found(self, p: Array, what: str, made: Callable[[], Array]) -> Array:
        """What is stored of the numbers p, or is made now."""
        key = packed(p)
        for row in self.rows:
            if row["p"] == key and what in row:
                return unpacked(row[what])
        values = made()
        self.rows.append({"p": key, what: packed(values)})
        self.store({"rows": self.rows})
        return values


def key_of(identity: Any) -> str:
    """A digest of the identity of a call, with which its rows are stored."""
    return digest("", identity)


def digest(key: str, row: Any) -> str:
    """A digest of plain data of the call with this key, the same before and after they are written and read."""
    return hashlib.sha256(json.dumps([key, json.loads(json.dumps(row))], sort_keys=True).encode()).hexdigest()[:16]


def is_sound(key: str, row: Any) -> bool:
    """Whether a row, with its digest, is as it was stored."""
    if not isinstance(row, dict):
        return False
    return row.get("digest") == digest(key, {name: value for name, value in row.items() if name != "digest"})


def computed_again(path: Any, what: str) -> None:
    """Warn that a stored row is not used. what: which one, in words."""
    warn(f"resume = '{path}': {what} was changed or damaged after it was stored, so it is computed again")


def resume_path(path: Any) -> Path | None:
    """The path that a user gave, or None; a path that cannot be written to is refused before anything is computed."""
    remedy = "give a file in a folder that exists and can be written to, or None"
    where: Path | None = optional("resume", path, file_to_write, remedy)
    if where is not None and not os.access(where.parent, os.W_OK):
        raise OptionError(f"resume = {shown(path)}: its folder cannot be written to; name a file in another one, or None")
    return where


@contextmanager
def told_when_interrupted(path: Any, what: str, count: Callable[[], tuple[int, int]], made: Callable[[], Any]) -> Iterator[None]:
    """Context of a study: where it is interrupted, a KeyboardInterrupt says how much is done and where that is stored, and the
    exception has what `made` returns as its attribute `solution`. what: the things counted, in words; count: number done, and of
    all."""
    try:
        yield
    except ENDS as error:
        kept = f"kept in {path}; the same call goes on from there" if path is not None else "not kept; resume=FILE keeps them"
        found, (done, total) = made(), count()
        has = "; this exception has them as its attribute `solution`" if found is not None else ""
        interrupted(error, f"interrupted: {done} of {total} {what} are done and {kept}{has}", found)
        raise


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Context in which a file is read: errors that damaged data cause are raised as OptionError, with the file's name."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, zlib.error) as error:
        if isinstance(error, OptionError):
            raise
        damage = str(error) if isinstance(error, BadValueError) else f"{type(error).__name__}: {shown(error)}"
        raise OptionError(f"resume = '{path}' is damaged ({damage}); delete it, or name another file") from error


def record(cls: type[T], data: Any, **further: Any) -> T:
    """A dataclass from its plain data, every entry of the type its class declares; further: entries that are no plain data."""
    record_name = f"the record '{cls.__name__}'"
    if not isinstance(data, dict):
        raise BadValueError(f"{shown(data)} stands where the entries of {record_name} should stand")
    declared = {f.name: str(f.type) for f in fields(cls)}  # type: ignore[arg-type]
    needed = {f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING}  # type: ignore[arg-type]
    for name in sorted(set(data) - set(declared)):
        raise BadValueError(f"{record_name} has the unknown entry {shown(name)}")
    for name in sorted(needed - set(data) - set(further)):
        raise BadValueError(f"{record_name} lacks the entry {shown(name)}")
    for name, value in data.items():
        if name not in further and not _fits(value, declared[name]):
            raise BadValueError(f"the entry {name} = {shown(value)} of {record_name} is not of type {declared[name]}")
    return cls(**(data | further))


def _fits(value: Any, declared: str) -> bool:
    if declared == "dict[str, float]":
        return type(value) is dict and all(type(v) is float and math.isfinite(v) for v in value.values())
    allowed = [kind for word in declared.split(" | ") for kind in _TYPES[word]]
    return type(value) in allowed


def check_same(path: Path, kind: str, there: Any, here: Any) -> None:
    """OptionError where the identity `there`, stored in the file, differs from that of the call, `here`, with the first
    difference."""
    here = json.loads(json.dumps(here))
    difference = first_difference(there, here) or first_difference(_with_types(there), _with_types(here))
    if difference:
        raise OptionError(f"resume = '{path}' holds another {kind}: {difference}; ask for the same one, or name another file")


def _with_types(value: Any) -> Any:
    """Plain data with every number as text, which tells 1 from 1.0 and true: jobs may."""
    if isinstance(value, dict):
        return {key: _with_types(one) for key, one in value.items()}
    return [_with_types(one) for one in value] if isinstance(value, list) else repr(value)


def packed(values: Array) -> dict[str, Any]:
    """An array (float64) as plain data for JSON: its shape and its compressed bytes as text, so that no digit is lost."""
    content = zlib.compress(np.ascontiguousarray(values, dtype="<f8").tobytes(), 1)
    return {"shape": list(np.shape(values)), "zlib_float64": base64.b64encode(content).decode("ascii")}


def unpacked(stored: Any) -> Array:
    """The array from its plain data; no more bytes are decompressed than its shape requires. BadValueError where the number of
    bytes does not agree with the shape."""
    shape = [whole(n, least=0) for n in stored["shape"]]
    content, size = base64.b64decode(stored["zlib_float64"], validate=True), 8 * math.prod(shape)
    if size > 2000 * len(content) + 64:
        raise BadValueError(f"the stored data are damaged: {len(content)} bytes cannot hold an array of shape {shape}")
    unpacking = zlib.decompressobj()
    raw = unpacking.decompress(content, size + 1)
    if len(raw) != size or not unpacking.eof:
        raise BadValueError(f"the stored data are damaged: an array of shape {shape} needs more or fewer bytes")
    return np.frombuffer(raw, dtype="<f8").reshape(shape)


# -- Rows of a sweep, and the file that keeps them: each is written as soon as it is known

SWEEP_FORMAT = "mbdae sweep 2"


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
        if not isinstance(said, dict) or said.get("format") != SWEEP_FORMAT:
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
