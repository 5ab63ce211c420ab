"""Numbers of a scene that make one number of its run, or its mass, least, within bounds on other numbers of the run.

The gradients are those of the run (`Result.gradient`), all from one run for each design that is tried; the method is SciPy's
sequential quadratic programming (SLSQP)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.derivatives import Bound, Objective
from mbdae.errors import AccuracyWarning, ListsAttributes, MbdaeError, OptionError, naming_arguments, warn
from mbdae.fits.functions import scene_given, stated_values, varied
from mbdae.integrators.base import end_after
from mbdae.notation import counted
from mbdae.results.result import Result
from mbdae.run.control import plausible
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.values import function, number, option, optional, sequence, shown, text, whole

MOST_RUNS = 100  #: default of the largest number of runs
ENOUGH = 1e-8  #: change of what is made least, over its size at the start, at which the search ends
#: a bound holds where it is passed by less than this share of it (or of its value at the start, of a bound of 0); it is active
#: where it is that near
HELD = 1e-4
TURNS = 4  #: most searches, of which each knows from the one before what smoothing makes of a largest value
#: curvature is looked at by gradients this part of a range away, along at most so many directions; what is found is no least
#: value where it is below minus this share of the largest
ASIDE, LOOKS, CURVED = 1e-2, 5, 1e-3
#: distance, as a part of the range of a number, of the differences by which masses follow it: they are straight lines in it
APART = 1e-3


class Mass:
    """The mass of bodies of a scene, kg, as what `mb.design` makes least, or bounds."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)

    def of(self, scene: SceneData) -> float:
        """The mass of the bodies in a scene, kg; OptionError for a name of none."""
        bodies = {body.name: body.mass for body in scene.bodies}
        for name in self.names:
            if bodies.get(name) is None:
                raise OptionError(f"mass: there is no body '{name}' with a mass; there are {', '.join(bodies)}")
        return float(sum(bodies[name] for name in self.names))

    def __le__(self, limit: float) -> Bound:
        return Bound(self, 1.0, number(limit))

    def __ge__(self, limit: float) -> Bound:
        return Bound(self, -1.0, number(limit))

    def __str__(self) -> str:
        return f"mass of {', '.join(self.names)}"


def mass(*bodies: str) -> Mass:
    """The mass of bodies together, kg: what `mb.design` makes least, or bounds."""
    names = option("bodies", bodies, sequence, "name one body or more, such as mb.mass('crank')", each=text)
    if not names:
        raise OptionError("mass: name one body or more, such as mb.mass('crank')")
    return Mass(names)


@dataclass(frozen=True)
class Held:
    """A bound at the design that was found. value: of what is bounded; error: its estimated error, None where it is exact or not
    known; active: whether the bound decides."""

    bound: Bound
    value: float
    error: float | None
    active: bool

    @property
    def kept(self) -> bool:
        """Whether it is kept, but for a ten-thousandth."""
        return self.bound.sign * (self.value - self.bound.limit) <= HELD * (abs(self.bound.limit) or 1.0)

    def __str__(self) -> str:
        word = "kept" if self.kept else "not kept"
        error = "" if self.error is None else f" +- {self.error:.1e}"
        return f"{self.bound}: {self.value:.6g}{error}, {word}{', decides' if self.active and self.kept else ''}"


@dataclass(frozen=True, eq=False)
class Design(ListsAttributes):
    """A design that was found.

    values: of the numbers, by name; minimum: what was made least, in its unit, and error, its estimated error, None where it is
    exact or not known; bounds: list of Held; without_effect: names of numbers on which neither what was made least nor a bound
    depends; scene: with the values; result: its run, None where no run was needed; runs: number of runs made; found: whether the
    search ended at a least value with all bounds kept; message: why it ended."""

    values: dict[str, float]
    minimum: float
    error: float | None
    bounds: list[Held]
    without_effect: tuple[str, ...]
    scene: Any
    result: Result | None
    runs: int
    found: bool
    message: str

    def __str__(self) -> str:
        error = "" if self.error is None else f" +- {self.error:.1e}"
        lines = [f"least value {self.minimum:.6g}{error}", *(f"{name} = {value:.6g}" for name, value in self.values.items())]
        if self.without_effect:
            lines.append(f"without effect: {', '.join(self.without_effect)}")
        return "\n".join([*lines, *map(str, self.bounds), f"{self.message}; {counted(self.runs, 'run')}"])

    def __repr__(self) -> str:
        return f"<Design: {'; '.join(str(self).splitlines())}>"


