"""Positions in which the constraint rows of a closed loop lose rank: two branches of the motion meet there, and a run may change
from one to the other.

Where the smallest singular value of the rows is s, the states between the branches violate the rows by only about s^2: an error
of that size suffices to change branch, and a companion run may change too, so that their difference does not show it.
"""

from __future__ import annotations

import numpy as np

from mbdae.deferred import median
from mbdae.results.result import Result
from mbdae.scene.topology import spanning_tree
from mbdae.system.base import Array
from mbdae.system.rank.rows import nearly_vanishing, smallest, unit_rows_at

SAMPLES = 200  #: number of positions evaluated along the run
CHOSEN, REFINED = 5, 40  #: largest number of minima between samples that are refined, and number of evaluations for each
NEAR = 0.3  #: ratio of the smallest singular value to its median over the run below which its minimum is refined
#: the singular values of the LAST steps before a run stopped are compared with those at BEFORE times of the whole run
LAST, BEFORE = 5, 20
SINGULAR = 1e-3  #: ratio of the smallest singular value before a stop to its median, below which the position counts as singular
#: a prescribed value counts as the cause where, without its row, the smallest singular value is this many times as large
RELEASED = 3.0
UNCONTROLLED = 1e-6  #: violation that a run without a tolerance is assumed to resolve
GOLDEN = (5**0.5 - 1) / 2


def singular_passages(result: Result, asked: float | None) -> list[str]:
    """A warning where a run passes a singular position; none for trees, whose rows never lose rank."""
    if not _loops(result):
        return []
    t = result.solution.t
    times = np.interp(np.linspace(0, len(t) - 1, min(SAMPLES, 4 * len(t))), np.arange(len(t)), t)
    value, when = _smallest(result, times)
    resolved = max(asked or 0.0, result.info.solver.rtol or 0.0) or UNCONTROLLED
    if value**2 > resolved:
        return []
    loop, _ = _dependent(result, when)
    return [f"the run passes a singular position of the loop closed by '{loop}' at t = {when:.6g} s (smallest singular value of "
            f"its rows {value:.1e}): two branches of the motion meet there, closer than {resolved:.0e} resolves, and the run may "
            "have changed branch; compare with runs at smaller accuracies, or avoid that position"]  # fmt: skip


def singular_stop(result: Result) -> str:
    """A sentence on the singular position at which a run stopped, or which it came near to; empty where there is none. Near a
    turning point of a loop the square of the singular value falls linearly with time: its last two values show whether two more
    steps of the same length would reach 0."""
    if not _loops(result) or len(result.solution.t) < 2:
        return ""
    last = result.solution.t[-LAST:]
    seen = result(last).smallest_singular_value
    value, when = float(np.min(seen)), float(last[np.argmin(seen)])
    usual = median(result(np.linspace(result.solution.t[0], last[-1], BEFORE)).smallest_singular_value)
    coming = seen[-1] < NEAR * usual and 3 * seen[-1] ** 2 < 2 * seen[-2] ** 2
    if value > SINGULAR * usual and not coming:
        return ""
    loop, driven = _dependent(result, when)
    listed = " and ".join(f"'{joint}'" for joint in driven)
    outlook = (f"it cannot follow what is prescribed for {listed} with finite velocities: prescribe less motion, or change the "
           "lengths" if driven else "two branches of the motion meet: let the start or the loads keep the scene away from it")
    return (f"near t = {when:.9g} s the loop closed by '{loop}' comes to a singular position (smallest singular value of its "
            f"rows {value:.1e}, usually {usual:.1e}), where {outlook}")  # fmt: skip


def _loops(result: Result) -> list[str]:
    """Names of the joints that close loops; none where nothing constrains the motion."""
    prepared = result.prepared
    return [joint.name for joint in spanning_tree(prepared.model.scene).closing if not joint.loose] if prepared.rows else []


def _dependent(result: Result, t: float) -> tuple[str, list[str]]:
    """Where rows are nearly dependent at the time t (s): (the joint that closes their loop, joints whose prescribed coordinate is
    the cause, since the other rows are independent without its row)."""
    at, mechanics, rank = result([t]), result.prepared.with_all_rows, len(result.prepared.rank.kept)
    (B,) = unit_rows_at(mechanics, at.t, at.q)
    factors, value = np.abs(nearly_vanishing(B, rank)), smallest(B, rank)
    shares, driven = dict.fromkeys(_loops(result), 0.0), dict[str, None]()
    for i, row in enumerate(mechanics.rows):
        joint = row.name.rsplit(".", 1)[0]
        if joint in shares:
            shares[joint] += float(factors[i]) ** 2
        if row.prescribes and factors[i] > value:
            others = np.delete(np.arange(len(factors)), i)
            if smallest(B[others], rank - 1) > RELEASED * value:
                driven[joint] = None
    return max(shares, key=lambda joint: shares[joint]), list(driven)


def _smallest(result: Result, times: Array) -> tuple[float, float]:
    """The smallest singular value of the rows between the first and the last time, and the time at which it occurs (s)."""
    seen = result(times).smallest_singular_value
    best = int(np.argmin(seen))
    found = [(float(seen[best]), float(times[best]))]
    inner = np.flatnonzero((seen[1:-1] <= seen[:-2]) & (seen[1:-1] <= seen[2:]) & (seen[1:-1] < NEAR * median(seen))) + 1
    for i in sorted(inner, key=lambda i: float(seen[i]))[:CHOSEN]:
        found.append(_minimum(result, float(times[i - 1]), float(times[i + 1])))
    return min(found)


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

