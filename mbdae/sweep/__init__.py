"""A job at every point of a grid, in processes, in a cluster or in any executor. A point that fails has a row with its error; an
interrupted sweep can be continued.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from mbdae.errors import ListsAttributes, OptionError, naming_arguments, warn
from mbdae.notation import counted
from mbdae.results.contacts import Mean, Peak
from mbdae.results.quantities import library
from mbdae.results.reads import reads
from mbdae.run.checkpoint import versions
from mbdae.scene.scene import SceneData
from mbdae.study import as_json
from mbdae.study.kept import SWEEP_FORMAT, Kept, SweepRow, as_line, told_when_interrupted
from mbdae.study.workers import THREADS, Job, Outcome, with_executor, with_processes
from mbdae.sweep.scene_sweep import SceneSweep, sweep_scene
from mbdae.system.base import Array
from mbdae.values import BadValueError, flag, function, option, optional, sequence, shown, text, whole

__all__ = ["Sweep", "sweep"]


MOST_WORKERS = 1024
GRID = "give a mapping of names to lists of values, or a list of points (dicts)"
Progress = Callable[[int, int], None]  #: called with the number of points done and of all points


@dataclass(frozen=True)
class Sweep(ListsAttributes):
    """Rows of a sweep in the order of its points; after an interruption there are fewer rows than `points`.
    axes: {name: values} where the grid is all combinations of values, None where a list of points was given."""

    points: tuple[dict[str, Any], ...]
    done: dict[int, SweepRow]
    axes: dict[str, list[Any]] | None

    @property
    def rows(self) -> list[SweepRow]:
        """Rows of the points that are done, as a list of SweepRow."""
        return [self.done[i] for i in sorted(self.done)]

    @property
    def failures(self) -> list[SweepRow]:
        """Rows of points that failed."""
        return [row for row in self.rows if row.values is None]

    @property
    def warnings(self) -> dict[int, str]:
        """{number of a point: its warnings}, of jobs in worker processes; in threads they are issued as usual."""
        return {i: "; ".join(row.warnings) for i, row in sorted(self.done.items()) if row.warnings}

    @property
    def complete(self) -> bool:
        """Whether every point was done."""
        return len(self.done) == len(self.points)

    def array(self, key: str) -> Array:
        """A value of the job on the grid, (one length per axis, ...) or (points, ...); nan where it is missing."""
        key = option("key", key, text, "give the name of a value that the job returns")
        known: dict[int, Array] = {}
        for i, row in self.done.items():
            if row.values and key in row.values:
                try:
                    known[i] = np.asarray(row.values[key], dtype=float)
                except (TypeError, ValueError, OverflowError):  # text, a dict, rows of different lengths, too large a number
                    raise OptionError(f"key = '{key}' is {shown(row.values[key])} at point {i}, which is no number or array of "
                                      f"numbers; read it from `rows`") from None
        if not known:
            names = sorted({name for row in self.rows for name in row.values or ()})
            if names:
                raise OptionError(f"key = '{key}' is no value of any row; they have {', '.join(names)}")
            raise OptionError(f"key = '{key}': there are no values, since {self._why_no_values()}")
        shapes = {value.shape for value in known.values()}
        if len(shapes) > 1:
            raise OptionError(f"key = '{key}' has different shapes from point to point: {sorted(shapes)}; read it from `rows`")
        out = np.full((len(self.points), *shapes.pop()), np.nan)
        for i, value in known.items():
            out[i] = value
        return out if self.axes is None else out.reshape(*map(len, self.axes.values()), *out.shape[1:])

    def _why_no_values(self) -> str:
        if not self.rows:
            return "no point is done yet"
        return "every point failed: see `failures`" if self.failures == self.rows else "the job returned empty dicts"

    def table(self) -> str:
        """All rows as text: points, values, errors, and how many warnings the job gave."""
        told = self.warnings
        names = list(dict.fromkeys(name for point in self.points for name in point))
        keys = list(dict.fromkeys(key for row in self.rows for key in row.values or ()))
        rows = [[*names, *keys, *(["warnings"] if told else [])]]
        for row in self.rows:
            values = [row.error] if row.error is not None else [_cell((row.values or {}).get(key)) for key in keys]
            values += [_cell(len(row.warnings) or None)] if told and row.error is None else []
            rows.append([*(_cell(row.point.get(name)) for name in names), *values])
        cells = [rows[0], *(line for line, row in zip(rows[1:], self.rows, strict=True) if row.error is None)]
        widths = [max(len(line[j]) for line in (cells if j >= len(names) else rows)) for j in range(len(rows[0]))]
        widths += [0] * (len(names) + 1 - len(widths))  # columns for the errors, where all points failed and there are no values
        return "\n".join("  ".join(f"{c:>{w}}" for c, w in zip(line, widths, strict=False)) for line in rows)

    def to_json(self, path: Any = None) -> str:
        """Rows as JSON text; path: a file to write it to. Numbers that are not finite become null."""
        rows = [{"point": row.point, "values": row.values, "error": row.error, "warnings": row.warnings} for row in self.rows]
        return as_json({"complete": self.complete, "rows": _finite(json.loads(as_line(rows)))}, path)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a row for every point: its numbers, the values that the job returned (of an array every entry,
        of a peak its error too), why the point failed, and its warnings. A value that is named as one of the other columns
        stands in "... returned"."""
        table = []
        for row in self.rows:
            others = row.point | {"failure": row.error or "", "warnings": "\n".join(row.warnings)}
            returned = _entries("", row.values or {}).items()
            values = {f"{name} returned" if name in others else name: value for name, value in returned}
            table.append(row.point | values | others)
        return library("pandas").DataFrame(table)

    def __repr__(self) -> str:
        return f"<Sweep: {len(self.done)} of {len(self.points)} points done, {len(self.failures)} failed>"


