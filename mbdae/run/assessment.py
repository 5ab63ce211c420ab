"""All warnings about the run that is returned, and whether it is reliable."""

from __future__ import annotations

import math

import numpy as np

from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result
from mbdae.run.checks import doubts
from mbdae.run.control import LARGE, Controlled
from mbdae.run.drift import energy_drift, joint_drift
from mbdae.run.estimate import SLOW
from mbdae.run.growth.amplification import decided_by_round_off
from mbdae.run.growth.growing import left_behind, total
from mbdae.run.quaternion_lengths import unequal_lengths
from mbdae.run.reliability import Assessment, doubts_of_steps, reliability
from mbdae.run.singular_positions import singular_passages
from mbdae.symbolic.frames import NodeKind
from mbdae.system.model.inputs import expressions_of
from mbdae.system.motion.mechanics import row_sizes
from mbdae.system.prepare import Prepared
from mbdae.system.rank.rows import DEPENDENT
from mbdae.system.start.start import ChangedVelocity
from mbdae.ties import largest

ROW_SAMPLES = 2000  #: largest number of steps at which constraint rows are evaluated
#: ratio of the error to the estimate from runs of this solver alone, above which the message says that something else limits the
#: error
APART = 2.0
#: a violation of a row up to this many times the novelty of a nearly redundant row that was left out (how independent that is of
#: the other rows, `system/rank`) is explained by a misalignment at the start: 0.2 to 2 times were measured in loops away from
#: singular positions
WITHIN = 10.0
#: violation of a row (divided by the scene's length, or in rad) above which a run is not reliable, where it is also above ten
#: times the accuracy and above what WITHIN explains
TORN = 1e-3
#: a body turns about an axis where the rate is more than ASIDE times its largest rate and 1 / characteristic time of the scene
ASIDE = 1e-6
#: accuracy that words about growing disturbances assume for runs with constant steps
SHARE = 1e-3
ENERGY_SAMPLES = 1000  #: largest number of outputs (of steps, where an input depends on time) at which energies are evaluated


