"""What a run with long steps leaves out of stiff beams: vibrations that the start excites and the method damps.

Errors of velocities and stresses are weighed by the step, so that stiff beams can be integrated with steps far longer
than their fastest periods. The vibrations that are lost that way keep their amplitude in the exact solution, and no
comparison of two such runs shows it. A short run from the start with velocities in the error test does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbdae.errors import SolverError
from mbdae.run.control import Controlled, distance, other_run
from mbdae.system.assembly import SceneSystem
from mbdae.system.prepare import Prepared

WINDOW = 5.0  #: mean steps: slower vibrations are resolved by the run itself
POINTS = 400
MARGIN = 2.0  #: the window may end before the largest amplitude (seen: 1.9 times as much later)


def with_lost_waves(prepared: Prepared, resolving: SceneSystem, run: Controlled) -> Controlled:
    """The run with what it leaves out in its estimate: the largest difference of positions (over the scene's length, rad) from a
    run that resolves the vibrations."""
    solution = run.solution
    t0, t1 = float(solution.t[0]), float(solution.t[-1])
    end = min(t1, t0 + WINDOW * (t1 - t0) / max(solution.stats.steps, 1))
    try:
        probe = run.solver.solve(resolving, end, max_residuals=10 * solution.stats.residuals + 10000)
    except SolverError as error:
        if error.solution is None or len(error.solution.t) < 3:
            return replace(run, estimate=float("inf"), others=())
        probe = error.solution
    times = np.linspace(t0, float(probe.t[-1]), POINTS)
    amplitude = float(np.max(distance(prepared, times, solution(times), probe(times))))
    others = (*run.others, *other_run(resolving, prepared, probe, times, MARGIN)) if run.others else ()
    return replace(run, estimate=run.estimate + MARGIN * amplitude, others=others)
