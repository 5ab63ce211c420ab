"""Whether the joints of a story can be closed at all from where it is drawn, found by least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from strangers.bodies import Array
from strangers.dense import Reference, quaternion
from strangers.story import Input, Story

TRIES, CLOSED = 12, 1e-8  #: starts beside the drawn one; gap (m, rad) up to which joints are closed


def can_close(story: Story) -> bool:
    """Whether some pose near the drawn one holds every joint, drive, and stated angle or displacement, and the one that is found
    from the drawn one itself does so within the limits of the joints."""
    reference, rng = Reference(story), np.random.default_rng(0)
    w, n = reference.w, reference.n
    drawn = np.concatenate([w.at[:n].ravel(), np.ravel([quaternion(R) for R in w.turned[:n]])])
    stated = {name: start_of(story, name) for name in reference.tracked}
    limits = np.reshape([limits_of(story, name) for name in reference.tracked], (-1, 2))

    def gaps(x: Array) -> Array:
        y = np.concatenate([x, np.zeros(6 * n)])
        m = reference.moved(y)
        c = reference._coordinates(m)
        held = [c[i] - stated[name] for i, name in enumerate(reference.tracked) if stated[name] is not None]
        where = m.value.copy()
        where[reference.watched] = c
        where -= np.where(reference.tables[0] == 3, np.sum(reference._drawn_d() ** 2, axis=1) / 2, 0.0)
        drives = [0.0 if d is None else d.derivative(0.0)(0.0) for d in reference.drives]
        return np.concatenate([reference.A @ where - drives, held, np.sum(x[3 * n :].reshape(n, 4) ** 2, axis=1) - 1])

    starts = [drawn, *(drawn + rng.normal(size=len(drawn)) * spread for spread in np.linspace(0.05, 0.6, TRIES))]
    for i, start in enumerate(starts):
        found = least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        if float(np.max(np.abs(found.fun))) < CLOSED:
            c = np.array(reference._coordinates(reference.moved(np.concatenate([found.x, np.zeros(6 * n)]))))
            return i > 0 or bool(np.all((limits[:, 0] <= c) & (c <= limits[:, 1])))
    return False


def start_of(story: Story, name: str) -> float | None:
    """Where a coordinate of a joint starts, as it is stated; None where it is not."""
    joint, coordinate = name.split(".")
    args = next(a.args for a in story.statements if a.name == joint)
    key = {"angle": "angle0", "displacement": "position0"}.get(coordinate, "")
    value = args.get(key)
    return None if value is None or isinstance(value, Input) else float(value)


def limits_of(story: Story, name: str) -> tuple[float, float]:
    """The limits of a joint's coordinate, infinite where there are none."""
    args = next(a.args for a in story.statements if a.name == name.split(".")[0])
    low, high = args.get("limits", (None, None))
    return -np.inf if low is None else float(low), np.inf if high is None else float(high)
