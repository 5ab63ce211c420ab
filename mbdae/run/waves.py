"""What a run with long steps leaves out of stiff beams: vibrations that the start excites and the method damps.

Errors of velocities and stresses are weighed by the step, so that stiff beams can be integrated with steps far longer
than their fastest periods. The vibrations that are lost that way keep their amplitude in the exact solution, and no
comparison of two such runs shows it. A short run from the start with velocities in the error test does.
"""

from __future__ import annotations

from dataclasses import replace

from mbdae.run.control import Controlled, Probe, distance, with_left_out
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem

WINDOW = 5.0  #: mean steps: slower vibrations are resolved by the run itself
POINTS = 400
#: the window may end before the largest amplitude (seen: 1.9 times as much later), and the short run is one to the tolerance of
#: a companion, which was seen to miss 6 % of an amplitude at an eighth of the cost
MARGIN = 2.1


def with_lost_waves(prepared: Prepared, resolving: SceneSystem, run: Controlled) -> Controlled:
    """The run with what it left out in its estimate: the largest difference of positions (over the scene's length, rad) from a
    short run that resolves the vibrations, from the start and from every kick of an input."""
    solution = run.solution
    t0, t1 = float(solution.t[0]), float(solution.t[-1])
    span = WINDOW * (t1 - t0) / max(solution.stats.steps, 1)
    close = run.solver
    if not close.by_steps:
        close = replace(close, rtol=close.companion * close.tolerance)  # type: ignore[type-var]
    probe = Probe(close, resolving, prepared, span, POINTS, MARGIN)
    return with_left_out(run, probe, lambda t, a, b: distance(prepared, t, a, b))
