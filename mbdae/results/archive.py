"""The arrays of a stored result: an .npz file; name, type and size of all members are checked before any of them is read.

The header of a stored result: which entries it must have, and of which types; others are refused.

A `Kind` checks one value: a function of the value and its place in the header that raises BadValueError naming both.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np

from mbdae.files import replacing
from mbdae.integrators.solution import Stats
from mbdae.system.base import Array
from mbdae.values import BadValueError, shown

#: limits against small files that unpack to more than the memory: a file of `size` bytes may unpack to FREE bytes or, if that is
#: more, to DENSEST * size
FREE, DENSEST = 2**28, 100
MOST_ARRAYS = 100  #: largest number of arrays in a file; one with more is refused
CHUNK = 2**22  #: largest number of bytes read at once
_HEAD = re.compile(rb"\{'descr': '([<>])(f8|U\d{1,9})', 'fortran_order': (True|False), 'shape': \(([\d, ]{0,60})\), \}\s*\Z")


def write(path: Any, header: str, arrays: Mapping[str, Array]) -> None:
    """Write a header and arrays of numbers as one file, or leave what is there."""
    with replacing(path) as part, part.open("wb") as file:
        np.savez_compressed(file, header=np.array(header), **arrays)  # type: ignore[arg-type]


class _Member(NamedTuple):
    """An array inside the file: offset of its numbers, their type, order and shape."""

    info: zipfile.ZipInfo
    offset: int
    dtype: np.dtype[Any]
    fortran: bool
    shape: tuple[int, ...]


class Archive:
    """An open .npz file; raises BadValueError where it is damaged, or contains what no result contains."""

    def __init__(self, path: Path) -> None:
        mode = os.stat(path).st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # opening a pipe may block for ever
            raise BadValueError("it is a pipe or a device, where a file is expected")
        self._file = path.open("rb")
        try:
            self._zip = zipfile.ZipFile(self._file)
            self._members = self._listed(os.fstat(self._file.fileno()).st_size)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._file.close()

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of every array of numbers, by name."""
        return {name: member.shape for name, member in self._members.items() if member.dtype.kind == "f"}

    def _listed(self, size: int) -> dict[str, _Member]:
        infos = self._zip.infolist()
        names = [info.filename.removesuffix(".npy") for info in infos]
        if len(infos) > MOST_ARRAYS:
            raise BadValueError(f"the file holds {len(infos)} arrays, where at most {MOST_ARRAYS} are expected")
        if len(set(names)) < len(names):
            raise BadValueError("the file holds two arrays of the same name")
        total = sum(info.file_size for info in infos)
        if total > max(FREE, DENSEST * size):
            raise BadValueError(f"the file of {size} bytes would become {total} bytes when unpacked, where at most "
                                f"{max(FREE, DENSEST * size)} are expected")
        return {name: self._member(name, info) for name, info in zip(names, infos, strict=True)}

    def _member(self, name: str, info: zipfile.ZipInfo) -> _Member:
        """A member of the file as its first bytes describe it, checked."""
        plain = info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not info.flag_bits & 1
        if not (info.filename == f"{name}.npy" and name.isidentifier() and plain):
            raise BadValueError(f"the file's entry {shown(info.filename)} is not stored as mbdae stores an array (NAME.npy, "
                                f"not encrypted)")
        with self._zip.open(info) as file:
            begin = file.read(12)
            wide = begin[6:8] == b"\2\0"
            length = int.from_bytes(begin[8:12] if wide else begin[8:10], "little")
            offset = (12 if wide else 10) + length
            head = (begin[12 if wide else 10 :] + file.read(max(0, offset - 12)))[:length] if length <= 4096 else b""
        found = _HEAD.fullmatch(head)
        if begin[:6] != b"\x93NUMPY" or begin[6:8] not in (b"\1\0", b"\2\0") or found is None:
            raise BadValueError(f"the file's entry {shown(name)} is not an array of numbers or of text in NumPy's format")
        order, kind, fortran, inside = found.groups()
        try:
            shape = tuple(int(n) for n in inside.decode().replace(" ", "").rstrip(",").split(",") if inside.strip())
        except ValueError:
            raise BadValueError(f"the shape of the file's array {shown(name)} cannot be read: {shown(inside.decode())}") from None
        letters = int(kind[1:]) if kind != b"f8" else 0
        item = 8 if kind == b"f8" else 4 * letters
        if len(shape) > 3:
            raise BadValueError(f"the file's array {shown(name)} has {len(shape)} dimensions, where at most 3 are expected")
        if offset + item * math.prod(shape) != info.file_size:
            raise BadValueError(f"the file's array {shown(name)} of shape {shape} has {info.file_size} bytes, where "
                                f"{offset + item * math.prod(shape)} are expected")
        return _Member(info, offset, np.dtype((order + kind).decode()), fortran == b"True", shape)

    def text(self, name: str) -> str:
        """A member that is one text."""
        member = self._members.get(name)
        if member is None or member.dtype.kind != "U" or member.shape:
            raise BadValueError(f"the file has no entry {shown(name)} that is one text")
        raw = np.empty(member.info.file_size - member.offset, np.uint8)
        self._read(member, raw)
        return raw.tobytes().decode("utf-32-be" if member.dtype.str[0] == ">" else "utf-32-le").rstrip("\0")

    def array(self, name: str) -> Array:
        """An array of finite numbers."""
        member = self._members[name]
        flat = np.empty(math.prod(member.shape), member.dtype)
        self._read(member, flat.view(np.uint8))
        if not np.isfinite(flat).all():
            raise BadValueError(f"the file's array {shown(name)} holds a number that is not finite")
        return flat.astype(float, copy=False).reshape(member.shape, order="F" if member.fortran else "C")

    def _read(self, member: _Member, into: np.ndarray[Any, np.dtype[np.uint8]]) -> None:
        """Fill an array with the bytes of a member; reading to its end compares the check sum."""
        with self._zip.open(member.info) as file:
            file.read(member.offset)
            at = 0
            while at < len(into):
                piece = file.read(min(CHUNK, len(into) - at))
                if not piece:
                    raise BadValueError(f"the file's array {shown(member.info.filename)} ends before all numbers of its shape")
                into[at : at + len(piece)] = np.frombuffer(piece, np.uint8)
                at += len(piece)
            if file.read(1):
                raise BadValueError(f"the file's array {shown(member.info.filename)} goes on after all numbers of its shape")


