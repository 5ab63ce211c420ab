"""From the accuracy that a user asks for to a run that has it; the error is measured by companion runs, not taken from rtol.

Every run is made twice, at a multiple of the tolerance (its companion) and at the tolerance itself; with contacts it has two
companions. Their differences, and the rate at which errors fall with the tolerance, give the estimated error of the last run
(`estimate`). Where it exceeds the accuracy, the run is repeated with a smaller tolerance. The measured ratios of accuracy and
rtol (`Solver.factors`) only choose the first tolerance.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import FINAL, AccuracyWarning, ChatteringError, SolverError, WallClockError, keeping
from mbdae.integrators.base import SHARE, Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Measure, Solution, check_times, scaled_distance
from mbdae.integrators.stepped import halved, second_method
from mbdae.results.clearance import OtherRun, some_of
from mbdae.run.contacts import Hidden, hidden_contacts, resolving
from mbdae.run.estimate import (
    LOOSEST,
    RunAt,
    beginning_at,
    companions,
    estimated,
    fall_shown,
    first_tolerance,
    share_of,
    usual_companion,
    windows,
    with_rtol,
)
from mbdae.run.growing import Growth, at_least, bounded, growing, unfollowed, unseen
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import distance
from mbdae.system.scene_system import SceneSystem
from mbdae.values import number, option

#: largest number of runs from the last of the first companions on, failed ones included; for batches largest number of estimates
ATTEMPTS = 5
FURTHER = 2  #: with contact, number of further runs: impacts multiply errors, and the first tolerance may be far too large
#: from one run to the next the longest step, as a fraction of the time scale of an input of time, is reduced by this factor.
#: Where only inputs bound the steps of two runs, these must differ, else the difference of the runs is no measure of the error.
#: It is below 1/2 because the time scales are known up to a factor of 2
CLOSER = 0.4
#: from one run to the next the longest step during an impact is reduced by this factor. The first run after the companions has
#: `Solver.impacts` times the bound of a run without error estimate; the companions take longer steps
CLOSER_IMPACTS = 0.5
UNKNOWN = "the run attached (attribute `solution`, rtol = {:g}) is complete, its error is not known"
USED_UP = "max_wall = {:g} s of wall time is used up while the error was measured: {}; raise max_wall or loosen the accuracy"
UNTESTED = "the run attached (attribute `solution`) is complete; whether its steps leave out fast vibrations was not tested"
#: a run is stopped, as too expensive, after this many times the residual evaluations of its companion, plus 10000, plus those
#: that CUT allows
CRAWL = 10
#: factor on that number where a run leaves an unstable rest: its companion, in which less growth may have come out, moves less
LEAVING = 10
#: number of residual evaluations that CRAWL allows in addition for every stretch and edge of inputs of time, where steps end
CUT = 100
#: with contact: a run is not repeated any more where its estimate, after two or more repeats, is still above the largest earlier
#: one divided by CHAOTIC, and above LARGE, because differences have grown to the size of the motion. Smaller estimates that do
#: not fall come from one unlucky step of a companion, which the next run does not have
CHAOTIC, LARGE = 2.0, 1e-2
CHAOS = ("tighter tolerances changed the estimate from {:.1e} to {:.1e} only: the motion is chaotic and not predictable beyond "
         "some time; rely on energies, forces and statistics, or on a shorter run")
#: smallest and largest ratio of the tolerance of a repeated run to that of the run before, without and with contacts; a tolerance
#: that round-off or penetrations bound is not subject to them
FINER, FINER_WITH_IMPACTS = (1e-3, 0.3), (0.1, 0.3)
#: a run is repeated if its tolerance is above this many times the largest one that resolves the penetrations and the sticking
#: found in it
COARSE = 3.0
#: SHALLOW: a contact inside a step counts if its penetration is above this fraction of the accuracy times the scene's length (m;
#: for gaps that are angles, rad); REPEATS: largest number of times that a run is repeated because of such contacts
SHALLOW, REPEATS = 0.1, 5
FOLLOWING = 3  #: largest number of times that a run is repeated because its steps do not follow a disturbance that grows
#: smallest ratio of the error to the difference from a companion where round-off bounds the tolerance, and errors fall no more:
#: measured with a multiplier of a pendulum, RadauIIA(5) at 1e-11
AT_ROUND_OFF = 1.0
SAMPLES = 200  #: largest number of steps whose speeds a comparison of motions relates to
#: length, in longest steps, of short runs that show vibrations shorter than a step, and number of times of the comparison
FIRST_STEPS, PROBES = 5.0, 200


@dataclass(frozen=True)
class Controlled:
    """A run, its estimated error, the number of runs made for it and their CPU time (s). others: runs that it was compared with;
    waves: whether it resolves all vibrations of beams although its form does not demand it; told: for every run with an estimate,
    in order, its tolerance (or constant step, s) and the estimate from runs of its method alone; limit: the smallest tolerance
    that round-off allows; hidden: contacts that close and open inside its steps; growth: of small disturbances along it."""

    solution: Solution
    solver: Solver
    estimate: float
    runs: int
    cpu_s: float
    notes: tuple[str, ...] = ()
    others: tuple[OtherRun, ...] = ()
    waves: bool = False
    told: tuple[tuple[float, float], ...] = ()
    limit: float = 0.0
    hidden: tuple[Hidden, ...] = ()
    growth: tuple[Growth, ...] = ()

    def after(self, runs: int, cpu_s: float) -> Controlled:
        """The same run, with a number of other runs and their CPU time (s) added to `runs` and `cpu_s`."""
        return replace(self, runs=self.runs + runs, cpu_s=self.cpu_s + cpu_s)


def cpu_of(error: SolverError) -> float:
    """CPU time of a run that failed, s."""
    return 0.0 if error.solution is None else float(error.solution.stats.cpu_s)


def measure_of(system: System, prepared: Prepared | None) -> Measure:
    """The distance between two trajectories of a system: of motions for a scene, else of unknowns."""
    if prepared is not None and isinstance(system, SceneSystem):
        return partial(distance, prepared)
    if system.measure is not None:
        return system.measure  # type: ignore[no-any-return]
    return lambda t, a, b: scaled_distance(system, a, b)


def other_run(system: System, prepared: Prepared | None, run: Solution, times: Array, share: float, kind: str = "companion",
              ratio: float = 0.0) -> tuple[OtherRun, ...]:
    """A companion run with some of the `times` of its comparison with the run that is returned, to estimate errors of all that is
    read. share: assumed ratio of the error to the difference of both; 1 with contacts; ratio: its tolerance over the run's."""
    if prepared is None or not isinstance(system, SceneSystem):
        return ()
    share = 1.0 if prepared.contacts else share  # errors of forces were measured to fall more slowly than those of the motion
    return (OtherRun.beside(run, some_of(times, run.y.shape[1], bool(prepared.contacts)), share, kind=kind, ratio=ratio),)


