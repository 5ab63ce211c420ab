"""Vibrations of stiff beams that the start excites and that long steps damp away.

Errors of velocities and stresses are weighted by the step, so that stiff beams can be integrated with steps far longer than their
shortest periods. The vibrations lost in this way keep their amplitude in the exact solution, and no comparison of two such runs
shows them. A short run from the start, with velocities in the error test, does.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mbdae.run.control import Controlled, Probe, with_left_out
from mbdae.system.distance import distance
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem

WINDOW = 5.0  #: length of a short run, in mean steps of the run, which itself resolves vibrations with longer periods
POINTS = 400  #: number of times at which both runs are compared
#: factor on the distance of the two runs: the largest amplitude may come after the end of the short run (observed: 1.9 times as
#: large), and the short run is made with the tolerance of a companion (observed: 6 % of an amplitude missed, an eighth of the
#: cost)
MARGIN = 2.1


def with_lost_vibrations(prepared: Prepared, resolving: SceneSystem, run: Controlled) -> Controlled:
    """The run whose estimate includes the lost vibrations: its largest difference of positions (over the scene's length, rad)
    from short runs of the system `resolving`, which resolves them, from the start and from every excitation."""
    solution = run.solution
    t0, t1 = float(solution.t[0]), float(solution.t[-1])
    span = WINDOW * (t1 - t0) / max(solution.stats.steps, 1)
    close = run.solver
    if not close.by_steps:
        close = replace(close, rtol=close.companion * close.tolerance)  # type: ignore[type-var]
    probe = Probe(close, resolving, prepared, span, POINTS, MARGIN)
    return with_left_out(run, probe, partial(distance, prepared))