@overload
def sweep(job: SceneData, grid: Mapping[str, Iterable[Any]] | Sequence[Mapping[str, Any]], executor: Executor | None = None, *,
          workers: int | None = None, resume: Any = None, again: bool = False, progress: Progress | None = None, t_end: float,
          accuracy: float = 1e-6, outputs: Any = None, of: Any = None, derivatives: Any = None, start: Any = None) -> SceneSweep:
    """Signature where `job` is a scene."""


@overload
def sweep(job: Job, grid: Mapping[str, Iterable[Any]] | Sequence[Mapping[str, Any]], executor: Executor | None = None, *,
          workers: int | None = None, resume: Any = None, again: bool = False,
          progress: Progress | None = None) -> Sweep:
    """Signature where `job` is a function of the user's own."""


@naming_arguments
def sweep(job: Any, grid: Any, executor: Executor | None = None, *, workers: int | None = None, resume: Any = None,
          again: bool = False, progress: Progress | None = None, t_end: float | None = None, accuracy: float = 1e-6,
          outputs: Any = None, of: Any = None, derivatives: Any = None, start: Any = None) -> Sweep | SceneSweep:
    """Call job(**point), which returns a dict, at every point of a grid; where `job` is a scene, run it to t_end (s) at every
    point.

    grid: name -> values (their outer product), or a list of points. executor: None for processes of this machine (`workers`
    of them, one per core by default, each with one BLAS thread), or any executor with the interface of concurrent.futures,
    such as dask.distributed's Client(...).get_executor(). What a job returns are numbers, texts, lists and arrays; of a peak
    (`r.peak`) named "force" the row has the value as "force" and its error as "force error".
    An error at a point is stored in its row. Where a worker process ends, its point is computed once more by another one; where
    that ends too, the point has failed. resume: a file to which every row is written as soon as it is known. A later call with
    the same job and grid computes only missing points, those whose worker died, and with again=True all that failed.
    progress(done, all) is called after every point. Ctrl-C raises KeyboardInterrupt, whose attribute `solution` is the Sweep of
    the points done. Worker processes end with this process, however it ends.

    Where `job` is a scene, names are those of `mb.extremes` ("crank.mass"), accuracy and outputs those of `simulate`, and
    `resume` is a folder; the result is a SceneSweep with the unknowns at the outputs. Points run in native batches where
    possible; else its `why` has the reason. of: sensors or expressions that every run is asked for as by `simulate(of=...)`,
    read at the outputs, with their peaks in the whole run and the errors of these; points then run one by one. derivatives: names
    of numbers by which each of these has derivatives at the outputs, with errors (`SceneSweep.derivatives`). start: "relaxed" as
    in `simulate`, found anew at every point; points then run one by one, without derivatives.
    """
    workers = optional("workers", workers, whole, "give the number of processes, 1 or more, or None for one per core",
                       least=1, most=MOST_WORKERS)
    again = option("again", again, flag, "give True to do points that failed once more, or False")
    tell = optional("progress", progress, function, "give a function progress(done, all), or None", takes="done, all")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise OptionError(f"executor = {shown(executor)}: give an executor of concurrent.futures, or None for processes; the end "
                          "of runs of a scene is t_end=")
    if isinstance(job, SceneData):
        return sweep_scene(job, grid, executor, workers, resume, again, tell, t_end, accuracy, outputs, of, derivatives,
                           start)
    for name, value, default in (("t_end", t_end, None), ("accuracy", accuracy, 1e-6), ("outputs", outputs, None),
                                 ("of", of, None), ("derivatives", derivatives, None), ("start", start, None)):
        if value is not default and not (isinstance(value, float) and value == default):
            raise OptionError(f"{name} = {shown(value)} is for sweeps of a scene; leave it out: a function takes what it needs "
                              f"itself")
    points, axes = _points(grid)
    if not callable(job):
        raise OptionError(f"job = {shown(job)}: give a mb.Scene, or a function that takes a point and returns a dict")
    if executor is None:
        _check_job(job, points)
    said = points if axes is None else {name: [_scalar(value) for value in values] for name, values in axes.items()}
    with Kept(resume, lambda: _statement(job, said), points, again) as kept:
        done = kept.rows
        left = {i: point for i, point in enumerate(points) if i not in done}
        come = with_executor(executor, job, left) if executor is not None else with_processes(job, left, workers)
        made = Sweep(tuple(points), done, axes)
        with told_when_interrupted(resume, "points", lambda: (len(done), len(points)), lambda: made), closing(come) as coming:
            for i, found in coming:
                done[i] = _row(points[i], found)
                kept.add(i, done[i])
                if tell is not None:
                    tell(len(done), len(points))
    if told := made.warnings:
        first = next(iter(told.values()))
        warn(f"sweep: {counted(len(told), 'point')} of {len(points)} warned, see its `warnings`; first {first}")
    return made


