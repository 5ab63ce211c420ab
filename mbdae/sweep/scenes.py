"""A sweep over numbers of a scene: points run in native batches where only parameters of laws vary, else each by a run of its
own.

Names ("crank.mass") are arguments of statements of the scene, as for `mb.extremes`. Which parameters of laws ("numbers of laws")
follow a name is found by modelling the scene at some of its values: a mass changes the inertia too, for example. So a point has
the same meaning in a batch and as a scene of its own.
"""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SceneError
from mbdae.run.batch import Batches
from mbdae.scene.models import with_open_tree
from mbdae.scene.scene import SceneData, refuse_other_laws, stated_laws
from mbdae.study.statements import changed
from mbdae.system.base import Array
from mbdae.system.prepare import modelled
from mbdae.values import BadValueError, array, option, several, shown, text
from mbdae.values import number as checked_number

#: largest number of values of a name at which the scene is modelled, to see whether numbers of laws follow that name on straight
#: lines
SAMPLED = 7
#: largest number of names that belong to the same item in a batch: all combinations of their smallest and largest values are
#: checked
TOGETHER = 6
#: largest deviation of a number of a law from a straight line, relative to its largest magnitude, and of the places at which laws
#: act from each other (relative, or m), with which a name can be varied in a batch
STRAIGHT = 1e-12
#: factor on the median values of names, with which the scene of a batch is prepared: a number of a law that happens to be 1 would
#: become a constant of the compiled equations, and could not be varied
BESIDE = 1.0009
#: largest relative difference of the start values and of the rates y' between a batch and a scene prepared for one point alone;
#: with a larger one the sweep makes no batch
SAME = 1e-9
SLOPES = ("", "error of ")  #: what is read of a derivative: its values, and their error
GRID = "give a mapping of names such as 'crank.mass' to lists of numbers, or a list of such points"
Line = tuple[float, float]  #: how a number of a law depends on the value of a name: number at value 0, and slope


@dataclass(frozen=True)
class Points:
    """The points of a grid: all combinations of the values in `axes`, one for each name, or an array `listed` (points, names)."""

    names: tuple[str, ...]
    axes: tuple[Array, ...] | None
    listed: Array | None

    def __len__(self) -> int:
        return int(np.prod([len(a) for a in self.axes])) if self.axes is not None else len(self.listed)  # type: ignore[arg-type]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes, or the number of points."""
        return tuple(map(len, self.axes)) if self.axes is not None else (len(self),)

    def values(self, first: int, last: int) -> Array:
        """Values (k, names) of the points with numbers from `first` to `last` - 1."""
        if self.axes is None:
            assert self.listed is not None
            return self.listed[first:last]
        where = np.unravel_index(np.arange(first, last), self.shape)
        return np.stack([axis[i] for axis, i in zip(self.axes, where, strict=True)], axis=1)

    def extent(self) -> Array:
        """All values of every name, in columns (k, names); a name with fewer values than another has them repeated."""
        columns = self.axes if self.axes is not None else tuple(self.listed.T)  # type: ignore[union-attr]
        longest = max(map(len, columns))
        return np.stack([np.resize(column, longest) for column in columns], axis=1)

    @classmethod
    def of(cls, grid: Any) -> Points:
        """The points of a grid as a user gives it; OptionError for anything else."""
        if isinstance(grid, Mapping):
            axes = tuple(option(f"grid: {shown(name)}", values, _axis, GRID) for name, values in grid.items())
            return cls(_names(grid), axes, None)
        listed = list(grid) if several(grid) else []
        if not listed or not all(isinstance(p, Mapping) and p.keys() == listed[0].keys() for p in listed):
            raise OptionError(f"grid = {shown(grid)}: give a mapping of names such as 'crank.mass' to lists of numbers, or a "
                              f"list of such points, all with the same names")
        names = _names(listed[0])
        return cls(names, None, np.array([[option(f"grid: '{n}'", p[n], checked_number, GRID) for n in names] for p in listed]))


def _names(point: Mapping[Any, Any]) -> tuple[str, ...]:
    if not point:
        raise OptionError("grid has 0 names: name what varies, as in {'crank.mass': [1.0, 2.0]}")
    return tuple(option("grid: name", name, text, GRID) for name in point)


