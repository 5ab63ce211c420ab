"""Numbers of a scene found from measurements.

The sum of the squared differences between sensors and measurements, over their standard deviations, is made least by the
trust-region method of SciPy, with the derivatives of the run. Confidence follows from the same derivatives at the end."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mbdae.derivatives import names_of
from mbdae.errors import AccuracyWarning, ListsAttributes, MbdaeError, OptionError, naming_arguments, warn
from mbdae.fits.functions import SceneFunction, scene_given, varied
from mbdae.integrators.base import end_after
from mbdae.notation import counted
from mbdae.results.quantities import named, unit_of
from mbdae.results.reads import own_of
from mbdae.results.result import Result
from mbdae.run.checkpoint import versions
from mbdae.run.control import plausible
from mbdae.show.plots import new_figure, style, with_unit, written
from mbdae.study.kept import ResumeFile, packed, resume_path, told_when_interrupted, unpacked
from mbdae.system.base import Array
from mbdae.values import array, number, option, optional, sequence, shown, whole
from mbdae.values import function as checked_function

MOST_RUNS = 100  #: default of the largest number of runs of a fit
ENOUGH = 1e-8  #: change of the sum of squares, and of the numbers, relative, at which a fit ends
#: singular value of the derivatives, over the largest times the accuracy of the run, up to which a combination of the numbers
#: counts as not told by the data, and the share that a number has in it at least
UNTOLD, SHARE = 10.0, 1e-2
#: largest error of the run, over the standard deviation of the mean of the measurements, that moves the numbers by little; and
#: the root mean square of the residuals over their standard deviations above which the scene does not explain the data
BORNE, SPREAD = 0.3, 2.0


@dataclass(frozen=True, eq=False)
class Fit(ListsAttributes):
    """Numbers of a scene found from measurements.

    values: by name; errors: their standard deviations, infinite where the data do not tell a number; covariance (k, k): in the
    order of values; weakest: the combination of numbers that the data tell least, as shares of the numbers stated, and its
    standard deviation; untold: names in combinations that the data do not tell; scene: with the values; result: its run;
    residuals: by sensor, computed less measured, in its unit; spread: root mean square of the residuals over their standard
    deviations, about 1 where these are right; runs: number of runs made; message: why the fit ended."""

    values: dict[str, float]
    errors: dict[str, float]
    covariance: Array
    weakest: tuple[dict[str, float], float]
    untold: tuple[str, ...]
    scene: Any
    result: Result
    data: dict[Any, tuple[Array, Array]]
    sigma: dict[Any, Array]
    residuals: dict[Any, Array]
    spread: float
    runs: int
    message: str

    @property
    def correlations(self) -> Array:
        """Correlations (k, k) of the numbers, in the order of `values`; nan with a number that the data do not tell."""
        size = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance / np.outer(size, size))

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Confidence intervals of the numbers at a level (probability), by Student's distribution; they hold for errors of the
        measurements that are independent, and so small that the run is linear in the numbers over the interval."""
        from scipy.special import stdtrit

        level = option("level", level, number, "give a probability, such as 0.95", above=0, most=1)
        freedom = sum(len(t) for t, _ in self.data.values()) - len(self.values)
        factor = float(stdtrit(max(freedom, 1), (1 + level) / 2))
        return {name: (value - factor * self.errors[name], value + factor * self.errors[name])
                for name, value in self.values.items()}

    def plot(self, path: Any = None) -> Any:
        """A figure of the measurements and the run, one axis for every sensor; path: a file to write it to."""
        figure, axes = new_figure(len(self.data))
        for axis, (name, (t, measured)) in zip(axes, self.data.items(), strict=True):
            axis.plot(t, measured, ".", color="0.55", label="measured")
            axis.plot(self.result.t, self.result.value(name), label="fitted", **style(0))
            axis.set_ylabel(with_unit(named(name), unit_of(self.result, name)))
        axes[0].legend(frameon=False)
        axes[-1].set_xlabel("t [s]")
        return written(figure, path)

    def __str__(self) -> str:
        lines = [f"{name} = {value:.6g} +- {self.errors[name]:.2g}" for name, value in self.values.items()]
        if self.untold:
            lines.append(f"the data do not tell {', '.join(self.untold)} apart")
        lines.append(f"{self.message}; {counted(self.runs, 'run')}; residuals of {self.spread:.3g} standard deviations")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Fit: {'; '.join(str(self).splitlines())}>"


