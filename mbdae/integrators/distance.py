"""The distance of two runs, and the times at which runs are compared."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbdae.deferred import distinct
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array, System

BETWEEN = 3  #: number of points at which runs are compared between two neighbouring ends of steps of the coarser run
#: where the coarser run has more ends of steps than this, only every second, third, ... one of them is used for the comparison
MOST = 2000

Measure = Callable[[Array, Array, Array], Array]  #: times (nt,) and two trajectories (nt, n) -> their distance (nt,)


def scaled_distance(system: System, a: Array, b: Array, without: tuple[str, ...] = ("lambda", "mu")) -> Array:
    """(nt,) largest difference of an unknown of a and b (nt, n), relative to its scale; without: kinds of unknowns left out. Used
    for equations without a scene."""
    keep = np.array([kind not in without for kind in system.kinds])
    unit = np.maximum(system.scale, np.max(np.abs(b), axis=0))
    return np.asarray(np.max((np.abs(a - b) / unit)[:, keep], axis=1))


def check_times(coarse: Solution, outputs: Array | None = None) -> Array:
    """Times (s) at which a run is compared with the run `coarse`: outputs, ends of steps of `coarse`, and points inside its
    steps."""
    t = coarse.t
    if len(t) > MOST:
        t = t[:: len(t) // MOST + 1]
    inner = (t[:-1, None] + np.diff(t)[:, None] * (np.arange(BETWEEN) + 0.5) / BETWEEN).ravel()
    asked = np.zeros(0) if outputs is None else outputs[outputs <= coarse.t[-1]]
    return distinct(np.concatenate([asked, t, inner]))
