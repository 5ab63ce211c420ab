"""Numbers of a scene that make one number of its run, or its mass, least, within bounds on other numbers of the run.

The gradients are those of the run (`Result.gradient`), all from one run for each design that is tried; the method is SciPy's
sequential quadratic programming (SLSQP)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbdae.derivatives import Bound, Objective
from mbdae.derivatives.reading import maxima
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, naming_arguments, warn
from mbdae.fits.beside import ASIDE, ENOUGH, UNSURE, OutOfRunsError, lower_beside, lower_elsewhere, unmoved
from mbdae.fits.functions import HELD, Design, Held, Mass, identity_of, peak_slopes, scene_given, stated_values, varied
from mbdae.integrators.base import end_after
from mbdae.results.accuracy import plausible
from mbdae.results.result import Result
from mbdae.scene.scene import SceneData
from mbdae.study import ranges
from mbdae.study.kept import Readings, packed, resume_path, told_when_interrupted
from mbdae.system.base import Array
from mbdae.values import function, option, optional, shown, whole

MOST_RUNS = 100  #: default of the largest number of runs
TURNS = 8  #: most searches, of which each knows the maxima over time that largest values have where the one before ended
MOVED = 0.05  #: a maximum over time that has moved by more than this share of the run is gone
#: distance, as a part of the range of a number, of the differences by which masses follow it: they are straight lines in it
APART = 1e-3


class _Kept(Readings):
    """What was read of the runs of a design, by x."""

    kind, file_format = "design", "mbdae design 1"


class _Designing:
    """What a search asks for, by x (k,): where the numbers are between their least and largest values. Objectives are known by
    their place in `all`: what is made least, then what the bounds are on."""

    def __init__(self, scene: SceneData, names: Sequence[str], low: Array, high: Array, t_end: float, accuracy: float, most: int,
                 tell: Callable[[int, float], None] | None, kept: _Kept, objectives: Sequence[Any]) -> None:
        self.scene, self.names, self.low, self.range = scene, list(names), low, high - low
        self.t_end, self.accuracy, self.most, self.tell, self.kept, self.all = t_end, accuracy, most, tell, kept, objectives
        self.runs, self._x = 0, np.zeros(0)
        self.felt: list[tuple[Array, Any]] = []  #: x, and whether (k,) slopes by the numbers were larger than their errors there
        self.followed: dict[int, Array] = {}  #: (m, 2) times and signs of the maxima of a largest value that are followed
        kept.load()

    def numbers(self, x: Array) -> Array:
        """The numbers (k,) at x."""
        return np.asarray(self.low + np.clip(x, 0.0, 1.0) * self.range)

    def at(self, x: Array) -> SceneData:
        """The scene at x."""
        return varied(self.scene, self.names, self.numbers(x).tolist(), self.t_end)

    def run(self, x: Array) -> Result:
        """The run at x."""
        if not np.array_equal(x, self._x):
            if self.runs == self.most:
                raise OutOfRunsError
            self.runs += 1
            made: Any = self.at(x)
            self.result: Result = made.simulate(self.t_end, self.accuracy, derivatives=True)
            self._x = x.copy()
        return self.result

    def _found(self, x: Array, what: str, made: Callable[[], Array]) -> Array:
        """What is known of x, or is made now."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            return self.kept.found(x, what, lambda: np.asarray(made()))

    def value(self, i: int, x: Array) -> float:
        """A number of the run, or a mass, at x."""
        of = self.all[i]
        if isinstance(of, Mass):
            return of.of(self.at(x))
        return float(self._found(x, f"value {i}", lambda: np.array(
            self.run(x).peak(of.quantity).value if of.kind == "largest" else of.value(self.run(x)))))

    def slope(self, i: int, x: Array) -> Array:
        """Derivatives (k,) by x of a number of the run that is no largest value, or of a mass."""
        of = self.all[i]
        if isinstance(of, Mass):
            found = np.array([self._mass_slope(of, x, e) for e in np.eye(len(x))])
            self.felt.append((x.copy(), np.abs(found) > HELD**2 * of.of(self.at(x))))
            return found
        value, error = self._found(x, f"slope {i}", lambda: np.array(
            [[one.value, one.error] for one in self.run(x).gradient(of, to=self.names).values()]).T)
        self.felt.append((x.copy(), np.abs(value) > error))
        return np.asarray(value * self.range)

    def _mass_slope(self, of: Mass, x: Array, e: Array) -> float:
        one, other = np.clip(x + APART * e, 0.0, 1.0), np.clip(x - APART * e, 0.0, 1.0)
        return (of.of(self.at(one)) - of.of(self.at(other))) / float(np.sum(one - other))

    # -- largest values, known by their maxima over time

    def largest(self, i: int) -> bool:
        """Whether an objective is a largest value."""
        return isinstance(self.all[i], Objective) and self.all[i].kind == "largest"

    def maxima(self, i: int, x: Array) -> Array:
        """(m, 2) times and values, with their signs, of the largest maxima over time."""
        return self._found(x, f"maxima {i}", lambda: maxima(self.all[i], self.run(x)))

    def peaks(self, i: int, x: Array) -> Array:
        """(m, 2) times and sizes of the maxima that are followed: each the nearest one of the same sign, or where that is gone
        the value at the same time."""
        found, now = np.array(self.followed[i], dtype=float), self.maxima(i, x)
        for row in found:
            same = now[np.sign(now[:, 1]) == row[1]]
            near = same[np.argmin(np.abs(same[:, 0] - row[0]))] if len(same) else np.full(2, np.inf)
            if abs(near[0] - row[0]) > MOVED * self.t_end:
                near = np.array([row[0], self._found(x, f"at {i} {row[0]!r}", lambda row=row: self.all[i].read(  # type: ignore[misc]
                    self.run(x), row[:1]))[0]])
            row[:] = near[0], row[1] * near[1]
        return np.asarray(found)

    def peak_slopes(self, i: int, x: Array) -> Array:
        """Derivatives (m, k) by x of the sizes of the maxima that are followed: those at their times, where the rate is 0."""
        times, signs = self.peaks(i, x)[:, 0], self.followed[i][:, 1]
        value, error = self._found(x, f"slopes {i} {packed(times)}", lambda: peak_slopes(
            self.run(x), self.all[i].quantity, times, self.names))
        self.felt.append((x.copy(), np.any(np.abs(value) > error, axis=0)))
        return np.asarray(signs[:, None] * value * self.range)

    def follow(self, i: int, x: Array, limit: float) -> bool:
        """Follow the maxima of the run at x too; returns whether one of them passes the limit and was not followed."""
        now, before = self.maxima(i, x), self.followed.get(i)
        new = now
        if before is not None:
            known, sizes = self.peaks(i, x).T
            limit = float(sizes.max()) if i == 0 else limit
            new = now[[not np.any(np.isclose(known, t, atol=1e-9 * self.t_end)) for t in now[:, 0]]]
            now = np.concatenate([np.column_stack([known, before[:, 1]]), new])
        self.followed[i] = np.unique(np.column_stack([now[:, 0], np.sign(now[:, 1])]), axis=0)
        return bool(np.any(np.abs(new[:, 1]) > limit + HELD * (abs(limit) or 1.0)))

    # -- bounds as rows that are at least 0

    def rows(self, limits: Sequence[Bound], scales: Sequence[float], x: Array) -> Array:
        """(r,) how far the bounds are kept, over their scales: of an upper bound of a largest value one for every maximum."""
        found = []
        for i, (one, scale) in enumerate(zip(limits, scales, strict=True), 1):
            if self.largest(i):
                sizes = self.peaks(i, x)[:, 1]
                found.append((one.limit - sizes if one.sign > 0 else sizes.max(keepdims=True) - one.limit) / scale)
            else:
                found.append(np.array([one.sign * (one.limit - self.value(i, x)) / scale]))
        return np.concatenate(found) if found else np.zeros(0)

    def row_slopes(self, limits: Sequence[Bound], scales: Sequence[float], x: Array) -> Array:
        """(r, k) derivatives of the rows by x."""
        found = []
        for i, (one, scale) in enumerate(zip(limits, scales, strict=True), 1):
            slopes = self.peak_slopes(i, x) if self.largest(i) else self.slope(i, x)[None]
            if self.largest(i) and one.sign < 0:
                slopes = slopes[[int(np.argmax(self.peaks(i, x)[:, 1]))]]
            found.append(-one.sign * slopes / scale)
        return np.concatenate(found) if found else np.zeros((0, len(x)))

    def error(self, i: int, x: Array) -> float | None:
        """The estimated error of a number of the run at x; None where it is exact or not known."""
        return None if isinstance(self.all[i], Mass) or np.isnan(
            error := float(self._found(x, f"error {i}", lambda: np.array(self._error(self.all[i], self.run(x)))))) else error

    def _error(self, of: Objective, run: Result) -> float:
        error = run.peak(of.quantity).error if of.kind == "largest" else run.error(of.quantity)
        return np.nan if error is None else error * (self.t_end if of.kind == "integral" else 1.0)

    # -- numbers on which nothing depends

    def felt_at(self, x: Array, beside: float = 0.0) -> Any:
        """(k,) whether a slope by a number was larger than its error at x, or so far beside it."""
        for i in range(len(self.all)):
            (self.peak_slopes if self.largest(i) else self.slope)(i, x)
        return np.any([felt for at, felt in self.felt if np.abs(at - x).max() <= beside], axis=0)

    def merits(self, limits: Sequence[Bound], x: Array) -> tuple[float, Array, Array]:
        """By how much of themselves the bounds are passed at x; values (n,) of what is made least and bounded, and what these may
        be off by."""
        values = np.array([self.value(i, x) for i in range(len(self.all))])
        known = [self.error(i, x) for i in range(len(self.all))]
        size = np.where([isinstance(of, Mass) for of in self.all], HELD**3, UNSURE * self.accuracy) * np.abs(values)
        off = np.array([share if one is None else one for one, share in zip(known, size, strict=True)])
        passed = [one.sign * (value - one.limit) / (abs(one.limit) or 1.0) for one, value in zip(limits, values[1:], strict=True)]
        return max(*passed, 0.0) if passed else 0.0, values, off


