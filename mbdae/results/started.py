"""The start of a scene as a Result: sensors before any run."""

from __future__ import annotations

import numpy as np

from mbdae.integrators.solution import Solution, Stats
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result
from mbdae.results.run_info import RunInfo
from mbdae.results.states import Instant
from mbdae.system.prepare import Prepared


def started(prepared: Prepared) -> Result:
    """The start of a scene as a Result of one time."""
    start = prepared.start
    y = np.hstack([*prepared.all_bodies.reduced(start.q[None], start.u[None]), start.s[None]])
    t, still = np.array([start.t]), Instant("start", y, np.zeros_like(y))
    solution = Solution(t, y, still.yp, None, Stats(), still, (), True, still)
    return Result(prepared, solution, RunInfo(still, "", Accuracy(None, None), Stats()), t)
