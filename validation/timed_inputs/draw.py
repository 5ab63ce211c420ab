"""From a seed to a scene, a solver with its form, and an accuracy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from timed_inputs import scenes
from timed_inputs.judge import Run, Way, measure
from timed_inputs.oracle import Problem

import mbdae as mb

MOST_STEPS = 5000  #: of a run that resolves a feature narrow in space
MOST_PIECES = 40  #: of a run with constant steps, each a run of its own where it is split by hand
Drawn = tuple[Problem, Way, float]
Makers = Sequence[Callable[[np.random.Generator], Problem]]


def ways(problem: Problem, rng: np.random.Generator) -> list[Way]:
    """Solvers and forms that apply to a scene, with the accuracies that they reach at acceptable cost."""
    held = problem.constrained
    found = [Way("default"), Way("default"), Way("RadauIIA(3)", mb.RadauIIA(3)), Way("IDA", mb.IDA(), None, (1e-7, 1e-3)),
             Way("RadauIIA(2)", mb.RadauIIA(2), None, (1e-6, 1e-3))]
    if problem.name.startswith("beam"):
        return [Way("default"), Way("RadauIIA(3)", mb.RadauIIA(3)), Way("RadauIIA(2)", mb.RadauIIA(2))]
    if problem.name == "loose pin":
        return [*found[:3], Way("CVODE BDF", mb.CVODE(method="BDF"))]
    form = mb.Index1() if held else mb.ODE()
    found += [Way(f"CVODE Adams, {form.label}", mb.CVODE(), form), Way(f"CVODE BDF, {form.label}", mb.CVODE(method="BDF"), form)]
    step = problem.t_end / float(rng.integers(200, 1500))
    for solver, name in ((mb.GeneralizedAlpha(), "GeneralizedAlpha()"), (mb.HHT(), "HHT()")):
        found.append(Way(name, solver, None, (1e-4, 1e-3)))
    pieces = sum(len(i.pieces) + 12 * len(i.fine) for i in problem.inputs)
    if pieces <= MOST_PIECES and (problem.inputs or problem.t_end / problem.largest_step < MOST_STEPS):
        found += [Way("RadauIIA(3, step=)", mb.RadauIIA(3, step=step)), Way("HHT(step=)", mb.HHT(step=step))]
    if held:
        found += [Way("RadauIIA(3), Index3", mb.RadauIIA(3), mb.Index3(), (1e-6, 1e-3)),
                  Way("RadauIIA(3), Index1", mb.RadauIIA(3), mb.Index1()),
                  Way("IDA, Index1", mb.IDA(), mb.Index1(), (1e-7, 1e-3)),
                  Way("default, GGL", None, mb.GGL())]
    return found


def draw(seed: int, of: Makers = scenes.SCENES) -> Drawn:
    """The scene of a seed, how it is solved and how accurately."""
    rng = np.random.default_rng(seed)
    problem = of[int(rng.integers(len(of)))](rng)
    possible = ways(problem, rng)
    way = possible[int(rng.integers(len(possible)))]
    low = max(way.accuracies[0], problem.tightest)
    return problem, way, float(f"{10 ** rng.uniform(np.log10(low), np.log10(way.accuracies[1])):.1e}")


def run(seed: int, of: Makers = scenes.SCENES) -> Run:
    """The run of a seed with its verdict."""
    return measure(*draw(seed, of), seed)
