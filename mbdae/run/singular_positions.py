"""Positions in which the constraint rows of a closed loop lose rank: two branches of the motion meet there, and a run may change
from one to the other; or a prescribed value goes beyond what the loop can follow, and the run stops (`system.rank.dependencies`).

An error as large as the violation of the rows by the states between two branches suffices to change branch, and a companion run
may change too, so that their difference does not show it.
"""

from __future__ import annotations

import numpy as np

from mbdae.deferred import median
from mbdae.results.result import Result
from mbdae.scene.topology import spanning_tree
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import row_sizes
from mbdae.system.rank.dependencies import Dependency, dependencies

SAMPLES = 200  #: largest number of positions evaluated along the run
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
                "run may have changed branch; compare with runs at smaller accuracies, or avoid that position"]  # fmt: skip
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
                f"motion, or change the lengths{doubt}")  # fmt: skip
    return f"where two branches of the motion meet: let the start or the loads keep the scene away from it{doubt}"


def _listed(names: list[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)


def _loops(result: Result) -> list[str]:
    """Names of the joints that close loops; none where nothing constrains the motion."""
    prepared = result.prepared
    return [joint.name for joint in spanning_tree(prepared.model.scene).closing if not joint.loose] if prepared.rows else []


def _dependencies(result: Result, t: float, below: float = 0.0) -> list[Dependency]:
    """The dependencies of all rows at the time t (s) of a run."""
    at = result([t])
    return dependencies(result.prepared.with_all_rows, len(result.prepared.rank.kept), t, at.q[0], below)


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
    """Minima of the smallest singular value of the rows between the first and the last time, with their times (s)."""
    seen = result(times).smallest_singular_value
    best = int(np.argmin(seen))
    found = [(float(seen[best]), float(times[best]))]
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

