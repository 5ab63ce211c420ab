"""Limits of methods: a scene run in every way at extreme values of its parameters, each run judged against a reference.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mbdae.compare import identity
from mbdae.compare.problem import SECONDS, Problem, new_problem
from mbdae.compare.run import Run, checked_runs, progress_of_runs
from mbdae.errors import MbdaeError, naming_arguments
from mbdae.extremes.cell import FAILED, VERDICTS, Cell, cell, reference_at
from mbdae.extremes.page import Block, Extremes
from mbdae.extremes.ways import Varied, Way, asked_values, default_vary, stated, stepped_ways, varied, ways
from mbdae.integrators.base import end_after
from mbdae.results.accuracy import plausible
from mbdae.results.reads import reads
from mbdae.scene.scene import SceneData
from mbdae.study.kept import ResumeFile, record, resume_path, told_when_interrupted
from mbdae.values import BadValueError, number, optional, shown, word

__all__ = ["extremes"]


ACCURACY = 1e-5
MAX_WALL = 20.0  #: default of the largest wall time of a run, s; a run of a reference may take `PATIENCE` times as long
STEPS = 20  #: largest number of steps of a run with a constant step: it ends after them, so that small steps take little time


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
                             for (p, v), (r, row) in self.rows.items()]})


def checkpoint(path: Path | None, scene: Any, problem: Problem, values: Mapping[str, Sequence[float]],
               runs: Sequence[Run] | None, accuracy: float) -> Checkpoint:
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


@naming_arguments
def extremes(scene: Any, t_end: float, vary: Mapping[str, Any] | None = None, runs: Sequence[Run] | None = None,
             accuracy: float = ACCURACY, measure: str | None = None, max_wall: float | None = MAX_WALL,
             progress: Callable[[int, int, str], None] | None = None, resume: Any = None,
             budget: float | None = None) -> Extremes:
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
    an equal call continues after Ctrl-C or an error. budget: seconds of wall time after which no further value is begun; those
    left out are named in `left_out`, and the same call with the same `resume` goes on with them.
    """
    begin = time.process_time()
    accuracy, tell, own = plausible(accuracy), progress_of_runs(progress), checked_runs(runs) if runs is not None else None
    resume, max_wall = resume_path(resume), optional("max_wall", max_wall, number, SECONDS, above=0)
    most = optional("budget", budget, number, "give a positive number of seconds, or None", above=0)
    end = end_after(0.0, t_end)
    base = stated(scene)
    asked = asked_values(vary) if vary is not None else default_vary(base)
    first = new_problem(base, end, measure, max_wall)
    parameters = varied(scene, end, asked)
    chosen = ways(first, own)
    kept = checkpoint(resume, scene, first, asked, own, accuracy)
    total = sum(len(p.values) for p in parameters)
    execution = _Execution(measure, max_wall, accuracy, chosen, first, runs is None, kept, tell, total * (len(chosen) + 1),
                           most or math.inf)

    def made() -> Extremes:
        blocks = tuple(block for p in parameters if (block := execution.block(p)).values)
        return Extremes(base.name, end, accuracy, measure, first.what, blocks, kept.cpu_s + time.process_time() - begin,
                        tuple(execution.left_out))

    def so_far() -> Extremes:
        execution.budget, execution.left_out = 0.0, []
        return made()

    with told_when_interrupted(kept.path, "values", lambda: (len(kept.rows), total), so_far):
        return made()


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
    budget: float  #: wall time, s, after which no value is begun
    done: int = 0
    begun: float = field(default_factory=time.monotonic)
    left_out: list[str] = field(default_factory=list)  #: values that were not begun

    def block(self, p: Varied) -> Block:
        """All values of one parameter."""
        cells: list[Cell] = []
        references, values = list[str](), list[float]()
        for value in p.values:
            if (p.name, value) not in self.kept.rows:
                if time.monotonic() - self.begun >= self.budget:
                    self.left_out.append(f"{p.name} = {value:g}")
                    continue
                self.kept.add(p.name, value, *self._at(p, value))
            reference, row = self.kept.rows[p.name, value]
            references.append(reference)
            values.append(value)
            cells += row
            self.done = self.done - self.done % (len(self.chosen) + 1) + len(self.chosen) + 1
        return Block(p.name, tuple(values), tuple(references), tuple(cells))

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
