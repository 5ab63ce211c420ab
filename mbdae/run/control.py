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
from dataclasses import replace

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import FINAL, AccuracyWarning, ChatteringError, SolverError, WallClockError, keeping
from mbdae.inputs.resolution import Bound, kept_by
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Beside, Solution, check_times, in_the_same_steps, rests
from mbdae.integrators.stepped import halved, second_method
from mbdae.results.clearance import OtherRun
from mbdae.results.errors import FAR
from mbdae.results.stored_parts import AskedToo
from mbdae.run.contacts import hidden_contacts, resolving
from mbdae.run.estimate import (
    LOOSEST,
    SLOW,
    Controlled,
    RunAt,
    companions,
    cpu_of,
    estimated,
    fall_shown,
    first_tolerance,
    least_error,
    measure_of,
    nearer_companion,
    other_run,
    share_of,
    usual_companion,
    with_round_off,
    with_rtol,
    with_short_vibrations,
)
from mbdae.run.growing import at_least, bounded, growing, unfollowed, unseen
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.without_multipliers import BranchingError

ATTEMPTS = 5  #: largest number of runs from the last companion on, failed ones included; for batches of estimates
FURTHER = 2  #: with contact, number of further runs: impacts multiply errors, and the first tolerance may be far too large
#: factor from one run to the next on the longest step as a fraction of the time scale of an input of time: where only inputs
#: bound the steps of two runs, these must differ. It is below 1/2 because the time scales are known up to a factor of 2
CLOSER = 0.4
#: the same for the longest step during an impact; in the first run after the companions it is `Solver.impacts` times that of a
#: run without error estimate
CLOSER_IMPACTS = 0.5
UNKNOWN = "the run attached (attribute `solution`, rtol = {:g}) is complete, its error is not known"
USED_UP = "max_wall = {:g} s of wall time is used up while the error was measured: {}; raise max_wall or loosen the accuracy"
#: a run is stopped after this many times the residual evaluations of its companion, plus 10000, plus those that CUT allows
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
#: smallest and largest ratio of the tolerance of a repeated run to that of the run before, without contacts, where vibrations may
#: be left out, and with contacts; round-off and penetrations bound it besides. At the smallest `share_of` is at its least value
FINER, FINER_LEFT_OUT, FINER_WITH_IMPACTS = (6e-3, 0.3), (6e-3, 0.2), (0.1, 0.3)
COARSE = 3.0  #: a run is repeated if its tolerance is this many times the largest that resolves its penetrations and sticking
#: SHALLOW: a contact inside a step counts if its penetration is above this fraction of the accuracy times the scene's length (m;
#: for gaps that are angles, rad); REPEATS: largest number of times that a run is repeated because of such contacts
SHALLOW, REPEATS = 0.1, 5
FOLLOWING = 3  #: largest number of times that a run is repeated because its steps do not follow a disturbance that grows
#: a run whose motion has the accuracy is repeated only while the last one brought what else was asked for nearer than this:
#: tolerances fall to 0.3 or less, and errors with the power SLOW of them at least
STUCK = 0.65
NEARLY = 10.0  #: factor up to which a run that vibrations left out bring above the accuracy is repeated with shorter steps
AT_ROUND_OFF = 1.0  #: smallest ratio of error to difference from a companion at the smallest tolerance; errors need not fall

Besides = Callable[[Controlled], Controlled] | None


def run_controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked,
                   outputs: Array, besides: Besides = None) -> Controlled:
    """Make runs with smaller and smaller tolerances until the estimated error, also at the outputs, is below `accuracy` or cannot
    be made smaller by this solver. The wall time in `asked` is the limit of all runs together. besides: gives a run the estimate
    that contains what no companion shows."""
    asked = replace(asked, begin=time.perf_counter() if asked.begin is None else asked.begin)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AccuracyWarning)
        run = _passing_nothing_over(system, prepared, solver, accuracy, asked, outputs, besides)
        second = None if solver.by_steps else second_method(
                solver, system, asked, accuracy, measure_of(system, prepared, asked.wanted, accuracy))
        if second is not None:
            distance = second.distance(run.solution, run.estimate)
            second.tell(run.estimate, distance, accuracy)
            run = replace(run, estimate=distance).after(second.runs, second.cpu_s)
    notes = [*run.notes, *(str(w.message) for w in caught)]  # of those that differ in the time ("at t = ...") the last
    return replace(run, notes=tuple({note.split(" at t = ")[0]: note for note in notes}.values()))