def run_controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked,
                   outputs: Array) -> Controlled:
    """Make runs with smaller and smaller tolerances until the estimated error, also at the outputs, is below `accuracy` or cannot
    be made smaller by this solver. The wall time in `asked` is the limit of all runs together."""
    asked = replace(asked, begin=time.perf_counter() if asked.begin is None else asked.begin)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AccuracyWarning)
        run = _passing_nothing_over(system, prepared, solver, accuracy, asked, outputs)
        second = None if solver.by_steps else second_method(solver, system, asked, accuracy, measure_of(system, prepared))
        if second is not None:
            distance = second.distance(run.solution, run.estimate)
            second.tell(run.estimate, distance, accuracy)
            run = replace(run, estimate=distance).after(second.runs, second.cpu_s)
    notes = [*run.notes, *(str(w.message) for w in caught)]  # of those that differ in the time they name ("at t = ...") the last
    return replace(run, notes=tuple({note.split(" at t = ")[0]: note for note in notes}.values()))


def _passing_nothing_over(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked,
                          outputs: Array) -> Controlled:
    """A run in which no contact closes and opens inside a step, and whose steps follow every disturbance that grows unseen: where
    they do not, the run is repeated with shorter steps there, at most REPEATS times. A run that misses the accuracy is also
    repeated because of such contacts in its companions."""
    depth, runs, cpu = SHALLOW * accuracy * (1.0 if prepared is None else prepared.length), 0, 0.0
    given = len(asked.bounds)
    for repeats in range(REPEATS + 1):
        made, grown = list[RunAt](), len(asked.bounds) > given
        try:
            run = _controlled(system, prepared, solver, accuracy, asked, outputs, made, grown).after(runs, cpu)
        except SolverError as error:
            if not grown or isinstance(error, FINAL):
                raise
            run = run.after(1 + len(made), cpu_of(error) + sum(other.stats.cpu_s for _, other in made))
            return replace(run, estimate=math.inf, others=(), notes=(*run.notes, f"a run with shorter steps failed: {error}"))
        hidden = hidden_contacts(system, run.solution, depth)
        of_companions = [] if hidden or run.estimate <= accuracy else [
            one for _, other in made for one in hidden_contacts(system, other, depth)]
        growth = growing(system, run.solution, grown)
        bounds = unfollowed(growth) if repeats < FOLLOWING else ()
        if not bounds and not grown and made and unseen(growth):  # else such an estimate was made
            measure = measure_of(system, prepared)
            run = replace(run, estimate=max(run.estimate, estimated(system, solver, made, measure, outputs, at_least(solver))))
            bounds = () if run.estimate <= accuracy else unseen(growth)
        if not hidden and not of_companions and not bounds:
            return replace(run, growth=tuple(growth))
        runs, cpu = run.runs, run.cpu_s
        asked = replace(asked, bounds=(*asked.bounds, *bounds))
        if hidden or of_companions:
            known = [] if asked.edges is None else [asked.edges]
            asked = replace(asked, edges=distinct(np.concatenate([*known, *(one[1:] for one in hidden + of_companions)])))
    run = replace(run, growth=tuple(growth))
    return replace(run, estimate=float("inf"), others=(), hidden=tuple(hidden)) if hidden else run


