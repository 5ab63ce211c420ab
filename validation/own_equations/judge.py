"""Whether runs of own equations are right or say that they are not."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from own_equations.problems import PROBLEMS, Problem

import mbdae as mb
from mbdae.results.accuracy import UnknownsDistance

SOLVERS = (mb.IDA(), mb.CVODE(), mb.CVODE(method="BDF"), mb.DOP853(), mb.RadauIIA(2), mb.RadauIIA(3), mb.RadauIIA(5),
           mb.GeneralizedAlpha(), mb.HHT(), None)
WALL = 20.0  #: s of wall time of a run, after which it has said that it did not end


@dataclass(frozen=True)
class Verdict:
    """One run: its error over the accuracy asked, the unknown that is farthest off, and what it said ("" for nothing)."""

    problem: str
    solver: str
    accuracy: float
    ratio: float
    unknown: str
    told: str

    @property
    def silent(self) -> bool:
        """Whether the run is more than three times off and said nothing."""
        return not self.told and not self.ratio <= 3

    @property
    def needless(self) -> bool:
        """Whether the run said that it is off, and is not."""
        return bool(self.told) and self.ratio <= 1


def judged(name: str, problem: Problem, solver: mb.Solver | None, accuracy: float) -> Verdict | None:  # type: ignore[name-defined]
    """The verdict on one run; None where the solver does not admit the problem."""
    system = problem.make()
    label = "default" if solver is None else solver.label
    try:
        if solver is not None:
            solver.at_accuracy(accuracy, system.label).check(system)
    except mb.OptionError:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        try:
            r = system.simulate(problem.t_end, accuracy, solver=solver, max_wall=WALL)
        except (mb.SolverError, mb.OptionError) as error:
            return Verdict(name, label, accuracy, float("nan"), "", f"{type(error).__name__}: {error}")
    times = np.unique(np.concatenate([np.linspace(system.t0, problem.t_end, 1501), r.solution.t]))
    distance = UnknownsDistance(system.scale)
    off = float(np.max(distance(times, r(times).y, problem.exact(times))))
    of_error = [note for note in r.warnings if not note.startswith("the equations are stiff")]  # a hint at cost
    said = "; ".join(of_error) or ("not reliable" if r.reliable is False else "")
    return Verdict(name, label, accuracy, off / accuracy, system.names[distance.worst], said)


def verdicts(names: Iterable[str], accuracies: Iterable[float]) -> Iterator[Verdict]:
    """Of every problem named, with every solver that admits it."""
    for name in names:
        problem = PROBLEMS[name]
        for solver in SOLVERS:
            for accuracy in accuracies:
                found = judged(name, problem, solver, accuracy) if accuracy >= problem.tight else None
                if found is not None:
                    yield found


def wrong_indices() -> list[str]:
    """Problems and declared indices, one number each, of which `DAE.doubt` says the wrong thing: nothing of a wrong one,
    something of the right one."""
    found = []
    for name, problem in PROBLEMS.items():
        right = problem.make()
        for index in (1, 2, 3):
            stated = mb.DAE(right.residual, right.y0, right.yp0, index=index, names=right.names, scale=right.scale)
            if bool(stated.doubt(problem.t_end)) == (index == int(np.max(right.index))):
                found.append(f"{name}, index {index}")
    return found
