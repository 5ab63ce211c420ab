"""Chattering: equations that jump where an argument vanishes, and drive the argument back to zero from both sides.

On-off control, and friction by sign(rate) where a body sticks, keep the motion at the point of switching. Steps then cross the
jump again and again, each by as little as the tolerance allows, and the run hardly advances. An argument that merely vanishes
often, as in a vibration, becomes far larger than the tolerance in between.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mbdae.integrators.watched_arguments import NODES, StepArguments
from mbdae.system.base import Array, System

#: an argument chatters where it changes its sign MOST times within the fraction PART of the run and the equations jump there
#: (JUMPS); at a lower rate a run has fewer than 2000 such changes, which it can afford (CVODE needs 15 steps for each)
MOST, PART = 100, 5e-2
#: an argument stays at zero while its magnitude in a step is below STAYS times the change that the tolerance of the unknowns
#: causes in it (measured while chattering: 3 times, in one of some hundred steps 12 times); in a step in which it is larger, the
#: count of changes of sign is halved. A change of sign with a magnitude below LEAST times that change may be round-off of a body
#: at rest (1e-9 at rtol 1e-7), and counts TENTH. A run that begins at rest exactly where the equations jump stays between 1e-5
#: and 1e-3 (Radau IIA, CVODE)
STAYS, LEAST, TENTH = 30.0, 1e-6, 0.1
#: HALVINGS: largest number of bisections that locate a change of sign in the step; they end where the argument changes by what
#: changes of the unknowns by DIGITS of their magnitude cause, since the law itself may round to the other side of the jump;
#: JUMPS: the equations jump there where their residuals change by more than this fraction of their change in the whole step
HALVINGS, DIGITS, JUMPS = 40, 1e2 * float(np.finfo(float).eps), 1e-3
#: a run is examined where its last 2000 steps are less than SHARE of it, so that it needs more than 1e5: at SAMPLES of them, it
#: is sought whether the equations jump within BESIDE steps on either side. They do at 33 to 40 of 40 in motions that switch
#: without end, at none in fast vibrations or where they jump with time; SAMPLES - SPARED are enough. BISECTIONS of that distance
#: locate a jump; a change of a residual by less than SLIGHT of it is round-off
SHARE, SAMPLES, SPARED, BESIDE, BISECTIONS, SLIGHT = 2e-2, 40, 10, 10, 25, 1e-6

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
    """Counts the steps in which the argument of a kink, or its rate, changes its sign while the argument stays near 0."""

    def __init__(self, system: System, arguments: StepArguments, tolerance: Callable[[Array], Array], known: Counts) -> None:
        """known: counts of the run until now; the parts of a run (between breaks) share this dictionary."""
        self.system, self.arguments, self.tolerance, self._counts = system, arguments, tolerance, known

    def endless(self, span: float) -> Endless | None:
        """Count the changes of sign in the last step, which is accepted: of the argument, or of its rate where the solver stays
        on one side within its tolerance, driven back by the jump all the same. Returns the argument that chatters, or None;
        span: length of the run, s."""
        arguments, counts = self.arguments, self._counts
        switched = arguments.kinks & (arguments.crossed | arguments.turned)
        for i in sorted({*np.flatnonzero(switched).tolist(), *counts}):
            noise, largest = arguments.noise(i, self.tolerance)[0], float(np.max(np.abs(arguments.at_nodes[:, i])))
            count, since = counts.pop(i, (0.0, arguments.t))
            leaves = largest > STAYS * noise
            count = count // 2 if leaves else count + switched[i] * (1.0 if largest > LEAST * noise else TENTH)
            if count >= MOST:  # counts grow only by the last step
                if arguments.t + arguments.h - since < PART * span and self._jumps(i):
                    return Endless(arguments.switches.names[i], round(count), arguments.t + arguments.h - since)
            elif count:
                counts[i] = count, since
        return None

    def _jumps(self, i: int) -> bool:
        """Whether the equations jump where argument i changes its sign, in the last step or beside its end."""
        sides = self._sides(i)
        if sides is None:
            return False
        arguments, (a, b) = self.arguments, sides
        rounded = arguments.noise(i, lambda y: DIGITS * np.abs(y))[0]
        u, v = self._argument(i, a), self._argument(i, b)
        for _ in range(HALVINGS):
            middle = (a + b) / 2
            value = self._argument(i, middle)
            left = (value < 0) == (u < 0)
            if abs(value - (v if left else u)) < rounded:
                break
            a, b, u, v = (middle, b, value, v) if left else (a, middle, u, value)
        start, end = self._states(np.array([0.0, 1.0]))
        F = self._equations((start, a, b, end))
        jump, change = np.abs(F[2] - F[1]), np.abs(F[3] - F[0])
        row = int(np.argmax(jump))
        return bool(jump[row] > JUMPS * change[row])

    def _sides(self, i: int) -> tuple[Array, Array] | None:
        """Two states between which argument i changes its sign: points of the last step, or its end and a state that differs from
        it by tolerances, since a solver may take either side for the other within its tolerance; None where there is none."""
        negative = self.arguments.at_nodes[:, i] < 0
        k = np.flatnonzero(negative[1:] != negative[:-1])
        if len(k):
            a, b = self._states(NODES[k[0] : k[0] + 2])
            return a, b
        end = self._states(np.ones(1))[0]
        shift = STAYS * np.array([0.0, *self.tolerance(end[1:])])
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (8, len(end)))
        others = [end + sign * shift for sign in signs]
        return next(((end, other) for other in others if (self._argument(i, other) < 0) != negative[-1]), None)

    def _states(self, parts: Array) -> Array:
        """States (k, 1 + n), t and y, at fractions (k,) of the last step."""
        return np.column_stack([self.arguments.t + parts * self.arguments.h, self.arguments.inside(parts)])

    def _argument(self, i: int, state: Array) -> float:
        return float(self.arguments.switches.arguments(state[:1], state[None, 1:])[0, i])

    def _equations(self, states: tuple[Array, ...]) -> Array:
        """Residuals F (k, n) at k states (1 + n,), all with the mean y' of the last step, so that only a jump of the equations
        makes them differ."""
        (first, last), out = self._states(np.array([0.0, 1.0]))[:, 1:], np.empty((len(states), self.system.n))
        for state, row in zip(states, out, strict=True):
            self.system.residual(float(state[0]), state[1:], (last - first) / self.arguments.h, row)
        return out


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
            whole[~(whole > SLIGHT * np.abs(size))] = np.inf
            for _ in range(BISECTIONS):
                at_middle = F(middle := (a + b) / 2)
                if np.max(np.abs(at_middle - at_a) / whole) > np.max(np.abs(at_b - at_middle) / whole):
                    b, at_b = middle, at_middle
                else:
                    a, at_a = middle, at_middle
            return bool(np.any(np.abs(at_b - at_a) > whole / 2))
    except Exception:  # functions of a user's own need not be defined beside the motion
        return False
