"""Limits of methods: a scene run in every way at extreme values of its parameters, each run judged against a reference."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mbdae.compare.problem import SECONDS, Problem, new_problem
from mbdae.compare.run import Run, checked_runs, progress_of_runs
from mbdae.display import plain, titled
from mbdae.errors import ENDS, MbdaeError, interrupted, naming_arguments
from mbdae.extremes.cell import FAILED, Cell, cell
from mbdae.extremes.checkpoint import Checkpoint, checkpoint
from mbdae.extremes.data import Block, ExtremesData
from mbdae.extremes.page import page
from mbdae.extremes.reference import reference_at
from mbdae.extremes.table import table
from mbdae.extremes.values import asked_values
from mbdae.extremes.vary import Varied, default_vary, stated, varied
from mbdae.extremes.ways import Way, stepped_ways, ways
from mbdae.integrators.base import end_after
from mbdae.run.control import plausible
from mbdae.sweep.resume import interruption, resume_path
from mbdae.sweep.writing import written
from mbdae.values import number, optional

ACCURACY = 1e-5
MAX_WALL = 20.0  #: default of the largest wall time of a run, s; a run of a reference may take `reference.PATIENCE` times as long
STEPS = 20  #: largest number of steps of a run with a constant step: it ends after them, so that small steps take little time


class Extremes(ExtremesData):
    """A map of extremes, made by `mb.extremes`, with table and page; `silent` lists runs that were wrong without a warning."""

    def to_html(self, path: Any = None) -> str:
        """One self-contained HTML page, also written to `path` where one is given."""
        return written(lambda: page(self), path)

    def table(self) -> str:
        """A grid per parameter, the reasons of failures, and the counts, as plain text."""
        return table(self)

    def __repr__(self) -> str:
        return f"<Extremes of '{self.scene}': {len(self.blocks)} parameters; print it for the table>"

    def _repr_html_(self) -> str:
        return titled(f"extremes of '{self.scene}'", plain(self.table()))

    def __str__(self) -> str:
        return self.table()


@naming_arguments
def extremes(scene: Any, t_end: float, vary: Mapping[str, Any] | None = None, runs: Sequence[Run] | None = None,
             accuracy: float = ACCURACY, measure: str | None = None, max_wall: float | None = MAX_WALL,
             progress: Callable[[int, int, str], None] | None = None, resume: Any = None) -> Extremes:  # fmt: skip
    """Run a scene at extreme values of its parameters: which methods reach the accuracy, and which fail to without saying so?

    Returns an `Extremes`. Raises OptionError for wrong arguments.

    scene: a mb.Scene, or a function scene(**parameters) that returns one. t_end: end time, s.
    vary: {parameter: (low, high)}, at most seven values, whole decades apart; or {parameter: [values]}. Values are in the
    unit of the parameter, which is "item.argument" of a statement of the scene ("coupler.mass" with its inertia,
    "C.spring", "beam.section.EA", "B.model.outer"; shorthands: mass, stiffness, speed, clearance), an argument of scene(),
    or "accuracy", "step" (constant step, s, at most `STEPS` of them), "t_end" (s). A faster drive or start is run for as many
    turns, so its t_end is shorter. Default: parameters that the scene states, times fixed factors.
    runs: list of mb.Run; default every joint model x form x solver that applies, and last the choice of mbdae itself.
    measure: a sensor such as "C.angle"; default the motion of the bodies. max_wall: largest wall time of a run, s; a run of
    a reference may take three times as long.
    progress(done, total, label): called before every run. resume: a JSON file that stores every finished value, so that
    an equal call continues after Ctrl-C or an error.
    """
    begin = time.process_time()
    accuracy, tell, own = plausible(accuracy), progress_of_runs(progress), checked_runs(runs) if runs is not None else None
    resume, max_wall = resume_path(resume), optional("max_wall", max_wall, number, SECONDS, above=0)
    end = end_after(0.0, t_end)
    base = stated(scene)
    asked = asked_values(vary) if vary is not None else default_vary(base)
    first = new_problem(base, end, measure, max_wall)
    parameters = varied(scene, end, asked)
    chosen = ways(first, own)
    kept = checkpoint(resume, scene, first, asked, own, accuracy)
    total = sum(len(p.values) for p in parameters)
    execution = _Execution(measure, max_wall, accuracy, chosen, first, runs is None, kept, tell, total * (len(chosen) + 1))
    try:
        blocks = tuple(execution.block(p) for p in parameters)
    except ENDS as error:
        interrupted(error, interruption(kept.path, len(kept.rows), total, "values"), None)
        raise
    return Extremes(base.name, end, accuracy, measure, first.what, blocks, kept.cpu_s + time.process_time() - begin)


@dataclass
class _Execution:
    """Computes the cells of a map value by value, and stores each value as soon as it is done."""

    measure: str | None
    max_wall: float | None
    accuracy: float
    chosen: list[Way]
    first: Problem  #: the problem of the scene as stated
    free_choice: bool  #: whether the user named no runs
    kept: Checkpoint
    tell: Callable[[int, int, str], None]
    total: int  #: number of runs and references
    done: int = 0

    def block(self, p: Varied) -> Block:
        """All values of one parameter."""
        cells: list[Cell] = []
        references = []
        for value in p.values:
            if (p.name, value) not in self.kept.rows:
                self.kept.add(p.name, value, *self._at(p, value))
            reference, row = self.kept.rows[p.name, value]
            references.append(reference)
            cells += row
            self.done = self.done - self.done % (len(self.chosen) + 1) + len(self.chosen) + 1
        return Block(p.name, p.values, tuple(references), tuple(cells))

    def _at(self, p: Varied, value: float) -> tuple[str, list[Cell]]:
        """Reference and cells at one value; a scene that is refused there is refused for every way."""
        accuracy = value if p.name == "accuracy" else self.accuracy
        chosen, t_end = self._ways(p, value), p.t_end(value)
        if p.name == "step":
            t_end = min(t_end, STEPS * value)
        self._announce(p, value, "reference")
        try:
            problem = new_problem(p.scene(value), t_end, self.measure, self.max_wall)
        except MbdaeError as error:
            reason = " ".join(str(error).split())
            return "the scene is refused", [_refused(way, value, accuracy, t_end, reason) for way in chosen]
        reference = reference_at(problem, accuracy, p.stops(value))
        cells = []
        for way in chosen:
            self._announce(p, value, way.label)
            cells.append(cell(problem, way, value, accuracy, reference))
        return reference.label, cells

    def _ways(self, p: Varied, value: float) -> list[Way]:
        if p.name != "step":
            return self.chosen
        if self.free_choice:
            return stepped_ways(self.first, value)
        stepped = [(way, way.with_step(value)) for way in self.chosen]
        return [Way(way.label, run) for way, run in stepped if run is not None] or stepped_ways(self.first, value)

    def _announce(self, p: Varied, value: float, label: str) -> None:
        self.tell(min(self.done, self.total), self.total, f"{p.name} = {value:g}: {label}")
        self.done += 1


def _refused(way: Way, value: float, accuracy: float, t_end: float, reason: str) -> Cell:
    solver, form = (way.run.solver.label, way.run.form.label if way.run.form else "") if way.run else ("", "")
    return Cell(value, way.label, solver, form, None, accuracy, t_end, FAILED, failure=reason)
