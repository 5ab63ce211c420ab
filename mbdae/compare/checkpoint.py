"""A comparison on its way: rows done, the reference, and what is needed to go on, kept in one JSON file after every run.

The file says what is compared (statements of the scene, runs, accuracies, versions); it is gone on with only where all of
that is the same. It is replaced as a whole, so it is valid whenever the run stops.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mbdae.compare.pairwise import Final
from mbdae.compare.reference import Reference
from mbdae.compare.rows import Row
from mbdae.files import write_file
from mbdae.sweep.resume import made, packed, read_kept, reading, resume_path, unpacked
from mbdae.system.base import Array
from mbdae.values import number

FORMAT = "mbdae comparison in progress 1"


@dataclass
class State:
    """What has been computed so far. reference_values: what is compared, of the reference; finals: the same of the tightest run
    of each label."""

    reference: Reference | None = None
    reference_values: Array | None = None
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
        with reading(self.path):
            reference = made(Reference, data["reference"]) if data["reference"] else None
            finals = {f["label"]: made(Final, f, values=unpacked(f["values"])) for f in data["finals"]}
            values = unpacked(data["truth"]) if data["truth"] else None
            rows = [made(Row, row) for row in data["rows"]]
            cpu, total = (number(data[key], least=0.0) for key in ("cpu_s", "total_cpu_s"))
            return State(reference, values, rows, finals, cpu, total)

    def save(self, state: State) -> None:
        """Replace the file by the state."""
        if self.path is None:
            return
        finals = [{"label": f.label, "asked": f.asked, "rtol": f.rtol, "values": packed(f.values)} for f in state.finals.values()]
        values = None if state.reference_values is None else packed(state.reference_values)
        data = {
            "format": FORMAT, "statement": self.statement, "rows": [asdict(row) for row in state.rows],
            "reference": asdict(state.reference) if state.reference else None, "cpu_s": state.cpu_s,
            "total_cpu_s": state.total_cpu_s, "finals": finals, "truth": values,
        }  # fmt: skip
        write_file(self.path, json.dumps(data, indent=1) + "\n")


def checkpoint(path: Any, statement: dict[str, Any]) -> Checkpoint:
    """The checkpoint at a path the user gave."""
    return Checkpoint(resume_path(path), statement)
