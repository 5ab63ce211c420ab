"""Data of a map of extremes: blocks of cells and their counts."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from mbdae.errors import ListsAttributes, NamesArguments
from mbdae.extremes.cell import SILENT, VERDICTS, Cell
from mbdae.notation import counted
from mbdae.run.environment import environment
from mbdae.sweep.writing import as_json
from mbdae.values import number, option, text


@dataclass(frozen=True)
class Block(NamesArguments):
    """One varied parameter: its values, a reference for each, and the cells."""

    parameter: str
    values: tuple[float, ...]
    references: tuple[str, ...]  #: for each value the methods of its reference, and their difference, in words
    cells: tuple[Cell, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the ways in which the scene was run (joint model, form and solver), in order."""
        return tuple(dict.fromkeys(cell.label for cell in self.cells))

    def at(self, label: str, value: float) -> Cell | None:
        """The cell with this label at a value of the parameter; None where the scene cannot be run in that way there."""
        label = option("label", label, text, "give the label of a way, one of `labels`")
        value = option("value", value, number, "give a value of the parameter, one of `values`")
        return next((cell for cell in self.cells if cell.label == label and cell.value == value), None)


@dataclass(frozen=True)
class ExtremesData(ListsAttributes):
    """All cells of a map. `silent`, the runs that missed the accuracy without a warning, should be empty."""

    scene: str
    t_end: float  #: end time of the unvaried scene, s; a cell may have one of its own
    accuracy: float
    measure: str | None
    what: str  #: definition of the error, in words
    blocks: tuple[Block, ...]
    cpu_s: float

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells."""
        return tuple(cell for block in self.blocks for cell in block.cells)

    @property
    def counts(self) -> dict[str, int]:
        """Number of cells for every verdict, zeros included."""
        found = Counter(cell.verdict for cell in self.cells)
        return {name: found[name] for name in VERDICTS}

    @property
    def silent(self) -> tuple[Cell, ...]:
        """Runs that missed the accuracy without a warning."""
        return tuple(cell for cell in self.cells if cell.verdict == SILENT)

    @property
    def verdict(self) -> str:
        """One sentence with the number of runs for every verdict."""
        told = ", ".join(f"{n} {name}" for name, n in self.counts.items())
        return f"{counted(len(self.cells), 'run')}: {told}."

    def to_dict(self) -> dict[str, Any]:
        """All data as plain values."""
        return dict(json.loads(json.dumps({
            "scene": self.scene, "t_end": self.t_end, "accuracy": self.accuracy, "measure": self.measure, "error_is": self.what,
            "counts": self.counts, "blocks": [asdict(block) for block in self.blocks], "cpu_s": self.cpu_s,
            "environment": environment(),
        })))  # fmt: skip

    def to_json(self, path: Any = None) -> str:
        """The data as JSON text, also written to `path` where one is given."""
        return as_json(self.to_dict(), path)
