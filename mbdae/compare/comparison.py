"""Runs x accuracies on one scene: error, CPU time and evaluations of each, against a confirmed reference."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.compare.job import Job
from mbdae.compare.reference import Reference, computed_reference, given_reference
from mbdae.compare.rows import Row, cheapest, with_front
from mbdae.compare.run import Run, checked_runs, default_runs
from mbdae.errors import MbdaeError, OptionError, SolverError
from mbdae.integrators.solution import Stats
from mbdae.results.control import plausible
from mbdae.system.base import System
from mbdae.system.prepare import prepare

ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)
MAX_WALL = 60.0  #: s of wall time per run


@dataclass(frozen=True)
class Comparison:
    """Rows (one per solver run) with what they were measured against."""

    scene: str
    t_end: float  #: s
    measure: str | None
    what: str  #: what the error is
    reference: Reference
    accuracies: tuple[float, ...]
    runs: tuple[Row, ...]
    cpu_s: float  #: CPU s in all solver calls, repeats and reference included

    @property
    def failures(self) -> tuple[Row, ...]:
        """Runs that did not finish."""
        return tuple(row for row in self.runs if row.failure)

    def cheapest(self, accuracy: float) -> Row | None:
        """The run that reached an error of at most `accuracy` in the least CPU time."""
        return cheapest(self.runs, accuracy)

    @property
    def verdict(self) -> str:
        """One sentence: the cheapest run that reached each accuracy wanted."""
        parts = []
        for wanted in self.accuracies:
            row = self.cheapest(wanted)
            if row is None:
                parts.append(f"{wanted:.0e} by no run")
            else:
                cost = f"{row.cpu_s:.3f} s, error {row.error:.1e}"
                parts.append(f"{wanted:.0e} by {row.label} asked for {_short(row.accuracy)} ({cost})")
        return "Reached at least cost: " + "; ".join(parts) + "."

    def to_dict(self) -> dict[str, Any]:
        """Everything, as plain values; unknown ones are None."""
        best = [{"accuracy": a, "run": row.label if (row := self.cheapest(a)) else None} for a in self.accuracies]
        return {
            "scene": self.scene, "t_end": self.t_end, "measure": self.measure, "error_is": self.what,
            "reference": asdict(self.reference), "accuracies": list(self.accuracies),
            "runs": [asdict(row) for row in self.runs], "cheapest": best, "cpu_s": self.cpu_s,
        }  # fmt: skip

    def to_json(self, path: Any = None) -> str:
        """JSON text, written to `path` where one is given."""
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"
        if path is not None:
            Path(path).write_text(text, encoding="utf-8")
        return text

    def table(self) -> str:
        """The rows as plain text, with reference, failures and verdict."""
        from mbdae.compare.table import table

        return table(self)

    def plot(self, path: Any = None) -> Any:
        """Error over CPU time and over residual evaluations; returns the matplotlib figure, saved where `path` is given."""
        from mbdae.compare.picture import work_precision

        return work_precision(self, path)

    def __str__(self) -> str:
        return self.table()


def compare(scene: Any, t_end: float, runs: Sequence[Run] | None = None, accuracies: Sequence[float] = ACCURACIES,
            measure: str | None = None, reference: Any = None, max_wall: float | None = MAX_WALL,
            progress: Callable[[int, int, str], None] | None = None) -> Comparison:  # fmt: skip
    """Run a scene (or a System) to t_end (s) by every run at every accuracy.

    runs: list of mb.Run; default IDA and Radau. measure: a sensor, "C.angle"; default the whole state.
    reference: a Result, or a function of the times that returns the measure; default a tight Radau run that a second
    method confirms. max_wall: s of wall time per run. progress(done, total, label): called before every run.
    """
    asked = _checked_accuracies(accuracies)
    job = _job(scene, t_end, measure, max_wall)
    chosen = checked_runs(runs) if runs is not None else default_runs(job.constrained, job.given)
    queue: list[tuple[Run, float | None]] = [(run, a) for run in chosen for a in ([None] if run.as_it_is else asked)]
    tell = progress or (lambda done, total, label: None)
    tell(0, len(queue) + 1, "reference")
    truth, values = given_reference(job, reference) if reference is not None else computed_reference(job, min(asked))
    rows = []
    for i, (run, accuracy) in enumerate(queue):
        tell(i + 1, len(queue) + 1, f"{run.name('')} {_short(accuracy)}")
        rows.append(_row(job, run, accuracy, values))
    return Comparison(job.name, job.t_end, measure, job.what, truth, asked, with_front(rows), job.spent)


def _checked_accuracies(accuracies: Sequence[float]) -> tuple[float, ...]:
    values = tuple(float(a) for a in np.atleast_1d(np.asarray(accuracies, dtype=float)))
    if not values:
        raise OptionError("accuracies is empty: give at least one, such as [1e-3, 1e-6]")
    for a in values:
        plausible(a)
    return tuple(sorted(set(values), reverse=True))


def _job(scene: Any, t_end: float, measure: str | None, max_wall: float | None) -> Job:
    given = scene if isinstance(scene, System) else None
    prepared = None if given is not None else prepare(scene)
    if given is not None and measure is not None:
        raise OptionError(f"measure = {measure!r}: a System has no sensors; leave it out, the error is that of all unknowns")
    start = given.t0 if given is not None else prepared.start.t  # type: ignore[union-attr]
    if not (isinstance(t_end, int | float) and math.isfinite(t_end) and t_end > start):
        raise OptionError(f"t_end = {t_end}: give a time after the start t = {start:g} s")
    return Job(prepared, given, float(t_end), measure, max_wall)


def _row(job: Job, run: Run, accuracy: float | None, reference: Any) -> Row:
    form = run.form.label if run.form is not None else job.system(None).label
    model = type(run.model).__name__ if run.model is not None else None
    facts: dict[str, Any] = {"label": run.name(form), "solver": run.solver.label, "form": form, "model": model}
    facts["accuracy"] = accuracy
    spent = job.spent
    try:
        solver = run.solver if accuracy is None else run.solver.at_accuracy(accuracy, job.system(run.form).label)
        facts["rtol"] = None if solver.fixed else solver.rtol
        done = job.solve(solver, run.form)
    except SolverError as error:
        reached = error.solution.stats if error.solution is not None else Stats()
        return Row(**facts, cpu_s=job.spent - spent, **counts(reached), failure=str(error))
    except (MbdaeError, np.linalg.LinAlgError) as error:
        return Row(**facts, failure=str(error))
    error_now = job.error(job.values(done.solution, form), reference)
    return Row(**facts, error=error_now, cpu_s=done.cpu_s, cpu_spread_s=done.spread_s, **counts(done.solution.stats))


def counts(stats: Stats) -> dict[str, Any]:
    """The evaluations a row tells."""
    names = ("steps", "rejected", "residuals", "jacobians", "factorisations")
    return {name: int(getattr(stats, name)) for name in names}


def _short(accuracy: float | None) -> str:
    return "its own tolerance" if accuracy is None else f"{accuracy:.0e}"
