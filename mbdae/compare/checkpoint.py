"""A comparison in progress: finished rows, the reference, and the data needed to continue, in one JSON file after every run."""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mbdae.compare.pairwise import TightestRun
from mbdae.compare.reference import Reference
from mbdae.compare.rows import Row
from mbdae.sweep.resume import ResumeFile, record
from mbdae.system.base import Array
from mbdae.values import BadValueError, number, shown, whole


@dataclass
class State:
    """Results of a comparison so far; reference_values: values of the reference that the runs are compared with."""

    reference: Reference | None = None
    reference_values: Array | None = None
    rows: list[Row] = field(default_factory=list)
    tightest_runs: dict[str, TightestRun] = field(default_factory=dict)
    cpu_s: float = 0.0  #: CPU time in solver calls, s
    total_cpu_s: float = 0.0  #: CPU time of the whole comparison, s


class Checkpoint(ResumeFile):
    """The JSON file of a comparison in progress."""

    kind, file_format, in_order = "comparison", "mbdae comparison in progress 2", True

    def row_name(self, row: Any) -> str:
        return f"the run {shown(row.get('label'))} at accuracy {shown(row.get('accuracy'))}" if isinstance(row, dict) else "a run"

    def load(self) -> State:
        """The state stored in the file; an empty one where there is no file."""
        with self.stored() as data:
            if data is None:
                return State()
            reference = record(Reference, data["reference"]) if data["reference"] else None
            tightest_runs = {f["label"]: record(TightestRun, f, values=unpacked(f["values"])) for f in data["finals"]}
            values = unpacked(data["truth"]) if data["truth"] else None
            rows = [record(Row, row) for row in data["rows"]]
            cpu, total = (number(data[key], least=0.0) for key in ("cpu_s", "total_cpu_s"))
            return State(reference, values, rows, tightest_runs, cpu, total)

    def save(self, state: State) -> None:
        """Write the state, replacing the file."""
        if self.path is None:
            return
        finals = [{"label": run.label, "asked": run.asked, "rtol": run.rtol, "values": packed(run.values)}
                  for run in state.tightest_runs.values()]  # fmt: skip
        self.store({
            "rows": [asdict(row) for row in state.rows], "reference": asdict(state.reference) if state.reference else None,
            "cpu_s": state.cpu_s, "total_cpu_s": state.total_cpu_s, "finals": finals,
            "truth": None if state.reference_values is None else packed(state.reference_values),
        })  # fmt: skip


def packed(values: Array) -> dict[str, Any]:
    """An array (float64) as plain data for JSON: its shape and its compressed bytes as text, so that no digit is lost."""
    content = zlib.compress(np.ascontiguousarray(values, dtype="<f8").tobytes(), 1)
    return {"shape": list(np.shape(values)), "zlib_float64": base64.b64encode(content).decode("ascii")}


def unpacked(stored: Any) -> Array:
    """The array from its plain data; no more bytes are decompressed than its shape requires. BadValueError where the number of
    bytes does not agree with the shape."""
    shape = [whole(n, least=0) for n in stored["shape"]]
    content, size = base64.b64decode(stored["zlib_float64"], validate=True), 8 * math.prod(shape)
    if size > 2000 * len(content) + 64:
        raise BadValueError(f"the stored data are damaged: {len(content)} bytes cannot hold an array of shape {shape}")
    unpacking = zlib.decompressobj()
    raw = unpacking.decompress(content, size + 1)
    if len(raw) != size or not unpacking.eof:
        raise BadValueError(f"the stored data are damaged: an array of shape {shape} needs more or fewer bytes")
    return np.frombuffer(raw, dtype="<f8").reshape(shape)
