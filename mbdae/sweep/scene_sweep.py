"""A sweep over numbers of a scene. Its points are divided into parts (ranges of points), which worker processes compute and which
are written to the disk as soon as they are finished."""

from __future__ import annotations

import functools
import hashlib
import json
import pickle
import re
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import DiskError, ListsAttributes, OptionError
from mbdae.files import first_difference, path_of, read_file, write_file
from mbdae.integrators.base import end_after, output_times
from mbdae.integrators.stored_runs import DamagedError, read_tree, write_tree
from mbdae.results.accuracy import plausible
from mbdae.results.quantities import library
from mbdae.results.reads import own_of
from mbdae.results.stored_parts import by_item, own_laws
from mbdae.run.checkpoint import versions
from mbdae.scene.scene import SceneData
from mbdae.study.kept import computed_again, told_when_interrupted
from mbdae.study.statements import stated_value
from mbdae.study.workers import THREADS, with_executor, with_processes
from mbdae.sweep.scenes import SLOPES, Points, SceneJob, by, planned, solved
from mbdae.system.base import Array
from mbdae.system.prepare import modelled
from mbdae.system.scene_system import begun
from mbdae.values import option, sequence, shown, text, whole

FORMAT = "mbdae sweep of a scene 7"
#: largest number of points per part: PART in native batches, ALONE where every point is a run of its own; a part that failed is
#: divided into PIECES
PART, ALONE, PIECES = 512, 8, 8
STATEMENT = "statement.json"  #: file in the folder of a sweep with its identity: scene, grid, options
FOLDER = "give a new folder, or that of an earlier call of the same sweep; None keeps nothing"
_NAME = re.compile(r"part(\d+)-(\d+)\.npz")


class Peaks(NamedTuple):
    """Largest magnitudes of a quantity on the grid, their times (s), and their estimated errors, nan where not known."""

    value: Array
    t: Array
    error: Array


class Slopes(NamedTuple):
    """Derivatives of a quantity at the outputs on the grid, and their estimated largest errors on the grid."""

    value: Array
    error: Array


