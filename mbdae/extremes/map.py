"""A map of extremes: its blocks of cells, counts, table, JSON and page."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from mbdae.compare.environment import environment
from mbdae.compare.table import grid
from mbdae.errors import Told
from mbdae.extremes.cell import FAILED, MET, NEAR, SILENT, TOLD, UNKNOWN, VERDICTS, Cell
from mbdae.sweep.resume import place_of, written
from mbdae.values import number, option
from mbdae.values import text as text_of

#: numbers, and what resists a run most: sentences that differ in them alone are told once
NUMBERS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\(resisting most: [^)]*\)+|; the iteration matrix is singular"
                     r"|Convergence tests failed too many times, or reached min step size"
                     r"|the step fell below the round-off of the time")  # fmt: skip
#: how a verdict is marked where there is no colour
MARKS = {MET: "=", NEAR: "~", TOLD: "!", SILENT: "SILENT", FAILED: "x", UNKNOWN: "?"}


@dataclass(frozen=True)
class Block:
    """One varied parameter: its values, what the runs at each value were measured against, and their cells."""

    parameter: str
    values: tuple[float, ...]
    references: tuple[str, ...]  #: by value
    cells: tuple[Cell, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Ways the scene was run, in their order."""
        return tuple(dict.fromkeys(cell.label for cell in self.cells))

    def at(self, label: str, value: float) -> Cell | None:
        """The cell of a way at a value; None where the way does not apply."""
        label = option("label", label, text_of, "give the label of a way, one of `labels`")
        value = option("value", value, number, "give a value of the parameter, one of `values`")
        return next((cell for cell in self.cells if cell.label == label and cell.value == value), None)


@dataclass(frozen=True)
class Extremes(Told):
    """The whole map; `silent` must be empty."""

    scene: str
    t_end: float  #: s
    accuracy: float
    measure: str | None
    what: str  #: what the error is
    blocks: tuple[Block, ...]
    cpu_s: float

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells."""
        return tuple(cell for block in self.blocks for cell in block.cells)

    @property
    def counts(self) -> dict[str, int]:
        """Number of cells by verdict, every verdict named."""
        found = Counter(cell.verdict for cell in self.cells)
        return {name: found[name] for name in VERDICTS}

    @property
    def silent(self) -> tuple[Cell, ...]:
        """Runs that were wrong and said nothing."""
        return tuple(cell for cell in self.cells if cell.verdict == SILENT)

    @property
    def verdict(self) -> str:
        """One sentence."""
        told = ", ".join(f"{n} {name}" for name, n in self.counts.items())
        return f"{len(self.cells)} runs: {told}."

    def to_dict(self) -> dict[str, Any]:
        """Everything, as plain values."""
        return dict(json.loads(json.dumps({
            "scene": self.scene, "t_end": self.t_end, "accuracy": self.accuracy, "measure": self.measure, "error_is": self.what,
            "counts": self.counts, "blocks": [asdict(block) for block in self.blocks], "cpu_s": self.cpu_s,
            "environment": environment(),
        })))  # fmt: skip

    def to_json(self, path: Any = None) -> str:
        """JSON text, written to `path` where one is given."""
        return written(json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n", path)

    def to_html(self, path: Any = None) -> str:
        """One self-contained HTML page, written to `path` where one is given."""
        from mbdae.extremes.page import page

        place = place_of(path)
        return written(page(self), place)

    def table(self) -> str:
        """A grid per parameter, the reasons of failures, and the counts."""
        lines = [f"scene '{self.scene}' to t = {self.t_end:g} s, accuracy {self.accuracy:g} unless varied", f"error: {self.what}"]
        for block in self.blocks:
            lines += ["", block.parameter, *grid(rows(block)), *(f"  {note}" for note in notes(block))]
        lines += ["", *(f"{MARKS[name]:>6}  {n:4d}  {name}: {VERDICTS[name]}" for name, n in self.counts.items())]
        return "\n".join([*lines, f"{self.cpu_s:.1f} s of CPU time"])

    def __str__(self) -> str:
        return self.table()


def rows(block: Block) -> list[tuple[str, ...]]:
    """Heading and one line per way: mark and error at every value."""
    lines = [("", *(f"{value:g}" for value in block.values))]
    for label in block.labels:
        lines.append((label, *(text(block.at(label, value), True) for value in block.values)))
    return lines


def text(cell: Cell | None, mark: bool = False) -> str:
    """What a cell shows: its error, or that there is none."""
    if cell is None:
        return ""
    shown = "failed" if cell.verdict == FAILED else "-" if cell.error is None else f"{cell.error:.0e}"
    return f"{MARKS[cell.verdict]} {shown}" if mark else shown


def notes(block: Block) -> list[str]:
    """What runs said, each sentence once with the cells it belongs to; silent misses first."""
    said: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], str] = {}
    for cell in sorted(block.cells, key=lambda c: c.verdict != SILENT):
        where = f"{cell.label} at {cell.value:g}"
        if cell.verdict == SILENT:
            reason = "error inf or nan" if cell.error is None else f"error {cell.error:.1e}, estimated {cell.estimated}"
            said.setdefault((SILENT, reason), []).append(where)
        for kind, sentence in (("failed", cell.failure), *(("said", w) for w in cell.warnings)):
            if sentence:
                alike = kind, NUMBERS.sub("#", sentence)
                first.setdefault(alike, sentence)
                said.setdefault(alike, []).append(where)
    return [f"{kind}: {_short(first.get((kind, sentence), sentence))} ({p[0]}{f' and {len(p) - 1} more' if len(p) > 1 else ''})"
            for (kind, sentence), p in said.items()]  # fmt: skip


def doubted(block: Block) -> list[tuple[float, str]]:
    """Values whose runs were not all judged, with their reference."""
    open_ = {cell.value for cell in block.cells if cell.verdict == UNKNOWN}
    return [(value, told) for value, told in zip(block.values, block.references, strict=True) if value in open_]


def _short(sentence: str) -> str:
    """Short enough to be read beside others."""
    return sentence if len(sentence) <= 300 else sentence[:297] + "..."
