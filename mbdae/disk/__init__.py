"""The folder of stored kernels: the user's folder for caches or one named by the environment; and whether it is safe to use.

A folder of entries by keys; no fault of the disk may cause a wrong answer or a failed run.

An entry is one file: a hash, then its content. The hash covers the key, so that a renamed file is not accepted. Damaged entries
are removed and made again; a folder or file to which others than the user have permissions is not read. Files are written under
another name and then renamed, so that several processes may use one folder. Where the disk is full or write-protected, nothing
more is stored.

What a stored entry depends on in addition to its own input: code of mbdae, versions of packages, Python, the processor.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import secrets
import stat
import sys
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

#: environment variable: the folder of the cache, or "off" for no cache; unset: the system's usual folder
VARIABLE = "MBDAE_CACHE"
OTHERS = 0o077  #: permission bits of the group and of all others: a file or folder of the cache with one of them set is not used
#: flags with which every file of the cache is opened, as far as the system has them: follow no symbolic link, do not wait for the
#: other end of a pipe, do not pass the file on to child processes, do not change line ends
FLAGS = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))


def chosen_folder() -> tuple[Path | None, str]:
    """The folder; or None and the reason why nothing is stored."""
    said = os.environ.get(VARIABLE, "")
    if said.lower() == "off":
        return None, f"{VARIABLE}=off"
    try:
        return (Path(os.path.abspath(Path(said).expanduser())) if said else _usual_folder()), ""
    except (OSError, RuntimeError, ValueError) as error:  # no home folder, or a name that no folder can have
        return None, f"there is no folder for caches ({error})"


def _usual_folder() -> Path:
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA", "")
        return Path(local) / "mbdae" / "Cache" if local else Path.home() / "AppData" / "Local" / "mbdae" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "mbdae"
    given = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(given) if os.path.isabs(given) else Path.home() / ".cache") / "mbdae"


def made(folder: Path) -> str:
    """Make the folder, for this user only, where it is missing; returns "" where it may be used, else the reason why not."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        return unsafe(os.lstat(folder), is_folder=True)
    except (OSError, ValueError) as error:
        return f"it cannot be made ({getattr(error, 'strerror', None) or error})"


def opened(path: Path | str, flags: int) -> int:
    """A descriptor of a regular file that only this user can access; OSError for any other file. flags: of `os.open`."""
    found = os.open(path, flags | FLAGS, 0o600)
    why = unsafe(os.fstat(found))
    if why:
        os.close(found)
        raise OSError(why)
    return found


def unsafe(found: os.stat_result, is_folder: bool = False) -> str:
    """Reason not to trust a file or folder; "" where only this user can have written it, as far as the system tells."""
    if not (stat.S_ISDIR if is_folder else stat.S_ISREG)(found.st_mode):
        return f"it is no {'folder' if is_folder else 'file'}"
    if not hasattr(os, "geteuid"):  # Windows: the permissions of the user's profile protect it
        return ""
    if found.st_uid != os.geteuid():
        return "it belongs to another user"
    return "others than its owner have rights on it (chmod 700)" if found.st_mode & OTHERS else ""


LIMIT = 500_000_000  #: largest size of all entries, bytes; the least recently used are removed first
MOST = 10_000  #: largest number of entries: a folder with more takes longer to look through than a scene takes to derive
KEPT = 0.8  #: fraction of both limits to which entries are reduced
SUFFIX, PART, COUNTS = ".kept", ".part", "counts"
HASH = 32  #: length of the hash, bytes
DAY, HOUR = 86400.0, 3600.0


class Content(NamedTuple):
    """Content of a store: number of entries, their bytes, and how often entries were found and not found."""

    entries: int
    size: int
    hits: int
    misses: int


