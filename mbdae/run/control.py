"""From the accuracy a user asks for to a run that has it: companion runs measure the error instead of trusting rtol.

Every controlled run is made twice, at a multiple of the tolerance and at the tolerance itself (with contacts three times);
their differences and the law by which the error falls estimate the error of the last (`estimate`). Where that is above what
was asked, the run is repeated with a tighter tolerance. The measured factors between accuracy and rtol (`Solver.factors`)
only choose where to begin.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import AccuracyWarning, SolverError, WallClockError, keeping
from mbdae.integrators.base import SHARE, Solver
from mbdae.integrators.distance import Measure, check_times, scaled_distance
from mbdae.integrators.halving import halved
from mbdae.integrators.solution import Solution
from mbdae.results.reactions import OtherRun, states_of
from mbdae.run.estimate import Run, companions, estimated, share_of
from mbdae.run.kicks import beginning_at, windows
from mbdae.run.resolution import largest_tolerance, resolving
from mbdae.system.base import Array, System
from mbdae.system.model.nodes import Node
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.values import number, option

LOOSEST = 1e-2
ATTEMPTS = 5  #: runs at tolerances below that of the first companions, and one
#: part of the width of an input of time that a step may cover, over that of the run before: where this width alone bounds the
#: steps of both, equal steps would make their difference say nothing. Neighbouring widths differ by 2: it is less than half
CLOSER = 0.4
UNKNOWN = "the run attached (rtol = {:g}) is complete, its error is not known"
UNTESTED = "the run attached is complete; what its steps may leave out is not known"
CRAWL = 10  #: residual evaluations of a run over those of its companion at which it is given up
#: runs with contact whose estimate has fallen by less than CHAOTIC after two repeats are not repeated any more
CHAOTIC = 2.0
CHAOS = ("tighter tolerances changed the estimate from {:.1e} to {:.1e} only: the motion is chaotic, and its digits are lost at "
         "some time; trust energies, forces and statistics, or a shorter run")  # fmt: skip
#: tolerance of a repeated run over that of the run before, at least and at most
FINER, FINER_WITH_IMPACTS = (1e-3, 0.3), (0.1, 0.3)
COARSE = 3.0  #: a run is repeated where its tolerance exceeds that of the penetrations found by more than this
SAMPLES = 200  #: times at which reactions of two runs are compared
FIRST_STEPS, PROBES = 5.0, 200  #: constant steps after the start that are compared with a run that resolves them, and where


@dataclass(frozen=True)
class Controlled:
    """A run, the estimate of its error, how many runs it took and their CPU seconds; the runs that told the error; waves: it
    resolves all vibrations of beams, whatever its form was asked to."""

    solution: Solution
    solver: Solver
    estimate: float
    runs: int
    cpu_s: float
    notes: tuple[str, ...] = ()
    others: tuple[OtherRun, ...] = ()
    waves: bool = False

    def after(self, runs: int, cpu_s: float) -> Controlled:
        """The run with the cost of others that were made for it."""
        return replace(self, runs=self.runs + runs, cpu_s=self.cpu_s + cpu_s)


def cpu_of(error: SolverError) -> float:
    """CPU seconds of a run that failed."""
    return 0.0 if error.solution is None else float(error.solution.stats.cpu_s)


Motion = tuple[Array, Array]  #: q (nt, nq), u (nt, nu) of all nodes


def motion_distance(prepared: Prepared, a: Motion, b: Motion) -> Array:
    """(nt,) difference of two motions: positions over the scene's length, angles in rad; without beams also velocities
    over the largest of length / characteristic time and the speed reached (those of beams ring), except where one of the
    motions is in contact: an impact a moment later is no error of the speed it leaves with."""
    m, (q_a, u_a), (q_b, u_b) = prepared.mechanics, a, b
    worst = np.zeros(len(q_a))
    apart = np.ones(len(q_a), dtype=bool)
    if prepared.contacts:
        apart = ~np.logical_or(touching(m, *a), touching(m, *b))
    for mask, unit in ((~m.rotational, prepared.length), (m.rotational, 1.0)):
        if mask.any() and not m.model.lines:
            reference = max(unit / prepared.time, float(np.max(np.abs(u_b[:, mask]))))
            worst = np.maximum(worst, apart * np.max(np.abs(u_a - u_b)[:, mask], axis=1) / reference)
    for node in m.model.nodes:
        at = slice(node.q, node.q + node.kind.sizes[0])
        worst = np.maximum(worst, position_distance(prepared, node, q_a[:, at], q_b[:, at]))
    return worst


def position_distance(prepared: Prepared, node: Node, a: Array, b: Array) -> Array:
    """(nt,) difference of two positions (nt, size) of a node: over the scene's length, angles in rad."""
    n, unit = node.kind.translations, prepared.length if node.unit == "m" else 1.0
    apart = np.linalg.norm(a[:, :n] - b[:, :n], axis=1) / unit
    if a.shape[1] == 3 and node.kind.turns:
        apart = np.maximum(apart, np.abs(a[:, 2] - b[:, 2]))
    elif a.shape[1] == 7:
        apart = np.maximum(apart, _angle_between(a[:, 3:], b[:, 3:]))
    return np.asarray(apart)


