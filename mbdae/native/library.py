"""The compiled library of the native core, opened once."""

from __future__ import annotations

import ctypes
import hashlib
import os
import subprocess
import tempfile
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent


@cache
def library() -> ctypes.CDLL:
    """The library, whose functions others declare."""
    sources = sorted(HERE.glob("*.c"))
    key = hashlib.sha256(b"".join(p.read_bytes() for p in [*sources, *HERE.glob("*.h")])).hexdigest()[:16]
    built = Path(tempfile.gettempdir()) / f"mbdae-core-{key}.so"
    if not built.exists():
        part = built.with_suffix(f".{os.getpid()}")
        subprocess.run(["cc", "-O3", "-std=c11", "-shared", "-fPIC", "-Wall", "-Wextra", "-o", str(part),
                        *map(str, sources), "-lm"], check=True)  # fmt: skip
        os.replace(part, built)
    return ctypes.CDLL(str(built))
