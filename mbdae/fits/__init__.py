"""Numbers of a scene found from measurements.

The sum of the squared differences between sensors and measurements, over their standard deviations, is made least by the
trust-region method of SciPy, with the derivatives of the run. Confidence follows from the same derivatives at the end."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.derivatives import names_of
from mbdae.errors import AccuracyWarning, ListsAttributes, MbdaeError, OptionError, naming_arguments, warn
from mbdae.fits.beside import ENOUGH, OutOfRunsError, lower_fit, told
from mbdae.fits.functions import SceneFunction, identity_of, labelled, scene_given, varied
from mbdae.integrators.base import end_after
from mbdae.notation import counted
from mbdae.results.accuracy import LEAST_ACCURACY, plausible
from mbdae.results.quantities import named, unit_of
from mbdae.results.result import Result
from mbdae.show.plots import new_figure, style, written
from mbdae.study import deviations, limits, measurements
from mbdae.study.kept import Readings, resume_path, told_when_interrupted
from mbdae.system.base import Array
from mbdae.system.prepare import prepare
from mbdae.values import function as checked_function
from mbdae.values import number, option, optional, shown, whole

MOST_RUNS = 100  #: default of the largest number of runs of a fit
SHARE = 1e-2  #: share that a number has in a combination that the data do not tell, above which it is not told itself
TURNS, GROWN = 8, 100.0  #: most searches, each from where the sum is lower than at the end of the one before; growth of a size
#: a number ends at a bound where it is this near to it, over the size of the number, and the sum of squares falls beyond
REACHED = 1e-4
EDGE = 1e-6  #: least size of a number that must not be 0, over what the scene states of it
#: largest error of the run, over the standard deviation of the mean of the measurements, that moves the numbers by little; and
#: the root mean square of the residuals over their standard deviations above which the scene does not explain the data
BORNE, SPREAD = 0.3, 2.0


@dataclass(frozen=True, eq=False)
class Fit(ListsAttributes):
    """Numbers of a scene found from measurements.

    values: by name; errors: their standard deviations, infinite where the data do not tell a number, nan where none is known: of
    a number that ended at a bound, and of all where neither sigma nor more measurements than numbers tell how large the errors of
    the measurements are; covariance (k, k): in the order of values; weakest: the combination of numbers that the data tell least,
    as shares of the numbers stated, and its standard deviation; untold: names in combinations that the data do not tell;
    at_bounds: name -> bound of the numbers that ended there, at which the errors of the others are taken; freedom: number of
    measurements less that of the numbers found, infinite where sigma is given; scene: with the values; result: its run;
    residuals: by sensor, computed less measured, in its unit; spread: root mean square of the residuals over their standard
    deviations, about 1 where these are right; runs: number of runs made; message: why the fit ended."""

    values: dict[str, float]
    errors: dict[str, float]
    covariance: Array
    weakest: tuple[dict[str, float], float]
    untold: tuple[str, ...]
    at_bounds: dict[str, float]
    freedom: float
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
        """Correlations (k, k) of the numbers, in the order of `values`; nan with a number that has no standard deviation."""
        size = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance / np.outer(size, size))

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Confidence intervals of the numbers at a level (probability), by the normal distribution, or Student's where the
        residuals have to tell the errors of the measurements; they hold for errors that are independent, and so small that the
        run is linear in the numbers over the interval."""
        from scipy.special import ndtri, stdtrit

        level = option("level", level, number, "give a probability, such as 0.95", above=0, most=1)
        share = (1 + level) / 2
        factor = float(ndtri(share) if np.isinf(self.freedom) else stdtrit(max(self.freedom, 1), share))
        return {name: (value - factor * self.errors[name], value + factor * self.errors[name])
                for name, value in self.values.items()}

    def plot(self, path: Any = None, ax: Any = None) -> Any:
        """A figure of the measurements and the run, one panel for every sensor; path: a file to write it to; ax: axes of
        matplotlib to draw in, one or a list with one per panel."""
        figure, axes = new_figure(len(self.data), ax=ax)
        for axis, (name, (t, measured)) in zip(axes, self.data.items(), strict=True):
            axis.plot(t, measured, ".", color="0.55", label="measured")
            axis.plot(self.result.t, self.result.value(name), label="fitted", **style(0))
            labelled(axis, named(name), unit_of(self.result, name))
        axes[0].legend(frameon=False)
        axes[-1].set_xlabel("t [s]")
        return written(figure, path)

    def __str__(self) -> str:
        lines = [f"{name} = {value:.6g} {self._error_of(name)}" for name, value in self.values.items()]
        if self.untold:
            lines.append(f"the data do not tell {', '.join(self.untold)}{' apart' if len(self.untold) > 1 else ''}")
        lines.append(f"{self.message}; {counted(self.runs, 'run')}; residuals of {self.spread:.3g} standard deviations")
        return "\n".join(lines)

    def _error_of(self, name: str) -> str:
        if name in self.at_bounds:
            return "(at its bound)"
        return "(standard deviation not known)" if np.isnan(self.errors[name]) else f"+- {self.errors[name]:.2g}"

    def __repr__(self) -> str:
        return f"<Fit: {'; '.join(str(self).splitlines())}>"