def touching(mechanics: Mechanics, q: Array, u: Array) -> Array:
    """(nt,) bool: whether any contact of a scene is made."""
    gaps = gaps_of(mechanics, np.zeros(len(q)), q, u)
    return np.asarray(np.any(np.hstack([gap for gap, _ in gaps.values()]) < 0, axis=1))


def distance(prepared: Prepared, t: Array, a: Array, b: Array) -> Array:
    """(nt,) `motion_distance` of two trajectories (nt, n) of unknowns at times t, over the motion of all bodies."""
    return motion_distance(prepared, prepared.states(t, a)[:2], prepared.states(t, b)[:2])


def _angle_between(P: Array, Q: Array) -> Array:
    """Angle (nt,) of the rotation between quaternions (nt, 4) of any length."""
    p, q = P / np.linalg.norm(P, axis=1, keepdims=True), Q / np.linalg.norm(Q, axis=1, keepdims=True)
    gap = np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    return np.asarray(4 * np.arcsin(np.clip(gap / 2, 0, 1)))


def measure_of(system: System, prepared: Prepared | None) -> Measure:
    """The distance between trajectories of a system."""
    if prepared is not None and isinstance(system, SceneSystem):
        return lambda t, a, b: distance(prepared, t, a, b)
    return lambda t, a, b: scaled_distance(system, a, b)


def other_run(system: System, prepared: Prepared | None, run: Solution, times: Array, share: float) -> tuple[OtherRun, ...]:
    """What is kept of a run that tells the error of another: its states at SAMPLES of the times at which both are compared.

    With contacts the whole difference is the error of forces: measured, that of an impact does not fall as the motion's."""
    if prepared is None or not isinstance(system, SceneSystem):
        return ()
    share = 1.0 if prepared.contacts else share
    chosen = np.unique(np.linspace(0, len(times) - 1, SAMPLES).astype(int))
    return (OtherRun(states_of(prepared, run, times[chosen]), share),)


def run_controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, t_end: float, outputs: Array,
                   begin: float | None = None, **options: Any) -> Controlled:  # fmt: skip
    """Integrate until the estimated error is below `accuracy`, or as near as the solver comes.

    begin: time.perf_counter() from which max_wall counts, for all runs together; now by default."""
    begin = time.perf_counter() if begin is None else begin
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AccuracyWarning)
        run = _controlled(system, prepared, solver, accuracy, t_end, outputs, begin, options)
    return replace(run, notes=tuple(dict.fromkeys([*run.notes, *(str(w.message) for w in caught)])))


def _controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, t_end: float,
                outputs: Array, begin: float, options: dict[str, Any]) -> Controlled:  # fmt: skip
    measure = measure_of(system, prepared)
    if solver.by_steps:
        found = halved(solver, system, t_end, accuracy, measure, begin=begin, **options)
        run = Controlled(found.solution, found.solver, found.estimate, found.runs, found.cpu_s)
        others = other_run(system, prepared, *found.coarser) if found.coarser is not None else ()
        return with_stepped_over(replace(run, others=others), system, prepared, accuracy, measure)
    ceiling = largest_tolerance(prepared, solver) if prepared is not None else float("inf")
    limit = solver.tightest.get(system.label, solver.tightest[""])
    tight = solver.at_accuracy(accuracy, system.label)
    tight = _with_rtol(tight, min(tight.tolerance, LOOSEST / 2, max(ceiling, limit)))
    best, made = _companions_of(system, tight, t_end, begin=begin, **options)
    most, estimates, count, kept = ATTEMPTS - 1 + best.runs, list[float](), len(made), len(companions(system, solver))
    while best.runs < most:
        loose, coarse = made[-1]
        try:
            most_residuals = CRAWL * coarse.stats.residuals + 10000
            with keeping(best.solution, UNKNOWN.format(best.solver.rtol)):
                fine = tight.solve(system, t_end, max_residuals=most_residuals, begin=begin, share=CLOSER**count, **options)
        except WallClockError as error:
            raise WallClockError(
                f"max_wall = {options['max_wall']:g} s of wall time is used up while the error was measured: "
                f"{UNKNOWN.format(best.solver.rtol)}; raise max_wall or loosen the accuracy",
                error.time, error.culprit, best.solution) from error  # fmt: skip
        except SolverError as error:
            best = _after_failure(best, error)
            tight = _with_rtol(tight, (tight.tolerance * loose) ** 0.5)
            if tight.tolerance > 0.5 * loose:
                return best
            continue
        cpu, runs = best.cpu_s + fine.stats.cpu_s, best.runs + 1
        made, count = [*made[-kept:], (tight.tolerance, fine)], count + 1  # runs are large: earlier ones are not needed any more
        estimates.append(estimated(system, solver, made, measure, outputs))
        share = share_of(system, solver, tight.tolerance / loose)
        others = other_run(system, prepared, coarse, check_times(coarse, outputs), share)
        best = Controlled(fine, tight, estimates[-1], runs, cpu, best.notes, others)
        ceiling = max(resolving(prepared, solver, fine, ceiling), limit)
        too_coarse = tight.tolerance > COARSE * ceiling
        if (best.estimate <= accuracy and not too_coarse) or tight.tolerance <= limit * (1 + 1e-9):
            return best
        if too_coarse:
            tight = _with_rtol(tight, ceiling)
            continue
        if system.guards is not None and len(estimates) > 2 and best.estimate > max(estimates[:-1]) / CHAOTIC:
            return replace(best, notes=(*best.notes, CHAOS.format(max(estimates[:-1]), best.estimate)))
        least = (0.5 * accuracy / best.estimate) ** (1 / 0.9)
        wanted = tight.tolerance * float(np.clip(least, *(FINER if system.guards is None else FINER_WITH_IMPACTS)))
        tight = _with_rtol(tight, max(wanted, limit))
    return best


