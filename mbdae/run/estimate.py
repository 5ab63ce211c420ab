"""The error of a run, estimated from companion runs at larger tolerances.

If a tolerance smaller by the factor r makes the error smaller by r**fall or more, the errors e of a run and E of its companion
obey e <= x E with x = r**fall. They differ by at least E - e, so that e <= x / (1 - x) times their difference.

Sequences of impacts violate this assumption: the time of each depends on all before, and errors at neighbouring tolerances
may be nearly equal. Measured with a slider-crank with clearance at tolerances from 1e-4 to 3e-10, one companion and the exponent
of smooth motion: too small by more than a factor of 3 in 11 % of 104 pairs; with FALL_WITH_IMPACTS and two companions in none.

Where the duration of an impact bounds the steps, runs at different tolerances take the same steps and have the same error.
Companions may therefore take longer steps in it (`CLOSER_IMPACTS` of `control`). Measured on 266 drawn scenes with balls and
pins: with the same bound the estimate is too small by more than 3 in 44 % of 88 cases with DOP853, with longer steps of
companions, and the differences themselves where they contradict the assumed fall (`contradicted`), in 2.5 %, by 4.1 at worst.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import FINAL, SolverError, WallClockError, keeping
from mbdae.inputs.resolution import Bound
from mbdae.integrators.base import SHARE, Asked, Solver
from mbdae.integrators.constant import roots_about, roots_beside
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Beside, Measure, Solution, by_speeds, check_times, scaled_distance, systems_at
from mbdae.results.clearance import OtherRun, some_of
from mbdae.results.stored_parts import AskedToo
from mbdae.run.amplification import entries_of
from mbdae.run.choice import EIGENVALUES
from mbdae.run.contacts import Hidden, largest_tolerance
from mbdae.run.growing import Growth, is_explicit
from mbdae.run.pieces import beginning_at, windows
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import distance
from mbdae.system.scene_system import SceneSystem

LOOSEST = 1e-2  #: largest rtol of a companion; the other runs have at most half of it
FALL_WITH_IMPACTS = 0.5
LEAST = 0.05  #: smallest ratio that is assumed of the error of a run to its difference from a companion
#: FALL: errors are assumed to fall with this power of the tolerance, or with the power that the last two runs showed where that
#: is smaller; SLOW, STEEP: smallest and largest power assumed
FALL, SLOW, STEEP = 0.9, 0.4, 1.5
#: steps rejected for their error, over accepted ones, from which on the errors of a method are taken to scatter with its
#: tolerance, where that is above COARSE_STEPS; with smaller ones they fall regularly
ERRATIC, COARSE_STEPS = 0.2, 1e-8
#: FARTHEST: largest ratio of the tolerance of a companion to that of a run, without contacts; REGULAR: accuracy down from which
#: errors fall regularly enough for it. Measured on 36 random mechanisms at 1e-5 to 1e-7: estimates from 32 times the tolerance
#: are at least 0.5 (DOP853) and 1.6 times the error (RadauIIA(3); from 10 times: 0.5, 1.9), and the companion takes 70 and 46 %
#: of the run (79, 58 %). At 1e-3 they are 0.1 times the error at worst (0.2), and the companion is no cheaper
FARTHEST, REGULAR = 30.0, 3e-4

#: ratio to the usual tolerance from which on a companion is no usual one (at 1000 times it an estimate was 80 times the error)
UNUSUAL = 3.0
RunAt = tuple[float, Solution]  #: tolerance and solution of a run


def companions(system: System, solver: Solver) -> list[float]:
    """Tolerances of the companions of a first run, relative to its own, the largest first; with contacts two."""
    if system.guards is not None:
        return [float(solver.companion**power) for power in (1.5, 0.5)]
    return [min(max(REGULAR / (solver.aimed(system.label) or REGULAR), solver.companion), max(FARTHEST, solver.companion))]


def usual_companion(system: System, solver: Solver, asked: Asked, runs: list[RunAt]) -> tuple[int, float]:
    """Put a companion beside the last of several runs, which has the smallest tolerance there is, where the one before has
    another tolerance than companions have. Returns the number of runs made and their CPU time (s); with contacts none is."""
    usual, ratio = companions(system, solver)[0], runs[-2][0] / solver.tolerance
    if system.guards is not None or solver.companion / UNUSUAL <= ratio <= UNUSUAL * usual:
        return 0, 0.0
    run = _companion(system, with_rtol(solver, usual * solver.tolerance), asked, runs[-1][1].stats.residuals)
    if run is not None:
        runs.insert(-1, (usual * solver.tolerance, run))
    return (0, 0.0) if run is None else (1, run.stats.cpu_s)


def _companion(system: System, solver: Solver, asked: Asked, most: int) -> Solution | None:
    """A further companion with at most so many residual evaluations; None where it cannot be made."""
    try:
        return solver.run(system, replace(asked, max_residuals=most))
    except SolverError as error:
        if isinstance(error, FINAL):
            raise
        return None


def nearer_companion(system: System, solver: Solver, asked: Asked, runs: Sequence[RunAt], difference: float,
                     accuracy: float) -> list[RunAt]:
    """The last of `runs` with its companion and one more between them: with contacts, where there is one companion only; where
    errors scatter with the tolerance: with BDF, if only the assumed fall of errors brings the `difference` of the two below the
    accuracy; with any method at a coarse tolerance that rejects many of its steps, because two such runs may have nearly equal
    errors. Else nothing.

    Measured with IDA on a linkage that passes a position in which it nearly locks: 4.3e-5 at rtol 6e-7, 9e-6 at 2e-7, 1.2e-4 at
    6e-8, 4.7e-5 at 2e-8; with DOP853 on a pendulum over 25 periods: 3.3e-2 at 3e-5, 1.1e-3 at 3e-6, 1.6e-3 at 9e-7, 1.2e-3 at
    3e-7. Of 540 runs of pendulums over 20 to 80 s at 1e-3 to 1e-5, 10 were silently wrong before, 0 with the run between."""
    (loose, coarse), (tight, fine) = runs[-2:]
    erratic = tight > COARSE_STEPS and any(
        run.stats.rejected - run.stats.newton_failures > ERRATIC * run.stats.steps for run in (coarse, fine))
    if not (erratic or (solver.bdf_order and difference > accuracy) if system.guards is None else len(runs) == 2):
        return []
    between = tight * (loose / tight) ** (0.5 if system.guards is None else 1 / 3)
    run = _companion(system, with_rtol(solver, between), asked, 10 * fine.stats.residuals + 10000)
    return [] if run is None else [(loose, coarse), (between, run), (tight, fine)]


def with_rtol(solver: Solver, rtol: float | None) -> Solver:
    """The solver with another tolerance."""
    return replace(solver, rtol=rtol)  # type: ignore[type-var]


def first_tolerance(system: System, prepared: Prepared | None, solver: Solver, accuracy: float) -> tuple[Solver, float, float]:
    """The solver with the tolerance of a first run; the largest that resolves contacts, the smallest that round-off allows."""
    ceiling = largest_tolerance(prepared, solver) if prepared is not None else float("inf")
    limit = solver.tightest.get(system.label, solver.tightest[""])
    tight = solver.at_accuracy(accuracy, system.label)
    return with_rtol(tight, min(tight.tolerance, LOOSEST / 2, max(ceiling, limit))), ceiling, limit


def fall_of(system: System, solver: Solver) -> float:
    """Power of the tolerance with which the errors of a solver are assumed to fall between neighbouring tolerances."""
    return solver.error_fall if system.guards is None else min(solver.error_fall, FALL_WITH_IMPACTS)


def share_of(system: System, solver: Solver, ratio: float, forces: bool = False) -> float:
    """Assumed ratio of the error of a run to its difference from a companion; ratio: tolerance of the run over the companion's;
    forces: whether forces are compared too, whose errors fall more slowly, as those of vibrations do that a run passes over."""
    x = ratio ** (fall := fall_of(system, solver))
    passes = isinstance(system, SceneSystem) and system.assembly.passes
    if system.guards is None and not (forces or passes):  # the scatter of two runs does not grow with the ratio
        x *= min(ratio * solver.companion, 1.0) ** (FALL - fall)
    return float(max(x / (1 - x), LEAST))


def contradicted(gaps: Sequence[float], ratios: Sequence[float], fall: float) -> bool:
    """Whether the differences of a run from its two companions show that errors fall more slowly than with the power `fall` of
    the tolerance.

    gaps: differences from the companions; ratios: tolerances of these over that of the run; both for the looser companion
    first."""
    (wide, near), (far, close) = gaps, ratios
    return bool(wide * (close**fall - 1) < near * (far**fall - 1))


def estimated(system: System, solver: Solver, runs: Sequence[RunAt], measure: Measure, outputs: Array,
              least: float = 0.0) -> float:
    """Estimated error of the last of several runs with falling tolerances. Its companions are the runs before it, one or two
    (`companions`, `nearer_companion`). The largest of their estimates is taken; where two show that errors fall more slowly than
    assumed, at least the larger difference. least: smallest ratio assumed of the error to a difference."""
    (tolerance, fine), forces = runs[-1], isinstance(measure, AskedToo)
    gaps, ratios, found = [], [], 0.0
    for before, coarse in runs[:-1]:
        ratios.append(before / tolerance)
        gaps.append(Beside(coarse, check_times(coarse, outputs), measure, ratio=ratios[-1]).distance(fine))
        found = max(found, gaps[-1] * max(share_of(system, solver, tolerance / before, forces), least))
    if len(gaps) == 2 and contradicted(gaps, ratios, fall_of(system, solver)):
        found = max(found, *gaps)
    return found


def fall_shown(told: list[tuple[float, float]]) -> float:
    """The power of the tolerance with which errors are assumed to fall: FALL, or that of the last two runs where that is smaller,
    as where looser runs leave out vibrations that tighter ones resolve. told: tolerance and estimate of every run."""
    if len(told) < 2:
        return FALL
    (loose, before), (tight, now) = told[-2:]
    return min(max(math.log(before / now) / math.log(loose / tight), SLOW), FALL) if 0 < now < before else SLOW


def least_error(system: System, told: list[tuple[float, float]], rtol: float) -> float:
    """The least error of a run with the smallest tolerance, where round-off may bring it as far away as its companion: 9e-5 was
    measured beside a difference of 2e-7. With contacts 0: the estimates before may come from one unlucky step."""
    known = told and system.guards is None and math.isfinite(told[-1][1])
    return told[-1][1] * (rtol / told[-1][0]) ** STEEP if known else 0.0


#: said where short runs beside a complete one could not be made
UNTESTED = "the run attached (attribute `solution`) is complete; whether its steps leave out fast vibrations was not tested"
#: length, in longest steps, of short runs that show vibrations shorter than a step, and number of times of the comparison
FIRST_STEPS, PROBES = 5.0, 200


@dataclass(frozen=True)
class Controlled:
    """A run, its estimated error, the number of runs made for it and their CPU time (s). others: runs that it was compared with;
    waves: whether it resolves all elastic vibrations although its form does not demand it; told: for every run with an estimate,
    in order, its tolerance (or constant step, s) and the estimate from runs of its method alone; limit: the smallest tolerance
    that round-off allows; hidden: contacts that close and open inside its steps; growth: of small disturbances along it;
    vibrations: bounds of steps that follow those which its own leave out; lost: whether the estimate contains elastic ones."""

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
    vibrations: tuple[Bound, ...] = ()
    lost: bool = False

    def after(self, runs: int, cpu_s: float) -> Controlled:
        """The same run, with a number of other runs and their CPU time (s) added to `runs` and `cpu_s`."""
        return replace(self, runs=self.runs + runs, cpu_s=self.cpu_s + cpu_s)


def cpu_of(error: SolverError) -> float:
    """CPU time of a run that failed, s."""
    return 0.0 if error.solution is None else float(error.solution.stats.cpu_s)


def measure_of(system: System, prepared: Prepared | None, wanted: Any = None, asked: float | None = None) -> Measure:
    """The distance between two trajectories of a system: of motions for a scene, and of the quantities `wanted`, `asked` for with
    this accuracy, else of unknowns."""
    if wanted and prepared is not None and isinstance(system, SceneSystem):
        return AskedToo(prepared, system, wanted, asked)
    if prepared is not None and isinstance(system, SceneSystem):
        return partial(distance, prepared)
    if system.measure is not None:
        return system.measure  # type: ignore[no-any-return]
    return lambda t, a, b: scaled_distance(system, a, b)


def other_run(system: System, prepared: Prepared | None, one: Beside, kind: str = "companion",
              ratio: float = 0.0) -> tuple[OtherRun, ...]:
    """A run beside the run that is returned, with some of the times of their comparison, to estimate errors of all that is read.
    ratio: its tolerance over the run's."""
    if prepared is None or not isinstance(system, SceneSystem):
        return ()
    share = 1.0 if prepared.contacts else one.margin  # errors of forces were measured to fall more slowly than those of motions
    times = some_of(one.times, one.run.y.shape[1], bool(prepared.contacts))
    return (OtherRun.beside(one.run, times, share, kind=kind, ratio=ratio),)


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
    is multiplied by `margin`. longest: bound of their steps, s."""

    solver: Solver
    system: System
    prepared: Prepared | None
    span: float
    samples: int
    margin: float = 1.0
    longest: float = math.inf


def with_left_out(run: Controlled, probe: Probe, measure: Measure) -> Controlled:
    """The run with an estimate that includes its largest distance from the short runs of `probe` (infinite where one of them
    fails in its first steps), with their cost added, and with them among its `others`."""
    solution, estimate = run.solution, run.estimate
    for begin, end in windows(probe.system, solution, probe.span):
        try:
            with keeping(solution, UNTESTED):
                most = 10 * solution.stats.residuals + 10000
                bounds = (Bound(begin, end, probe.longest / SHARE),) if probe.longest < math.inf else ()
                close = probe.solver.run(beginning_at(probe.system, solution, begin),
                                         Asked(end, max_residuals=most, share=SHARE, bounds=bounds))
        except WallClockError:
            raise
        except SolverError as error:
            if error.solution is None or len(error.solution.t) < 3:
                return replace(run, estimate=float("inf"), others=()).after(1, cpu_of(error))
            close = error.solution
        times = np.linspace(begin, float(close.t[-1]), probe.samples)
        window = Beside(close, times, by_speeds(solution, measure), probe.margin, better=True)
        estimate = max(estimate, window.error(solution) + (run.estimate if begin == solution.t[0] else 0.0))
        beside = other_run(probe.system, probe.prepared, window, "window") if run.others else ()
        run = replace(run, others=(*run.others, *beside)).after(1, close.stats.cpu_s)
    return replace(run, estimate=estimate)


#: STATES: number of states of a run at which its vibrations are sought. One counts as left out where a step is longer than half
#: its period, since neither the error test nor a companion run, which steps over it too, shows its force; and where less than
#: DAMPED of the critical damping acts on it, so that several of its periods last
STATES, DAMPED = 3, 0.1
#: short runs show vibrations of frequencies up to ALIKE times the lowest at once, over PERIODS of the slowest, in steps that turn
#: the phase of the fastest by PHASE rad at most; BOTH: vibrations of two such short runs may add up
ALIKE, PERIODS, PHASE, BOTH = 10.0, 2.0, 0.5, 2.0
#: the phase by which a step of Radau IIA(5) may turn, rad, where all of a run follows them: 2e-9 of the amplitude is lost in it
FOLLOWS = 1.0
#: roots are sought beside SHIFTS over the step, with more than EIGENVALUES unknowns beside ABOUT; of explicit methods, which are
#: stable in steps that are short beside all roots but those near the first, beside that alone
SHIFTS, ABOUT = (30.0, 1e8), (10.0, 1e2, 1e3, 1e4, 1e5)


def left_out(system: System, run: Solution) -> Array:
    """Angular frequencies (k,), rad/s, rising, of weakly damped vibrations with periods shorter than two steps of a run: of its
    equations linearised at a few states. None in runs of explicit methods with so many unknowns that they take sparse matrices:
    these are not stable in such steps."""
    t, memory, few, explicit = run.t, system.memory(), system.n <= EIGENVALUES, is_explicit(run)
    if len(t) < 2 or (explicit and not few):
        return np.zeros(0)
    steps, first = np.diff(t), distinct(np.linspace(0, len(t) - 1, STATES + 1).astype(int))[:-1]
    longest = steps[first] if system.guards is not None else np.maximum.reduceat(steps, first)
    found, systems = [np.zeros(0)], systems_at(run, t[first], system)
    try:
        for one in dict.fromkeys(systems):
            these = np.array([other is one for other in systems])
            at, h = first[these], longest[these]
            equations, *parts = one.linear_stages(t[at], run.y[at], run.yp[at])
            entries = entries_of(equations)
            for number in (SHIFTS[:1] if explicit else SHIFTS) if few else ABOUT:
                roots = (roots_beside if few else roots_about)(entries, parts, number / h)
                w = np.abs(roots.imag)
                found.append(w[(w * h[:, None] > math.pi) & (np.abs(roots.real) < DAMPED * w)])
    finally:
        system.remember(memory)
    return distinct(np.concatenate(found))


def with_vibrations(run: Controlled, system: System, prepared: Prepared, accuracy: float, measure: Measure) -> Controlled:
    """The run with an estimate that includes vibrations that its steps leave out, such as those of stiff springs between bodies:
    they hardly move anything and carry forces."""
    left = w = left_out(system, run.solution) if not run.solver.by_steps else np.zeros(0)  # of constant steps these are known
    close = RadauIIA(3).at_accuracy(max(accuracy, 1e-9), system.label)
    while len(left):
        alike = left[left <= ALIKE * left[0]]
        run = with_left_out(run, Probe(close, system, prepared, PERIODS * 2 * math.pi / float(alike[0]), PROBES, BOTH,
                                       PHASE / float(alike[-1])), measure)
        left = left[len(alike) :]
    return replace(run, vibrations=(Bound(-math.inf, math.inf, FOLLOWS / float(w[-1])),)) if len(w) else run


def with_round_off(run: Controlled) -> Controlled:
    """A run in very many steps, in which round-off adds up (9e-6 in 59 000): its error is the difference from its companion."""
    whole = max((1 / other.share for other in run.others if other.kind == "companion"), default=1.0)
    others = tuple(replace(other, share=max(other.share, 1.0)) for other in run.others)
    return replace(run, estimate=run.estimate * max(whole, 1.0), others=others)