def following(run: Controlled, system: System, prepared: Prepared, accuracy: float, asked: Asked, outputs: Array) -> Controlled:
    """A run in place of `run` whose steps follow the vibrations that those of it leave out. What grows along it is known."""
    asked = replace(asked, bounds=(*asked.bounds, *run.vibrations), motion_alone=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        found = with_round_off(Search(system, prepared, RadauIIA(5), accuracy, asked, outputs, False).run())
    return replace(found, growth=run.growth, vibrations=run.vibrations)


def _passing_nothing_over(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked,
                          outputs: Array, besides: Besides) -> Controlled:
    """A run in which no contact closes and opens inside a step, and whose steps follow every disturbance that grows unseen: where
    they do not, the run is repeated with shorter steps there, at most REPEATS times. A run that misses the accuracy is also
    repeated because of such contacts in its companions."""
    depth, given = SHALLOW * accuracy * (1.0 if prepared is None else prepared.length), len(asked.bounds)
    runs, cpu, known = 0, 0.0, None
    for repeats in range(REPEATS + 1):
        grown = len(asked.bounds) > given
        search = Search(system, prepared, solver, accuracy, asked, outputs, grown, besides, known)
        try:
            run = (search.by_steps() if solver.by_steps else search.run()).after(runs, cpu)
        except SolverError as error:
            if not grown or isinstance(error, FINAL):
                raise
            made = [other for _, other in search.made[known is not None :]]
            run = run.after(1 + len(made), cpu_of(error) + sum(other.stats.cpu_s for other in made))
            return replace(run, estimate=math.inf, others=(), notes=(*run.notes, f"a run with shorter steps failed: {error}"))
        hidden = hidden_contacts(system, run.solution, depth)
        of_companions = [] if hidden or run.estimate <= accuracy else [
            one for _, other in search.made for one in hidden_contacts(system, other, depth)]
        growth = growing(system, run.solution, grown)
        bounds = unfollowed(growth) if repeats < FOLLOWING else ()
        if bounds and not grown:
            bounds = unseen(growth := growing(system, run.solution, True)) or bounds  # a disturbance may be unseen by turns
        elif not grown and search.made and unseen(growth):  # else such an estimate was made
            run = replace(run, estimate=max(run.estimate, search.estimate(at_least(solver))))
            bounds = () if run.estimate <= accuracy and not solver.starts_low else unseen(growth)
        if not hidden and not of_companions and not bounds:
            return replace(run, growth=tuple(growth))
        runs, cpu, known, asked = run.runs, run.cpu_s, None, replace(asked, bounds=(*asked.bounds, *bounds))
        if ends := [one.ends() for one in hidden + of_companions]:
            asked = replace(asked, edges=distinct(np.concatenate(ends if asked.edges is None else [asked.edges, *ends])))
        elif search.made and system.guards is None and not solver.starts_low and kept_by(run.solution.t, bounds):
            rtol = search.made[-1][0] / companions(system, search.tight)[0]
            known = search.made[-1:], rtol  # it keeps the bounds of a companion: it is that of the next run
    run = replace(run, growth=tuple(growth))
    return replace(run, estimate=float("inf"), others=(), hidden=tuple(hidden)) if hidden else run


class Search:
    """Runs with smaller and smaller tolerances, without the search for hidden contacts. grown: whether steps are bounded by
    growth; known: the first companions, and the tolerance to go on with; made: the last runs, each beside those before it."""

    def __init__(self, system: System, prepared: Prepared | None, solver: Solver, accuracy: float, asked: Asked, outputs: Array,
                 grown: bool, besides: Besides = None, known: tuple[list[RunAt], float] | None = None) -> None:
        self.system, self.prepared, self.solver, self.accuracy = system, prepared, solver, accuracy
        self.asked, self.outputs, self.grown, self.besides, self.known = asked, outputs, grown, besides, known
        self.measure = measure_of(system, prepared, asked.wanted, accuracy)
        self.made: list[RunAt] = []

    def by_steps(self) -> Controlled:
        """The run of a method with constant steps, which are halved instead."""
        what, method = (self.system, self.asked, self.accuracy, self.measure), self.solver
        found = halved(method, *what, second_method(method, *what))
        run = Controlled(found.solution, found.solver, found.estimate, found.runs, found.cpu_s, told=found.told)
        others = other_run(self.system, self.prepared, found.coarser) if found.coarser is not None else ()
        return with_short_vibrations(replace(run, others=others), self.system, self.prepared, self.accuracy, self.measure)

    def run(self) -> Controlled:
        """The first run that has the accuracy, or the last one that can be made."""
        self.tight, self.ceiling, self.limit = first_tolerance(self.system, self.prepared, self.solver, self.accuracy)
        if self.known and self.known[1] >= self.limit:
            self.made, self.tight = self.known[0], with_rtol(self.tight, self.known[1])
            best = Controlled(self.made[-1][1], with_rtol(self.tight, self.made[-1][0]), math.inf, 0, 0.0)
        else:
            best, self.made = companions_of(self.system, self.tight, self.asked, first=True)
        self.first = self.made[-1][0] / self.tight.tolerance
        contacts, told = self.system.guards is not None, list[tuple[float, float]]()
        self._count = self._kept
        for _ in range(ATTEMPTS - 1 + FURTHER * contacts):
            loose, rtol = self.made[-1][0], self.tight.tolerance
            try:
                fine = self._finer(best)
            except SolverError as error:
                if isinstance(error, WallClockError | ChatteringError | BranchingError):
                    raise
                best = replace(best, notes=(*best.notes, f"a tighter run failed: {error}")).after(1, cpu_of(error))
                self.tight = with_rtol(self.tight, (rtol * loose) ** 0.5)
                if self.tight.tolerance > 0.5 * loose:
                    return best
                continue
            best = self._compared_again(self._with_estimate(best, fine, told), told)
            self.ceiling = max(resolving(self.prepared, self.solver, fine, self.ceiling), self.limit)
            last, goal = rtol <= self.limit * (1 + 1e-9), self._goal(fine)
            if rtol > COARSE * self.ceiling and not last:
                self.tight = with_rtol(self.tight, self.ceiling)
                continue
            if best.estimate > goal and not last:
                if self._in_vain(told, rtol / loose):
                    return best
                if not self.grown and goal == self.accuracy:
                    best = self._compared_again(self._beside_usual(best, told), told)
            if best.estimate <= goal or last:
                best = self._judged_again(best)
                best = best if self.besides is None else self.besides(best)
                if last or not self.accuracy < best.estimate < NEARLY * self.accuracy:
                    return best
                told[-1] = rtol, best.estimate
            earlier = max((estimate for _, estimate in told[:-1]), default=0.0)
            if contacts and len(told) > 2 and best.estimate > max(LARGE, earlier / CHAOTIC):
                return replace(best, notes=(*best.notes, CHAOS.format(earlier, best.estimate)))
            fall = min(fall_shown(told), self.solver.error_fall) if best.lost else fall_shown(told)
            falls = float(np.clip((0.5 * goal / best.estimate) ** (1 / fall),
                                  *(FINER_WITH_IMPACTS if contacts else FINER if self.besides is None else FINER_LEFT_OUT)))
            self.tight = with_rtol(self.tight, max(rtol * falls, self.limit))
        return best

    def _goal(self, run: Solution) -> float:
        """The estimate with which a run is kept: the accuracy; FAR of it for what was asked for where its steps met kinks, since
        a larger one, which may be too small there, takes a closer run: that run is rather the one that is returned."""
        met = self.asked.wanted and not self.asked.motion_alone and self.system.guards is None and run.stats.retaken
        return FAR * self.accuracy if met else self.accuracy

    def _in_vain(self, told: list[tuple[float, float]], ratio: float) -> bool:
        """Whether the motion is within the accuracy, and what else was asked for has come no nearer to it by the last run; or
        runs are not repeated for it."""
        if not isinstance(self.measure, AskedToo):
            return False
        if not self.asked.motion_alone and (len(told) < 2 or told[-1][1] < STUCK * told[-2][1]):
            return False
        return self.measure.motion * share_of(self.system, self.solver, ratio) <= self.accuracy

    def _finer(self, best: Controlled) -> Solution:
        """The next run; it is stopped where it costs far more than the one before."""
        system, end = self.system, self.asked.t_end
        line = None if system.timeline is None else system.timeline(system.t0, end, self.tight.aimed(system.label))
        cuts = 0 if line is None else len(line.stretches.edges) + len(line.edges)  # more for a smaller tolerance, with tables
        most = (CRAWL * self.made[-1][1].stats.residuals + 10000 + CUT * cuts) * (LEAVING if self.grown else 1)
        asked = closer(replace(self.asked, max_residuals=most), self.solver, self._count, self._kept)
        try:
            with keeping(best.solution, UNKNOWN.format(best.solver.rtol)):
                if not in_the_same_steps(run := self.tight.run(self.system, asked), self.made[-1][1]) or rests(run, self.measure):
                    return run
                longest = Bound(-math.inf, asked.t_end, CLOSER * float(np.max(np.diff(run.t))) / (asked.share or 1.0))
                return self.tight.run(self.system, replace(asked, bounds=(*asked.bounds, longest)))
        except WallClockError as error:
            raise WallClockError(USED_UP.format(asked.max_wall, UNKNOWN.format(best.solver.rtol)), error.time, error.culprit,
                                 best.solution) from error

    @property
    def _kept(self) -> int:
        """Number of companions that a run is compared with; earlier runs are dropped, because they take much memory."""
        return len(companions(self.system, self.tight))

    def estimate(self, least: float = 0.0) -> float:
        """The estimated error of the last run; least: smallest ratio assumed of it to a difference."""
        return estimated(self.system, self.solver, self.made[-1 - self._kept :], self.measure, self.outputs, least)

    def _with_estimate(self, best: Controlled, fine: Solution, told: list[tuple[float, float]]) -> Controlled:
        """The run `fine`, which followed `best`, with its estimate, and its companions beside it."""
        rtol, coarse = self.tight.tolerance, self.made[-1][1]
        self.made, self._count = [*self.made[-self._kept :], (rtol, fine)], self._count + 1
        found = bounded(self.tight, told, self.estimate, self.first, coarse, fine) if self.grown else self.estimate()
        told.append((rtol, max(found, least_error(self.system, told, rtol) if rtol <= self.limit * (1 + 1e-9) else 0.0)))
        return Controlled(fine, self.tight, told[-1][1], best.runs + 1, best.cpu_s + fine.stats.cpu_s, best.notes, self._others(),
                          told=tuple(told), limit=self.limit)

    def _others(self) -> tuple[OtherRun, ...]:
        """The companions of the last run, beside it."""
        return tuple(one for run in self.made[-1 - self._kept : -1] for one in self._other(run))

    def _beside_usual(self, best: Controlled, told: list[tuple[float, float]]) -> Controlled:
        """The last run, which misses the accuracy beside the run before; where that had a far larger tolerance, beside a usual
        companion instead, which costs less than a tighter run and mostly shows that none is needed."""
        count, cpu = usual_companion(self.system, best.solver, replace(self.asked, share=CLOSER), self.made)
        if not count:
            return best
        told[-1] = told[-1][0], self.estimate()
        return replace(best, estimate=told[-1][1], told=tuple(told), others=self._others()).after(count, cpu)

    def _other(self, companion: RunAt) -> tuple[OtherRun, ...]:
        """A companion of the last run, beside it."""
        (before, run), rtol = companion, self.tight.tolerance
        one = Beside(run, check_times(run, self.outputs), self.measure, share_of(self.system, self.solver, rtol / before, True))
        return other_run(self.system, self.prepared, one, ratio=before / rtol)

    def _compared_again(self, best: Controlled, told: list[tuple[float, float]]) -> Controlled:
        """The last run, compared with one more companion where only the assumed fall of errors brings its estimate below the
        accuracy; not where the estimate of the run before does, fallen as slowly as errors may."""
        if best.estimate > self.accuracy:
            return best
        if len(told) > 1 and self.system.guards is None:
            (loose, before), (tight, _) = told[-2:]
            if before * (tight / loose) ** SLOW <= self.accuracy:
                return best
        with keeping(best.solution, UNKNOWN.format(best.solver.rtol)):
            runs = nearer_companion(self.system, best.solver, closer(self.asked, best.solver, 1, self._kept), self.made,
                                    self.estimate(1.0), self.accuracy)
        if not runs:
            return best
        if self.system.guards is not None:
            self.made = runs
        again = estimated(self.system, self.solver, runs, self.measure, self.outputs)
        told[-1] = (told[-1][0], max(best.estimate, again))
        return replace(best, estimate=told[-1][1], others=(*best.others, *self._other(runs[1])), told=tuple(told)).after(
            1, runs[1][1].stats.cpu_s)

    def _judged_again(self, best: Controlled) -> Controlled:
        """The last run; where it misses the accuracy, with the estimate from a usual companion if those in `made` are none."""
        if best.estimate <= self.accuracy:
            return best
        count, cpu = usual_companion(self.system, best.solver, replace(self.asked, share=CLOSER), self.made)
        again = self.estimate(max(at_least(self.solver) if self.grown else 0.0, AT_ROUND_OFF)) if count else math.inf
        return replace(best, estimate=min(best.estimate, again)).after(count, cpu)


def closer(asked: Asked, solver: Solver, count: int, kept: int) -> Asked:
    """`asked` for a run after `count` others, with shorter longest steps; kept: how many of them were the first companions."""
    return replace(asked, share=CLOSER**count, impacts=solver.impacts * CLOSER_IMPACTS ** (count - kept))


def companions_of(system: System, tight: Solver, asked: Asked, first: bool = False) -> tuple[Controlled, list[RunAt]]:
    """Make the companions of the run `tight`, with larger tolerances; first: only the first that can be made. Returns the last
    one, and all with their tolerances, the largest first. A companion that fails is left out; the last one must not fail."""
    rtols = [min(tight.tolerance * multiple, LOOSEST) for multiple in companions(system, tight)]
    made: list[RunAt] = []
    for count, rtol in enumerate(dict.fromkeys(rtols)):
        if first and made:
            break
        solver = with_rtol(tight, rtol)
        try:
            run = solver.run(system, closer(asked, tight, count, len(rtols)))
        except SolverError as error:
            if rtol == rtols[-1] or isinstance(error, FINAL):
                raise
            continue
        made.append((rtol, run))
    return Controlled(run, solver, float("inf"), len(made), sum(one.stats.cpu_s for _, one in made)), made