def _controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked,
                outputs: Array, made: list[RunAt], grown: bool) -> Controlled:
    """`run_controlled` without the search for hidden contacts; the last runs and their tolerances are left in the list `made`.
    grown: whether steps are bounded by growth."""
    measure = measure_of(system, prepared)
    if solver.by_steps:
        found = halved(solver, system, asked, accuracy, measure, second_method(solver, system, asked, accuracy, measure))
        run = Controlled(found.solution, found.solver, found.estimate, found.runs, found.cpu_s, told=found.told)
        others = other_run(system, prepared, *found.coarser) if found.coarser is not None else ()
        return with_short_vibrations(replace(run, others=others), system, prepared, accuracy, measure)
    tight, ceiling, limit = first_tolerance(system, prepared, solver, accuracy)
    best, made[:] = companions_of(system, tight, asked)
    most = best.runs + ATTEMPTS - 1 + (0 if system.guards is None else FURTHER)
    count, kept = len(made), len(companions(system, solver))
    told: list[tuple[float, float]] = []  # tolerance and estimated error of every run after the companions
    while best.runs < most:
        loose, coarse = made[-1]
        try:
            most_residuals = CRAWL * coarse.stats.residuals + 10000 + CUT * _cuts(system, tight, asked.t_end)
            most_residuals *= LEAVING if grown else 1
            with keeping(best.solution, UNKNOWN.format(best.solver.rtol)):
                fine = tight.run(system, closer(replace(asked, max_residuals=most_residuals), solver, count, kept))
        except WallClockError as error:
            raise WallClockError(USED_UP.format(asked.max_wall, UNKNOWN.format(best.solver.rtol)), error.time, error.culprit,
                                 best.solution) from error
        except ChatteringError:
            raise
        except SolverError as error:
            best = replace(best, notes=(*best.notes, f"a tighter run failed: {error}")).after(1, cpu_of(error))
            tight = with_rtol(tight, (tight.tolerance * loose) ** 0.5)
            if tight.tolerance > 0.5 * loose:
                return best
            continue
        cpu, runs = best.cpu_s + fine.stats.cpu_s, best.runs + 1
        made[:], count = [*made[-kept:], (tight.tolerance, fine)], count + 1  # earlier runs are dropped: they take much memory
        estimate = partial(estimated, system, solver, made, measure, outputs)
        told.append((tight.tolerance, bounded(tight, told, estimate, coarse, fine) if grown else estimate()))
        estimates = [estimate for _, estimate in told]
        others = tuple(one for before, run in made[-1 - kept : -1] for one in other_run(
            system, prepared, run, check_times(run, outputs), share_of(system, solver, tight.tolerance / before),
            ratio=before / tight.tolerance))
        best = Controlled(fine, tight, estimates[-1], runs, cpu, best.notes, others, told=tuple(told), limit=limit)
        ceiling = max(resolving(prepared, solver, fine, ceiling), limit)
        too_coarse = tight.tolerance > COARSE * ceiling
        if (best.estimate <= accuracy and not too_coarse) or tight.tolerance <= limit * (1 + 1e-9):
            return _judged_again(system, best, accuracy, asked, made, partial(
                estimate, max(at_least(solver) if grown else 0.0, AT_ROUND_OFF)))
        if too_coarse:
            tight = with_rtol(tight, ceiling)
            continue
        stuck = len(estimates) > 2 and best.estimate > max(LARGE, max(estimates[:-1]) / CHAOTIC)
        if system.guards is not None and stuck:
            return replace(best, notes=(*best.notes, CHAOS.format(max(estimates[:-1]), best.estimate)))
        falls = (0.5 * accuracy / best.estimate) ** (1 / fall_shown(told))
        falls = float(np.clip(falls, *(FINER if system.guards is None else FINER_WITH_IMPACTS)))
        tight = with_rtol(tight, max(tight.tolerance * falls, limit))
    return best


def _judged_again(system: System, best: Controlled, accuracy: float, asked: Asked, made: list[RunAt],
                  estimate: Callable[[], float]) -> Controlled:
    """The last run; where it misses the accuracy, with the estimate from a usual companion if those in `made` are none."""
    closer_runs = replace(asked, share=CLOSER)
    count, cpu = (0, 0.0) if best.estimate <= accuracy else usual_companion(system, best.solver, closer_runs, made)
    return replace(best, estimate=min(best.estimate, estimate() if count else math.inf)).after(count, cpu)


