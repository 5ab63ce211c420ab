"""A comparison on its way: rows done, the reference, and what is needed to go on, kept in one JSON file after every run.

The file says what is compared (statements of the scene, runs, accuracies, versions); it is gone on with only where all of
that is the same. It is replaced as a whole, so it is valid whenever the run stops.
"""

from __future__ import annotations

import base64
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.compare.pairwise import Final
from mbdae.compare.reference import Reference
from mbdae.compare.rows import Row
from mbdae.errors import OptionError
from mbdae.system.base import Array

FORMAT = "mbdae comparison in progress 1"


@dataclass
class State:
    """What has been computed so far. truth: what is compared, of the reference; finals: of the tightest run of each label."""

    reference: Reference | None = None
    truth: Array | None = None
    rows: list[Row] = field(default_factory=list)
    finals: dict[str, Final] = field(default_factory=dict)
    cpu_s: float = 0.0  #: CPU s in solver calls
    total_cpu_s: float = 0.0  #: CPU s in all


@dataclass(frozen=True)
class Checkpoint:
    """The file at `path` for the comparison that `statement` (plain data) says; path None: nothing is kept."""

    path: Path | None
    statement: dict[str, Any]

    def load(self) -> State:
        """What the file holds; an empty state where there is none."""
        if self.path is None or not self.path.exists():
            return State()
        data = _read(self.path)
        difference = first_difference(data["statement"], json.loads(json.dumps(self.statement)))
        if difference:
            raise OptionError(f"resume = '{self.path}' holds another comparison: {difference}; "
                              f"ask for the same one, or name another file")  # fmt: skip
        reference = Reference(**data["reference"]) if data["reference"] else None
        finals = {f["label"]: Final(**(f | {"values": _array(f["values"])})) for f in data["finals"]}
        truth = _array(data["truth"]) if data["truth"] else None
        return State(reference, truth, [Row(**row) for row in data["rows"]], finals, data["cpu_s"], data["total_cpu_s"])

    def save(self, state: State) -> None:
        """Replace the file by the state."""
        if self.path is None:
            return
        finals = [{"label": f.label, "asked": f.asked, "rtol": f.rtol, "values": _text(f.values)} for f in state.finals.values()]
        data = {
            "format": FORMAT, "statement": self.statement, "rows": [asdict(row) for row in state.rows],
            "reference": asdict(state.reference) if state.reference else None, "cpu_s": state.cpu_s,
            "total_cpu_s": state.total_cpu_s, "finals": finals, "truth": None if state.truth is None else _text(state.truth),
        }  # fmt: skip
        part = self.path.with_name(self.path.name + ".part")
        try:
            part.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
            os.replace(part, self.path)
        finally:
            part.unlink(missing_ok=True)


def checkpoint(path: Any, statement: dict[str, Any]) -> Checkpoint:
    """The checkpoint at a path the user gave; a path that cannot be written is refused before anything runs."""
    where = Path(path) if path is not None else None
    if where is not None and (where.is_dir() or not where.parent.is_dir() or not os.access(where.parent, os.W_OK)):
        raise OptionError(f"resume = '{where}': give a file in a folder that exists and can be written to")
    return Checkpoint(where, statement)


def _read(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OptionError(f"resume = '{path}' cannot be read: {error}") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise OptionError(f"resume = '{path}' is not a comparison kept by resume; name another file")
    return data


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


def _text(values: Array) -> dict[str, Any]:
    packed = zlib.compress(np.ascontiguousarray(values, dtype="<f8").tobytes(), 1)
    return {"shape": list(np.shape(values)), "zlib_float64": base64.b64encode(packed).decode("ascii")}


def _array(stored: Mapping[str, Any]) -> Array:
    shape: Sequence[int] = stored["shape"]
    return np.frombuffer(zlib.decompress(base64.b64decode(stored["zlib_float64"])), dtype="<f8").reshape(shape)