class SceneSweep(ListsAttributes):
    """A sweep over numbers of a scene.

    grid: its points; t (m,): output times, s; names: of the unknowns; of: quantities that were asked for; to: numbers by which
    they have `derivatives`; batched: whether points run in native batches; why: reason where they do not. Results are stored in
    parts, on the disk where a folder was given: `array` and `peaks` read them."""

    def __init__(self, points: Points, job: SceneJob, folder: Path | None, statement: str = "") -> None:
        """folder: where parts are stored (None: in memory); statement: identity of the sweep, whose hash is stored in each
        part."""
        self._statement, self._key = statement, hashlib.sha256(statement.encode()).hexdigest()
        self.grid, self.t, self.batched, self.why = points, job.outputs, job.lines is not None, job.why
        self.of, self.to = job.of, job.to
        self._folder, self._parts = folder, dict[tuple[int, int], Any]()
        self.names: tuple[str, ...] = ()

    def array(self, name: str) -> Array:
        """An unknown, or a quantity that was asked for, at the outputs on the grid, (one length per axis, ..., m) or (points, m),
        vectors with their components; nan where it is missing. Where every point failed the unknowns are not known, and every
        name gives nan."""
        if name in self.of:
            return self._read_of(name, len(self.t))
        column = self._column(name)
        out = np.full((len(self.grid), len(self.t)), np.nan)
        for (first, last), part in self._all():
            if part["y"].shape[2]:
                out[first:last] = part["y"][:, :, column]
        return out.reshape(*self.grid.shape, len(self.t))

    def _read_of(self, name: str, outputs: int) -> Array:
        """What was read of every run, on the grid (..., outputs, ...)."""
        parts = [(place, part["of"][name]) for place, part in self._all() if name in part["of"]]
        inner = next((values.shape[2:] for _, values in parts if np.isfinite(values).any()), ())
        read = np.full((len(self.grid), outputs, *inner), np.nan)
        for (first, last), values in parts:
            read[first:last] = values if values.shape[1:] == read.shape[1:] else np.nan
        return read.reshape(*self.grid.shape, *read.shape[1:])

    def derivatives(self, name: str, to: str) -> Slopes:
        """Derivatives of a quantity that was asked for, in the shape of its `array`, by a number that was, with their errors, in
        the shape of the grid; OptionError for others."""
        if name not in self.of or to not in self.to:
            raise OptionError(f"there are no derivatives of {shown(name)} by {shown(to)}: give mb.sweep(..., of=[...], "
                              "derivatives=[...]), in which they are")
        return Slopes(self._read_of(by(name, to), len(self.t)), self._read_of(by(name, to, SLOPES[1]), 1)[..., 0])

    def _column(self, name: str) -> int:
        name = option("name", name, text, "give the name of an unknown")
        if self.names and name not in self.names:
            raise OptionError(f"name = '{name}' is no unknown of these runs, and was not asked for (of=): there are "
                              f"{', '.join([*self.of, *self.names])}")
        return self.names.index(name) if self.names else 0

    def peaks(self, name: str) -> Peaks:
        """The largest magnitudes of a quantity that was asked for; OptionError for another one."""
        return Peaks(*self._read_peaks(name)[:3])

    def errors(self, name: str) -> Array:
        """Estimated errors of a quantity that was asked for, over the run of every point, in its unit, on the grid; nan where
        they are not known. OptionError for another quantity; `estimate` has the errors of the motion."""
        return np.asarray(self._read_peaks(name)[3])

    def _read_peaks(self, name: str) -> list[Array]:
        """Largest magnitudes of a quantity, their times, their errors, and the errors over the run, each on the grid."""
        name = option("name", name, text, "give a quantity of `of`")
        if name not in self.of:
            raise OptionError(f"name = '{name}' was not asked for: there are {', '.join(self.of) or 'none'}; give mb.sweep(..., "
                              f"of=['{name}'])")
        out = np.full((len(self.grid), 4), np.nan)
        for (first, last), part in self._all():
            out[first:last] = part["peaks"][:, self.of.index(name)]
        return [column.reshape(self.grid.shape) for column in out.T]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a row for every point: its numbers, the estimated error of the run, of every quantity asked for
        the peak, its time (s) and its error, its derivatives at the last output with their errors where these were asked for
        (of a vector, of every component), why the point failed, and its warnings."""
        table: dict[str, Any] = dict(zip(self.grid.names, self.grid.values(0, len(self.grid)).T, strict=True))
        table["estimate"] = self.estimate.ravel()
        for name in self.of:
            found = self.peaks(name)
            table |= {f"{name} {word}": values.ravel() for word, values in zip(("peak", "t", "error"), found, strict=True)}
        for name, to in product(self.of, self.to):
            slopes = self.derivatives(name, to)
            last = np.asarray(slopes.value)[(slice(None),) * len(self.grid.shape) + (-1,)].reshape(len(self.grid), -1)
            heads = [name] if last.shape[1] == 1 else [f"{name}[{i}]" for i in range(last.shape[1])]
            table |= {f"d {head}/d {to}": values for head, values in zip(heads, last.T, strict=True)}
            table[f"d {name}/d {to} error"] = np.ravel(slopes.error)
        for word, said in ("failure", self.failures), ("warnings", self.warnings):
            table[word] = [said.get(i, "") for i in range(len(self.grid))]
        return library("pandas").DataFrame(table)

    @property
    def estimate(self) -> Array:
        """Estimated error of every point on the grid; nan where it is not known."""
        out = np.full(len(self.grid), np.nan)
        for (first, last), part in self._all():
            out[first:last] = part["estimate"]
        return out.reshape(self.grid.shape)

    @property
    def failures(self) -> dict[int, str]:
        """{number of a point: why it failed}."""
        return {first + i: error for (first, _), part in self._all() for i, error in enumerate(part["errors"]) if error}

    @property
    def warnings(self) -> dict[int, str]:
        """{number of a point: its warnings}."""
        return {first + int(i): said for (first, _), part in self._all() for i, said in part["warnings"].items()}

    def point(self, i: int) -> dict[str, float]:
        """The values of point number i; OptionError where there is none of this number."""
        last = len(self.grid) - 1
        i = option("i", i, whole, f"give the number of a point, from 0 to {last}", least=0, most=last)
        return dict(zip(self.grid.names, self.grid.values(i, i + 1)[0].tolist(), strict=True))

    @property
    def done(self) -> int:
        """Number of points that are computed or have failed."""
        return sum(last - first for first, last in self._parts)

    @property
    def complete(self) -> bool:
        """Whether every point was done."""
        return self.done == len(self.grid)

    def missing(self) -> list[tuple[int, int]]:
        """Ranges (first, last + 1) of the numbers of points that are not done."""
        ends = [0, *(number for part in sorted(self._parts) for number in part), len(self.grid)]
        return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b]

    def _all(self) -> Iterator[tuple[tuple[int, int], Any]]:
        for place in sorted(self._parts):
            yield place, self._read(place)

    def _read(self, place: tuple[int, int]) -> Any:
        kept = self._parts[place]
        return _part(kept) if isinstance(kept, Path) else kept

    def add(self, place: tuple[int, int], part: dict[str, Any]) -> None:
        """Store `part`, the results of the points with numbers place[0] to place[1] - 1."""
        self.names = self.names or tuple(part["names"])
        self._parts[place] = part
        if self._folder is not None:
            path = self._folder / f"part{place[0]:08d}-{place[1]:08d}.npz"
            try:
                write_tree(path, part | {"sweep": self._key})
            except OptionError as error:
                raise DiskError(f"resume: {error}; the parts before it are there: make room, and the call goes on") from error
            self._parts[place] = path

    def read_folder(self, again: bool) -> None:
        """Read which parts the folder has, and write its statement; again: whether parts in which a point failed are left out."""
        assert self._folder is not None
        for path in sorted(self._folder.glob("part*.npz")):
            named = _NAME.fullmatch(path.name)
            if named is None:
                continue
            try:
                part = read_tree(path)
            except DamagedError:
                computed_again(self._folder, f"the file {path.name} of the points {int(named[1])} to {int(named[2]) - 1}")
                continue
            if part.get("sweep") != self._key:
                raise OptionError(f"resume = '{self._folder}' holds another sweep: {path.name} is not of this one; "
                                  f"delete the folder, or name another one")
            if not (again and any(part["errors"])):
                self._parts[int(named[1]), int(named[2])] = path
                self.names = self.names or tuple(part["names"])
        write_file(self._folder / STATEMENT, self._statement + "\n")

    def __repr__(self) -> str:
        how = "in batches" if self.batched else f"one by one ({self.why})"
        return f"<SceneSweep: {self.done} of {len(self.grid)} points done {how}, {len(self.failures)} failed>"


def _part(path: Path) -> Any:
    """The part of a sweep in a file; OptionError where the file is damaged."""
    try:
        return read_tree(path)
    except DamagedError as damaged_file:
        raise OptionError(f"resume = '{path.parent}': {damaged_file}") from damaged_file


def sweep_scene(scene: SceneData, grid: Any, executor: Executor | None, workers: int | None, resume: Any, again: bool, tell: Any,
                t_end: Any, accuracy: Any, outputs: Any, of: Any, derivatives: Any = None, start: Any = None) -> SceneSweep:
    """`mb.sweep` of a scene; arguments as there, tell: its `progress`."""
    points, end = Points.of(grid), end_after(0.0, t_end)
    times = np.array([end]) if outputs is None else output_times(0.0, end, outputs)
    listed = [of] if isinstance(of, str) else () if of is None else of
    named = option("of", listed, sequence, "give sensors or expressions, as in of=['A.drive']", each=text)
    to = [derivatives] if isinstance(derivatives, str) else () if derivatives is None else derivatives
    by_names = option("derivatives", to, sequence, "give names of numbers, as in derivatives=['crank.mass']", each=text)
    if by_names and not named:
        raise OptionError("derivatives: name the quantities too, as in of=['A.drive']")
    if by_names and start is not None:
        raise OptionError(f"start = {shown(start)}: runs that begin relaxed have no derivatives; leave derivatives or start out")
    job = SceneJob(scene, points.names, end, plausible(accuracy), times, of=tuple(dict.fromkeys(named)),
                   to=tuple(dict.fromkeys(by_names)), options={"start": begun(start)} if start is not None else {})
    for name in job.to:
        stated_value(scene, name, end)  # raises OptionError for an unknown name
    for name, value in zip(points.names, points.values(0, 1)[0], strict=True):
        replace(job, names=(name,)).at([value])  # raises OptionError for an unknown name, before anything is computed
    job = planned(job, points.extent())
    if executor is None:
        _check_sent(job)
    made = SceneSweep(points, job, *_folder(resume, job, points))
    if resume is not None:
        made.read_folder(again)
    size = PART if job.lines is not None else ALONE
    left = [(a, min(a + size, last)) for first, last in made.missing() for a in range(first, last, size)]
    with told_when_interrupted(resume, "points", lambda: (made.done, len(points)), lambda: made):
        _compute(made, functools.partial(solved, job), points, left, executor, workers, tell)
    return made


def _check_sent(job: SceneJob) -> None:
    """Raise OptionError for a scene that cannot be sent (pickled) to other processes."""
    try:
        sent = pickle.dumps(job)
    except Exception as error:
        raise OptionError(f"scene '{job.scene.name}' cannot be sent to another process ({error}): define functions and classes "
                          f"of your own at the top level of a file, or pass {THREADS}") from error
    if b"__main__" in sent and not hasattr(sys.modules["__main__"], "__file__"):
        raise OptionError(f"scene '{job.scene.name}' contains something defined at the prompt or in a notebook, which worker "
                          f"processes cannot import: define it in a file and import it from there, or pass {THREADS}")


def _compute(made: SceneSweep, job: Any, points: Points, left: Sequence[tuple[int, int]], executor: Executor | None,
             workers: int | None, tell: Any) -> None:
    """Compute the parts `left` and add them to `made`. A part whose worker failed is divided and computed again, until the point
    that causes the failure is in a part of its own."""
    while left:
        sent = {first: {"values": points.values(first, last)} for first, last in left}
        ends, left = dict(left), []
        come = with_executor(executor, job, sent) if executor is not None else with_processes(job, sent, workers)
        with closing(come) as coming:
            for first, found in coming:
                last = ends[first]
                if found.values is None and last - first > 1:
                    step = -(-(last - first) // PIECES)
                    left += [(a, min(a + step, last)) for a in range(first, last, step)]
                    continue
                made.add((first, last), found.values or _failed(found.error, len(made.t), len(made.of)))
                if tell is not None:
                    tell(made.done, len(points))


def _failed(error: str | None, outputs: int, quantities: int) -> dict[str, Any]:
    """The results of a part that consists of one failed point."""
    return {"names": [], "y": np.full((1, outputs, 0), np.nan), "estimate": np.array([np.nan]), "errors": [error], "warnings": {},
            "of": {}, "peaks": np.full((1, quantities, 4), np.nan)}


def _folder(resume: Any, job: SceneJob, points: Points) -> tuple[Path | None, str]:
    """The folder of a sweep, made where it is missing, and the identity of the sweep as JSON; OptionError for the folder of
    another sweep."""
    if resume is None:
        return None, ""
    folder: Path = option("resume", resume, path_of, FOLDER)
    values = [axis.tolist() for axis in points.axes] if points.axes else points.values(0, len(points)).T.tolist()
    scene = job.scene
    stated = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": scene.statements}
    said = {"format": FORMAT, "scene": by_item(stated), "laws": own_laws(modelled(scene)[0]), "accuracy": job.accuracy,
            "t_end": job.t_end, "outputs": job.outputs.tolist(), "of": list(job.of), "to": list(job.to), **job.options,
            "grid": dict(zip(points.names, values, strict=True)),
            "listed": points.axes is None, "own": own_of(scene), "versions": versions()}
    place, statement = folder / STATEMENT, json.dumps(said)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = json.loads(read_file(place)) if place.exists() else None
    except (OSError, ValueError) as error:
        raise OptionError(f"resume = '{folder}' cannot be used ({error}): give a new folder, or that of an earlier call of "
                          f"the same sweep; None keeps nothing") from error
    if there is not None and (difference := first_difference(there, json.loads(statement))):
        raise OptionError(f"resume = '{folder}' holds another sweep: {difference}; ask for the same one, or name another folder")
    return folder, statement