@dataclass
class _Kept(ResumeFile):
    """The runs of a fit: values (times, quantities) and derivatives by numbers p, so that none is made again."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    kind: ClassVar[str] = "fit"
    file_format: ClassVar[str] = "mbdae fit 1"

    def load(self) -> None:
        """Take over what is stored in the file, where there is one."""
        with self.stored() as data:
            self.rows = [] if data is None else data["rows"]

    def found(self, p: Array, what: str, made: Callable[[], Array]) -> Array:
        """What is stored of the numbers p, or is made now."""
        key = packed(p)
        for row in self.rows:
            if row["p"] == key and what in row:
                return unpacked(row[what])
        values = made()
        self.rows.append({"p": key, what: packed(values)})
        self.store({"rows": self.rows})
        return values


class _Fitting:
    """Residuals over their standard deviations, and their derivatives, by the numbers over `unit`."""

    def __init__(self, f: SceneFunction, data: Mapping[Any, tuple[Array, Array]], sigma: Mapping[Any, Array], kept: _Kept,
                 most: int, tell: Callable[[int, float], None] | None) -> None:
        self.f, self.data, self.sigma, self.kept, self.most, self.tell = f, data, sigma, kept, most, tell
        self.unit, self.runs, self.said = np.where(f.start != 0, np.abs(f.start), 1.0), 0, 0
        self.at = [np.searchsorted(f.at, t) for t, _ in data.values()]
        self.best, self.least = f.start / self.unit, np.inf
        self.refused: MbdaeError | None = None
        self._p: Array | None = None
        self._values = np.zeros((0, 0))

    def run(self, p: Array) -> Array:
        """Values (times, quantities) of the run with the numbers p."""
        if self._p is None or np.any(p != self._p):
            if self.runs == self.most:
                raise _OutOfRunsError
            self.runs, self._p = self.runs + 1, None
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                values = self.f(p)
            self._values, self._p = values, p.copy()
        return self._values

    def slopes(self, p: Array) -> Array:
        """Derivatives (times, quantities, k) of the run."""
        self.run(p)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            return np.asarray(self.f.jacobian())

    def residuals(self, x: Array) -> Array:
        """Computed less measured, over the standard deviations; infinite where the scene refuses the numbers, so that a shorter
        step is tried."""
        p = x * self.unit
        try:
            values = self.kept.found(p, "values", lambda: self.run(p))
        except MbdaeError as error:
            self.refused = error
            return np.full(sum(len(t) for t, _ in self.data.values()), np.inf)
        found = np.concatenate([(values[at, j] - measured) / self.sigma[name]
                                for j, (at, (name, (_, measured))) in enumerate(zip(self.at, self.data.items(), strict=True))])
        if (size := float(found @ found)) < self.least:
            self.best, self.least = x.copy(), size
        if self.tell is not None and self.runs > self.said:
            self.said = self.runs
            self.tell(self.runs, size)
        return found

    def jacobian(self, x: Array) -> Array:
        """Derivatives (residuals, k) by the numbers over `unit`."""
        slopes = self.kept.found(x * self.unit, "slopes", lambda: self.slopes(x * self.unit))
        rows = [slopes[at, j] / self.sigma[name][:, None] for j, (at, name) in enumerate(zip(self.at, self.data, strict=True))]
        return np.asarray(self.unit * np.concatenate(rows))

    def solved(self, low: Array, high: Array) -> str:
        """Find the best numbers; returns why it ended."""
        from scipy.optimize import least_squares

        begin = np.clip(self.best, low, high)
        try:
            if not np.all(np.isfinite(self.residuals(begin))):
                raise self.refused or OptionError("the run with the numbers stated is not finite")
            ended = least_squares(self.residuals, begin, self.jacobian, bounds=(low, high), x_scale="jac",
                                  ftol=ENOUGH, xtol=ENOUGH, gtol=ENOUGH)
        except _OutOfRunsError:
            return f"{self.most} runs were made, as many as allowed: the numbers may not be the best"
        self.best = ended.x
        return "the sum of squares falls no more" if ended.status > 0 else "too many steps: the numbers may not be the best"


class _OutOfRunsError(Exception):
    """A fit has made as many runs as it may."""


@naming_arguments
def fit(scene: Any, data: Any, to: Any, sigma: Any = None, bounds: Any = None, accuracy: float = 1e-6, runs: int = MOST_RUNS,
        progress: Callable[[int, float], None] | None = None, resume: Any = None) -> Fit:
    """Find numbers of a scene from measurements, by least squares with the derivatives of the run; returns a `Fit`.

    data: sensor -> (times (n,), s, measured values (n,)); to: names of numbers, as in `Result.gradient`, which begin at what the
    scene states; sigma: standard deviations of the measurements, a number, an array (n,), or either by sensor; None where they
    are not known: equal for all sensors, and as large as the residuals say. bounds: name -> (least, largest), None for none.
    runs: largest number of runs. progress(runs, sum of squares): called after every run. resume: a JSON file that keeps runs.

    A local minimum may be found; begin near the answer. A warning names numbers that the data do not tell, and says where the
    error of the run itself, or a model that does not explain the data, moves the numbers by more than their errors say."""
    scene = option("scene", scene, scene_given, "give a mb.Scene")
    names = names_of(to)
    tell = optional("progress", progress, checked_function, "give a function progress(runs, squares), or None",
                    takes="runs, squares")
    measured = _measurements(data)
    times = np.unique(np.concatenate([t for t, _ in measured.values()]))
    known, deviations = sigma is not None, _deviations(sigma, measured)
    f = SceneFunction(scene, names, list(measured), end_after(0.0, times[-1]), times, plausible(accuracy))
    low, high = _limits(bounds, names)
    kept = _Kept(resume_path(resume), _identity(f, measured, deviations))
    kept.load()
    most = option("runs", runs, whole, "give the largest number of runs", least=1)
    work = _Fitting(f, measured, deviations, kept, most, tell)
    with told_when_interrupted(kept.path, "runs", lambda: (work.runs, most), lambda: None):
        message = work.solved(low / work.unit, high / work.unit)
        work.most += 2
        return _made(work, known, message)


def _made(work: _Fitting, known: bool, message: str) -> Fit:
    """The fit at the best numbers; known: whether standard deviations were given."""
    f, x = work.f, work.best
    off, J = work.residuals(x), work.jacobian(x)
    work.run(x * work.unit)
    freedom = max(len(off) - len(x), 1)
    spread = float(np.sqrt(off @ off / freedom))
    _, size, combinations = np.linalg.svd(J, full_matrices=True)
    size = np.concatenate([size, np.zeros(len(x) - len(size))])
    lost = size <= UNTOLD * f.accuracy * (size[0] or 1.0)
    told, scale = ~lost, 1.0 if known else spread
    part = combinations[told] / size[told][:, None]
    unit = work.unit * scale
    covariance = unit[:, None] * (part.T @ part) * unit
    hidden = np.any(np.abs(combinations[lost]) > SHARE, axis=0)
    covariance[hidden], covariance[:, hidden] = np.nan, np.nan
    covariance[hidden, hidden] = np.inf
    p, untold = x * work.unit, tuple(name for name, one in zip(f.names, hidden, strict=True) if one)
    values = dict(zip(f.names, p.tolist(), strict=True))
    errors = dict(zip(f.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    weakest = (dict(zip(f.names, combinations[-1].tolist(), strict=True)), np.inf if lost[-1] else float(scale / size[-1]))
    ends = np.cumsum([0, *(len(t) for t, _ in work.data.values())])
    residuals = {name: off[a:b] * work.sigma[name] for name, a, b in zip(work.data, ends[:-1], ends[1:], strict=True)}
    assert f.result is not None
    sigma = {name: one * scale for name, one in work.sigma.items()}
    _warn(work, f.result, sigma, untold, spread if known else 1.0)
    return Fit(values, errors, covariance, weakest, untold, varied(f.scene, f.names, p.tolist(), f.t_end), f.result,
               dict(work.data), sigma, residuals, spread if known else 1.0, work.runs, message)


def _warn(work: _Fitting, r: Result, sigma: Mapping[Any, Array], untold: Sequence[str], spread: float) -> None:
    """Say what the errors of the numbers do not contain."""
    if untold:
        warn(f"fit: the data do not tell {', '.join(untold)}: other values of them, together, give the same run to its accuracy; "
             "fix some of them, or measure what depends on them")
    if spread > SPREAD:
        warn(f"fit: the residuals are {spread:.3g} times their standard deviations: the scene does not explain the data, or "
             "sigma is too small; the errors of the numbers are too small then")
    for name, one in sigma.items():
        error = r.error(name)
        if error is not None and error > BORNE * float(np.min(one)) / np.sqrt(len(one)):
            better = work.f.accuracy * BORNE * float(np.min(one)) / np.sqrt(len(one)) / error
            warn(f"fit: the run's own error of {shown(name)}, {error:.1e}, is not small beside the standard deviation of what "
                 f"{counted(len(one), 'measurement')} tell together, and moves the numbers; give accuracy={better:.0e}")


def _measurements(data: Any) -> dict[Any, tuple[Array, Array]]:
    """Measurements as a user gives them; OptionError for anything else."""
    remedy = "give a mapping of sensors to (times, values), such as {'D.angle': (t, measured)}"
    if not isinstance(data, Mapping) or not data:
        raise OptionError(f"data = {shown(data)}: {remedy}")
    found: dict[Any, tuple[Array, Array]] = {}
    for name, given in data.items():
        pair = option(f"data: {shown(name)}", given, sequence, remedy, each=array)
        if len(pair) != 2:
            raise OptionError(f"data: {shown(name)} has {counted(len(pair), 'entry')}: {remedy}")
        t, values = pair
        if t.ndim != 1 or t.shape != values.shape or not len(t) or t.min() < 0 or t.max() <= 0:
            raise OptionError(f"data: {shown(name)} has times of shape {t.shape} and values of shape {values.shape}: give as "
                              "many values as times, from 0 s on")
        found[name] = t, values
    return found


def _deviations(sigma: Any, data: Mapping[Any, tuple[Array, Array]]) -> dict[Any, Array]:
    """Standard deviations (n,) of the measurements by sensor, 1 where none are given."""
    remedy = "give positive standard deviations: a number, an array with one for each measurement, or either by sensor"
    if isinstance(sigma, Mapping) and sigma.keys() != data.keys():
        raise OptionError(f"sigma is given for {', '.join(map(str, sigma))}: {remedy}, for {', '.join(map(str, data))}")
    found = {}
    for name, (t, _) in data.items():
        given = sigma[name] if isinstance(sigma, Mapping) else 1.0 if sigma is None else sigma
        one = option("sigma", given, array, remedy)
        if one.shape not in ((), t.shape) or not np.all(one > 0):
            raise OptionError(f"sigma = {shown(given)}: {remedy}")
        found[name] = np.broadcast_to(one, t.shape).astype(float)
    return found


def _limits(bounds: Any, names: Sequence[str]) -> tuple[Array, Array]:
    """Least and largest values (k,) of the numbers."""
    remedy = "give a mapping of names in `to` to (least, largest), None for none, such as {'C.spring': (0, None)}"
    given = {} if bounds is None else bounds
    if not isinstance(given, Mapping) or not given.keys() <= set(names):
        raise OptionError(f"bounds = {shown(bounds)}: {remedy}")
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for name, pair in given.items():
        both = option(f"bounds: '{name}'", pair, sequence, remedy, each=lambda one: None if one is None else number(one))
        if len(both) != 2:
            raise OptionError(f"bounds: '{name}' = {shown(pair)}: {remedy}")
        for ends, one in ((low, both[0]), (high, both[1])):
            if one is not None:
                ends[names.index(name)] = one
    if np.any(low >= high):
        raise OptionError(f"bounds: a least value is not below the largest one: {remedy}")
    return low, high


def _identity(f: SceneFunction, data: Mapping[Any, tuple[Array, Array]], sigma: Mapping[Any, Array]) -> dict[str, Any]:
    """What a fit is known by, as plain data."""
    s = f.scene
    return {"scene": {"name": s.name, "gravity": s.gravity.tolist(), "statements": s.statements, "own": own_of(s)},
            "to": list(f.names), "accuracy": f.accuracy, "versions": versions(),
            "data": [[named(name), t.tolist(), values.tolist(), sigma[name].tolist()] for name, (t, values) in data.items()]}
