"""The arrays of a stored result: an .npz file; name, type and size of all members are checked before any of them is read."""

from __future__ import annotations

import math
import os
import re
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np

from mbdae.files import replacing
from mbdae.system.base import Array
from mbdae.values import BadValueError, shown

#: limits against small files that unpack to more than the memory: a file of `size` bytes may unpack to FREE bytes or, if that is
#: more, to DENSEST * size
FREE, DENSEST = 2**28, 100
MOST = 100  #: largest number of arrays in a file; one with more is refused
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
        if len(infos) > MOST:
            raise BadValueError(f"the file holds {len(infos)} arrays, where at most {MOST} are expected")
        if len(set(names)) < len(names):
            raise BadValueError("the file holds two arrays of the same name")
        total = sum(info.file_size for info in infos)
        if total > max(FREE, DENSEST * size):
            raise BadValueError(f"the file of {size} bytes would become {total} bytes when unpacked, where at most "
                                f"{max(FREE, DENSEST * size)} are expected")  # fmt: skip
        return {name: self._member(name, info) for name, info in zip(names, infos, strict=True)}

    def _member(self, name: str, info: zipfile.ZipInfo) -> _Member:
        """A member of the file as its first bytes describe it, checked."""
        plain = info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not info.flag_bits & 1
        if not (info.filename == f"{name}.npy" and name.isidentifier() and plain):
            raise BadValueError(f"the file's entry {shown(info.filename)} is not stored as mbdae stores an array (NAME.npy, "
                                f"not encrypted)")  # fmt: skip
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
                                f"{offset + item * math.prod(shape)} are expected")  # fmt: skip
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
