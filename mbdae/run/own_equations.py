"""Starts of equations of a user's own that violate a derivative of a constraint.

Runs of equations of a user's own (`mb.DAE.simulate`): from an accuracy to a run with its error and its warnings.

What runs of scenes have, these have by the same functions: companions and estimates (`control`), words of warnings
(`assessment`). What differs is the measure, which is every unknown by itself, and what is checked before the run: the declared
index (`system.shown_index`) and the start (`start`).
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.errors import ENDS, FINAL, AccuracyWarning, OptionError, SolverError, warn, with_text_when_interrupted
from mbdae.inputs.resolution import Bound
from mbdae.integrators.base import Asked, Solver, end_after, output_times
from mbdae.integrators.dop853 import DOP853
from mbdae.integrators.named import solver_of
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.integrators.sundials import IDA
from mbdae.results.accuracy import RunInfo, Unknowns, UnknownsAccuracy, UnknownsDistance, plausible
from mbdae.run.amplification import Amplified
from mbdae.run.assessment import growth_words, missed
from mbdae.run.checkpoint import progress_of
from mbdae.run.control import run_controlled
from mbdae.run.drift import doubts_of_steps
from mbdae.run.estimate import Controlled, cpu_of
from mbdae.run.job import run_once
from mbdae.system.base import Array
from mbdae.system.dae import ATTACHED
from mbdae.system.dae import DAE as DAE
from mbdae.system.shown_index import measured
from mbdae.threads import limited, single_threaded
from mbdae.values import number, optional

#: longer of the two steps that look for a jump at the start, over the time of the run; their ratio; smallest jump that counts,
#: over the magnitude of the unknown
FIRST, SHORTER, JUMP = 1e-5, 8.0, 1e-3


def inconsistency(system: DAE, span: float) -> str:
    """How the start violates a derivative of a constraint, in words; "" where it does not, or where nothing has index 2 or 3.

    Steps of two lengths are made from the start: what changes in both by the same amount, or more in the shorter one, does not
    begin where y0 says."""
    found = measured(system, span)
    hidden = np.array([k is not None and k > 1 for k in found])
    if not hidden.any():
        return ""
    apart = []
    for h in (FIRST * span, FIRST * span / SHORTER):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                made = RadauIIA(2, step=h).run(system, Asked(system.t0 + h))
        except SolverError:
            return ""
        apart.append(np.abs(made.y[-1] - system.y0))
    unit = np.maximum(np.abs(system.y0), system.scale)
    jumps = hidden & (apart[1] > JUMP * unit) & (apart[1] > apart[0] / 2)
    if not jumps.any():
        return ""
    index = np.where(jumps, system.index, 9)
    j = int(np.argmin(index))
    value = float(made.y[-1, j])
    return (f"the start is not consistent: {system.names[j]} = {system.y0[j]:g} in y0, but the derivatives of the constraints "
            f"make it {value:.6g} just after t = {system.t0:g} s: correct y0 (and yp0)")


RUN_ONCE = "not estimated: the solver ran once, as it was given; leave out its rtol, atol or step"
#: accuracy below which Radau IIA with 5 stages is tried first, which is cheaper there than that with 3; with unknowns of index 2
#: or 3, whose errors fall more slowly, from a larger one on
TIGHT, TIGHT_MULTIPLIERS = 1e-8, 1e-5
#: steps of a run whose error is estimated are at most the time of the run over LOOKS, of the companion; of the run itself 0.4
#: times as long. What varies in time and moves no differential unknown is in no error test: a load that a constraint holds
LOOKS = 100
#: where a run fails, accuracies that are tried in turn over the one asked, and the smallest. Measured: Robertson's reaction with
#: unknowns of 1e-5 and a scale of 1 fails at 1e-2 and 1e-3, and ends with the next
RETRIED, LEAST = (1.0, 3e-2, 1e-3), 1e-12
#: number of evaluations after which the explicit method, where it was chosen, gives way to Radau IIA: the equations are stiff
EXPLICIT = 30_000


@with_text_when_interrupted
@single_threaded
def simulate(dae: DAE, t_end: float, accuracy: float, solver: Any, outputs: Any, max_wall: Any, progress: Any) -> Unknowns:
    """`DAE.simulate`."""
    accuracy = plausible(accuracy)
    method = solver_of(solver) if solver is not None else None
    end = end_after(dae.t0, t_end)
    times = output_times(dae.t0, end, outputs)
    wall = optional("max_wall", max_wall, number, "give a positive number of seconds, or None", above=0)
    with limited(wall):
        if wrong := dae.doubt(end - dae.t0) or inconsistency(dae, end - dae.t0):
            raise OptionError(wrong)
        run = OwnRun(dae, accuracy, Asked(end, max_wall=wall, progress=progress_of(progress)), times)
        return run.result(*(run.chosen() if method is None else (run.by(method), "")))


class OwnRun:
    """One call of `simulate`. system: the equations with the measure of every unknown."""

    def __init__(self, dae: DAE, accuracy: float, asked: Asked, times: Array) -> None:
        self.accuracy, self.times = accuracy, times
        bound = Bound(dae.t0, asked.t_end, (asked.t_end - dae.t0) / LOOKS)
        self.asked = replace(asked, begin=time.perf_counter(), bounds=(bound,))
        self.distance = UnknownsDistance(dae.scale)
        self.system = copy(dae)
        self.system.measure = self.distance

    def by(self, solver: Solver, budget: float = math.inf) -> Controlled:
        """A run of one solver to the accuracy, or with the tolerance or step that the user set. budget: largest number of
        evaluations of one run."""
        with self._attaching(solver):
            asked = replace(self.asked, max_residuals=budget, bounds=() if solver.fixed or solver.rtol else self.asked.bounds)
            if not solver.fixed and solver.rtol is None and getattr(solver, "atol", None) is not None:
                solver = solver.at_accuracy(self.accuracy, self.system.label)  # atol is the user's: one run, with the usual rtol
            if not solver.fixed and solver.rtol is None:
                return self._closer_where_it_fails(solver, asked)
            return run_once(self.system, solver, asked, self.accuracy)

    def _closer_where_it_fails(self, solver: Solver, asked: Asked) -> Controlled:
        """A run to the accuracy; where it fails, to smaller ones: an unknown that is off by what is allowed may be where the
        equations have no solution, as a concentration below 0."""
        asked_for = self.accuracy
        *first, last = dict.fromkeys(min(asked_for, max(smaller * asked_for, LEAST)) for smaller in RETRIED)
        for accuracy in first:
            try:
                return run_controlled(self.system, None, solver, accuracy, asked, self.times)
            except FINAL:
                raise
            except SolverError:
                if math.isfinite(asked.max_residuals):
                    raise
        return run_controlled(self.system, None, solver, last, asked, self.times)

    def chosen(self) -> tuple[Controlled, str]:
        """The run of the first solver that meets the accuracy, else the one with the smallest error; and why it was chosen."""
        best: Controlled | None = None
        failure: SolverError | OptionError | None = None
        why, runs, cpu = "", 0, 0.0
        for solver, budget, reason in self._alternatives():
            try:
                run = self.by(solver, budget)
            except FINAL:
                raise
            except (SolverError, OptionError) as error:
                runs, cpu = runs + 1, cpu + (cpu_of(error) if isinstance(error, SolverError) else 0.0)
                failure = error if failure is None or isinstance(solver, RadauIIA) else failure
                continue
            runs, cpu = runs + run.runs, cpu + run.cpu_s
            if best is None or run.estimate < best.estimate:
                best, why = run, reason
            if run.estimate <= self.accuracy:
                break
        if best is None:
            assert failure is not None
            raise failure
        return replace(best, runs=runs, cpu_s=cpu), f"{best.solver.label}: {why}"

    def _alternatives(self) -> Iterator[tuple[Solver, float, str]]:
        """Solvers in the order in which they are tried, each with its budget of evaluations and the reason."""
        low = int(np.max(self.system.index)) < 2
        if self.system.rhs is not None and low:
            yield DOP853(), EXPLICIT, "an ordinary differential equation that is not stiff"
        five, three = RadauIIA(5), RadauIIA(3)
        first, second = (five, three) if self.accuracy < (TIGHT if low else TIGHT_MULTIPLIERS) else (three, five)
        yield first, math.inf, "implicit, of any index up to 3"
        yield second, math.inf, f"{first.label} did not reach the accuracy"
        if low:
            yield IDA(), math.inf, f"{first.label} did not reach the accuracy"

    def result(self, run: Controlled, choice: str) -> Unknowns:
        """The result with its warnings, each also issued as an AccuracyWarning."""
        known = self._accuracy(run)
        notes = [*missed(known, run), *(run.notes if known.met is not True else ()), *doubts_of_steps(run, known.asked),
                 *growth_words(run, known.asked)]
        if known.met is False and notes and known.worst:
            notes[0] = f"{notes[0]}; the unknown that is farthest off is {known.worst}"
        reliable = not run.hidden and not run.solution.stats.missed_dips
        for note in notes:
            warn(note)
        return self._made(run.solution, RunInfo(run.solver, self.system.label, known, run.solution.stats, run.runs, run.cpu_s,
                                                tuple(notes), choice, reliable))

    def _accuracy(self, run: Controlled) -> UnknownsAccuracy:
        if math.isnan(run.estimate):
            return UnknownsAccuracy(None, None, unknown={"unknowns": RUN_ONCE}, found_amplification=Amplified(run.solution))
        return UnknownsAccuracy(self.accuracy, run.estimate, worst=self.system.names[self.distance.worst],
                                found_amplification=Amplified(run.solution))

    def _made(self, solution: Solution, info: RunInfo) -> Unknowns:
        return Unknowns(solution, info, self.times[self.times <= solution.t[-1]])

    @contextmanager
    def _attaching(self, solver: Solver) -> Iterator[None]:
        """Context in which a run is made: where it fails or is interrupted, what was computed is attached to the error."""
        try:
            yield
        except (SolverError, *ENDS) as error:
            solution = getattr(error, "solution", None)
            if isinstance(solution, Solution):
                why = "the run failed before its end" if isinstance(error, SolverError) else "the run was interrupted"
                known = UnknownsAccuracy(None, None, unknown={"unknowns": f"not estimated: {why}"})
                stats = solution.stats
                info = RunInfo(solver, self.system.label, known, stats, 1, stats.cpu_s, (str(error),))
                error.solution = self._made(solution, info)  # type: ignore[union-attr]
            raise


def _simulate(dae: DAE, *args: Any) -> Unknowns:
    return simulate(dae, *args)


ATTACHED["simulate"] = _simulate
__all__: Sequence[str] = ["DAE"]
