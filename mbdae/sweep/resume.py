"""The file that a user names by `resume=`: it stores what is finished, so that the same call continues after an interruption.

Every row has a digest of itself and of the call that it belongs to. A row that was changed, cut or taken from another file is
computed again, and a warning names it."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from mbdae.errors import OptionError, warn
from mbdae.files import first_difference, read_file, write_file
from mbdae.values import BadValueError, file_to_write, optional, shown

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
                for row, good in zip(rows[:last], sound[:last], strict=True) if good]  # fmt: skip

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
            write_file(self.path, json.dumps(content, indent=1) + "\n")


def key_of(identity: Any) -> str:
    """A digest of the identity of a call, with which its rows are stored."""
    return digest("", identity)


def digest(key: str, row: Any) -> str:
    """A digest of plain data of the call with this key, the same before and after they are written and read."""
    text = json.dumps([key, json.loads(json.dumps(row))], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


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


def interruption(path: Any, done: int, total: int, what: str) -> str:
    """A sentence on an interrupted call: how much it has finished, and where that is stored."""
    kept = f"kept in {path}; the same call goes on from there" if path is not None else "not kept; resume=FILE keeps them"
    return f"interrupted: {done} of {total} {what} are done and {kept}"


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
