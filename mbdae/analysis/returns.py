"""When a motion comes back to where it was: the time since a run was last near its end, and how often a motion repeats within a
period in which it returns."""

from __future__ import annotations

import numpy as np

from mbdae.analysis.orbit import angles
from mbdae.errors import SteadyError
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: part of its size by which a motion is nearer to its last state where it has returned; and that by which it is where it repeats
NEAR, REPEATS = 0.1, 3e-3
SAMPLES = 4000  #: number of times at which such a return is sought
MOST = 1000  #: largest number of times that a motion is sought to repeat within a period
RESTS = 1e-6  #: a motion that stays this near to its start, in lengths of the scene and rad, is at rest
FAR = 1e4  #: number of lengths of the scene beyond which accuracies, which refer to it, mean nothing
REST = ("the only motion found that repeats is rest, which has no period: start the scene in motion, or give start=(result, t) "
        "of a run that has come near a periodic motion; where damping ends every motion there is none")
DRIVEN = ("period = None: it is found for scenes without loads and drives that depend on the time, and '{}' depends on it; give "
          "the period (s) after which they repeat, such as 2 * pi / rate")
LOST = ("the motion does not come near to a state in which it was before: give the period, or a start near a periodic motion, "
        "start=(result, t)")
OTHER = "the scene has no drive and repeats by itself after {:.9g} s, which is its period, not the one stated, {:.9g} s"
UNFOLLOWED = "the motion over one period cannot be followed in steps of one pattern, as its jumps do not stay where they were: {}"
DRAWN = ("the motion goes {:.3g} m, {:.2g} times the largest distance in the drawing, to which accuracies refer: draw the scene "
         "at the size of its motion, and start it with velocities or start=")


def at_rest(prepared: Prepared, run: Solution) -> bool:
    """Whether nothing moves in the last two thirds of a run."""
    _, u, _ = prepared.states(*_late(run))
    return bool(np.max(np.abs(u) / prepared.mechanics.velocity_units) * (run.t[-1] - run.t[0]) < RESTS)


def last_return(prepared: Prepared, run: Solution) -> float | None:
    """The time (s) since a run was last near its end, going the same way; None where it was not."""
    t, y = _late(run)
    x, far = _states(prepared, t, y)
    off = x - x[-1]
    size = np.max(np.linalg.norm(off, axis=1))
    going = off @ (x[-1] - x[-2])
    crossed = np.flatnonzero((going[:-1] < 0) & (going[1:] >= 0) & (np.linalg.norm(off[1:], axis=1) < NEAR * size))
    crossed = crossed[crossed < len(t) - 3]
    if not size > 0 or not len(crossed):
        return None
    if far > FAR * prepared.length:
        raise SteadyError(DRAWN.format(far, far / prepared.length))
    k = int(crossed[-1])
    share = -going[k] / (going[k + 1] - going[k])
    return float(t[-1] - (t[k] + share * (t[k + 1] - t[k])))


def repeats(prepared: Prepared, run: Solution) -> list[int]:
    """How often a motion may repeat within a run over a period, the largest number first: it is near its start again after that
    part of it."""
    parts, shares = np.arange(MOST, 1, -1), np.linspace(0, 1, SAMPLES)
    t = run.t[0] + (run.t[-1] - run.t[0]) * np.concatenate([shares, 1 / parts])
    x, _ = _states(prepared, t, run(t))
    off = np.linalg.norm(x - x[0], axis=1)
    gone = shares[int(np.argmax(off[:SAMPLES] > NEAR * np.max(off)))]  # until then it has not left its start
    return [int(k) for k in parts[(off[SAMPLES:] < REPEATS * np.max(off)) & (1 / parts > gone)]]


def _late(run: Solution) -> tuple[Array, Array]:
    t = np.linspace(run.t[0] + (run.t[-1] - run.t[0]) / 3, run.t[-1], SAMPLES)
    return t, run(t)


def _states(prepared: Prepared, t: Array, y: Array) -> tuple[Array, float]:
    """Positions and velocities (k, ...) of one size, angles without whole turns, and how far anything goes, m."""
    q, u, _ = prepared.states(t, y)
    speed = np.maximum(np.max(np.abs(u), axis=0), 1e-12 * prepared.mechanics.velocity_units / prepared.time)
    turning = angles(prepared)
    straight = np.delete(q, turning, axis=1)
    far = float(np.max(np.ptp(straight, axis=0), initial=0.0))
    turn = float(np.max(np.ptp(q[:, turning], axis=0), initial=0.0))
    size = max(far, min(turn, 1.0) * prepared.length)
    parts = [straight, size * u / speed]
    if turning:
        parts += [prepared.length * np.sin(q[:, turning]), prepared.length * np.cos(q[:, turning])]
    return np.hstack(parts), far