class _OutOfRunsError(Exception):
    """A search has made as many runs as it may."""


class _Designing:
    """Numbers of runs, and their derivatives, by x (k,): where the numbers are between their least and largest values."""

    def __init__(self, scene: SceneData, names: Sequence[str], low: Array, high: Array, t_end: float, accuracy: float, most: int,
                 tell: Callable[[int, float], None] | None) -> None:
        self.scene, self.names, self.low, self.range = scene, list(names), low, high - low
        self.t_end, self.accuracy, self.most, self.tell = t_end, accuracy, most, tell
        self.runs, self._x = 0, np.zeros(0)
        self._slopes: dict[int, Array] = {}
        self.felt: Any = np.zeros(len(names), dtype=bool)  #: whether some slope by a number was larger than its error

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
                raise _OutOfRunsError
            made: Any = self.at(x)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                self.result = made.simulate(self.t_end, self.accuracy, derivatives=True)
            self.runs, self._x, self._slopes = self.runs + 1, x.copy(), {}
        return self.result  # type: ignore[no-any-return]

    def value(self, of: Any, x: Array) -> float:
        """A number of the run, or a mass, at x."""
        return of.of(self.at(x)) if isinstance(of, Mass) else of.value(self.run(x))

    def told(self, of: Any, x: Array) -> float:
        """The same, of a smoothed largest value that itself."""
        if isinstance(of, Mass) or of.kind != "largest":
            return self.value(of, x)
        return float(self.run(x).peak(of.quantity).value)

    def smoothed(self, of: Any, x: Array) -> float:
        """What smoothing makes of a largest value, over that itself; 1 for others."""
        told = self.told(of, x)
        return self.value(of, x) / told if told else 1.0

    def slope(self, of: Any, x: Array) -> Array:
        """Its derivatives (k,) by x."""
        if isinstance(of, Mass):
            found = np.array([self._mass_slope(of, x, e) for e in np.eye(len(x))])
            self.felt |= np.abs(found) > HELD**2 * of.of(self.at(x))
            return found
        r = self.run(x)
        if id(of) not in self._slopes:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                found = r.gradient(of, to=self.names)
            given = [found[name] for name in self.names]
            self._slopes[id(of)] = np.array([one.value for one in given])
            self.felt |= np.array([abs(one.value) > one.error for one in given])
        return self._slopes[id(of)] * self.range

    def _mass_slope(self, of: Mass, x: Array, e: Array) -> float:
        by = APART if x @ e < 0.5 else -APART
        return (of.of(self.at(x + by * e)) - of.of(self.at(x))) / by

    def error(self, of: Any) -> float | None:
        """The estimated error of a number of the last run; None where it is exact or not known."""
        if isinstance(of, Mass) or not self.runs:
            return None
        if of.kind == "largest":
            return self.result.peak(of.quantity).error  # type: ignore[no-any-return]
        error = self.result.error(of.quantity)
        return None if error is None else error * (self.t_end if of.kind == "integral" else 1.0)