def _axis(values: Any) -> Array:
    """The values (k,) of one name, read from what a user gave."""
    if not several(values):
        raise BadValueError(f"{shown(values)} is no list of numbers")
    listed = list(values)
    if not listed:
        raise BadValueError(f"{shown(values)} is an empty list")
    found = array(listed)
    if found.ndim != 1:
        raise BadValueError(f"{shown(values)} has shape {found.shape}, not that of a plain list of numbers")
    return found


@dataclass(frozen=True)
class SceneJob:
    """A scene with names that vary, and the end (s), accuracy and output times (m,) of its runs. lines: {name: {number of a
    law: straight line on which it follows the name}}; None where every point runs as a scene of its own, for the reason `why`.
    middle: values of the names for which a batch is prepared; of: quantities that are read; to: their derivatives by these."""

    scene: SceneData
    names: tuple[str, ...]
    t_end: float
    accuracy: float
    outputs: Array
    middle: tuple[float, ...] = ()
    lines: Mapping[str, Mapping[str, Line]] | None = None
    why: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    of: tuple[str, ...] = ()
    to: tuple[str, ...] = ()

    @cached_property
    def key(self) -> str:
        """A hash of the job, the same for equal jobs in every process."""
        options = self.names, self.t_end, self.accuracy, self.outputs.tobytes(), self.middle, repr(self.lines), self.of, \
            self.to, dict(self.options), stated_laws(self.scene)
        return hashlib.sha256(pickle.dumps((self.scene.name, self.scene.statements, *options))).hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "key"} | {"_key": self.key}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(key=state.pop("_key"), **state)

    def at(self, values: Sequence[float]) -> SceneData:
        """The scene with these values of the names; LawError where its laws state something else here than where it comes
        from."""
        refuse_other_laws(self.scene)
        scene = self.scene
        for name, value in zip(self.names, values, strict=True):
            scene, factor = changed(scene, name, float(value), self.t_end)
            if factor != 1:
                raise OptionError(f"grid: '{name}' is a speed, with which t_end would change from point to point; sweep a "
                                  f"function of your own, mb.sweep(job, grid)")
        return scene

    def numbers(self, values: Array) -> dict[str, Array]:
        """Values (k,) of the numbers of laws at points (k, names)."""
        assert self.lines is not None
        return {number: begin + slope * values[:, i] for i, name in enumerate(self.names)
                for number, (begin, slope) in self.lines[name].items()}


def planned(job: SceneJob, values: Array) -> SceneJob:
    """The job, prepared for native batches where these give the same as scenes of their own at points (k, names); else with the
    reason why not."""
    if job.of or job.options:
        return replace(job, why="quantities (of=) are read of every run, with their peaks inside its steps" if job.of else
                       "the relaxed start (start=) of every point is found for itself")
    try:
        middle = tuple(float(np.median(values[:, i])) * BESIDE for i in range(len(job.names)))
        base = job.at(middle)
        lines = {name: _lines(base, name, values[:, i], job.t_end) for i, name in enumerate(job.names)}
        setting: dict[Any, str] = {}
        for name, number in ((name, number) for name, found in lines.items() for number in found):
            if number in setting:
                raise _run_one_by_one(f"a batch varies each number of a law once; '{setting[number]}' and '{name}' of the grid "
                                      "set the same one")
            setting[number] = name
        _check_together(job, values)
        made = replace(job, middle=middle, lines=lines)
        _compare(made, values[[0, -1]])
    except MbdaeError as error:
        return replace(job, why=" ".join(str(error).split()))
    return made