@naming_arguments
def design(scene: Any, minimize: Any, to: Any, t_end: float, bounds: Any = (), accuracy: float = 1e-6, runs: int = MOST_RUNS,
           progress: Callable[[int, float], None] | None = None, resume: Any = None) -> Design:
    """Find numbers of a scene that make one number of its run least; returns a `Design`.

    minimize: an objective as of `Result.gradient` (mb.integral, mb.at_end, mb.largest), or mb.mass(...); to: name -> (least,
    largest) of numbers, as in `Result.gradient`; the search begins at what the scene states, or at the nearer end. bounds: list
    of bounds, such as mb.largest("A.drive") <= 30.0. t_end: end of the runs, s. runs: largest number of runs. progress(runs,
    value): called after every run. resume: a JSON file that keeps what was read of the runs.

    The least value in the neighbourhood of the start is found, which may not be the least of all. A warning says where a bound
    is not kept, or the search did not end."""
    scene, end = option("scene", scene, scene_given, "give a mb.Scene"), end_after(0.0, t_end)
    wanted = (Objective, Mass)
    if not isinstance(minimize, wanted):
        raise OptionError(f"minimize = {shown(minimize)}: give mb.integral(...), mb.at_end(...), mb.largest(...) or "
                          "mb.mass('crank')")
    limits = list(bounds) if isinstance(bounds, list | tuple) else [bounds]
    if not all(isinstance(one, Bound) for one in limits):
        raise OptionError(f"bounds = {shown(bounds)}: give a list of bounds, such as [mb.largest('A.drive') <= 30]")
    names, low, high = ranges(to)
    tell = optional("progress", progress, function, "give a function progress(runs, value), or None", takes="runs, value")
    most, accuracy = option("runs", runs, whole, "give the largest number of runs", least=1), plausible(accuracy)
    kept = _Kept(resume_path(resume), {"scene": identity_of(scene), "to": [names, low.tolist(), high.tolist()], "t_end": end,
                                       "asked": [str(minimize), *map(str, limits)], "accuracy": accuracy})
    work = _Designing(scene, names, low, high, end, accuracy, most, tell, kept, [minimize, *(one.of for one in limits)])
    x = np.clip((stated_values(scene, names, end) - low) / (high - low), 0.0, 1.0)
    with told_when_interrupted(kept.path, "runs", lambda: (work.runs, most), lambda: None):
        others: dict[str, float] | None = None
        better: Array | None = None
        x, none = _begun(work, limits, x)
        for turn in range(0 if none else TURNS):
            passed = [work.follow(i, x, limit) for i, limit in enumerate([work.value(0, x), *(one.limit for one in limits)])
                      if work.largest(i)]
            if turn and better is None and not any(passed):
                break
            x, ended, message = _searched(work, limits, x)
            better = lower_beside(work, limits, x) if ended else None
            if better is None and others is None:
                better, others = lower_elsewhere(work, limits, x)
            work.most += 1
            if better is not None:
                x = better
            elif not ended or not passed:
                break
        else:
            ended, message = False, none or "the search moved on again and again: the values may not be the best"
        if work.runs or not all(isinstance(one, Mass) for one in work.all):
            work.run(x)
    held = [_held(work, one, i, x) for i, one in enumerate(limits, 1)]
    ended = ended and all(one.kept for one in held)
    flat, without = ((), ()) if none else _flat(work, others or {}, x)
    if without and others is None:
        message += f"; too few runs are left to know whether other values of {', '.join(without)} matter"
        ended, without = False, ()
    if flat and ended:
        message += f", near which nothing depends on {', '.join(flat)}"
    broken = [*(str(one) for one in held if not one.kept), *filter(None, [none])]
    _warn(broken, "" if ended else message, flat, without, others or {})
    return Design(dict(zip(names, work.numbers(x).tolist(), strict=True)), work.value(0, x), work.error(0, x), minimize, held,
                  without, work.at(x), work.result if work.runs else None, work.runs, ended, message)


