"""Data of a comparison: its rows, the reference of their errors, and what follows from both."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from mbdae.compare.pairwise import Pairwise
from mbdae.compare.reference import Reference
from mbdae.compare.rows import Row, asked_for, cheapest
from mbdae.errors import ListsAttributes
from mbdae.sweep.writing import as_json
from mbdae.values import number, option


@dataclass(frozen=True)
class ComparisonData(ListsAttributes):
    """Rows (one per solver run), the reference they were measured against, and differences between the runs."""

    scene: str
    t_end: float  #: end time, s
    measure: str | None
    what: str  #: definition of the error, in words
    reference: Reference
    accuracies: tuple[float, ...]
    runs: tuple[Row, ...]
    pairwise: Pairwise
    cpu_s: float  #: CPU time in all solver calls, s, repeats and reference included
    total_cpu_s: float  #: CPU time of the whole comparison, s
    environment: dict[str, str | int]

    @property
    def failures(self) -> tuple[Row, ...]:
        """Runs that did not finish."""
        return tuple(row for row in self.runs if row.failure)

    def cheapest(self, accuracy: float) -> Row | None:
        """The run with an error of at most `accuracy` (unit of the measure) in the least CPU time; None where there is none."""
        return cheapest(self.runs, option("accuracy", accuracy, number, "give a positive number such as 1e-6", above=0))

    @property
    def choices(self) -> tuple[str, ...]:
        """For each wanted accuracy the cheapest run that reached it, in words."""
        parts = []
        for wanted in self.accuracies:
            row = self.cheapest(wanted)
            if row is None:
                parts.append(f"{wanted:.0e} by no run")
            else:
                cost = f"{row.cpu_s:.3f} s, error {row.error:.1e}"
                parts.append(f"{wanted:.0e} by {row.label} asked for {asked_for(row.accuracy)} ({cost})")
        return tuple(parts)

    @property
    def verdict(self) -> str:
        """One sentence: the cheapest run that reached each wanted accuracy."""
        return "Reached at least cost: " + "; ".join(self.choices) + "."

    @property
    def caution(self) -> str | None:
        """A sentence where errors are smaller than the uncertainty of the reference; else None."""
        known = self.reference.difference
        if known is None or not any(row.error is not None and row.error < known for row in self.runs):
            return None
        return f"Errors below {known:.1e} are within the reference's own uncertainty."

    def to_dict(self) -> dict[str, Any]:
        """All data as dictionaries, lists, texts and numbers; values that are not known are None."""
        best = [{"accuracy": a, "run": row.label if (row := self.cheapest(a)) else None} for a in self.accuracies]
        data = {
            "scene": self.scene, "t_end": self.t_end, "measure": self.measure, "error_is": self.what,
            "reference": asdict(self.reference), "accuracies": list(self.accuracies),
            "runs": [asdict(row) for row in self.runs], "cheapest": best, "pairwise": asdict(self.pairwise),
            "cpu_s": self.cpu_s, "total_cpu_s": self.total_cpu_s, "environment": self.environment,
        }  # fmt: skip
        return dict(json.loads(json.dumps(data)))

    def to_json(self, path: Any = None) -> str:
        """The data as JSON text, also written to `path` where one is given."""
        return as_json(self.to_dict(), path)