def _lines(base: SceneData, name: str, values: Array, t_end: float) -> dict[str, Line]:
    """The straight lines on which numbers of laws follow the values (k,) of a name; OptionError where one follows on another
    curve, or where the name changes more than such numbers."""
    known = np.unique(values)
    at = known[np.unique(np.linspace(0, len(known) - 1, SAMPLED).astype(int))]
    at = np.append(at, at[-1] * BESIDE**2) if len(at) == 1 else at
    shapes, places, rows = zip(*(_law_numbers(changed(base, name, float(v), t_end)[0]) for v in at), strict=True)
    if any(shape != shapes[0] for shape in shapes) or any(row.keys() != rows[0].keys() for row in rows):
        raise _run_one_by_one(f"a batch varies only numbers of laws; '{name}' changes which laws act")
    if not np.allclose(places, places[0], rtol=STRAIGHT, atol=STRAIGHT):
        raise _run_one_by_one(f"a batch varies only numbers of laws; '{name}' changes the places at which they act")
    table = np.array([list(row.values()) for row in rows])
    lines = {}
    for number, column in zip(rows[0], table.T, strict=True):
        if np.ptp(column) > 0:
            slope = (column[-1] - column[0]) / (at[-1] - at[0])
            begin = column[0] - slope * at[0]
            if np.max(np.abs(begin + slope * at - column)) > STRAIGHT * np.max(np.abs(column)):
                raise _run_one_by_one(f"a batch varies numbers of laws linearly; {number} is not linear in '{name}'")
            lines[number] = float(begin), float(slope)
    if not lines:
        raise _run_one_by_one(f"a batch varies only numbers of laws; '{name}' changes none of them")
    return lines


def _law_numbers(scene: SceneData) -> tuple[list[Any], list[float], dict[str, float]]:
    """Of the model of a scene: which laws there are, numbers for the places where they act, and the parameters of laws by
    name."""
    if scene.problems:
        raise SceneError(scene.problems)
    model, _ = modelled(with_open_tree(scene) or scene)
    shape, places, found = [], list[float](), dict[str, float]()
    for g, _, instance in model.instances():
        law = instance.law
        shape.append((g, model.groups[g].key, instance.item, repr(instance.timed), tuple(instance.numbers)))
        places += [v for n, v in instance.numbers.items() if n not in law.params]
        for n, v in instance.numbers.items():
            if n in law.params and found.setdefault(f"{instance.item}.{n}", v) != v:
                raise _run_one_by_one(f"a batch varies one {n} of an item; the laws of '{instance.item}' have different ones")
    return shape, places, found


def _check_together(job: SceneJob, values: Array) -> None:
    """Raise an error where several numbers of one statement contradict each other at points (k, names). Only their least and
    largest values are combined: statements bound numbers and sums of numbers, so that all points are valid where these
    combinations are."""
    items = [name.partition(".")[0] for name in job.names]
    for item in dict.fromkeys(items):
        of_item = [i for i, other in enumerate(items) if other == item]
        if len(of_item) > TOGETHER:
            raise _run_one_by_one(f"a batch varies at most {TOGETHER} numbers of an item, not {len(of_item)} of '{item}'")
        some = replace(job, names=tuple(job.names[i] for i in of_item))
        for corner in product(*({np.min(values[:, i]), np.max(values[:, i])} for i in of_item)) if len(of_item) > 1 else ():
            if problems := some.at(corner).problems:
                raise SceneError(problems)


def _compare(job: SceneJob, values: Array) -> None:
    """Compare equations and start of a batch at some points (k, names) with those of scenes prepared for these points;
    OptionError where they differ, because a name changes more than parameters that the equations read."""
    batch = _batches(job)
    for point in values:
        own = Batches(job.at(point), job.t_end, job.accuracy, job.outputs).system
        same = own.names == batch.system.names and own.label == batch.system.label
        if not same or not np.allclose(own.y0, batch.system.y0, rtol=SAME, atol=SAME * float(np.max(own.scale))):
            raise _run_one_by_one(f"a batch needs the same unknowns and the same start at all points; at {_in_words(job, point)} "
                                  f"they differ")
        apart = batch.rates_apart(own, {n: float(v[0]) for n, v in job.numbers(point[None]).items()})
        if not apart <= SAME:
            raise _run_one_by_one(f"at {_in_words(job, point)} the rates y' of a batch differ by {apart:.1e} (relative) from "
                                  f"those of the scene, so that a name changes more than numbers that the equations read")


def _run_one_by_one(why: str) -> OptionError:
    """Why points run one by one: no mistake of the user."""
    return OptionError(f"no mistake: {why}")


def _in_words(job: SceneJob, point: Array) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in zip(job.names, point, strict=True))


_ready: dict[str, Batches] = {}  #: the scene prepared last for batches in this process, by the key of its job