class _Kept(Readings):
    """The runs of a fit: values (times, quantities) and derivatives by numbers p."""

    kind, file_format = "fit", "mbdae fit 1"


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
                raise OutOfRunsError
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

    def unsure(self, values: Array) -> float:
        """What the estimated errors of the last run, with these values (times, quantities), make of the residuals together."""
        of_run, most = self.f.errors, np.abs(values).max(axis=0)
        error = np.where(np.isfinite(of_run), of_run, self.f.accuracy * most)
        return float(np.sqrt(sum(np.sum((error[j] / self.sigma[name]) ** 2) for j, name in enumerate(self.data))))

    def measure_again(self) -> None:
        """Take the sizes of numbers that have become far larger for their units."""
        grown = np.where(np.abs(self.best) > GROWN, np.abs(self.best), 1.0)
        self.best, self.unit = self.best / grown, self.unit * grown

    def solved(self, low: Array, high: Array) -> str:
        """Find the best numbers; returns why it ended."""
        from scipy.optimize import least_squares

        begin = np.clip(self.best, low, high)
        try:
            if not np.all(np.isfinite(self.residuals(begin))):
                raise self.refused or OptionError("the run with the numbers stated is not finite")
            ended = least_squares(self.residuals, begin, self.jacobian, bounds=(low, high), x_scale="jac",
                                  ftol=ENOUGH, xtol=ENOUGH, gtol=ENOUGH)
        except OutOfRunsError:
            return f"{self.most} runs were made, as many as allowed: the numbers may not be the best"
        self.best = ended.x
        return "the sum of squares falls no more" if ended.status > 0 else "too many steps: the numbers may not be the best"


@naming_arguments
def fit(scene: Any, data: Any, to: Any, sigma: Any = None, bounds: Any = None, accuracy: float = 1e-6, runs: int = MOST_RUNS,
        progress: Callable[[int, float], None] | None = None, resume: Any = None) -> Fit:
    """Find numbers of a scene from measurements, by least squares with the derivatives of the run; returns a `Fit`.

    data: sensor -> (times (n,), s, measured values (n,)); to: names of numbers, as in `Result.gradient`, which begin at what the
    scene states; sigma: standard deviations of the measurements, a number, an array (n,), or either by sensor; None where they
    are not known: equal for all sensors, and as large as the residuals say. bounds: name -> (least, largest), None for none.
    runs: largest number of runs. progress(runs, sum of squares): called after every run; the sum is over sigma, or over the mean
    square of the measurements. resume: a JSON file that keeps runs.

    A local minimum may be found; begin near the answer. Where the fit begins at a saddle, or where the data do not depend on a
    number yet, other values of it are looked at. A warning names numbers that the data do not tell, and says where the
    error of the run itself, or a model that does not explain the data, moves the numbers by more than their errors say."""
    scene = option("scene", scene, scene_given, "give a mb.Scene")
    names = names_of(to)
    tell = optional("progress", progress, checked_function, "give a function progress(runs, squares), or None",
                    takes="runs, squares")
    measured = measurements(data)
    times = np.unique(np.concatenate([t for t, _ in measured.values()]))
    known, errors = sigma is not None, deviations(sigma, measured)
    f = SceneFunction(scene, names, list(measured), end_after(0.0, times[-1]), times, plausible(accuracy))
    low, high = _within_scene(f, *limits(bounds, names))
    kept = _Kept(resume_path(resume), _identity(f, measured, errors))
    kept.load()
    most = option("runs", runs, whole, "give the largest number of runs", least=1)
    work = _Fitting(f, measured, errors, kept, most, tell)
    with told_when_interrupted(kept.path, "runs", lambda: (work.runs, most), lambda: None):
        others: dict[str, float] = {}
        for _ in range(TURNS):
            message = work.solved(low / work.unit, high / work.unit)
            if work.runs == most:
                break
            work.measure_again()
            ranges = low / work.unit, high / work.unit
            lower, others = lower_fit(work, _ended(work, work.best, *ranges) == 0, *ranges, known)
            if not lower:
                break
        work.most += 2
        return _made(work, known, message, low / work.unit, high / work.unit, others)