class Store:
    """The entries of a folder. why: reason why it is not used; limit: largest size of all entries, bytes."""

    def __init__(self, folder: Path | None, why: str = "", limit: int = LIMIT) -> None:
        self.folder, self.limit = folder, limit
        self.why = why or ("there is no folder" if folder is None else made(folder))
        self.hits = self.misses = 0
        self._held: tuple[int, int] | None = None  #: size (bytes) and number of all entries as far as this process knows
        self._full = False
        if self.used:
            atexit.register(self._count)

    @property
    def used(self) -> bool:
        """Whether entries are read and written."""
        return not self.why

    def _path(self, key: str) -> Path:
        assert self.folder is not None
        assert key.isalnum(), key
        return self.folder / (key + SUFFIX)

    def read(self, key: str) -> bytes | None:
        """The content of an entry; None where there is none."""
        found = self._checked(key) if self.used else None
        if found is None:
            self.misses += 1
        else:
            self.hits += 1
        return found

    def _checked(self, key: str) -> bytes | None:
        path = f"{self.folder}/{key}{SUFFIX}"  # text, because some 200 files are read before a run and objects of Path take time
        try:
            file = opened(path, os.O_RDONLY)
            try:
                state = os.fstat(file)
                whole = os.read(file, state.st_size)
            finally:
                os.close(file)
        except OSError:  # missing, not a regular file, or accessible to others
            return None
        content = whole[HASH:]
        if len(whole) < HASH or whole[:HASH] != _hash(key, content):
            self.remove(key)
            return None
        if time.time() - state.st_mtime > DAY:  # the time of last use, by which entries are removed, is updated once a day
            with contextlib.suppress(OSError):
                os.utime(path)
        return content

    def write(self, key: str, content: bytes) -> None:
        """Store an entry, if the disk allows it."""
        if not self.used or self._full or len(content) > self.limit:
            return
        path = self._path(key)
        part = path.with_name(f"{secrets.token_hex(8)}{PART}")
        try:
            with open(opened(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as file:
                file.write(_hash(key, content) + content)
            os.replace(part, path)
        except OSError:
            self._full = not path.is_dir()  # where a folder has the name of this entry, other entries can still be written
            with contextlib.suppress(OSError):
                part.unlink()
            return
        self._bounded(len(content) + HASH)

    def remove(self, key: str) -> None:
        """Remove an entry that cannot be used."""
        with contextlib.suppress(OSError):
            self._path(key).unlink()

    def _bounded(self, added: int) -> None:
        """Remove the least recently used entries where all together exceed the limit, or are more than MOST."""
        if self._held is None:
            files = self._files()
            self._held = sum(size for _, size, _ in files), len(files)
        else:
            self._held = self._held[0] + added, self._held[1] + 1
        if self._held[0] <= self.limit and self._held[1] <= MOST:
            return
        files = sorted(self._files())
        left, count = sum(size for _, size, _ in files), len(files)
        for _, size, path in files:
            if left <= KEPT * self.limit and count <= KEPT * MOST:
                break
            with contextlib.suppress(OSError):
                os.unlink(path)
                left, count = left - size, count - 1
        self._held = left, count

    def _files(self) -> list[tuple[float, int, str]]:
        """Time of last use, size (bytes) and path of every entry; removes files left by interrupted writing."""
        found = []
        with contextlib.suppress(OSError), os.scandir(self.folder) as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    state = entry.stat(follow_symlinks=False)
                    if not stat.S_ISREG(state.st_mode):
                        continue
                    if entry.name.endswith(SUFFIX):
                        found.append((state.st_mtime, state.st_size, entry.path))
                    elif entry.name.endswith(PART) and time.time() - state.st_mtime > HOUR:
                        os.unlink(entry.path)
        return found

    # -- statistics for `mbdae cache`

    def _count(self) -> None:
        """Add the hits and misses of this process to the stored totals."""
        if self.folder is None or not self.hits + self.misses:
            return
        with contextlib.suppress(OSError):
            with open(opened(self.folder / COUNTS, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab") as file:
                file.write(f"{self.hits} {self.misses}\n".encode())
                long = file.tell() > 1 << 16
            if long:
                self._shorten()

    def _shorten(self) -> None:
        """Replace the lines of the file of counts by their sum; counts added meanwhile may be lost, which is harmless."""
        hits, misses = self._counts()
        part = Path(f"{self.folder}/{secrets.token_hex(8)}{PART}")
        with open(opened(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as file:
            file.write(f"{hits} {misses}\n".encode())
        os.replace(part, Path(f"{self.folder}/{COUNTS}"))

    def _counts(self) -> tuple[int, int]:
        try:
            with open(opened(Path(f"{self.folder}/{COUNTS}"), os.O_RDONLY)) as file:
                lines = [line.split() for line in file]
            return sum(int(h) for h, _ in lines), sum(int(m) for _, m in lines)
        except (OSError, ValueError):
            return 0, 0

    def content(self) -> Content:
        """Number and size of the entries, with all hits and misses counted so far."""
        files, (hits, misses) = self._files() if self.used else [], self._counts() if self.used else (0, 0)
        return Content(len(files), sum(size for _, size, _ in files), hits, misses)

    def clear(self) -> int:
        """Remove all entries; returns their number."""
        files = self._files() if self.used else []
        for path in [path for *_, path in files] + [f"{self.folder}/{COUNTS}"] * self.used:
            with contextlib.suppress(OSError):
                os.unlink(path)
        self._held = None
        return len(files)


def _hash(key: str, content: bytes) -> bytes:
    return hashlib.sha256(key.encode() + b"\n" + content).digest()


@lru_cache(maxsize=1)
def store() -> Store:
    """The store of this process."""
    return Store(*chosen_folder())


PACKAGE = Path(__file__).resolve().parent.parent
FACTS = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features", "CPU implementer", "CPU architecture",
         "CPU variant", "CPU part")  #: lines of /proc/cpuinfo about instruction sets


@lru_cache(maxsize=1)
def surroundings() -> str:
    """A hash of code, versions and machine; "" where one of them cannot be determined, so that nothing is stored."""
    try:
        parts = [sources(PACKAGE), *releases(), *machine()]
    except (OSError, ImportError, LookupError):
        return ""
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()


def releases() -> list[str]:
    """Versions of symengine (with the size of its library, which contains LLVM), NumPy and Python; mbdae's is in its sources."""
    import numpy
    import symengine
    from symengine.lib import symengine_wrapper

    library = str(symengine_wrapper.__file__)
    return [symengine.__version__, str(os.stat(library).st_size), numpy.__version__, sys.version,
            sys.implementation.name]


def machine() -> list[str]:
    """Operating system, processor type and its instruction sets."""
    import numpy

    features: Any = numpy.show_config(mode="dicts")
    kind = os.uname().machine if hasattr(os, "uname") else os.environ.get("PROCESSOR_IDENTIFIER", "")
    return [sys.platform, sys.byteorder, str(sys.maxsize), kind, repr(features["SIMD Extensions"]), *_processor()]


def _processor() -> list[str]:
    """The system's description of the first processor, where a file gives it."""
    try:
        with open("/proc/cpuinfo", "rb") as file:
            first = file.read(8192).split(b"\n\n")[0].decode("utf-8", "replace")
    except OSError:
        return []
    return [line for line in first.splitlines() if line.split(":")[0].strip() in FACTS]


def sources(package: Path) -> str:
    """A hash of the Python sources of a package. Contents are read only where a file is new or changed, as sizes, times and
    inode numbers of the files tell."""
    files = sorted(_files(str(package)))
    stamp = hashlib.sha256(repr(files).encode()).hexdigest()
    known = store().read(stamp)
    if known is not None and len(known) == 64:
        return known.decode("ascii", "replace")
    found = hashlib.sha256()
    for path, *_ in files:
        content = Path(path).read_bytes()
        found.update(f"{os.path.relpath(path, package)} {len(content)}\n".encode() + content)
    store().write(stamp, found.hexdigest().encode())
    return found.hexdigest()


def _files(folder: str) -> list[tuple[str, int, int, int, int]]:
    """Path, inode number, size and times (of content and of any change) of every Python file."""
    found = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                found += _files(entry.path) if entry.name != "__pycache__" else []
            elif entry.name.endswith(".py"):
                state = entry.stat()
                found.append((entry.path, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns))
    return found
