"""Entries of values and compiled functions under keys made of digests."""

from __future__ import annotations

import hashlib
import io
import pickle
from typing import Any

from mbdae.disk.store import store
from mbdae.disk.surroundings import surroundings

#: what an entry may contain beside plain values: compiled functions, and expressions
ALLOWED = {("symengine.lib.symengine_wrapper", "llvm_loading_func"), ("symengine.lib.symengine_wrapper", "load_basic"),
           ("numpy", "float64")}  # fmt: skip


def key_of(*parts: str) -> str | None:
    """The key of an entry by the digests of all it was made from; None where nothing is kept."""
    if not (store().used and surroundings()):
        return None
    return hashlib.sha256("\n".join((surroundings(), *map(repr, parts))).encode()).hexdigest()


def part_key(key: str | None, *part: str) -> str | None:
    """The key of a part of an entry."""
    return None if key is None else key_of("part", key, *part)


class _Reader(pickle.Unpickler):
    """Reads plain values, expressions and compiled functions, and calls nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


def recall(key: str | None) -> Any:
    """The value of an entry; None where there is none, or none that can be read."""
    content = store().read(key) if key is not None else None
    if content is None or key is None:
        return None
    try:
        return _Reader(io.BytesIO(content)).load()
    except Exception:  # of whatever kind: it is made again
        store().remove(key)
        return None


def keep(key: str | None, value: Any) -> None:
    """Keep a value that is not None. What cannot be stored is not."""
    if key is None:
        return
    try:
        content = pickle.dumps(value, protocol=5)
        _Reader(io.BytesIO(content)).load()
    except Exception:  # a part without a stored form: it is made again every time
        return
    store().write(key, content)
