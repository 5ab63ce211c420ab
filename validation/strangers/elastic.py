"""The reference of scenes with beams: accelerations of mbdae, stated anew for every smooth piece of inputs, steps by SciPy."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from strangers.bodies import Array
from strangers.story import Along, Input, Said, Story, build, number

import mbdae as mb
from mbdae.results.result import Result

MOST = 25  #: pieces of a run
LIMIT = 100_000  #: evaluations of accelerations


def elastic_truth(story: Story, result: Result) -> Any:
    """The verdict on a run with beams."""
    from strangers.judge import Verdict, settled

    ends = pieces(story)
    if len(ends) > MOST:
        return Verdict("not judged", note=f"{len(ends)} pieces")
    times = np.unique(np.concatenate([np.linspace(0, story.t_end, 41), ends]))
    story = story.but(model="", space="planar" if result.prepared.model.planar else "spatial")  # pieces without a load across too
    scene, run = build(story), result(times)
    shown = [run.state_for(scene, float(t)).q for t in times]
    first = result.state_for(scene, 0.0)
    errors = []
    for rtol in (min(1e-7, story.accuracy * 1e-3), min(1e-7, story.accuracy * 1e-3) / 10):
        gap = np.array(shown) - _solved(story, first, ends, times, rtol)  # m, rad, and entries of quaternions
        errors.append(float(np.max(np.abs(gap))) / max(1.0, result.prepared.length))
        if errors[-1] <= 3 * story.accuracy:
            return Verdict("right", errors[-1] / story.accuracy)
    return settled(story, result, *errors)


def pieces(story: Story) -> list[float]:
    """Ends of the smooth pieces of a story's inputs, s."""
    T = story.t_end
    inside = sorted({0.0, T, *(b for i in story.inputs for b in i.breaks if 0 < b < T),
                     *(e for i in story.inputs for p in i.narrow for e in p[:2] if 0 < e < T)})
    return [0.0, *(b for a, b in itertools.pairwise(inside) if b - a > 1e-12 * T)]


def smooth(story: Story, middle: float) -> Story:
    """The story with the smooth functions that hold at an instant."""
    return story.but(model="", statements=tuple(Said(a.verb, {k: _smooth(v, middle) for k, v in a.args.items()})
                                                for a in story.statements))


def _smooth(value: Any, middle: float) -> Any:
    if isinstance(value, Along):
        return Along(_smooth(value.value, middle), value.direction)
    if not isinstance(value, Input):
        return value
    own = value.delay + value.pace * middle
    text = [e for start, e in value.pieces if start <= own][-1]
    said = f"sp.sympify({text!r}, locals={{'t': {number(value.pace)} * mb.t + ({number(value.delay)})}})"
    return Input("piece", said, ((-np.inf, text),), scale=value.scale)


def _solved(story: Story, first: Any, ends: list[float], times: Array, rtol: float) -> Array:
    """Positions of all nodes over the times (nt, nq), in the scene's order."""
    y, found, count = None, [], 0
    piece = np.clip(np.searchsorted(ends, times, "right") - 1, 0, len(ends) - 2)  # the first and last may lie a bit outside
    for i, (a, b) in enumerate(itertools.pairwise(ends)):
        scene = build(smooth(story, (a + b) / 2))
        form = mb.Index1(multipliers="eliminated", baumgarte=0.0) if scene.joints else mb.ODE()
        system = scene.system(form, start=first)
        y = system.y0.copy() if y is None else y
        out = np.empty(len(y))

        def rhs(t: float, y: Array, system: Any = system, out: Array = out) -> Array:
            nonlocal count
            count += 1
            if count > LIMIT:
                raise ArithmeticError("the reference takes too many steps")
            try:
                system.rhs(t, np.ascontiguousarray(y), out)
            except mb.errors.SolverError:  # a trial that went too far, which is then repeated with a shorter step
                return np.full(len(y), np.nan)
            return out.copy()

        narrow = [h for one in story.inputs for low, high, h in one.narrow if low < (a + b) / 2 < high]
        s = solve_ivp(rhs, (a, b), y, "DOP853", rtol=rtol, atol=rtol * 1e-2, dense_output=True, max_step=min([np.inf, *narrow]))
        if not s.success:
            raise ArithmeticError(f"the reference failed: {s.message}")
        found += [s.sol(t) for t in times[piece == i]]
        y = s.y[:, -1]
    return np.asarray(system._prepared.states(times, np.array(found))[0])
