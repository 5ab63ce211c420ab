"""Positions in which the joints of a closed loop lose their rank: two motions meet there, and a run may leave on the other.

Between branches that come as near as s (in the smallest singular value of the constraint rows) lies a violation of about s^2:
an error of that size is enough to change over, and companion runs may do so together.
"""

from __future__ import annotations

import numpy as np

from mbdae.results.result import Result
from mbdae.scene.topology import spanning_tree
from mbdae.system.base import Array
from mbdae.system.rank.rows import smallest, unit_rows

SAMPLES, CHOSEN, REFINED = 200, 5, 40  #: positions looked at, minima among them that are followed, and in how many positions
NEAR = 0.3  #: smallest singular value, over its median, below which a minimum is followed
BLIND = 1e-6  #: violation that a run with a constant step is taken to be unable to resolve
GOLDEN = (5**0.5 - 1) / 2


def passages(result: Result, asked: float | None) -> list[str]:
    """What is to be said of a run through singular positions; nothing of trees, whose joints never lose their rank."""
    prepared = result.prepared
    scene = prepared.model.scene
    loops = [joint for joint in spanning_tree(scene).closing if not joint.loose]
    if not loops or not prepared.rows:
        return []
    t = result.solution.t
    times = np.interp(np.linspace(0, len(t) - 1, min(SAMPLES, 4 * len(t))), np.arange(len(t)), t)
    value, when = _smallest(result, times)
    resolved = max(asked or 0.0, result.info.solver.rtol or 0.0) or BLIND
    if value**2 > resolved:
        return []
    return [f"passes a singular position of the loop closed by '{loops[0].name}' at t = {when:.6g} s (smallest singular value "
            f"of its rows {value:.1e}): two motions meet there within what {resolved:.0e} resolves, and it may have left on the "
            f"other; compare with runs at smaller accuracies, or keep apart from that position"]  # fmt: skip


def _smallest(result: Result, times: Array) -> tuple[float, float]:
    """The smallest singular value of the rows between the first and the last time, and when."""
    seen = _singular_values(result, times)
    best = int(np.argmin(seen))
    found = [(float(seen[best]), float(times[best]))]
    inner = np.flatnonzero((seen[1:-1] <= seen[:-2]) & (seen[1:-1] <= seen[2:]) & (seen[1:-1] < NEAR * np.median(seen))) + 1
    for i in sorted(inner, key=lambda i: float(seen[i]))[:CHOSEN]:
        found.append(_followed(result, float(times[i - 1]), float(times[i + 1])))
    return min(found)


def _followed(result: Result, a: float, b: float) -> tuple[float, float]:
    """The minimum between two times, by golden section."""
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_c, at_d = (float(v) for v in _singular_values(result, np.array([c, d])))
    for _ in range(REFINED):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - GOLDEN * (b - a)
            at_c = float(_singular_values(result, np.array([c]))[0])
        else:
            a, c, at_c = c, d, at_d
            d = a + GOLDEN * (b - a)
            at_d = float(_singular_values(result, np.array([d]))[0])
    return min((at_c, c), (at_d, d))


def _singular_values(result: Result, t: Array) -> Array:
    m, rank = result.prepared.with_all_rows, len(result.prepared.rank.kept)
    G = m.constraint_jacobian(t, result.states(t)[0])
    return np.array([smallest(unit_rows(m, g), rank) for g in G])
