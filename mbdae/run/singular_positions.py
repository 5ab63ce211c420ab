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

SAMPLES = 200  #: number of positions evaluated along the run
CHOSEN, REFINED = 5, 40  #: largest number of minima that are refined, and evaluations for each
NEAR = 0.3  #: ratio of the smallest singular value to its median below which a minimum is refined
UNCONTROLLED = 1e-6  #: violation that a run without a tolerance is assumed to resolve
GOLDEN = (5**0.5 - 1) / 2


def singular_passages(result: Result, asked: float | None) -> list[str]:
    """A warning where a run passes a singular position; none for trees, whose rows never lose rank."""
    prepared = result.prepared
    scene = prepared.model.scene
    loops = [joint for joint in spanning_tree(scene).closing if not joint.loose]
    if not loops or not prepared.rows:
        return []
    t = result.solution.t
    times = np.interp(np.linspace(0, len(t) - 1, min(SAMPLES, 4 * len(t))), np.arange(len(t)), t)
    value, when = _smallest(result, times)
    resolved = max(asked or 0.0, result.info.solver.rtol or 0.0) or UNCONTROLLED
    if value**2 > resolved:
        return []
    return [f"the run passes a singular position of the loop closed by '{loops[0].name}' at t = {when:.6g} s (smallest singular "
            f"value of its rows {value:.1e}): two branches of the motion meet there, closer than {resolved:.0e} resolves, and "
            "the run may have changed branch; compare with runs at smaller accuracies, or avoid that position"]  # fmt: skip


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