FORMAT, VERSION = "mbdae result", 1
DEEPEST = 60  #: largest number of lists and tables that may be inside each other; a header with more is refused
MOST_OTHERS = 20  #: largest number of runs beside the one that is stored
MOST = 2**53  #: largest magnitude of a whole number that a header may contain
Kind = Callable[[Any, str], None]


def parsed(text: str) -> dict[str, Any]:
    """The header from its JSON text, checked; BadValueError where it is damaged, or of another format."""
    try:
        header = json.loads(text, object_pairs_hook=_table)
    except (ValueError, RecursionError) as error:
        raise BadValueError(f"the file's header cannot be read as JSON: {error}") from error
    _plain(header, 0)
    if not isinstance(header, dict) or "format" not in header:
        raise BadValueError("the file's header does not name its format")
    if header["format"] != FORMAT:
        raise OtherFormatError(f"the file's format is {shown(header['format'])}, not {FORMAT!r}; give a file written by "
                               f"r.save(path)")
    _whole()(header.get("version"), "version")
    if header["version"] > VERSION:
        raise OtherFormatError(f"the file has format version {header['version']}, this mbdae reads up to {VERSION}: update mbdae")
    HEADER(header, "")
    return header


class OtherFormatError(BadValueError):
    """A file of another kind, or of a later version: not damaged."""


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"two entries have the same name among {shown([name for name, _ in pairs])}")
    return found


def _plain(value: Any, depth: int) -> None:
    """Refuse what is nested too deeply, and text that cannot be written."""
    if depth > DEEPEST:
        raise BadValueError(f"lists and tables in the file's header are nested more than {DEEPEST} deep")
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise BadValueError(f"the file's header holds {ascii(value)[:60]}, with characters UTF-8 cannot store") from None
    for part in value.items() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ():
        _plain(part, depth if isinstance(value, dict) else depth + 1)


# ---- kinds ----------------------------------------------------------------------------------------------------------------


def _refuse(value: Any, where: str, expected: str) -> BadValueError:
    return BadValueError(f"the file's header says {where} = {shown(value)}, where {expected} is expected")


def _text(value: Any, where: str) -> None:
    if not isinstance(value, str):
        raise _refuse(value, where, "a text")


def _flag(value: Any, where: str) -> None:
    if not isinstance(value, bool):
        raise _refuse(value, where, "true or false")


def _real(least: float = -math.inf, finite: bool = True, known: bool = True) -> Kind:
    """A number, at least `least`; infinite too where finite=False, nan too where known=False."""

    def check(value: Any, where: str) -> None:
        number = isinstance(value, int | float) and not isinstance(value, bool) and (type(value) is float or abs(value) <= MOST)
        if not number or value < least or (finite and not math.isfinite(value)) or (known and math.isnan(value)):
            raise _refuse(value, where, f"a {'finite ' if finite else ''}number{'' if least < 0 else f' from {least:g}'}")

    return check


def _whole(least: int = 0, most: int = MOST) -> Kind:
    def check(value: Any, where: str) -> None:
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            raise _refuse(value, where, f"a whole number from {least} to {most}")

    return check


def _optional(kind: Kind) -> Kind:
    return lambda value, where: None if value is None else kind(value, where)


def _many(kind: Kind, count: int | None = None, most: int = MOST) -> Kind:
    def check(value: Any, where: str) -> None:
        if not isinstance(value, list) or len(value) > most or (count is not None and len(value) != count):
            raise _refuse(value, where, f"a list{'' if count is None else f' of {count}'}")
        for i, part in enumerate(value):
            kind(part, f"{where}[{i}]")

    return check


