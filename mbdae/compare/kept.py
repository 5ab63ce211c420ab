"""What is kept on its way in a file that the user names with `resume`, so that a run that was stopped goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mbdae.errors import OptionError


def resume_path(path: Any) -> Path | None:
    """The path a user gave, None for nothing; one that cannot be written is refused before anything runs."""
    where = Path(path) if path is not None else None
    if where is not None and (where.is_dir() or not where.parent.is_dir() or not os.access(where.parent, os.W_OK)):
        raise OptionError(f"resume = '{where}': give a file in a folder that exists and can be written to")
    return where


def read_kept(path: Path, file_format: str, what: str, statement: Any) -> dict[str, Any]:
    """A JSON file kept earlier; refused where it is not of this format, or holds another `what` than the statement says."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OptionError(f"resume = '{path}' cannot be read: {error}") from error
    if not isinstance(data, dict) or data.get("format") != file_format:
        raise OptionError(f"resume = '{path}' is not a {what} kept by resume; name another file")
    check_same(path, what, data["statement"], statement)
    return data


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
