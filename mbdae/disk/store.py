"""A folder of entries by keys; no fault of the disk may cause a wrong answer or a failed run.

An entry is one file: a hash, then its content. The hash covers the key, so that a renamed file is not accepted. Damaged entries
are removed and made again; a folder or file to which others than the user have permissions is not read. Files are written under
another name and then renamed, so that several processes may use one folder. Where the disk is full or write-protected, nothing
more is stored.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import secrets
import stat
import time
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from mbdae.disk.place import chosen_folder, made, opened

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