def assessed(found: Result, run: Controlled, drifts: bool) -> Assessment:
    """All warnings about a run, and whether it is reliable; drifts: whether its constraints are imposed on accelerations only
    (index 1)."""
    known, timed = found.info.accuracy, bool(expressions_of(found.prepared.model))
    times = run.solution.t if timed else found.t  # at all steps, since a short input of time may act between outputs
    few = times is found.t and len(times) <= ENERGY_SAMPLES
    contact = reliability(found if few else found(times[:: len(times) // ENERGY_SAMPLES + 1]), run)
    singular = singular_passages(found, known.asked)
    off, broken = _broken_rows(found.prepared, run, known.asked)
    of_run = run.notes if known.met is False or run.solver.fixed or known.asked is None else ()
    rows = (joint_drift(found.prepared, run, known.asked) if drifts else []) or broken
    changed = dict.fromkeys(c for c in found.prepared.start.changes if isinstance(c, ChangedVelocity))
    notes = [*changed, *missed(known, run), *of_run, *rows, *doubts(found.prepared), *doubts_of_steps(run, known.asked),
             *contact.notes, *singular, *growth_words(run, known.asked, found.prepared), *unequal_lengths(found),
             *turned_aside(found), *energy_drift(found, run, known.asked)]  # fmt: skip
    reliable = contact.reliable and off <= TORN and not run.solution.stats.missed_dips
    return Assessment(tuple(notes), reliable, bool(singular), off)


def growth_words(run: Controlled, asked: float | None, prepared: Prepared | None = None) -> list[str]:
    """Words about disturbances that grow so much that round-off decides, and about those that constant steps do not follow.
    prepared: None for own equations."""
    solution = run.solution
    if not run.growth or not solution.systems:
        return []
    accuracy = asked or run.solver.rtol or SHARE
    return [*decided_by_round_off(prepared, solution, total(run.growth), accuracy), *left_behind(run.growth)]


def turned_aside(result: Result) -> list[str]:
    """Warnings about bodies whose inertia is stated as one number, about z, and which turn about other axes of theirs in space:
    about these their inertia is 0."""
    found = []
    for node, body in result.prepared.model.bodies:
        if body.principal_plane and node.kind is NodeKind.SPATIAL:
            turning = np.max(np.abs(result.u[:, node.u + 3 : node.u + 6]), axis=0, initial=0.0)
            if max(turning[:2]) > ASIDE * max(1 / result.prepared.time, float(np.max(turning))):
                found.append(f"body '{body.name}' turns about its x or y axis, about which its inertia is 0: one number counts "
                             "about z alone; in space give three principal moments, or a matrix")  # fmt: skip
    return found


def missed(known: Accuracy, run: Controlled) -> list[str]:
    """Warnings where the estimated error of the integration in time, or that of the mesh of beams, exceeds the accuracy asked."""
    asked, notes = known.asked, []
    if asked is None:
        return []
    if known.motion is not None and not known.motion <= asked:
        found = f"about {known.motion:.1e}" if math.isfinite(known.motion) else "not known"
        notes.append(f"accuracy {asked:g} was asked, the error is {found}: {_advice(known.motion, asked, run)}")
    if known.mesh is not None and not known.mesh <= asked:
        notes.append(f"accuracy {asked:g} was asked, the error by the mesh of the beams is about {known.mesh:.1e}: give them "
                     "more elements or a higher order")  # fmt: skip
    return notes


def _advice(error: float, asked: float, run: Controlled) -> str:
    """Advice in words, from the runs that were made: whether asking for a smaller accuracy makes the error smaller, else what
    limits the error."""
    told = [one for one in run.told if math.isfinite(one[1])]
    size = "steps of {:.2g} s" if run.solver.by_steps else "rtol = {:.1g}"
    if not math.isfinite(error) or not told:
        return "no two runs that can be compared were completed; take another solver, a larger accuracy or a shorter run"
    last, estimate = told[-1]
    if error > APART * estimate:
        return (f"runs of {run.solver.label} alone differ by {estimate:.1e}, the larger error is what another method or shorter "
                "steps show; no run has shown that a smaller accuracy comes nearer: take another solver or a shorter run")
    if last <= run.limit * (1 + 1e-9):
        return (f"{size.format(last)} is the smallest that round-off allows {run.solver.label}, so that a smaller accuracy ends "
                f"with the same run; a run over a shorter time comes nearer")  # fmt: skip
    if len(told) < 2:
        return (f"the error was estimated once, with {size.format(last)}, so that it is not known whether a smaller accuracy "
                "comes nearer: try one, or take a shorter run")  # fmt: skip
    before, earlier = told[-2]
    errors_so_far = f"with {size.format(before)} the error was {earlier:.1e}, with {size.format(last)} {estimate:.1e}"
    if estimate > earlier * (last / before) ** SLOW:
        chaos = "a smaller accuracy comes no nearer where the motion is chaotic, only a shorter run does"
        unknown = "it is not known whether a smaller accuracy comes nearer; a run over a shorter time does"
        return f"{errors_so_far}: {chaos if estimate > LARGE else unknown}"
    return f"{errors_so_far}, so that accuracy={asked / 10:g} comes nearer"


def _misaligned(prepared: Prepared) -> float:
    """Violation of constraint rows (divided by the scene's length, or in rad) that is to be expected because nearly redundant
    rows are left out, about which `doubts` warns; such rows are misaligned by at most `DEPENDENT` at the start."""
    dropped = set(prepared.rank.dropped)
    novelty = max((size for row, size in prepared.rank.doubtful if row in dropped), default=0.0)
    return WITHIN * min(novelty, DEPENDENT)


def _broken_rows(prepared: Prepared, run: Controlled, asked: float | None) -> tuple[float, list[str]]:
    """Largest violation of a constraint row (divided by the scene's length, or in rad), redundant rows included, and a warning
    about it, where it is larger than the accuracy allows; else 0 and no warning."""
    m, t = prepared.with_all_rows, run.solution.t
    if not m.m:
        return 0.0, []
    t = t[:: len(t) // ROW_SAMPLES + 1]
    off = np.max(np.abs(m.position_residual(t, prepared.states(t, run.solution(t))[0])), axis=0)
    off /= row_sizes(m, prepared.start.t, prepared.start.q)
    worst = largest(off)
    if off[worst] <= max(10 * (asked if asked is not None else 1e-6), _misaligned(prepared)):
        return 0.0, []
    driven = any(c.prescribed for c in prepared.model.scene.joints)
    likely_cause = ("prescribed motions may contradict each other there, then release one of them" if driven
                    else "the joints do not stay together")  # fmt: skip
    left_out = ""
    if m.rows[worst] in prepared.rank.dropped:
        left_out = " (left out as redundant at the start, and not redundant all the way)"
    note = (f"constraint {m.rows[worst].name}{left_out} is violated by {off[worst]:.1e} of the scene's length, or rad: "
            f"{likely_cause}; r.drift shows the violation over time; if it is a numerical error, take a smaller accuracy or rtol")
    return float(off[worst]), [note]
