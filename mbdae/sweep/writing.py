"""Texts of results that are returned to users and, where they name a file, written to it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from mbdae.files import write_file
from mbdae.values import file_to_write, optional


def written(make: Callable[[], str], path: Any) -> str:
    """The text that `make` returns, written to `path` where one is given; a path that cannot be written to is refused first."""
    place = optional("path", path, file_to_write, "give the path of a file in a folder that exists, or None")
    text = make()
    if place is not None:
        write_file(place, text)
    return text


def as_json(data: Any, path: Any) -> str:
    """Plain data as JSON text, written to `path` where one is given."""
    return written(lambda: json.dumps(data, indent=1, allow_nan=False) + "\n", path)