def _begun(work: _Designing, limits: Sequence[Bound], x: Array) -> tuple[Array, str]:
    """Where the search begins, and why there is none; "": there is one."""
    try:
        x, still = unmoved(work, limits, x)
    except OutOfRunsError:
        return x, ""
    if not still:
        return x, ""
    return x, (f"no search was made, because nothing brings {' and '.join(map(str, still))} nearer to its limit: its slopes by "
               f"{', '.join(work.names)} are 0 at the start, and elsewhere in the ranges it is as far away; vary other numbers, "
               "or leave the bound out")


def _warn(broken: Sequence[str], failed: str, flat: Sequence[str], without: Sequence[str], others: dict[str, float]) -> None:
    """Say what a design does not hold. broken: bounds; failed: why the search did not end; flat: numbers on which nothing depends
    near the end, but at other values (`others`, by name); without: numbers on which nothing depends."""
    if broken:
        warn(f"design: {'; '.join(broken)}")
    elif failed:
        warn(f"design: {failed}")
    if without:
        warn(f"design: neither what is made least nor a bound depends on {', '.join(without)}, at other values in the range too: "
             "its value is as good as any other")
    if flat:
        place = next((f", as at {name} = {others[name]:.6g}" for name in flat if name in others), "")
        warn(f"design: near the values found, neither what is made least nor a bound depends on {', '.join(flat)}, but elsewhere "
             f"in the range they do{place}: values beside are as good, and a lower one may lie where it was not looked for")


