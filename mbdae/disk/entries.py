"""Stored values and compiled functions, under keys made of digests."""

from __future__ import annotations

import hashlib
import io
import pickle
from typing import Any

from mbdae.disk.store import store
from mbdae.disk.surroundings import surroundings

#: classes that an entry may contain in addition to plain values: compiled functions, expressions, floats of NumPy
ALLOWED = {("symengine.lib.symengine_wrapper", "llvm_loading_func"), ("symengine.lib.symengine_wrapper", "load_basic"),
           ("numpy", "float64")}  # fmt: skip


def key_of(*parts: str) -> str | None:
    """The key of an entry from the digests of all it was made from; None where nothing is stored."""
    if not (store().used and surroundings()):
        return None
    return hashlib.sha256("\n".join((surroundings(), *map(repr, parts))).encode()).hexdigest()


def part_key(key: str | None, *part: str) -> str | None:
    """The key of a part of an entry."""
    return None if key is None else key_of("part", key, *part)


class _Reader(pickle.Unpickler):
    """Unpickler for plain values, expressions and compiled functions, which calls no other code."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name} is not among what mbdae stores: this entry is not used")
        return super().find_class(module, name)


def recall(key: str | None) -> Any:
    """The value of an entry; None where there is none that can be read."""
    content = store().read(key) if key is not None else None
    if content is None or key is None:
        return None
    try:
        return _Reader(io.BytesIO(content)).load()
    except Exception:  # any error means a damaged entry: it is removed and made again
        store().remove(key)
        return None


def keep(key: str | None, value: Any) -> None:
    """Store a value that is not None, unless it cannot be stored."""
    if key is None:
        return
    try:
        content = pickle.dumps(value, protocol=5)
        _Reader(io.BytesIO(content)).load()
    except Exception:  # a part cannot be stored: the value is made anew in every process
        return
    store().write(key, content)
