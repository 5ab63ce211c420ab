"""A comparison on its way: rows done, the reference, and what is needed to go on, kept in one JSON file after every run.

The file says what is compared (statements of the scene, runs, accuracies, versions); it is gone on with only where all of
that is the same. It is replaced as a whole, so it is valid whenever the run stops.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.compare.kept import read_kept, resume_path
from mbdae.compare.pairwise import Final
from mbdae.compare.reference import Reference
from mbdae.compare.rows import Row
from mbdae.files import write_file
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
        data = read_kept(self.path, FORMAT, "comparison", self.statement)
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
        write_file(self.path, json.dumps(data, indent=1) + "\n")


def checkpoint(path: Any, statement: dict[str, Any]) -> Checkpoint:
    """The checkpoint at a path the user gave."""
    return Checkpoint(resume_path(path), statement)


def _text(values: Array) -> dict[str, Any]:
    packed = zlib.compress(np.ascontiguousarray(values, dtype="<f8").tobytes(), 1)
    return {"shape": list(np.shape(values)), "zlib_float64": base64.b64encode(packed).decode("ascii")}


def _array(stored: Mapping[str, Any]) -> Array:
    shape: Sequence[int] = stored["shape"]
    return np.frombuffer(zlib.decompress(base64.b64decode(stored["zlib_float64"])), dtype="<f8").reshape(shape)
