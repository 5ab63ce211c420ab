"""Quaternions of different length along a beam, which make interpolated rotations and strains wrong.

A length other than 1 that is common to all does not matter. Measured: lengths from 1 to 1.08 within an element change its strains
by 1e-4.

Positions in which the constraint rows of a closed loop lose rank: two branches of the motion meet there, and a run may change
from one to the other; or a prescribed value goes beyond what the loop can follow, and the run stops (`system.rank.dependencies`).

An error as large as the violation of the rows by the states between two branches suffices to change branch, and a companion run
may change too, so that their difference does not show it.

All warnings about the run that is returned, and whether it is reliable.
"""

from __future__ import annotations

import math

import numpy as np

from mbdae.deferred import median
from mbdae.results.accuracy import Accuracy, against_mesh, left_by_modes
from mbdae.results.result import Result
from mbdae.run.amplification import decided_by_round_off
from mbdae.run.checks import doubts
from mbdae.run.control import LARGE
from mbdae.run.drift import Assessment, doubts_of_steps, energy_drift, joint_drift, reliability
from mbdae.run.estimate import SLOW, Controlled
from mbdae.run.growing import left_behind, total
from mbdae.scene.models import spanning_tree
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.dependent_rows import DEPENDENT, Dependency, dependencies, least_parts
from mbdae.system.model.moved_bodies import expressions_of
from mbdae.system.motion.mechanics import row_sizes
from mbdae.system.prepare import Prepared
from mbdae.system.start import ChangedVelocity
from mbdae.values import largest

UNEQUAL = 1e-3  #: largest relative difference of the quaternion lengths in one element without a warning
SAMPLES = 200  #: largest number of steps of the run at which lengths are compared


