"""What a stored entry depends on in addition to its own input: code of mbdae, versions of packages, Python, the processor."""

from __future__ import annotations

import hashlib
import os
import sys
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from mbdae.disk.store import store

PACKAGE = Path(__file__).resolve().parent.parent
FACTS = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features", "CPU implementer", "CPU architecture",
         "CPU variant", "CPU part")  #: lines of /proc/cpuinfo about instruction sets  # fmt: skip


@lru_cache(maxsize=1)
def surroundings() -> str:
    """A hash of code, versions and machine; "" where one of them cannot be determined, so that nothing is stored."""
    try:
        parts = [sources(PACKAGE), *releases(), *machine()]
    except (OSError, ImportError, AttributeError):
        return ""
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()


def releases() -> list[str]:
    """Versions of symengine (with the size of its library, which contains LLVM), NumPy and Python; mbdae's is in its sources."""
    import numpy
    import symengine
    from symengine.lib import symengine_wrapper

    library = str(symengine_wrapper.__file__)
    return [symengine.__version__, str(os.stat(library).st_size), numpy.__version__, sys.version,
            sys.implementation.name]  # fmt: skip


def machine() -> list[str]:
    """Operating system, processor type and its instruction sets."""
    features_of: Any = import_module("numpy._core._multiarray_umath")
    kind = os.uname().machine if hasattr(os, "uname") else os.environ.get("PROCESSOR_IDENTIFIER", "")
    features = sorted(name for name, there in features_of.__cpu_features__.items() if there)
    return [sys.platform, sys.byteorder, str(sys.maxsize), kind, *features, *_processor()]


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