def _companions_of(system: System, tight: Solver, t_end: float, **options: Any) -> tuple[Controlled, list[Run]]:
    """The last of the runs with which the first at a tolerance is compared, and all of them, the loosest first. Those but the
    last may fail, and are left out then."""
    rtols = [min(tight.tolerance * multiple, LOOSEST) for multiple in companions(system, tight)]
    made: list[Run] = []
    cpu = 0.0
    for rtol in dict.fromkeys(rtols):
        solver = _with_rtol(tight, rtol)
        try:
            run = solver.solve(system, t_end, share=CLOSER ** len(made), **options)
        except SolverError as error:
            if rtol == rtols[-1] or isinstance(error, WallClockError):
                raise
            continue
        cpu += run.stats.cpu_s
        made.append((rtol, run))
    return Controlled(run, solver, float("inf"), len(made), cpu), made


def with_stepped_over(run: Controlled, system: System, prepared: Prepared | None, accuracy: float,
                      measure: Measure) -> Controlled:  # fmt: skip
    """The run with what constant steps leave out in its estimate: vibrations that are shorter than a step look alike with steps
    of half the size, so that halving does not show them. Measured: 5e-6 where a stiff spring swung by 2e-4."""
    from mbdae.integrators.runge_kutta.radau import RadauIIA

    close = RadauIIA(3).at_accuracy(max(accuracy, 1e-9), system.label)
    return with_left_out(run, Probe(close, system, prepared, FIRST_STEPS * run.solution.stats.h_max, PROBES), measure)


class Probe(NamedTuple):
    """Short runs by another solver or of another system, for `span` (s) from the start of a run and from every kick of its
    inputs; each is compared with that run at so many samples, and what it finds counts `margin` times."""

    solver: Solver
    system: System
    prepared: Prepared | None
    span: float
    samples: int
    margin: float = 1.0


def with_left_out(run: Controlled, probe: Probe, measure: Measure) -> Controlled:
    """The run with its largest distance from a probe in its estimate (infinite where a probe does not come anywhere), with the
    cost of the probes, and with them beside it as other runs that tell its error."""
    solution, estimate = run.solution, run.estimate
    for begin, end in windows(probe.system, solution, probe.span):
        try:
            with keeping(solution, UNTESTED):
                most = 10 * solution.stats.residuals + 10000
                close = probe.solver.solve(beginning_at(probe.system, solution, begin), end, max_residuals=most, share=SHARE)
        except SolverError as error:
            if error.solution is None or len(error.solution.t) < 3:
                return replace(run, estimate=float("inf"), others=()).after(1, cpu_of(error))
            close = error.solution
        times = np.linspace(begin, float(close.t[-1]), probe.samples)
        left = probe.margin * _apart(solution, close, times, measure)
        estimate = max(estimate, left + (run.estimate if begin == solution.t[0] else 0.0))
        beside = other_run(probe.system, probe.prepared, close, times, probe.margin) if run.others else ()
        run = replace(run, others=(*run.others, *beside)).after(1, close.stats.cpu_s)
    return replace(run, estimate=estimate)


def _apart(run: Solution, close: Solution, times: Array, measure: Measure) -> float:
    """Largest distance of two runs at some times, with the speeds of the whole first one as units."""
    steps = run.t[:: len(run.t) // SAMPLES + 1]
    both = np.concatenate([times, steps])
    return float(np.max(measure(both, run(both), np.concatenate([close(times), run(steps)]))))


def _after_failure(best: Controlled, error: SolverError) -> Controlled:
    """The best run so far, with the failure of a tighter one in its notes and its cost counted."""
    return replace(best, notes=(*best.notes, f"a tighter run failed: {error}")).after(1, cpu_of(error))


def _with_rtol(solver: Solver, rtol: float) -> Solver:
    return replace(solver, rtol=rtol)  # type: ignore[type-var]


def plausible(accuracy: Any, name: str = "accuracy") -> float:
    """An accuracy as a plain number; one nobody can mean is refused."""
    found: float = option(name, accuracy, number, "give a number from 1e-12 to 0.1 (1e-6 serves most)", least=1e-12, most=1e-1)
    return found