def unequal_lengths(result: Result) -> list[str]:
    """A warning for every beam in space whose quaternions differ in length."""
    lines = [line for line in result.prepared.model.lines if line.kind.sizes[0] == 7]
    if not lines:
        return []
    t = result.solution.t
    q = result.states(t[:: len(t) // SAMPLES + 1])[0]
    notes = []
    for line in lines:
        norms = np.stack([np.linalg.norm(q[:, node.q + 3 : node.q + 7], axis=1) for node in line.nodes], axis=1)
        along = norms[:, line.mesh.elements]
        worst = float(np.max(np.max(along, axis=2) / np.min(along, axis=2))) - 1
        if worst > UNEQUAL:
            notes.append(f"beam '{line.beam.name}': quaternions within one element differ in length by {worst:.1e}, which "
                         "strains it falsely (all should have length 1): ask for a smaller accuracy, or more elements")
    return notes


CHOSEN, REFINED = 5, 40  #: largest number of minima between samples that are refined, and number of evaluations for each
#: ratio of the smallest singular value to its median over the run, below which its minimum is refined, and below which a run that
#: stopped may have been on its way to a singular position
NEAR = 0.3
#: singular value up to which a position counts as singular whatever the curvature of the rows, which is then hardly known
ROUNDED = 1e-6
#: the singular values of the LAST steps before a run stopped are compared with those at BEFORE times of the whole run
LAST, BEFORE = 5, 20
#: ratio of the smallest singular value in the LAST steps before a stop to the median over the run, up to which the position
#: counts as singular
SINGULAR = 1e-3
#: where a run stops in a singular position, loops are named for the smallest singular value, and for further ones that are less
#: than TOGETHER times the smallest, or less than ALSO times the median of the smallest over the run
TOGETHER, ALSO = 3.0, 0.05
#: prescribed values count as not possible where they ask for a speed above GROWN times the median of the largest speed in the
#: run; of them those are named that contribute more than PART of the largest contribution
GROWN, PART = 2.5, 0.1
UNCONTROLLED = 1e-6  #: violation of constraint rows that a run without a tolerance is assumed to resolve
#: with form Index1: violation of rows, over the scene's length or in rad, above which it explains a stop in a singular position;
#: a smaller one is mentioned where it can change the smallest singular value by more than NEARBY times the median over the run
DRIFTED, NEARBY = 1e-3, 1e-2
GOLDEN = (5**0.5 - 1) / 2


def singular_passages(result: Result, asked: float | None) -> list[str]:
    """A warning where a run passes a singular position; none for trees, whose rows never lose rank."""
    if not _loops(result):
        return []
    t = result.solution.t
    times = np.interp(np.linspace(0, len(t) - 1, min(SAMPLES, 4 * len(t))), np.arange(len(t)), t)
    resolved = max(asked or 0.0, result.info.solver.rtol or 0.0) or UNCONTROLLED
    for value, when in sorted(_minima(result, times), key=lambda found: found[1]):
        near = _dependencies(result, when)
        if value > ROUNDED and near[0].between > resolved:
            continue
        return [f"the run passes a singular position of {_named(result, near[:1])} at t = {when:.6g} s (smallest singular value "
                f"of its rows {value:.1e}): two branches of the motion meet there, closer than {resolved:.0e} resolves, and the "
                "run may have changed branch; compare with runs at smaller accuracies, or avoid that position"]
    return []


def singular_stop(result: Result, drifts: bool = False) -> str:
    """A sentence on the singular position at which a run stopped, or which it came near to; empty where there is none. Near a
    turning point of a loop the square of the singular value falls linearly with time: its last two values show whether two more
    steps of the same length would reach 0. drifts: whether the form of the run lets joints drift (`FormSpec.drifts`)."""
    if not _loops(result) or len(result.solution.t) < 2:
        return ""
    last = result.solution.t[-LAST:]
    seen = result(last).smallest_singular_value
    value, when = float(np.min(seen)), float(last[np.argmin(seen)])
    before = result(np.linspace(result.solution.t[0], last[-1], BEFORE))
    usual = median(before.smallest_singular_value)
    coming = seen[-1] < NEAR * usual and 3 * seen[-1] ** 2 < 2 * seen[-2] ** 2
    if value > SINGULAR * usual and not coming:
        return ""
    near = _dependencies(result, when, max(TOGETHER * value, ALSO * usual))
    loops = _named(result, near)
    come = "comes" if loops.startswith("the loop ") else "come"
    return (f"near t = {when:.9g} s {loops} {come} to a singular position (smallest singular value of the rows {value:.1e}, "
            f"usually {usual:.1e}), {_why(before, near, usual, drifts)}")


def _why(before: Result, near: list[Dependency], usual: float, drifts: bool) -> str:
    """Why the run `before` a stop comes to a singular position, and what to do; usual: the median of the smallest singular value;
    drifts: as of `singular_stop`. With the curvature c of the rows, a violation of them by e changes the square of that value by
    2 c e."""
    prepared, mechanics = before.prepared, before.prepared.with_all_rows
    violated = np.max(np.abs(mechanics.position_residual(before.t, before.q)), axis=0)
    off = float(np.max(violated / row_sizes(mechanics, prepared.start.t, prepared.start.q)))
    drifted = f"the rows have drifted by {off:.1e} of the scene's length, or rad"
    if drifts and off > DRIFTED:
        return f"after {drifted}: take a smaller accuracy, or mb.GGL(), which holds them"
    may = drifts and 2 * near[0].curvature * off > (NEARBY * usual) ** 2
    doubt = f"; or {drifted} into that position: compare with mb.GGL()" if may else ""
    speeds = np.max(np.abs(before.u / mechanics.velocity_units), axis=1, initial=0.0)
    names = dict[str, None]()
    for one in near:
        if one.speed > GROWN * median(speeds):
            parts = np.abs(one.speeds)
            named = [mechanics.rows[i].name.rsplit(".", 1)[0] for i in np.flatnonzero(parts > PART * np.max(parts)).tolist()]
            names.update(dict.fromkeys(named))
    if names:
        return (f"where it cannot follow what is prescribed for {_listed(list(names))} with finite velocities: prescribe less "
                f"motion, or change the lengths{doubt}")
    return f"where two branches of the motion meet: let the start or the loads keep the scene away from it{doubt}"


def _listed(names: list[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)


def _loops(result: Result) -> list[str]:
    """Names of the joints that close loops, and of interfaces of elastic bodies that do; none where nothing constrains motion."""
    prepared, scene = result.prepared, result.prepared.model.scene
    items = [c for c in scene.connections if c.kind == "interface" or (c.is_joint and c.k is not c.l)]
    return [item.name for item in spanning_tree(scene, items).closing if not item.loose] if prepared.rows else []


def _dependencies(result: Result, t: float, below: float = 0.0) -> list[Dependency]:
    """The dependencies of all rows at the time t (s) of a run."""
    return dependencies(result.prepared.with_all_rows, len(result.prepared.rank.kept), t, result([t]).q[0], below)


def _named(result: Result, near: list[Dependency]) -> str:
    """The loops, by the joints that close them, whose rows take part most in the dependencies."""
    rows, loops, names = result.prepared.with_all_rows.rows, _loops(result), dict[str, None]()
    for one in near:
        shares = dict.fromkeys(loops, 0.0)
        for row, coefficient in zip(rows, one.rows.tolist(), strict=True):
            joint = row.name.rsplit(".", 1)[0]
            if joint in shares:
                shares[joint] += coefficient**2
        names[max(shares, key=lambda joint: shares[joint])] = None
    return f"the {'loop' if len(names) == 1 else 'loops'} closed by {_listed(list(names))}"


def _minima(result: Result, times: Array) -> list[tuple[float, float]]:
    """Minima of the smallest singular value of the rows between the first and the last time, with their times (s), sought where
    the smallest independent part of a row has its minima."""
    at = result(times)
    seen = least_parts(result.prepared.with_all_rows, len(result.prepared.rank.kept), at.t, at.q)
    best = float(times[np.argmin(seen)])
    found = [(float(result([best]).smallest_singular_value[0]), best)]
    inner = np.flatnonzero((seen[1:-1] <= seen[:-2]) & (seen[1:-1] <= seen[2:]) & (seen[1:-1] < NEAR * median(seen))) + 1
    for i in sorted(inner, key=lambda i: float(seen[i]))[:CHOSEN]:
        found.append(_minimum(result, float(times[i - 1]), float(times[i + 1])))
    return found


def _minimum(result: Result, a: float, b: float) -> tuple[float, float]:
    """The minimum between two times and its time (s), by golden-section search."""
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_c, at_d = (float(v) for v in result([c, d]).smallest_singular_value)
    for _ in range(REFINED):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - GOLDEN * (b - a)
            at_c = float(result(c).smallest_singular_value[0])
        else:
            a, c, at_c = c, d, at_d
            d = a + GOLDEN * (b - a)
            at_d = float(result(d).smallest_singular_value[0])
    return min((at_c, c), (at_d, d))


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
             *turned_aside(found), *past_their_domain(found), *energy_drift(found, run, known.asked)]
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
    """Warnings about bodies whose inertia is stated as one number, about z, and which turn about other axes in space."""
    found = []
    for node, body in result.prepared.model.bodies:
        if body.principal_plane and node.kind is NodeKind.SPATIAL:
            turning = np.max(np.abs(result.u[:, node.u + 3 : node.u + 6]), axis=0, initial=0.0)
            if max(turning[:2]) > ASIDE * max(1 / result.prepared.time, float(np.max(turning))):
                found.append(f"body '{body.name}' turns about its x or y axis, about which its inertia is 0: one number counts "
                             "about z alone; in space give three principal moments, or a matrix")
    return found


PAST = 1e-9  #: of the scene's length, by which a quantity is negative where a run ends at 0 by `until`


def past_their_domain(result: Result) -> list[str]:
    """Warnings of forces that no longer mean what they state, as a rope off its pulley, or change the stiffness of bodies."""
    found = []
    for c in result.prepared.model.scene.connections:
        for name, words in (entry for law in c.laws for entry in getattr(law, "must_stay", {}).items()):
            seen = getattr(result[c.name], name)
            if (below := np.flatnonzero(np.any(seen < -PAST * result.prepared.length, axis=1))).size:
                found.append(f"{c.kind} '{c.name}', at t = {result.t[below[0]]:.6g} s: {words}")
    off = left_by_modes(result.prepared, result.t, result.q, result.u) if result.prepared.model.elastic else []
    return found + [f"reduced body '{c.k.name}', {words}" for c, x in off for words in c.joint.reduced.doubts(result, c, x)]


def missed(known: Accuracy, run: Controlled) -> list[str]:
    """Warnings where the error of the integration in time, of the mesh of beams or of modes of bodies exceeds the accuracy."""
    asked, notes = known.asked, []
    if asked is None:
        return []
    if known.motion is not None and not known.motion <= asked:
        found = f"about {known.motion:.1e}" if math.isfinite(known.motion) else "not known"
        notes.append(f"accuracy {asked:g} was asked, the error is {found}: {_advice(known.motion, asked, run)}")
    if known.mesh is not None and not known.mesh <= asked:
        notes.append(f"accuracy {asked:g} was asked, the error by the mesh of beams and the modes of bodies is about "
                     f"{known.mesh:.1e}: {against_mesh(known.meshes)}")
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
                f"with the same run; a run over a shorter time comes nearer")
    if len(told) < 2:
        return (f"the error was estimated once, with {size.format(last)}, so that it is not known whether a smaller accuracy "
                "comes nearer: try one, or take a shorter run")
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
                    else "the joints do not stay together")
    left_out = ""
    if m.rows[worst] in prepared.rank.dropped:
        left_out = " (left out as redundant at the start, and not redundant all the way)"
    note = (f"constraint {m.rows[worst].name}{left_out} is violated by {off[worst]:.1e} of the scene's length, or rad: "
            f"{likely_cause}; r.drift shows the violation over time; if it is a numerical error, take a smaller accuracy or rtol")
    return float(off[worst]), [note]