@naming_arguments
def design(scene: Any, minimize: Any, to: Any, t_end: float, bounds: Any = (), accuracy: float = 1e-6, runs: int = MOST_RUNS,
           progress: Callable[[int, float], None] | None = None) -> Design:
    """Find numbers of a scene that make one number of its run least; returns a `Design`.

    minimize: an objective as of `Result.gradient` (mb.integral, mb.at_end, mb.largest), or mb.mass(...); to: name -> (least,
    largest) of numbers, as in `Result.gradient`; the search begins at what the scene states, or at the nearer end. bounds: list
    of bounds, such as mb.largest("A.drive", smooth=1e-3) <= 30.0, which the largest value itself keeps. t_end: end of the runs,
    s. runs: largest number of runs. progress(runs, value): called after every run.

    The least value in the neighbourhood of the start is found, which may not be the least of all. A warning says where a bound
    is not kept, or the search did not end."""
    scene, end = option("scene", scene, scene_given, "give a mb.Scene"), end_after(0.0, t_end)
    wanted = (Objective, Mass)
    if not isinstance(minimize, wanted):
        raise OptionError(f"minimize = {shown(minimize)}: give mb.integral(...), mb.at_end(...), mb.largest(..., smooth=1e-3) or "
                          "mb.mass('crank')")
    limits = list(bounds) if isinstance(bounds, list | tuple) else [bounds]
    if not all(isinstance(one, Bound) for one in limits):
        raise OptionError(f"bounds = {shown(bounds)}: give a list of bounds, such as [mb.largest('A.drive', smooth=1e-3) <= 30]")
    names, low, high = _ranges(to)
    tell = optional("progress", progress, function, "give a function progress(runs, value), or None", takes="runs, value")
    most = option("runs", runs, whole, "give the largest number of runs", least=1)
    work = _Designing(scene, names, low, high, end, plausible(accuracy), most, tell)
    x, used = np.clip((stated_values(scene, names, end) - low) / (high - low), 0.0, 1.0), [1.0] * len(limits)
    for _ in range(TURNS):
        tightened = [replace(one, limit=one.limit * by) for one, by in zip(limits, used, strict=True)]
        x, ended, message = _searched(work, minimize, tightened, x)
        if ended and (lower := _beside(work, minimize, tightened, x)) is not None:
            x, ended, message = _searched(work, minimize, tightened, lower)
        work.most += 1
        before, used = used, [work.smoothed(one.of, x) for one in limits]
        if not ended or max((abs(a - b) for a, b in zip(before, used, strict=True)), default=0.0) < HELD:
            break
    held = [_held(work, one, x) for one in limits]
    value = work.told(minimize, x)
    ended = ended and all(one.kept for one in held)
    broken = [str(one) for one in held if not one.kept]
    if broken:
        warn(f"design: {'; '.join(broken)}")
    elif not ended:
        warn(f"design: {message}")
    without = tuple(name for name, felt in zip(names, work.felt, strict=True) if not felt)
    if without:
        warn(f"design: neither what is made least nor a bound depends on {', '.join(without)}: its value is as good as any other")
    return Design(dict(zip(names, work.numbers(x).tolist(), strict=True)), value, work.error(minimize), held, without, work.at(x),
                  work.result if work.runs else None, work.runs, ended, message)


def _searched(work: _Designing, minimize: Any, limits: Sequence[Bound], x: Array) -> tuple[Array, bool, str]:
    """The x (k,) found from x, whether the search ended, and why."""
    from scipy.optimize import minimize as least

    size = abs(work.value(minimize, x)) or 1.0
    scales = [abs(one.limit) or abs(work.value(one.of, x)) or 1.0 for one in limits]
    best: list[Any] = [np.inf, x]

    def value(x: Array) -> float:
        try:
            found = work.value(minimize, x) / size
            passed = max((one.sign * (work.value(one.of, x) - one.limit) / scale
                          for one, scale in zip(limits, scales, strict=True)), default=0.0)
        except MbdaeError:  # the scene refuses these numbers: a shorter step is tried
            return np.inf
        if passed <= HELD and found < best[0]:
            best[:] = [found, x.copy()]
        if work.tell is not None:
            work.tell(work.runs, found * size)
        return float(found)

    rows = [{"type": "ineq", "fun": lambda x, one=one, s=s: one.sign * (one.limit - work.value(one.of, x)) / s,
             "jac": lambda x, one=one, s=s: -one.sign * work.slope(one.of, x) / s}
            for one, s in zip(limits, scales, strict=True)]
    try:
        ended = least(value, x, jac=lambda x: work.slope(minimize, x) / size, bounds=[(0.0, 1.0)] * len(x), constraints=rows,
                      method="SLSQP", options={"ftol": ENOUGH, "maxiter": 10 * work.most})
    except _OutOfRunsError:
        return best[1], False, f"{work.most} runs were made, as many as allowed: the values may not be the best"
    x = np.clip(ended.x, 0.0, 1.0)
    return x, bool(ended.success), "the search ended at a least value" if ended.success else f"the search failed: {ended.message}"


