"""Files are written as a whole: under another name first, then renamed, so that the old file stays until the new one is complete.
Files that hold the state of an interrupted call are read only if they are regular files: a pipe could block for ever."""

from __future__ import annotations

import json
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from mbdae.errors import OptionError


def path_of(path: Any) -> Path:
    """The Path of a file name that a user gives; OptionError where it cannot be one."""
    try:
        found = Path(path)
        os.fsencode(found)
    except (TypeError, ValueError):
        raise OptionError(f"path = {path!r} is not the name of a file; give a text such as 'result.npz', or a Path") from None
    if "\0" in str(found):
        raise OptionError(f"path = {path!r} holds the character of code 0, which no file name may hold; give another name")
    return found


@contextmanager
def replacing(path: Any) -> Iterator[Path]:
    """A temporary file in the folder of `path`, with its suffix, to write to: it takes the place of `path` at the end.

    Where the writing fails or is interrupted, `path` stays as it was and the temporary file is removed. What is no regular
    file (a pipe, a terminal) is written to directly; of a link its target is replaced. OptionError, with the reason, where the
    system refuses."""
    named = path_of(path)
    try:
        place = Path(os.path.realpath(named))
        if place.exists() and not place.is_file() and not place.is_dir():
            yield place
            return
        part = place.with_name(f".{secrets.token_hex(8)}{named.suffix}")
        try:
            _begin(part, place)
            yield part
            # wait until the file is on the disk: only then may it replace another
            with part.open("rb+") as file:
                os.fsync(file.fileno())
            os.replace(part, place)
            _flush_folder(place.parent)
        except BaseException as error:
            part.unlink(missing_ok=True)
            if isinstance(error, KeyboardInterrupt) and not error.args:
                error.args = (f"interrupted while '{named}' was written: what was there before stays",)
            raise
    except OSError as error:
        raise OptionError(f"'{named}' cannot be written: {error.strerror or error}; name a file in a folder that exists, may be "
                          f"written to and has space left") from error


def write_file(path: Any, content: str | bytes) -> Path:
    """Write text (UTF-8) or bytes as a whole file, see `replacing`; returns its path."""
    with replacing(path) as part:
        part.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "backslashreplace"))
    return Path(path)


def regular(path: Any) -> BinaryIO:
    """A file to be read; OSError where it is no regular one, without waiting for the other end of a pipe."""
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(f"'{path}' is no regular file (it is a folder, a pipe or a device)")
    return open(number, "rb")


def read_file(path: Any) -> str:
    """The text (UTF-8) of a regular file."""
    with regular(path) as file:
        return file.read().decode("utf-8")


def _begin(part: Path, place: Path) -> None:
    """Create the empty file `part` with the rights of the file at `place`; OSError where that file may not be replaced."""
    if place.is_dir():
        raise IsADirectoryError("there is a folder of this name")
    there = place.exists()
    if there and not os.access(place, os.W_OK):
        raise PermissionError("there is a file of this name that may not be changed")
    os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    if there:
        part.chmod(place.stat().st_mode & 0o777)


def _flush_folder(folder: Path) -> None:
    """Wait until the new name is on the disk too, where the system can."""
    if os.name == "nt":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    except OSError:  # some file systems do not flush folders
        pass
    finally:
        os.close(number)


def first_difference(there: Any, here: Any, where: str = "") -> str | None:
    """The first entry in which plain values of a file (`there`) and of a call (`here`) differ, in words; None where none does."""
    if there == here:
        return None
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        names = [(f"{where}.{key}" if where else str(key), there[key], here[key]) for key in there if key in here]
        alone = next(((key, "what is stored" if key in there else "this call") for key in (*there, *here)
                      if (key in there) != (key in here)), None)
        if alone is not None:
            return f"{where}.{alone[0]} is part of {alone[1]} only" if where else f"{alone[0]} is part of {alone[1]} only"
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        names = [(f"{where}[{i}]", a, b) for i, (a, b) in enumerate(zip(there, here, strict=True))]
    else:
        return f"{where or 'its content'} is {_short(there)} as stored and {_short(here)} in this call"
    return next(found for name, a, b in names if (found := first_difference(a, b, name)))


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