def closer(asked: Asked, solver: Solver, count: int, kept: int) -> Asked:
    """`asked` for a run after `count` others, with shorter longest steps; kept: how many of these were the first companions."""
    return replace(asked, share=CLOSER**count, impacts=solver.impacts * CLOSER_IMPACTS ** (count - kept))


def _cuts(system: System, solver: Solver, end: float) -> int:
    """Number of stretches into which inputs of time divide a run to the time `end` (s), each at least a step. It depends on the
    tolerance, because tables are divided more finely for a smaller one."""
    if system.timeline is None:
        return 0
    line = system.timeline(system.t0, end, solver.aimed(system.label))
    return 0 if line is None else len(line.stretches.edges) + len(line.edges)


def companions_of(system: System, tight: Solver, asked: Asked) -> tuple[Controlled, list[RunAt]]:
    """Make the companions of the run `tight`, with larger tolerances. Returns the last one, and all with their tolerances, the
    largest first. A companion that fails is left out; the last one must not fail."""
    rtols = [min(tight.tolerance * multiple, LOOSEST) for multiple in companions(system, tight)]
    made: list[RunAt] = []
    for rtol in dict.fromkeys(rtols):
        solver = with_rtol(tight, rtol)
        try:
            run = solver.run(system, closer(asked, tight, len(made), len(rtols)))
        except SolverError as error:
            if rtol == rtols[-1] or isinstance(error, FINAL):
                raise
            continue
        made.append((rtol, run))
    return Controlled(run, solver, float("inf"), len(made), sum(one.stats.cpu_s for _, one in made)), made


def with_short_vibrations(run: Controlled, system: System, prepared: Prepared | None, accuracy: float,
                           measure: Measure) -> Controlled:
    """The run with an estimate that includes vibrations with periods shorter than its constant steps. Runs with a step and with
    half of it reproduce them equally badly, so that their difference does not show them. Measured: an estimate of 5e-6 where a
    stiff spring vibrated with 2e-4."""
    close = RadauIIA(3).at_accuracy(max(accuracy, 1e-9), system.label)
    return with_left_out(run, Probe(close, system, prepared, FIRST_STEPS * run.solution.stats.h_max, PROBES), measure)


class Probe(NamedTuple):
    """How short runs are made that show vibrations left out of a run: by `solver`, of `system`, of length `span` (s), from the
    start of the run and from every excitation by its inputs. Each is compared with the run at `samples` times, and the distance
    is multiplied by `margin`."""

    solver: Solver
    system: System
    prepared: Prepared | None
    span: float
    samples: int
    margin: float = 1.0


def with_left_out(run: Controlled, probe: Probe, measure: Measure) -> Controlled:
    """The run with an estimate that includes its largest distance from the short runs of `probe` (infinite where one of them
    fails in its first steps), with their cost added, and with them among its `others`."""
    solution, estimate = run.solution, run.estimate
    for begin, end in windows(probe.system, solution, probe.span):
        try:
            with keeping(solution, UNTESTED):
                most = 10 * solution.stats.residuals + 10000
                close = probe.solver.run(beginning_at(probe.system, solution, begin),
                                         Asked(end, max_residuals=most, share=SHARE))
        except WallClockError:
            raise
        except SolverError as error:
            if error.solution is None or len(error.solution.t) < 3:
                return replace(run, estimate=float("inf"), others=()).after(1, cpu_of(error))
            close = error.solution
        times = np.linspace(begin, float(close.t[-1]), probe.samples)
        left = probe.margin * _apart(solution, close, times, measure)
        estimate = max(estimate, left + (run.estimate if begin == solution.t[0] else 0.0))
        beside = other_run(probe.system, probe.prepared, close, times, probe.margin, "window") if run.others else ()
        run = replace(run, others=(*run.others, *beside)).after(1, close.stats.cpu_s)
    return replace(run, estimate=estimate)


def _apart(run: Solution, close: Solution, times: Array, measure: Measure) -> float:
    """Largest distance of the run `close` from `run` at some times; differences of velocities are relative to the speeds of the
    whole `run`."""
    steps = run.t[:: len(run.t) // SAMPLES + 1]
    both = np.concatenate([times, steps])
    return float(np.max(measure(both, run(both), np.concatenate([close(times), run(steps)]))))


def plausible(accuracy: Any, name: str = "accuracy") -> float:
    """An accuracy as a float; OptionError outside 1e-12 to 0.1."""
    found: float = option(name, accuracy, number, "give a number from 1e-12 to 0.1 (1e-6 serves most)", least=1e-12, most=1e-1)
    return found
