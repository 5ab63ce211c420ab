"""Trees of plain values and arrays, each in one .npz file that is replaced as a whole."""

from __future__ import annotations

import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.deferred import csc_matrix, issparse
from mbdae.files import regular, replacing

TEXT, DIGEST = "tree", "digest"
Tree = Any  #: None, booleans, numbers, texts, arrays, sparse matrices (CSC), and lists, tuples and dictionaries of these


class DamagedError(Exception):
    """A stored file cannot be read. The call fails, and no other solver is tried (as it is where a run fails)."""


class NotPlainError(Exception):
    """A value is none of the plain values and arrays that a tree can hold."""


def write_tree(path: Path, tree: Tree) -> None:
    """Replace a file by a tree, which is on the disk when this returns."""
    arrays: dict[str, Any] = {}
    text = json.dumps(packed(tree, arrays))
    arrays[DIGEST] = np.frombuffer(_digest(text, arrays), dtype=np.uint8)
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays, **{TEXT: np.frombuffer(text.encode(), dtype=np.uint8)})


def read_tree(path: Path) -> Tree:
    """Read the tree in a file; raises DamagedError where it is damaged."""
    from zipfile import BadZipFile

    try:
        with regular(path) as file, np.load(file, allow_pickle=False) as stored:
            text, arrays = stored[TEXT].tobytes().decode(), {name: stored[name] for name in stored.files if name != TEXT}
            if arrays.pop(DIGEST).tobytes() != _digest(text, arrays):
                raise ValueError("its numbers are not those that were stored")
            return unpacked(json.loads(text), arrays)
    except (OSError, ValueError, KeyError, TypeError, BadZipFile, zlib.error, EOFError) as error:
        raise DamagedError(f"file '{path}' cannot be read or is damaged ({error}): delete it with its folder, or name another "
                           "folder") from error


def _digest(text: str, arrays: dict[str, Any]) -> bytes:
    found = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        found.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape}".encode())
        found.update(np.ascontiguousarray(arrays[name]).data)
    return found.digest()


def packed(value: Tree, arrays: dict[str, Any]) -> Any:
    """A tree as JSON values, with its arrays moved to `arrays`; NotPlainError where it holds another value."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "bifc":
        arrays[f"a{len(arrays)}"] = value
        return {"array": f"a{len(arrays) - 1}"}
    if issparse(value) and value.format == "csc":
        return {"csc": [packed(part, arrays) for part in (value.data, value.indices, value.indptr)], "shape": list(value.shape)}
    if isinstance(value, list):
        return [packed(part, arrays) for part in value]
    if isinstance(value, tuple):
        return {"tuple": [packed(part, arrays) for part in value]}
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {"dict": {key: packed(part, arrays) for key, part in value.items()}}
    raise NotPlainError(type(value).__name__)


def unpacked(value: Any, arrays: Any) -> Tree:
    """The tree from JSON values and arrays: the inverse of `packed`."""
    if isinstance(value, list):
        return [unpacked(part, arrays) for part in value]
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "csc" in value:
        return csc_matrix(tuple(unpacked(part, arrays) for part in value["csc"]), shape=tuple(value["shape"]))
    if "tuple" in value:
        return tuple(unpacked(part, arrays) for part in value["tuple"])
    return {key: unpacked(part, arrays) for key, part in value["dict"].items()}
