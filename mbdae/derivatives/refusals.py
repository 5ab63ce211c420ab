"""Runs that have no derivative, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.errors import DerivativeError
from mbdae.results.result import Result
from mbdae.run.choice import prepared_from
from mbdae.system.prepare import Prepared

if TYPE_CHECKING:
    from mbdae.derivatives.steps import Tangent

#: y' is compared on both sides of an instant, this share of the run away from it; a difference of more than JUMP times the
#: largest y' of the run counts as a jump
BESIDE, JUMP = 1e-9, 1e-5
BISECTIONS = 60
SAME = 1e-9  #: largest difference of two starts, relative to the largest unknown, that count as the same


def refuse_scene(prepared: Prepared, continued: Any = None, ends: bool = False) -> None:
    """Raise DerivativeError for a scene whose runs have no derivatives; for runs that begin where another ended (`continued`), or
    that end at an event."""
    if continued is not None:
        raise DerivativeError("there are no derivatives of a run that begins where another one ended (start=): what that state depends "
                              "on is not known; run the scene from its own start")
    if ends:
        raise DerivativeError("there are no derivatives of a run that ends at an event (until=), whose time would move with the "
                              "numbers; run to a fixed time, and record= the event")
    scene = prepared.model.scene
    if prepared.contacts:
        names = ", ".join(f"'{name}'" for name in dict.fromkeys(contact.item for contact in prepared.contacts))
        raise DerivativeError(f"there are no derivatives of runs with contacts ({names}): steps do not move with the instants at "
                              "which bodies touch yet, and derivatives would be wrong by per cents; take the contact or stop away "
                              "where it does not touch, or compare runs")
    if scene.controllers:
        raise DerivativeError(f"there are no derivatives of runs with the sampled controller '{scene.controllers[0].name}': what its "
                              "function does is not known; state the control law by expressions (s.state, s.signal), or compare runs")


def refuse_run(result: Result) -> None:
    """Raise DerivativeError for a run without derivatives."""
    prepared, run = result.prepared, result.solution
    refuse_scene(prepared)
    if not hasattr(run, "systems"):
        raise DerivativeError("a state at rest has no derivatives yet; compare states at rest of two values")
    if len(run.systems) > 1:
        raise DerivativeError(f"there are no derivatives of this run: the constraint rows in force change at t = "
                              f"{run.systems[1][0]:.6g} s; leave redundant joints out, or compare runs")
    end = float(run.t[-1])
    ended = [event.name for event in result.events if abs(event.time - end) <= 1e-12 * max(abs(end), 1.0)]
    if ended:
        refuse_scene(prepared, ends=True)
    fresh = prepared_from(prepared.model.scene, None, end).start
    for a, b in ((prepared.start.q, fresh.q), (prepared.start.u, fresh.u), (prepared.start.s, fresh.s)):
        if prepared.start.t != fresh.t or np.any(np.abs(a - b) > SAME * np.max(np.abs(b), initial=1.0)):
            refuse_scene(prepared, continued=True)
    if not run.complete:
        raise DerivativeError("there are no derivatives of a run that was stopped before its end, at an event or by an error: run to "
                              "a time instead")


def refuse_jumps(tangent: Tangent) -> None:
    """Raise DerivativeError where y' jumps at an instant that depends on the motion, at which the derivative would jump too."""
    run, system = tangent.run, tangent.run.systems[0][1] if tangent.run.systems else None
    switches: Any = None if system is None else system.switches
    if switches is None or not len(run.t) > 1:
        return
    kinks = np.array([kind == "kink" for kind in switches.kinds], dtype=bool)
    if not kinks.any():
        return
    values = switches.arguments(run.t, run.y)[:, kinks]
    names = [name for name, kink in zip(switches.names, kinks, strict=True) if kink]
    size = np.abs(run.yp).max(axis=0) + 1e-300
    for i, a in np.argwhere(values[1:] * values[:-1] < 0):
        low, high = run.t[i], run.t[i + 1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            at = switches.arguments(np.array([middle]), run(np.array([middle])))[0, kinks][a]
            low, high = (middle, high) if at * values[i, a] > 0 else (low, middle)
        span = BESIDE * (run.t[-1] - run.t[0])
        sides = [max(low - span, run.t[0]), min(high + span, run.t[-1])]
        with tangent.within((run.t[i] + run.t[i + 1]) / 2):
            before, after = (tangent.balance(t, run(np.array([t]))[0][: tangent.n])[0] for t in sides)
        if np.any(np.abs(after - before) > JUMP * size[: len(before)]):
            raise DerivativeError(f"there are no derivatives of this run: '{names[a]}' makes accelerations jump at t = {high:.6g} s, at "
                                  "an instant that depends on the motion, and derivatives do not pass such jumps yet; state it by a "
                                  "function without jumps, such as tanh")