def _made(work: _Fitting, known: bool, message: str, low: Array, high: Array, others: Mapping[str, float]) -> Fit:
    """The fit at the best numbers, which are between low and high (k,), over the units; known: whether standard deviations were
    given; others: values with another run, of numbers that the data do not tell."""
    f, x = work.f, work.best
    free = (ended := _ended(work, x, low, high)) == 0
    x = np.where(ended < 0, low, np.where(ended > 0, high, x))
    off, (size, combinations, lost) = work.residuals(x), told(work, x, free)
    assert f.result is not None
    left = len(off) - int(free.sum())
    spread = float(np.sqrt(off @ off / max(left, 1))) if known or left > 0 else np.nan
    scale = 1.0 if known else spread
    part = combinations[~lost] / size[~lost][:, None]
    unit = work.unit[free] * scale
    covariance: Array = np.full((len(x), len(x)), np.nan)
    inner = unit[:, None] * (part.T @ part) * unit
    hidden = np.any(np.abs(combinations[lost]) > SHARE, axis=0)
    inner[hidden], inner[:, hidden] = np.nan, np.nan
    inner[hidden, hidden] = np.inf
    covariance[np.ix_(free, free)] = inner
    p, names = x * work.unit, np.array(f.names)
    untold = tuple(names[free][hidden].tolist())
    values = dict(zip(f.names, p.tolist(), strict=True))
    errors = dict(zip(f.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    weakest: tuple[dict[str, float], float] = ({}, np.nan)
    if len(size):
        weakest = (dict(zip(names[free].tolist(), combinations[-1].tolist(), strict=True)),
                   np.inf if lost[-1] else float(scale / size[-1]))
    ends = np.cumsum([0, *(len(t) for t, _ in work.data.values())])
    residuals = {name: off[a:b] * work.sigma[name] for name, a, b in zip(work.data, ends[:-1], ends[1:], strict=True)}
    sigma = {name: one * scale for name, one in work.sigma.items()}
    held = {name: values[name] for name in names[~free].tolist()}
    made = Fit(values, errors, covariance, weakest, untold, held, np.inf if known else left,
               varied(f.scene, f.names, p.tolist(), f.t_end), f.result, dict(work.data), sigma, residuals,
               spread if known else 1.0, work.runs, message)
    _warn(made, f.accuracy, others)
    return made


def _ended(work: _Fitting, x: Array, low: Array, high: Array) -> Array:
    """(k,) -1 or 1 where a number has ended at its least or largest value, beyond which the sum of squares falls, else 0."""
    near = REACHED * np.maximum(np.abs(x), 1.0)
    if not np.any((x - low < near) | (high - x < near)):
        return np.zeros(len(x))
    slope = work.jacobian(x).T @ work.residuals(x)
    return np.asarray(np.where((x - low < near) & (slope > 0), -1.0, np.where((high - x < near) & (slope < 0), 1.0, 0.0)))


def _warn(made: Fit, accuracy: float, others: Mapping[str, float]) -> None:
    """Say what the errors of the numbers do not contain."""
    if made.untold:
        those = "it" if len(made.untold) == 1 else "them"
        further = [f"{name} = {others[name]:.4g}" for name in made.untold if name in others]
        but = f", but not {' and '.join(further)}" if further else ""
        warn(f"fit: the data do not tell {', '.join(made.untold)}: other values of {those} give the same run to its "
             f"accuracy{but}; fix some of them, or measure what depends on them")
    for name, bound in made.at_bounds.items():
        warn(f"fit: '{name}' ended at its bound {bound:g}, beyond which the sum of squares falls: it has no standard deviation, "
             "and those of the others are for this value of it; see whether bound and scene are right")
    if made.freedom <= 0:
        warn(f"fit: {counted(sum(len(t) for t, _ in made.data.values()), 'measurement')} for as many numbers or more, and no "
             "sigma: nothing tells how large the errors of the measurements are, so that the numbers have no standard "
             "deviations; give sigma=, or more measurements")
        return
    if made.spread > SPREAD:
        warn(f"fit: the residuals are {made.spread:.3g} times their standard deviations: the scene does not explain the data, or "
             "sigma is too small; the errors of the numbers are too small then")
    for name, one in made.sigma.items():
        error, borne = made.result.error(name), BORNE * float(np.min(one)) / np.sqrt(len(one))
        if error is not None and error > borne:
            better = accuracy * borne / error
            give = (f"give accuracy={better:.0e}" if better >= LEAST_ACCURACY else
                    f"no accuracy that can be asked for ({LEAST_ACCURACY:g} or more) makes it so")
            warn(f"fit: the run's own error of {shown(name)}, {error:.1e}, is not small beside the standard deviation of what "
                 f"{counted(len(one), 'measurement')} tell together, and moves the numbers; {give}")


def _within_scene(f: SceneFunction, low: Array, high: Array) -> tuple[Array, Array]:
    """Least and largest values (k,) within those given, of the sign that the numbers have where the scene refuses the other one,
    as of a mass or a coefficient of friction: a search that met this edge as mere refusals would shorten its steps to nothing."""
    for i, (name, value) in enumerate(zip(f.names, f.start, strict=True)):
        ends = low if value > 0 else high
        if value and ends[i] * value < 0 and _refused(f, name, -value):
            ends[i] = value * EDGE if _refused(f, name, 0.0) else 0.0
    return low, high


def _refused(f: SceneFunction, name: str, value: float) -> bool:
    """Whether the scene refuses a value of a number."""
    try:
        prepare(varied(f.scene, [name], [value], f.t_end))
    except MbdaeError:
        return True
    return False


def _identity(f: SceneFunction, data: Mapping[Any, tuple[Array, Array]], sigma: Mapping[Any, Array]) -> dict[str, Any]:
    """What a fit is known by, as plain data."""
    return {"scene": identity_of(f.scene), "to": list(f.names), "accuracy": f.accuracy,
            "data": [[named(name), t.tolist(), values.tolist(), sigma[name].tolist()] for name, (t, values) in data.items()]}