def _beside(work: _Designing, minimize: Any, limits: Sequence[Bound], x: Array) -> Array | None:
    """A design beside x (k,) with a lower value, where the slopes vanish at x but it is no least value: a largest one, or one
    that is least along some directions only. None at a least value.

    The curvature is that of the Lagrange function along the bounds that decide, in the space of a few products with its second
    derivatives, which are differences of slopes (Lanczos)."""
    if not work.runs:  # masses alone, which are straight lines
        return None
    middle, rng = np.clip(x, ASIDE, 1 - ASIDE), np.random.default_rng(0)
    try:
        size = abs(work.value(minimize, x)) or 1.0
        active = [one for one in limits if abs(work.value(one.of, x) - one.limit) <= HELD * (abs(one.limit) or 1.0)]
        of, rows = work.slope(minimize, x), np.array([one.sign * work.slope(one.of, x) for one in active]).reshape(-1, len(x))
        factors = np.linalg.lstsq(rows.T, -of, rcond=None)[0]
        rest = of + factors @ rows
        fixed = ((x <= 0) & (rest > HELD * size)) | ((x >= 1) & (rest < -HELD * size))
        across = np.linalg.svd(np.vstack([rows / (np.abs(rows).max(initial=0.0) or 1.0), np.eye(len(x))[fixed]]))
        space = across[2][int(np.sum(across[1] > HELD)) :].T

        def slope(at: Array) -> Array:
            return np.asarray(work.slope(minimize, at) + sum(
                (m * one.sign * work.slope(one.of, at) for m, one in zip(factors, active, strict=True)), np.zeros(len(x))))

        basis, products, own = np.zeros((0, len(x))), np.zeros((0, len(x))), slope(middle)
        v = space @ rng.normal(size=space.shape[1])
        while len(basis) < min(LOOKS, space.shape[1]) and np.linalg.norm(v) > HELD * size:
            v = v / np.linalg.norm(v)
            basis, products = np.vstack([basis, v]), np.vstack([products, (slope(middle + ASIDE * v) - own) / ASIDE])
            v = space @ (space.T @ products[-1])
            v -= basis.T @ (basis @ v)
        bent, along = np.linalg.eigh(basis @ products.T + products @ basis.T) if len(basis) else (np.zeros(1), np.zeros((1, 1)))
        if bent[0] >= -CURVED * np.abs(bent).max():
            return None
        least, found = work.value(minimize, x) - ENOUGH * size, None
        for step in (10 * ASIDE, -10 * ASIDE, ASIDE, -ASIDE):
            beside = np.clip(middle + step * (along[:, 0] @ basis), 0.0, 1.0)
            if (value := work.value(minimize, beside)) < least:
                least, found = value, beside
    except (_OutOfRunsError, MbdaeError):
        return None
    return found


def _held(work: _Designing, one: Bound, x: Array) -> Held:
    value = work.told(one.of, x)
    return Held(one, value, work.error(one.of), abs(value - one.limit) <= HELD * (abs(one.limit) or 1.0))


def _ranges(to: Any) -> tuple[list[str], Array, Array]:
    """Names of numbers with their least and largest values."""
    remedy = "give a mapping of names of numbers to (least, largest), such as {'coupler.mass': (0.1, 2.0)}"
    if not isinstance(to, Mapping) or not to:
        raise OptionError(f"to = {shown(to)}: {remedy}")
    names = [option("to", name, text, remedy) for name in to]
    pairs = [option(f"to: '{name}'", to[name], sequence, remedy, each=number) for name in names]
    for name, pair in zip(names, pairs, strict=True):
        if len(pair) != 2 or pair[0] >= pair[1]:
            raise OptionError(f"to: '{name}' = {shown(to[name])}: {remedy}")
    low, high = np.array(pairs).T
    return names, low, high
