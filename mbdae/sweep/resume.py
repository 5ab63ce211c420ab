"""What is kept on its way in a file that the user names with `resume`, so that a run that was stopped goes on."""

from __future__ import annotations

import base64
import json
import math
import os
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mbdae.errors import OptionError
from mbdae.system.base import Array
from mbdae.values import BadValueError, file_to_write, function, optional, shown, whole

T = TypeVar("T")
_TYPES = {"str": (str,), "int": (int,), "float": (int, float), "bool": (bool,), "None": (type(None),)}


def resume_path(path: Any) -> Path | None:
    """The path a user gave, None for nothing; one that cannot be written is refused before anything runs."""
    remedy = "give a file in a folder that exists and can be written to, or None"
    where: Path | None = optional("resume", path, file_to_write, remedy)
    if where is not None and not os.access(where.parent, os.W_OK):
        raise OptionError(f"resume = {shown(path)}: {remedy}")
    return where


def progress_of_runs(progress: Any) -> Callable[[int, int, str], None]:
    """The function called before every run; one that does nothing where there is none."""
    told = optional("progress", progress, function, "give a function progress(done, total, label), or None",
                    takes="done, total, label")  # fmt: skip
    return told or (lambda done, total, label: None)


def read_kept(path: Path, file_format: str, what: str, statement: Any) -> dict[str, Any]:
    """A JSON file kept earlier; refused where it is not of this format, or holds another `what` than the statement says."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"resume = '{path}' cannot be read: {error}; delete it, or name another file") from error
    if not isinstance(data, dict) or data.get("format") != file_format:
        raise OptionError(f"resume = '{path}' is not a {what} kept by resume; name another file")
    check_same(path, what, data.get("statement"), statement)
    return data


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Tell damage of a file that is read inside: what is kept has to be as it was written."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, zlib.error) as error:
        if isinstance(error, OptionError):
            raise
        told = str(error) if isinstance(error, BadValueError) else f"{type(error).__name__}: {shown(error)}"
        raise OptionError(f"resume = '{path}' is damaged ({told}); delete it, or name another file") from error


def made(cls: type[T], data: Any, **further: Any) -> T:
    """A record from its plain data, every entry of the type its class declares; further: entries that are no plain data."""
    if not isinstance(data, dict):
        raise BadValueError(f"{shown(data)} is no {cls.__name__}")
    declared = {f.name: str(f.type) for f in fields(cls)}  # type: ignore[arg-type]
    needed = {f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING}  # type: ignore[arg-type]
    wrong = sorted((set(data) - set(declared)) | (needed - set(data) - set(further)))
    if wrong:
        raise BadValueError(f"a {cls.__name__} has no entry {shown(wrong[0])}, or lacks it")
    for name, value in data.items():
        if name not in further and not _fits(value, declared[name]):
            raise BadValueError(f"{name} = {shown(value)} of a {cls.__name__} is not {declared[name]}")
    return cls(**(data | further))


def _fits(value: Any, declared: str) -> bool:
    allowed = [kind for word in declared.split(" | ") for kind in _TYPES[word]]
    return type(value) in allowed


def packed(values: Array) -> dict[str, Any]:
    """An array as plain data."""
    content = zlib.compress(np.ascontiguousarray(values, dtype="<f8").tobytes(), 1)
    return {"shape": list(np.shape(values)), "zlib_float64": base64.b64encode(content).decode("ascii")}


def unpacked(stored: Any) -> Array:
    """The array again; no more is unpacked than its shape says."""
    shape = [whole(n, least=0) for n in stored["shape"]]
    content, size = base64.b64decode(stored["zlib_float64"], validate=True), 8 * math.prod(shape)
    if size > 2000 * len(content) + 64:
        raise BadValueError(f"an array has shape {shape}, but {len(content)} bytes")
    unpacking = zlib.decompressobj()
    raw = unpacking.decompress(content, size + 1)
    if len(raw) != size or not unpacking.eof:
        raise BadValueError(f"an array of shape {shape} has other bytes")
    return np.frombuffer(raw, dtype="<f8").reshape(shape)


def check_same(path: Path, what: str, there: Any, here: Any) -> None:
    """Refuse a file that holds something else, the first difference named."""
    difference = first_difference(there, json.loads(json.dumps(here)))
    if difference:
        raise OptionError(f"resume = '{path}' holds another {what}: {difference}; ask for the same one, or name another file")


def first_difference(there: Any, here: Any, where: str = "") -> str | None:
    """The first entry in which two plain values differ, in words; None where they are equal."""
    if there == here:
        return None
    if isinstance(there, Mapping) and isinstance(here, Mapping) and set(there) == set(here):
        names = [(f"{where}.{key}" if where else str(key), there[key], here[key]) for key in there]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        names = [(f"{where}[{i}]", a, b) for i, (a, b) in enumerate(zip(there, here, strict=True))]
    else:
        return f"{where or 'it'} is {_short(there)} there and {_short(here)} here"
    return next(found for name, a, b in names if (found := first_difference(a, b, name)))


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
