"""What is asked is delivered: random scenes, from the accuracy alone, compared between steps too."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from random_scenes import random_scene
from runner import Case, Claim, Found, allowed
from runs import SOLVERS

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare
from mbdae.system.sampling import distance

claim = Claim("asked_accuracy", "on random scenes of 1 to 20 bodies no run is more than three times off what was asked without a "
              "warning", 3.0, "times asked",
              "Radau IIA at 1e-11 on the same scene, 501 times; the scenes are made from seeds")
ACCURACIES = (1e-3, 1e-5, 1e-7)
NEEDLESS = 0.05  #: share of runs within the accuracy that may warn


class Run(NamedTuple):
    """One run: error over the accuracy asked for, and whether it warned."""

    ratio: float
    warned: bool
    seed: int
    solver: str
    accuracy: float


def runs(seeds: Iterable[int], accuracies: Iterable[float], t_end: float = 1.0) -> list[Run]:
    """Every scene with both solvers at every accuracy."""
    found = []
    times = np.linspace(0.0, t_end, 501)
    for seed in seeds:
        scene = random_scene(seed)
        prepared = prepare(scene)
        n = prepared.mechanics.nq + prepared.mechanics.nu
        exact = mb.RadauIIA(3, rtol=1e-11).solve(system_for(prepared, None, 3), t_end)(times)[:, :n]
        for solver in SOLVERS:
            for accuracy in accuracies:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", mb.AccuracyWarning)
                    r = scene.simulate(t_end, accuracy, solver=solver)
                error = float(np.max(distance(prepared, times, r.solution(times)[:, :n], exact)))
                found.append(Run(error / accuracy, bool(r.warnings), seed, solver.label, accuracy))
    return found


def judge(seeds: Sequence[int], accuracies: Iterable[float] = ACCURACIES) -> list[Found]:
    """Silent errors, needless warnings, and how near the median is to what was asked."""
    found = runs(seeds, accuracies)
    unwarned = [run for run in found if not run.warned]
    worst = max(unwarned)
    told = f"{len(found)} runs; the largest without a warning: seed {worst.seed}, {worst.solver}, asked {worst.accuracy:.0e}"
    median = float(np.median([run.ratio for run in found]))
    return [Found(worst.ratio, quantity="largest error without a warning", note=told),
            Found(float(np.mean([run.warned for run in found if run.ratio <= 1])), allowed(NEEDLESS, seeds), "share",
                  "needless warnings"),
            Found(median, 1.0, quantity="median error"),
            Found(0.01 / median, 1.0, "1", "wasted accuracy, 0.01 / median")]


def cases() -> list[Case]:
    both = " and ".join(solver.label for solver in SOLVERS)
    return [Case("scenes, 1e-3 to 1e-7", both, judge, slow=True, parts=range(50))]
