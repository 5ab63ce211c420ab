"""From a seed to a verdict: the run, its error against the reference, and whether the run reported a larger error than asked."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import Any

import numpy as np
from timed_inputs import oracle
from timed_inputs.inputs import PER_WIDTH
from timed_inputs.oracle import Array, Problem

import mbdae as mb

DENSE = 4  #: order of the dense output of methods of constant steps, a cubic through values and rates
FACTOR = 3.0  #: an error up to so many times the accuracy counts as right
WALL = 20.0  #: largest wall time of a run, s; a run that is stopped there reports it
VERDICTS = ("right", "told", "told needlessly", "silent", "refused needlessly", "crashed", "not judged")
RATES = ("velocity", "angular_velocity", "rate")
Values = dict[str, Array]


@dataclass(frozen=True)
class Way:
    """A solver, a form and the accuracies that are asked of them."""

    name: str
    solver: Any = None
    form: Any = None
    accuracies: tuple[float, float] = (1e-8, 1e-3)


@dataclass(frozen=True)
class Run:
    """One run: error over the accuracy asked (nan where it returned nothing), its verdict and remarks."""

    seed: int
    scene: str
    kind: str
    width: float  #: of the narrowest feature, relative to the length of the run or of the path
    way: str
    accuracy: float
    ratio: float
    verdict: str
    note: str
    wall: float

    @property
    def equal_steps(self) -> bool:
        """Whether its steps are equal, given or found by halving: it cannot resolve a feature narrower than these."""
        return self.way.startswith(("GeneralizedAlpha", "HHT")) or "step=" in self.way

    def __str__(self) -> str:
        return (f"seed {self.seed}: {self.scene}, {self.kind}, width {self.width:.1e}, {self.way}, asked {self.accuracy:.0e}: "
                f"{self.verdict}, error {self.ratio:.2g} x asked; {self.note}")


def error_of(result: mb.Result, times: Array, truth: Values, positions_only: bool = False, longest: float = inf) -> float:
    """Largest error at times (nt,), as the README defines accuracy: positions over the scene's length, angles in rad, velocities
    over the largest of length / characteristic time (s, at most `longest`) and the largest speed; nan and infinite values are
    infinitely wrong."""
    length, T = result.prepared.length, min(result.prepared.time, longest)
    shown, worst = result(times), 0.0
    turning = result.prepared.mechanics.rotational
    fastest = {turns: float(np.max(np.abs(shown.u[:, turning == turns]), initial=0.0)) for turns in (False, True)}
    for name, exact in truth.items():
        if positions_only and _is_rate(name):
            continue
        found = read(shown, name)
        turns = _turns(shown, name)
        unit = 1.0 if turns else length
        if _is_rate(name):
            unit = max(unit / T, fastest[turns])
        gap = angle_between(found, exact) if name.endswith("rotation") else np.where(np.isnan(exact), 0.0, found - exact)
        size = np.linalg.norm(gap, axis=-1) if gap.ndim > 1 and not _is_rate(name) else np.abs(gap)
        worst = max(worst, float(np.max(size)) / unit) if np.all(np.isfinite(size)) else inf
    return worst


def read(result: mb.Result, name: str) -> Array:
    """A sensor by its name, such as "hinge.rate"."""
    item, quantity = name.rsplit(".", 1)
    return np.asarray(getattr(result[item], quantity), dtype=float)


def _is_rate(name: str) -> bool:
    return name.rsplit(".", 1)[1] in RATES


def _turns(result: mb.Result, name: str) -> bool:
    """Whether a quantity is an angle or its rate."""
    item, quantity = name.rsplit(".", 1)
    if quantity == "rate":
        return any(c.name == item and c.kind == "revolute" for c in result.prepared.model.scene.connections)
    return quantity in ("angle", "rotation", "angular_velocity")


def angle_between(a: Array, b: Array) -> Array:
    """Angle (nt,) of the rotation from matrices a to b (nt, 3, 3)."""
    return np.asarray(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=(1, 2)) / np.sqrt(8), 0, 1)))


def told(result: mb.Result) -> str:
    """What a result says against itself."""
    if result.warnings:
        return str(result.warnings[0])
    if result.reliable is False:
        return "not met, not reliable or not complete"
    return ""


def judged(error: float, bound: float, said: str) -> str:
    """The verdict on a run that returned a result; a warning between the accuracy and FACTOR times it is none too many."""
    if said:
        return "told needlessly" if error <= bound / FACTOR else "told"
    return "right" if error <= bound else "silent"


def failed(error: Exception) -> tuple[str, str]:
    """The verdict on a run that returned nothing. Inputs here are legitimate: a scene that is refused is refused needlessly."""
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    if isinstance(error, mb.SceneError | mb.LawError):
        return "refused needlessly", text
    return ("told", text) if isinstance(error, mb.MbdaeError) else ("crashed", text)


def measure(problem: Problem, way: Way, accuracy: float, seed: int = 0) -> Run:
    """One run and its verdict."""
    begin = time.perf_counter()
    times = oracle.instants(problem)
    try:
        truth = oracle.solve(problem, times)
    except ArithmeticError as failure:
        truth = {}
        ratio, verdict, note = nan, "not judged", str(failure)
    known = time.perf_counter()
    if truth:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ratio, verdict, note = _verdict(problem, way, accuracy, times, truth)
    note += f" (reference {known - begin:.1f} s, run {time.perf_counter() - known:.1f} s)"
    kind = problem.kind or ", ".join(i.kind for i in problem.inputs)
    return Run(seed, problem.name, kind, problem.width, way.name, accuracy, ratio, verdict, note, time.perf_counter() - begin)


def _verdict(problem: Problem, way: Way, accuracy: float, times: Array, truth: Values) -> tuple[float, str, str]:
    """Error over the accuracy asked, verdict, and the warnings of the run."""
    try:
        result = simulate(problem.build([i.said for i in problem.inputs]), problem.t_end, accuracy, way)
        error, said = error_of(result, times, truth, problem.positions_only), told(result)
        bound = FACTOR * accuracy
        if result.accuracy.asked is None and error > bound and not said:  # constant step, no accuracy claimed: README
            own, shortest = by_hand(problem, way, accuracy, times, truth)
            # both runs divide different intervals by halves until their steps are short enough, so that these differ by up to
            # 2; the error between steps falls with the power DENSE of them
            bound = FACTOR * (accuracy + own * min(max(result.stats.h_min / shortest, 1.0), 2.0) ** DENSE)
    except Exception as failure:  # an exception is a verdict too
        return nan, *failed(failure)
    return error / accuracy, judged(error, bound, said) if isfinite(bound) else "not judged", said


def simulate(scene: mb.Scene, t_end: float, accuracy: float, way: Way, start: mb.Result | None = None) -> mb.Result:
    """One run as a user makes it."""
    return scene.simulate(t_end, accuracy, solver=way.solver, form=way.form, start=start, max_wall=WALL)


def by_hand(problem: Problem, way: Way, accuracy: float, times: Array, truth: Values) -> tuple[float, float]:
    """Error of the same constant step where the user splits the run at every break and edge of a narrow feature, states the
    smooth piece alone, and takes at most a width of a narrow feature in a step. It is measured at times (nt,) and halfway between
    them and between its own steps, where dense output is worst: the times alone are often those of its steps. Infinite where that
    run fails. Beside it the shortest of its steps (s)."""
    worst, shortest, start = 0.0, inf, None
    try:
        for a, b, step in oracle.segments(problem):
            scene = problem.build([i.piece((a + b) / 2) for i in problem.inputs])
            own = replace(way, solver=replace(way.solver, step=min(way.solver.step, PER_WIDTH * step, b - a)))
            start = simulate(scene, b, accuracy, own, start)
            shortest = min(shortest, start.stats.h_min)
            inside = times[(times >= a) & (times <= b)]
            if len(inside):
                looked = {name: v[(times >= a) & (times <= b)] for name, v in truth.items()}
                worst = max(worst, error_of(start, inside, looked, problem.positions_only))
                between = _between(start.solution.t, inside)
                exact = oracle.solve(problem, np.array([0.0, *between, problem.t_end]))
                looked = {name: v[1:-1] for name, v in exact.items()}
                worst = max(worst, error_of(start, between, looked, problem.positions_only))
    except mb.MbdaeError:
        return inf, shortest
    return worst, shortest


def _between(steps: Array, times: Array, most: int = 400) -> Array:
    """Midpoints of the steps and of the times within the times' range, (n,) at most `most`, the narrowest first."""
    points = np.unique(np.concatenate([times, steps[(steps > times[0]) & (steps < times[-1])]]))
    narrow = np.sort(np.argsort(np.diff(points), kind="stable")[:most])
    return np.asarray((points[:-1] + points[1:])[narrow] / 2)
