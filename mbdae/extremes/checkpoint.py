"""A map of extremes in progress: the finished values, in one JSON file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mbdae.compare.identity import identity
from mbdae.compare.problem import Problem
from mbdae.compare.run import Run
from mbdae.extremes.cell import VERDICTS, Cell
from mbdae.results.reads import reads
from mbdae.scene.scene import SceneData
from mbdae.sweep.resume import ResumeFile, record
from mbdae.values import BadValueError, number, shown, word


@dataclass
class Checkpoint(ResumeFile):
    """The JSON file of a map in progress: reference and cells by (parameter, value)."""

    rows: dict[tuple[str, float], tuple[str, list[Cell]]] = field(default_factory=dict)
    cpu_s: float = 0.0  #: CPU time of the rows that were read from the file, s

    kind, file_format = "map", "mbdae extremes in progress 2"

    def row_name(self, row: Any) -> str:
        return f"{shown(row.get('parameter'))} = {shown(row.get('value'))}" if isinstance(row, dict) else "a value"

    def add(self, parameter: str, value: float, reference: str, cells: list[Cell]) -> None:
        """Add a value, and write the file anew."""
        self.rows[parameter, value] = reference, cells
        self.store({"rows": [{"parameter": p, "value": v, "reference": r, "cells": [asdict(c) for c in row]}
                             for (p, v), (r, row) in self.rows.items()]})  # fmt: skip


def checkpoint(path: Path | None, scene: Any, problem: Problem, values: Mapping[str, Sequence[float]],
               runs: Sequence[Run] | None, accuracy: float) -> Checkpoint:  # fmt: skip
    """The file of this map with its stored values; the file of another map is refused, with the difference. scene: as the user
    gave it, a scene or a function that returns one."""
    function = {} if path is None or isinstance(scene, SceneData) else reads(scene)
    found = Checkpoint(path, identity(problem, runs or [], [accuracy], None) | {"vary": values, "scene function": function})
    with found.stored() as data:
        for r in data["rows"] if data is not None else []:
            found.rows[_text(r["parameter"]), number(r["value"])] = _text(r["reference"]), [_cell(c) for c in r["cells"]]
    found.cpu_s = sum(c.cpu_s or 0.0 for _, row in found.rows.values() for c in row)
    return found


def _cell(stored: Any) -> Cell:
    word(stored["verdict"], VERDICTS)
    return record(Cell, stored, warnings=tuple(_text(w) for w in stored["warnings"]))


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise BadValueError(f"{shown(value)} stands where a text should stand")
    return value