def _searched(work: _Designing, limits: Sequence[Bound], x: Array) -> tuple[Array, bool, str]:
    """The x (k,) found from x, whether the search ended, and why. A largest value is made least as a number that none of its
    maxima passes, and that is sought with x."""
    from scipy.optimize import minimize as least

    k, top, size = len(x), work.largest(0), abs(work.value(0, x)) or 1.0
    scales = [abs(one.limit) or abs(work.value(i, x)) or 1.0 for i, one in enumerate(limits, 1)]
    best: list[Any] = [np.inf, x]

    def value(z: Array) -> float:
        try:
            found = work.value(0, z[:k]) / size
            passed = -min(work.rows(limits, scales, z[:k]), default=0.0)
        except MbdaeError:  # the scene refuses these numbers: a shorter step is tried
            return np.inf
        if passed <= HELD and found < best[0]:
            best[:] = [found, z[:k].copy()]
        if work.tell is not None:
            work.tell(work.runs, found * size)
        return float(z[k] if top else found)

    def slope(z: Array) -> Array:
        return np.eye(k + 1)[k] if top else work.slope(0, z) / size

    def rows(z: Array) -> Array:
        over = z[k] - work.peaks(0, z[:k])[:, 1] / size if top else np.zeros(0)
        return np.concatenate([over, work.rows(limits, scales, z[:k])])

    def row_slopes(z: Array) -> Array:
        found = work.row_slopes(limits, scales, z[:k])
        if not top:
            return found
        over = -work.peak_slopes(0, z[:k]) / size
        return np.column_stack([np.concatenate([over, found]), np.r_[np.ones(len(over)), np.zeros(len(found))]])

    begin, ranges = (np.r_[x, 1.0], [*[(0.0, 1.0)] * k, (None, None)]) if top else (x, [(0.0, 1.0)] * k)
    held = [{"type": "ineq", "fun": rows, "jac": row_slopes}] if top or limits else []
    try:
        ended = least(value, begin, jac=slope, bounds=ranges, constraints=held, method="SLSQP",
                      options={"ftol": ENOUGH, "maxiter": 10 * work.most})
    except OutOfRunsError:
        return best[1], False, f"{work.most} runs were made, as many as allowed: the values may not be the best"
    x = np.clip(ended.x[:k], 0.0, 1.0)
    return x, bool(ended.success), "the search ended at a least value" if ended.success else f"the search failed: {ended.message}"


def _flat(work: _Designing, others: dict[str, float], x: Array) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of numbers on which nothing depends at x (k,) and beside it, but elsewhere; and those without effect anywhere."""
    here, ever = work.felt_at(x, 2 * ASIDE), np.any([felt for _, felt in work.felt], axis=0)
    known = [name in others or bool(felt) for name, felt in zip(work.names, ever, strict=True)]
    return (tuple(name for name, one, felt in zip(work.names, known, here, strict=True) if one and not felt),
            tuple(name for name, one in zip(work.names, known, strict=True) if not one))


def _held(work: _Designing, one: Bound, i: int, x: Array) -> Held:
    value = work.value(i, x)
    return Held(one, value, work.error(i, x), abs(value - one.limit) <= HELD * (abs(one.limit) or 1.0))