def _each(kind: Kind) -> Kind:
    """A table with any names and values of one kind."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, dict):
            raise _refuse(value, where, "a table")
        for key, part in value.items():
            kind(part, f"{where}.{shown(key)}")

    return check


def _coordinates(value: Any, where: str) -> None:
    """Start values by joint and coordinate; files of earlier versions have one number for the only coordinate of a joint."""
    _each(lambda part, place: (_each(_real()) if isinstance(part, dict) else _real())(part, place))(value, where)


def _controllers(value: Any, where: str) -> None:
    """Controllers under way, by name: first instant, number of calls, and memory; the memory is not checked here, but where it is
    read as the argument of a statement is."""
    _each(_row(_real(), _whole(), lambda memory, place: None))(value, where)


def _row(*kinds: Kind) -> Kind:
    """A list with one value of each kind, in this order."""

    def check(value: Any, where: str) -> None:
        _many(lambda part, place: None, len(kinds))(value, where)
        for i, (kind, part) in enumerate(zip(kinds, value, strict=True)):
            kind(part, f"{where}[{i}]")

    return check


def _record(required: Mapping[str, Kind], optional: Mapping[str, Kind] | None = None) -> Kind:
    """A table with these entries and no others; optional ones are missing in files of earlier versions."""
    known = {**required, **(optional or {})}

    def check(value: Any, where: str) -> None:
        if not isinstance(value, dict):
            raise _refuse(value, where or "(the whole header)", "a table")
        for key in (*(k for k in required if k not in value), *(k for k in value if k not in known)):
            raise BadValueError(f"the file's header {'has an unknown' if key in value else 'lacks the'} entry "
                                f"{f'{where}.' if where else ''}{shown(key)}")
        for key, part in value.items():
            known[key](part, f"{where}.{key}" if where else key)

    return check


def _dense(value: Any, where: str) -> None:
    kinds = {"collocation": {"stages": _whole(2, 20)}, "hermite": {"points": _whole(1, 20)},
             "joined": {"points": _many(_whole(1, 20)), "steps": _many(_whole(1))}}
    kind = value.get("kind") if isinstance(value, dict) else None
    if not isinstance(kind, str) or kind not in kinds:
        raise _refuse(value, where, f"a table whose kind is one of {', '.join(kinds)}")
    _record({"kind": _text, **kinds[kind]})(value, where)
    if kind == "joined" and len(value["points"]) != len(value["steps"]):
        raise _refuse(value["steps"], f"{where}.steps", f"a list of {len(value['points'])}")


def _elements(value: Any, where: str) -> None:
    (_many(_whole(1)) if isinstance(value, list) else _whole(1))(value, where)


_TEXTS, _SHARE = _many(_text), _optional(_real(0.0, finite=False, known=False))
_STATS = {f.name: _whole() if f.type == "int" else _each(_whole()) if f.name == "unresolved" else _real(0.0, finite=False)
          for f in fields(Stats)}
_ACCURACY = {"mesh": _SHARE, "deformation": _SHARE, "has_mesh": _flag, "unknown": _each(_text), "found_reactions": _SHARE,
             "found_amplification": _optional(_real(0.0, finite=False)), "of": _each(_SHARE),
             "meshes": _each(_record({"elements": _elements, "order": _whole(1)}))}
_INFO = {
    "solver": _record({"class": _text, "options": _each(lambda value, where: None)}), "form": _text,
    "accuracy": _record({"asked": _SHARE, "estimated": _SHARE, "verified": _SHARE}, _ACCURACY), "stats": _record({}, _STATS),
    "warnings": _TEXTS, "runs": _whole(), "cpu_s": _real(0.0),
}
HEADER = _record({
    "format": _text, "version": _whole(),
    "scene": _record({"name": _text, "gravity": _many(_real(), 3), "space": _text,
                      "statements": _many(_row(_text, _many(lambda value, where: None), _each(lambda value, where: None)))}),
    "rank": _record({**dict.fromkeys(("kept", "dropped", "singular_here", "not_unique"), _TEXTS),
                     "doubtful": _many(_row(_text, _real(0.0))), "degrees_of_freedom": _whole(-MOST),
                     "smallest": _real(0.0, finite=False)}),
    "start": _record({"t": _real(), "changes": _TEXTS}, {"coordinates": _coordinates, "controllers": _controllers}),
    "time": _real(0.0),
    "info": _record(_INFO, {"choice": _text, "reliable": _flag, "events": _many(_row(_real(), _text, _whole(-1, 1)))}),
    "run": _record({"names": _TEXTS, "complete": _flag, "dense": _dense}),
}, {"laws": _each(_text), "told": _each(_text),
    "others": _many(_record({"names": _TEXTS, "share": _real(0.0), "kind": _text, "ratio": _real(0.0)}), most=MOST_OTHERS),
})
