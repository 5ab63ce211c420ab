"""Vibrations of stiff beams that the start excites and that a run with long steps damps away.

Errors of velocities and stresses are weighed by the step, so that stiff beams can be integrated with steps far longer than their
fastest periods. The vibrations lost that way keep their amplitude in the exact solution, and no comparison of two such runs shows
it. A short run from the start with velocities in the error test does.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mbdae.run.control import Controlled, Probe, with_left_out
from mbdae.system.distance import distance
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem

WINDOW = 5.0  #: length of the short run in mean steps: slower vibrations are resolved by the run itself
POINTS = 400  #: times at which both are compared
#: factor on their distance: the largest amplitude may come after the window (observed: 1.9 times as much), and the short run has
#: the tolerance of a companion (observed to miss 6 % of an amplitude at an eighth of the cost)
MARGIN = 2.1


def with_lost_vibrations(prepared: Prepared, resolving: SceneSystem, run: Controlled) -> Controlled:
    """The run with the lost vibrations in its estimate: its largest difference of positions (over the scene's length, rad) from
    short runs of the system `resolving`, which resolves them, from the start and from every excitation."""
    solution = run.solution
    t0, t1 = float(solution.t[0]), float(solution.t[-1])
    span = WINDOW * (t1 - t0) / max(solution.stats.steps, 1)
    close = run.solver
    if not close.by_steps:
        close = replace(close, rtol=close.companion * close.tolerance)  # type: ignore[type-var]
    probe = Probe(close, resolving, prepared, span, POINTS, MARGIN)
    return with_left_out(run, probe, partial(distance, prepared))
