"""Chattering: equations that jump where an argument vanishes, and drive the argument back to zero from both sides.

On-off control, and friction by sign(rate) where a body sticks, keep the motion at the point of switching. Steps then cross the
jump again and again, each by as little as the tolerance allows, and the run hardly advances. An argument that merely vanishes
often, as in a vibration, becomes far larger than the tolerance in between.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mbdae.errors import ChatteringError, SolverError
from mbdae.integrators.watched_arguments import NODES, StepArguments
from mbdae.system.base import Array, System

#: an argument chatters where it changes its sign MOST times within the fraction PART of the run and the equations jump there
#: (JUMPS); at a lower rate a run has fewer than 1e4 such changes, which it can afford
MOST, PART = 100, 1e-2
#: an argument stays at zero while its magnitude in a step is below STAYS times the change that the tolerance of the unknowns
#: causes in it (measured while chattering: 3 times, in one of some hundred steps 12 times); in a step in which it is larger, the
#: count of changes of sign is halved. A change of sign with a magnitude below LEAST times that change may be round-off of a body
#: at rest, and counts TENTH: a run that begins at rest exactly where the equations jump has nothing else
STAYS, LEAST, TENTH = 30.0, 1e-4, 0.1
#: HALVINGS: number of bisections that locate a change of sign in the step; JUMPS: the equations jump there where their residuals
#: change by more than this fraction of their change in the whole step
HALVINGS, JUMPS = 40, 1e-3
#: a run is examined where its last 2000 steps are less than SHARE of it, so that it needs more than 1e5: at SAMPLES of them, it
#: is sought whether the equations jump within BESIDE steps on either side. They do at 33 to 40 of 40 in motions that switch
#: without end, at none in fast vibrations or where they jump with time; SAMPLES - SPARED are enough. BISECTIONS of that distance
#: locate a jump; a change of a residual by less than SLIGHT of it is round-off, or by less than ABOVE times how far its values at
#: points NEXT of a step apart are off a straight line (of constraints and strains of beams, all of whose vibrations short steps
#: followed, it was nothing else)
SHARE, SAMPLES, SPARED, BESIDE, BISECTIONS, SLIGHT, ABOVE, NEXT = 2e-2, 40, 10, 10, 25, 1e-6, 100.0, 0.1

#: a motion grows without bound where an unknown is GROWN times its scale and its start, faster than with this POWER of the time
#: (a rotor under a torque: 1), and the run would take more than so many STEPS if it goes on growing so
GROWN, POWER, STEPS = 1e4, 8, 1e10

#: number of a kink -> number of changes of sign of its argument until now, and the time (s) of the first
Counts = dict[int, tuple[float, float]]


class Endless(NamedTuple):
    """A chattering argument: its item, the number of changes of sign, and the time (s) they took."""

    item: str
    times: int
    span: float

    def message(self) -> str:
        """The text of the error about it."""
        return (f"'{self.item}' switches without end: {self.times} times or more within {self.span:.1e} s, while the motion "
                "stays there to within the tolerance. Its value jumps there and drives the motion back from both sides, "
                "as on-off control and friction by the sign of a rate do: give the jump a width, as in tanh(x/width), state "
                "mb.Coulomb friction, or switch at the instants of s.controller(...)")


class Chattering:
    """Counts the changes of sign of every kink of a run while its argument stays near 0."""

    def __init__(self, system: System, arguments: StepArguments, tolerance: Callable[[Array], Array], known: Counts) -> None:
        """known: counts of the run until now; the parts of a run (between breaks) share this dictionary."""
        self.system, self.arguments, self.tolerance, self._counts = system, arguments, tolerance, known

    def endless(self, span: float) -> Endless | None:
        """Count the changes of sign in the last step, which is accepted. Returns the argument that chatters, or None; span:
        length of the run, s."""
        arguments, counts = self.arguments, self._counts
        negative = arguments.at_nodes < 0
        crossed = arguments.kinks & np.any(negative[1:] != negative[:-1], axis=0)
        for i in sorted({*np.flatnonzero(crossed).tolist(), *counts}):
            noise, largest = arguments.noise(i, self.tolerance)[0], float(np.max(np.abs(arguments.at_nodes[:, i])))
            count, since = counts.pop(i, (0.0, arguments.t))
            leaves = largest > STAYS * noise
            count = count // 2 if leaves else count + crossed[i] * (1.0 if largest > LEAST * noise else TENTH)
            if count >= MOST:  # counts grow only by a change of sign in the last step, so that it has one
                if arguments.t + arguments.h - since < PART * span and self._jumps(i):
                    return Endless(arguments.switches.names[i], round(count), arguments.t + arguments.h - since)
            elif count:
                counts[i] = count, since
        return None

    def _jumps(self, i: int) -> bool:
        """Whether the equations jump where argument i changed its sign in the last step."""
        arguments = self.arguments
        negative = arguments.at_nodes[:, i] < 0
        k = int(np.flatnonzero(negative[1:] != negative[:-1])[0])
        a, b = NODES[k], NODES[k + 1]
        for _ in range(HALVINGS):
            middle = (a + b) / 2
            a, b = (middle, b) if (arguments.at(np.array([middle]))[0, i] < 0) == negative[k] else (a, middle)
        F = self._equations(np.array([0.0, a, b, 1.0]))
        jump, change = np.abs(F[2] - F[1]), np.abs(F[3] - F[0])
        row = int(np.argmax(jump))
        return bool(jump[row] > JUMPS * change[row])

    def _equations(self, parts: Array) -> Array:
        """Residuals F (k, n) at fractions (k,) of the last step, all with the mean y' of the step, so that only a jump of the
        equations makes them differ."""
        t, h = self.arguments.t, self.arguments.h
        y, out = self.arguments.inside(np.array([0.0, *parts, 1.0])), np.empty((len(parts), self.system.n))
        for i, part in enumerate(parts):
            self.system.residual(t + part * h, y[i + 1], (y[-1] - y[0]) / h, out[i])
        return out


def without_end(system: System, t: Array, y: Array, yp: Array, ends: tuple[float, float],
                y0: Array) -> tuple[str, str, type[SolverError]] | None:
    """The text, the unknown that grows, if any, and the kind of the error about a run that does not come to its end; None where
    it does. t (m+1,), y and yp (m+1, n): the last steps; ends: times (s) of the run; y0 (n,): where it began."""
    if (text := stalled(system, t, y, yp, ends[1] - ends[0])) is not None:
        return text, "", ChatteringError
    size, span = np.abs(y[-1]) / np.maximum(system.scale, np.abs(y0)), t[-1] - t[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.where(size > GROWN, np.log(np.abs(y[-1]) / np.maximum(np.abs(y[0]), system.scale)), 0.0) / span
    k, left = int(np.argmax(rates)), ends[1] - t[-1]
    if left <= 0 or rates[k] * (t[-1] - ends[0]) <= POWER or rates[k] * left + np.log(left / span * len(t)) <= np.log(STEPS):
        return None
    return (f"the motion grows without bound, {np.exp(1):.3g} times in {1 / rates[k]:.1e} s, and the steps become shorter as it "
            f"does, so that the end would take more than {STEPS:.0e} of them; see whether a stiffness or damping is negative, or "
            "end the run earlier"), system.names[k], SolverError


def stalled(system: System, t: Array, y: Array, yp: Array, span: float) -> str | None:
    """The text of an error about equations that jump where the last steps stay, found without being told where that is; None
    where they do not. t (m+1,), y and yp (m+1, n): the last steps; span: length of the run, s."""
    if t[-1] - t[0] > SHARE * span:
        return None
    spared, steps = SPARED, len(t) - 1
    for k in range(steps // SAMPLES, steps + 1, steps // SAMPLES):
        spared -= not _jumps_beside(system, t[k], y[k - 1], y[k], t[k] - t[k - 1])
        if spared < 0:
            return None
    turns = np.abs(np.diff(yp, axis=0)).sum(axis=0) / (np.abs(yp).max(axis=0) + np.finfo(float).tiny)
    return (f"{steps} steps took {t[-1] - t[0]:.1e} s, all of them where the equations jump: there the motion is driven back "
            f"from both sides without end, most of all {system.names[int(np.argmax(turns))]}; give the jump a width, as in "
            "tanh(x/width), or end the run there")


def _jumps_beside(system: System, t: float, first: Array, last: Array, h: float) -> bool:
    """Whether the equations jump on the straight line through the ends of a step of h (s), within BESIDE steps of it."""
    def F(part: float) -> Array:
        system.residual(t, first + part * (last - first), (last - first) / h, out := np.empty(system.n))
        return out

    a, b = -float(BESIDE), 1.0 + BESIDE
    system.residual(t, first, np.zeros(system.n), size := np.empty(system.n))
    try:
        with np.errstate(all="ignore"):
            at_a, at_b = F(a), F(b)
            whole = np.abs(at_b - at_a)
            noise = np.max(np.abs(np.diff([F(a + NEXT * k) for k in range(5)], 2, axis=0)), axis=0)
            whole[~(whole > np.maximum(SLIGHT * np.abs(size), ABOVE * noise))] = np.inf
            for _ in range(BISECTIONS):
                at_middle = F(middle := (a + b) / 2)
                if np.max(np.abs(at_middle - at_a) / whole) > np.max(np.abs(at_b - at_middle) / whole):
                    b, at_b = middle, at_middle
                else:
                    a, at_a = middle, at_middle
            return bool(np.any(np.abs(at_b - at_a) > whole / 2))
    except Exception:  # functions of a user's own need not be defined beside the motion
        return False
