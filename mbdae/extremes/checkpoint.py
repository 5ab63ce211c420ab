"""Finished values of a map of extremes in one JSON file, so that a map that was stopped goes on."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mbdae.compare.identity import identity
from mbdae.compare.problem import Problem
from mbdae.compare.run import Run
from mbdae.extremes.cell import VERDICTS, Cell
from mbdae.files import write_file
from mbdae.sweep.resume import made, read_kept, reading, resume_path
from mbdae.values import BadValueError, number, shown, word

FORMAT = "mbdae extremes in progress 1"


@dataclass
class Checkpoint:
    """Reference and cells by (parameter, value); written to `path` after every value, where there is one."""

    path: Path | None
    statement: dict[str, Any]
    rows: dict[tuple[str, float], tuple[str, list[Cell]]] = field(default_factory=dict)
    cpu_s: float = 0.0  #: of the rows that were read

    def keep(self, parameter: str, value: float, reference: str, cells: list[Cell]) -> None:
        """Add a value, and replace the file as a whole."""
        self.rows[parameter, value] = reference, cells
        if self.path is None:
            return
        rows = [{"parameter": p, "value": v, "reference": r, "cells": [asdict(c) for c in row]}
                for (p, v), (r, row) in self.rows.items()]  # fmt: skip
        data = {"format": FORMAT, "statement": self.statement, "rows": rows}
        write_file(self.path, json.dumps(data, indent=1) + "\n")

    def said(self, total: int) -> str:
        """What there is of a map that is interrupted, of `total` values."""
        done = f"interrupted: {len(self.rows)} of {total} values are done"
        if self.path is not None:
            return f"{done} and kept in {self.path}; the same call goes on from there"
        return f"{done}, none is kept; with resume=FILE a map goes on where it was stopped"


def checkpoint(resume: Any, problem: Problem, vary: Mapping[str, Any], runs: Sequence[Run] | None, accuracy: float) -> Checkpoint:
    """What the file holds of this map; nothing where there is none. Another map is refused, the difference named."""
    said = identity(problem, runs or [], [accuracy], None) | {"vary": {str(k): [float(v) for v in vs] for k, vs in vary.items()}}
    path = resume_path(resume)
    if path is None or not path.exists():
        return Checkpoint(path, said)
    data = read_kept(path, FORMAT, "map", said)
    with reading(path):
        rows = {(_text(r["parameter"]), number(r["value"])): (_text(r["reference"]), [_cell(c) for c in r["cells"]])
                for r in data["rows"]}  # fmt: skip
    return Checkpoint(path, said, rows, sum(c.cpu_s or 0.0 for _, row in rows.values() for c in row))


def _cell(stored: Any) -> Cell:
    word(stored["verdict"], VERDICTS)
    return made(Cell, stored, warnings=tuple(_text(w) for w in stored["warnings"]))


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise BadValueError(f"{shown(value)} is no text")
    return value
