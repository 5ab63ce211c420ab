"""Constant steps from an accuracy: runs with steps of two sizes measure the error, its order says the next size.

An estimate made inside a single step was measured not to follow the tolerance; two runs compared over their whole length do.
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from mbdae.errors import SolverError, WallClockError, keeping
from mbdae.integrators.base import Asked
from mbdae.integrators.distance import Measure, check_times, scaled_distance
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array, System

ORDER = 2
SAFETY = 0.5  #: part of the accuracy aimed at
MOST_STEPS = 300_000
RUNS = 7
SHORTEST = 0.01  #: next step over the present one, at least, where an estimate asks for it
LONGEST, FIRST = 1 / 20, 0.1  #: first step: part of the run, and of the time in which an unknown changes by its scale
SHARE = 0.5  #: part of the width of an input of time that the longest of these steps covers; shorter ones less
NEARBY = 0.24  #: steps of two runs farther apart than this are not compared for an estimate
COARSER = "the run attached (step = {:g} s) is complete, its error is not known"
ALGEBRAIC = ("lambda", "mu", "z")  #: kinds of unknowns that are not compared


@dataclass(frozen=True)
class Halved:
    """The finest run, its solver with the step, the estimate of its error, the number of runs and their CPU seconds; coarser: the
    run it was compared with, where, and the share of their difference that is its error."""

    solution: Solution
    solver: Any
    estimate: float
    runs: int
    cpu_s: float
    coarser: tuple[Solution, Array, float] | None = None


def scaled_difference(system: System) -> Measure:
    """Largest difference of positions, velocities and states over their scale."""
    return lambda t, a, b: scaled_distance(system, a, b, ALGEBRAIC)


def halved(solver: Any, system: System, asked: Asked, accuracy: float, measure: Measure) -> Halved:
    """Run with ever shorter steps until the estimate is below `accuracy`, or RUNS runs are made.

    Raises SolverError, with the last run attached, where more than MOST_STEPS steps would be needed."""
    t_end, asked = asked.t_end, replace(asked, begin=time.perf_counter() if asked.begin is None else asked.begin)
    h, coarse, spent, runs = _first_step(system, t_end), None, 0.0, 0
    first = h
    best: Halved | None = None
    while runs < RUNS:
        now = replace(solver, step=h, accuracy=None)
        runs += 1
        try:
            with keeping(best.solution, COARSER.format(best.solver.step)) if best is not None else nullcontext():
                fine = now.run(system, replace(asked, share=SHARE * h / first))
        except WallClockError:
            raise
        except SolverError as error:
            spent += error.solution.stats.cpu_s if error.solution is not None else 0.0
            if runs >= RUNS or (best is not None and not best.solution.stats.unresolved):
                raise
            h /= 4
            continue
        spent += fine.stats.cpu_s
        if coarse is None:
            coarse, best = (fine, h), Halved(fine, now, float("inf"), runs, spent)
            h = min(h / 2, fine.stats.resolving_step or h)
            continue
        estimate, coarser = _estimate(coarse, (fine, h), measure)
        estimate = inf if fine.stats.unresolved else estimate
        if estimate <= accuracy and h < NEARBY * coarse[1]:  # so far apart the order says nothing: steps may alias a vibration
            with keeping(fine, COARSER.format(h)):
                near = replace(solver, step=2 * h, accuracy=None).run(system, replace(asked, share=2 * SHARE * h / first))
            runs, spent = runs + 1, spent + near.stats.cpu_s
            estimate, coarser = _estimate((near, 2 * h), (fine, h), measure)
        best = Halved(fine, now, estimate, runs, spent, coarser)
        if estimate <= accuracy:
            return best
        coarse = fine, h
        wanted = max((SAFETY * accuracy / estimate) ** (1 / ORDER) if isfinite(estimate) else 0.25, SHORTEST)
        if fine.stats.unresolved:  # what a law does was stepped over: an estimate does not know of it
            wanted = fine.stats.resolving_step / h
        if (t_end - system.t0) / (h * wanted) > MOST_STEPS:
            raise _too_dear(best, h * wanted, t_end - system.t0, accuracy)
        h *= float(min(wanted, 0.5))
    assert best is not None
    return best


def _first_step(system: System, t_end: float) -> float:
    slow = np.array([kind not in ALGEBRAIC for kind in system.kinds])
    rate = float(np.max((np.abs(system.yp0) / (np.asarray(system.scale) + np.abs(system.y0)))[slow], initial=0.0))
    span = t_end - float(system.t0)
    return min(LONGEST * span, FIRST / rate if rate > 0 else span)


def _estimate(coarse: tuple[Solution, float], fine: tuple[Solution, float], measure: Measure,
              ) -> tuple[float, tuple[Solution, Array, float]]:  # fmt: skip
    """Error of the finer of two runs, each with its step; the coarser, where they were compared, and that share of it."""
    fallen = (fine[1] / coarse[1]) ** ORDER
    times, share = check_times(coarse[0]), fallen / (1 - fallen)
    return float(np.max(measure(times, coarse[0](times), fine[0](times)))) * share, (coarse[0], times, share)


def _too_dear(best: Halved, h: float, span: float, accuracy: float) -> SolverError:
    solution, steps = best.solution, span / h
    cpu = solution.stats.cpu_s * steps / max(solution.stats.steps, 1)
    reached = best.estimate * (solution.stats.steps / MOST_STEPS) ** ORDER
    text = (f"{best.solver.label}: accuracy {accuracy:g} needs steps of {h:.1e} s, {steps:.1e} steps and {cpu:.0f} s of CPU; "
            f"the run attached has {best.estimate:.1e}. Ask for {reached:.0e} or more, or use mb.RadauIIA(3)")  # fmt: skip
    return SolverError(text, float(solution.t[-1]), "", solution)
