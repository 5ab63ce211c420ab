"""From a seed to a problem, a solver with its form and an accuracy; and the verdict on the run."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from growing.problems import PROBLEMS, Problem

import mbdae as mb

ROUNDED = 1e-16  #: round-off of the largest coordinate
RIGHT = 3.0  #: an error up to this many times the accuracy is right
WALL = 60.0  #: s of wall time of a run
VERDICTS = ("right", "told", "told needlessly", "silent", "refused", "crashed")


@dataclass(frozen=True)
class Run:
    """What came of a seed. error, growth: the true error over the accuracy; natural logarithm of the true growth."""

    seed: int
    problem: str
    way: str
    off: float
    accuracy: float
    verdict: str
    error: float
    growth: float
    said: str
    wall: float

    def __str__(self) -> str:
        return (f"{self.seed:5d} {self.problem:12s} {self.way:20s} {self.off:.0e} off, accuracy {self.accuracy:.0e}: "
                f"{self.verdict:16s} error / accuracy {self.error:9.2g} growth e^{self.growth:.0f}, "
                f"{self.wall:.1f} s {self.said[:90]}")


def ways(problem: Problem) -> list[tuple[str, dict[str, Any], float]]:
    """Solvers and forms that apply, each with its smallest accuracy."""
    found = [("default", {}, 1e-8), ("default", {}, 1e-8), ("RadauIIA(3)", {"solver": mb.RadauIIA(3)}, 1e-7),
             ("RadauIIA(5)", {"solver": mb.RadauIIA(5)}, 1e-7), ("RadauIIA(2)", {"solver": mb.RadauIIA(2)}, 1e-5),
             ("IDA", {"solver": mb.IDA()}, 1e-6)]
    if not problem.stiff:
        found += [("DOP853", {"solver": mb.DOP853()}, 1e-8), ("CVODE", {"solver": mb.CVODE()}, 1e-7),
                  ("CVODE BDF", {"solver": mb.CVODE(method="BDF")}, 1e-6)]
    if not problem.adaptive:
        found += [("HHT", {"solver": mb.HHT()}, 1e-3), ("GeneralizedAlpha", {"solver": mb.GeneralizedAlpha()}, 1e-3)]
    if problem.constrained:
        found += [("RadauIIA(3), Index3", {"solver": mb.RadauIIA(3), "form": mb.Index3()}, 1e-5),
                  ("IDA, Index1", {"solver": mb.IDA(), "form": mb.Index1()}, 1e-6),
                  ("RadauIIA(3), GGL", {"solver": mb.RadauIIA(3), "form": mb.GGL()}, 1e-7)]
    return found


def run(seed: int) -> Run:
    """The run of a seed with its verdict."""
    rng = np.random.default_rng([seed, 35])
    problem = PROBLEMS[int(rng.integers(len(PROBLEMS)))](rng)
    possible = ways(problem)
    way, options, least = possible[int(rng.integers(len(possible)))]
    accuracy = float(f"{10 ** rng.uniform(np.log10(max(least, problem.tightest)), -2):.1e}")
    times = np.linspace(0, problem.t_end, 121)
    begin, said, reliable, error = time.perf_counter(), "", None, float("nan")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)
            found = problem.scene().simulate(problem.t_end, accuracy=accuracy, outputs=times, max_wall=WALL, **options)
        said, reliable = " | ".join(found.warnings), found.reliable
        apart = float(np.max(np.abs(problem.seen(found) - problem.known(problem.reference(times)))))
        error = apart / (found.prepared.length if problem.lengths else 1.0) / accuracy
        verdict = "right" if error <= RIGHT else "silent"
        if said or reliable is False:
            verdict = "told"
    except mb.SolverError as stopped:  # a wall clock that ran out, an accuracy that constant steps do not reach
        said, verdict = str(stopped), "told"
    except mb.MbdaeError as refused:
        said, verdict = str(refused), "refused"
    except Exception as failed:
        said, verdict = f"{type(failed).__name__}: {failed}", "crashed"
    growth = problem.growth()
    if verdict == "told" and error <= 1 and ROUNDED * np.exp(growth) < 0.1 * accuracy:
        verdict = "told needlessly"
    return Run(seed, problem.name, way, problem.seed, accuracy, verdict, error, growth, said, time.perf_counter() - begin)