def _points(grid: Any) -> tuple[list[dict[str, Any]], dict[str, list[Any]] | None]:
    if isinstance(grid, Mapping):
        axes = {name: option(f"grid: {shown(name)}", _listed(values), sequence, GRID, each=_scalar)
                for name, values in grid.items()}
        points = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
        if not (axes and points):
            raise OptionError(f"grid has {counted(len(axes), 'name')} and {counted(len(points), 'point')}: give one name or more,"
                              f" each with one value or more")
        return [_scalars(point) for point in points], axes
    points = option("grid", _listed(grid), sequence, GRID, each=_point)
    if not points:
        raise OptionError(f"grid = {shown(grid)} is empty: give one point or more, such as [{{'mass': 1.0}}]")
    return [_scalars(point) for point in points], None


def _point(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadValueError(f"{shown(value)} is not a dict, as a point is")
    return value


def _listed(values: Any) -> Any:
    """An iterator, which can be read only once, as a list."""
    return list(values) if isinstance(values, Iterator) else values


def _scalars(point: Mapping[str, Any]) -> dict[str, Any]:
    """The point with plain numbers instead of NumPy's, so that it is equal to the point read from a file."""
    for name in point:
        if not (isinstance(name, str) and name.isidentifier()):
            raise OptionError(f"grid: {shown(name)} cannot be the name of an argument of the job; use letters, digits and _")
    return {name: _scalar(value) for name, value in point.items()}


def _scalar(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _check_job(job: Any, points: list[dict[str, Any]]) -> None:
    """Raise OptionError for a job or points that cannot be sent (pickled) to another process."""
    inner = job.func if isinstance(job, functools.partial) else job
    if getattr(inner, "__module__", None) == "__main__" and not hasattr(sys.modules["__main__"], "__file__"):
        raise OptionError(f"job {_name(job)} was defined at the prompt or in a notebook: worker processes cannot import it; "
                          f"move it to the top level of a file, or pass {THREADS}")
    try:
        pickle.dumps((job, points))
    except Exception as error:
        raise OptionError(f"job {_name(job)} or its points cannot be sent to another process ({error}); give a function at the "
                          f"top level of a file and points of numbers or texts, or pass {THREADS}") from error


def _name(job: Any) -> str:
    if isinstance(job, functools.partial):
        return f"{_name(job.func)}{job.args!r}{job.keywords!r}"
    return f"{getattr(job, '__module__', '?')}.{getattr(job, '__qualname__', type(job).__qualname__)}"


def _statement(job: Any, grid: Any) -> dict[str, Any]:
    """What a stored sweep is known by: the job, all that it reads, the grid, and versions."""
    return {"format": SWEEP_FORMAT, "job": _name(job), "reads": reads(job), "grid": grid, "versions": versions()}


def _row(point: dict[str, Any], found: Outcome) -> SweepRow:
    """The row of a point, with plain values as they would be read from a file."""
    if found.values is None:
        return SweepRow(point, None, found.error, found.died)
    try:
        return SweepRow(point, json.loads(as_line(_with_errors(found.values))), warnings=found.warnings)
    except (TypeError, ValueError) as error:
        return SweepRow(point, None, f"TypeError: the job returned what cannot be kept: {error}; "
                                     f"return numbers, texts, lists and arrays")


def _with_errors(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a job; in the place of a peak or a mean its value, and its error beside it."""
    errors = {f"{name} error": one.error for name, one in values.items() if isinstance(one, Peak | Mean)}
    return {name: one.value if isinstance(one, Peak | Mean) else one for name, one in values.items()} | errors


def _entries(name: str, value: Any) -> dict[str, Any]:
    """Plain values by name; those in dictionaries and lists each by itself, "forces[0]"."""
    if not isinstance(value, dict | list):
        return {name: value}
    parts = {f"{name}[{i}]": part for i, part in enumerate(value)} if isinstance(value, list) else {
        f"{name}.{key}".removeprefix("."): part for key, part in value.items()}
    return {found: one for inner, part in parts.items() for found, one in _entries(inner, part).items()}


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cell(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)