def _batches(job: SceneJob) -> Batches:
    """The scene of a job prepared for batches, once per process."""
    if job.key not in _ready:
        _ready.clear()
        numbers = [number for lines in (job.lines or {}).values() for number in lines]
        _ready[job.key] = Batches(job.at(job.middle), job.t_end, job.accuracy, job.outputs, numbers)
    return _ready[job.key]


def solved(job: SceneJob, values: Array) -> dict[str, Any]:
    """Run the points (k, names). Returns {"names": of the unknowns, "y": (k, m, n) at the outputs, "estimate": (k,) of the error,
    "errors": message of every point that failed, else None, "warnings": by the number of the point, "of": {quantity:
    (k, m, ...)}, "peaks": (k, quantities, 4) with values, times (s), errors, errors over the run}."""
    if job.lines is None:
        return _each(job, values)
    batches = _batches(job)
    runs = batches.run(numbers=batches.read(job.numbers(values)))
    warned = {str(i): text for i, text in runs.warnings.items() if runs.batch.errors[i] is None}
    return {"names": list(runs.names), "y": runs.batch.y, "estimate": runs.estimate, "errors": list(runs.batch.errors),
            "warnings": warned, "of": {}, "peaks": np.zeros((len(values), 0, 4))}


def _each(job: SceneJob, values: Array) -> dict[str, Any]:
    """The same results as of `solved`, by one scene and one run per point."""
    names: tuple[str, ...] = ()
    errors, warned, y = list[str | None](), dict[str, str](), list[Any]()
    estimate, peaks = np.full(len(values), np.nan), np.full((len(values), len(job.of), 4), np.nan)
    read: dict[str, list[Any]] = {name: [] for name in (*job.of, *(by(q, p, x) for q in job.of for p in job.to for x in SLOPES))}
    for i, point in enumerate(values):
        y.append(None)
        for found in read.values():
            found.append(None)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                r = job.at(point).simulate(job.t_end, job.accuracy, outputs=job.outputs,  # type: ignore[attr-defined]
                                           of=list(job.of) or None, derivatives=bool(job.to), **job.options)
                for k, name in enumerate(job.of):
                    read[name][i], peak = r.value(name), r.peak(name, t=r.solution.t[[0, -1]])  # of the whole run
                    peaks[i, k] = np.array([peak.value, peak.t, peak.error, r.error(name)], dtype=float)
            slopes, told = _slopes(r, job) if job.to else ({}, [])
            for name in slopes:
                read[name][i] = slopes[name]
        except MbdaeError as error:
            errors.append(f"{type(error).__name__}: {error}")
            continue
        first = r.prepared.all_bodies.numbering.n
        names = names or tuple(r.solution.names[:first])
        if tuple(r.solution.names[:first]) != names:
            errors.append("OptionError: this point has other unknowns than the first")
            continue
        errors.append(None)
        y[i], estimate[i] = r.solution(job.outputs)[:, :first], np.nan if r.accuracy.estimated is None else r.accuracy.estimated
        warned |= {str(i): "; ".join([*r.warnings, *told])} if r.warnings or told else {}
    return {"names": list(names), "y": _filled(y, (len(job.outputs), len(names))), "estimate": estimate, "errors": errors,
            "warnings": warned, "of": {name: _filled(found, (len(job.outputs),)) for name, found in read.items()}, "peaks": peaks}


def by(quantity: str, name: str, of: str = "") -> str:
    """The key of the derivatives of a quantity by a number among what is read of runs; of: "error of " for their errors."""
    return f"{of}d({quantity}) / d({name})"


def _slopes(r: Any, job: SceneJob) -> tuple[dict[str, Array], list[str]]:
    """Derivatives of what is asked for (m, ...), their errors (1,), and what was warned of them."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        found = r.sensitivity(*job.of, to=list(job.to))
    values = {by(quantity, name): np.asarray(one.value) for (quantity, name), one in found.items()}
    errors = {by(quantity, name, SLOPES[1]): np.array([one.error]) for (quantity, name), one in found.items()}
    return values | errors, [str(w.message) for w in heard]


def _filled(found: list[Any], shape: tuple[int, ...]) -> Array:
    """Arrays of one shape (`shape` where there is none) as one, nan in the place of those that are missing."""
    shape = next((one.shape for one in found if one is not None), shape)
    return np.array([np.full(shape, np.nan) if one is None else one for one in found])
