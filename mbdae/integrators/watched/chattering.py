"""Motions that switch without end: equations that jump where an argument vanishes, and push it back from either side.

On-off control, and friction by sign(rate) where a body sticks, keep the motion where they switch. Steps then cross the jump again
and again, each by as little as the tolerance tells apart, and a run would hardly go on. A run that crosses other switches often
leaves each of them between two crossings.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mbdae.integrators.watched.arguments import NODES, StepArguments
from mbdae.system.base import Array, System

#: changes of sign in a row, and the part of the run in which so many have to happen: rarer ones cost less than 1e4 of them do
MOST, PART = 100, 1e-2
#: an argument stays where it vanishes while it is below so many times the change that the tolerance makes in it (measured: 3,
#: in one step of some hundred 12), else half of the count is forgotten; crossings by less than a part of that change (round-off
#: of a body at rest) do not count
STAYS, LEAST = 30.0, 1e-4
#: halvings of the step to either side of a change of sign; change of the equations across that place, over their change in the
#: whole step, above which they jump
HALVINGS, JUMPS = 40, 1e-3

#: number of a kink -> changes of sign until now, and the time (s) of the first
Counts = dict[int, tuple[int, float]]


class Endless(NamedTuple):
    """What switches without end: its item, how often it did, and in which time (s)."""

    item: str
    times: int
    span: float

    def told(self) -> str:
        """For a message."""
        return (f"'{self.item}' switches without end: {self.times} times within {self.span:.1e} s, and where it switches is met "
                f"within the tolerance all the time. Its value jumps there and drives the motion back from either side, as "
                f"on-off control and friction by the sign of a rate do: give the jump a width, as in tanh(x/width), state "
                f"mb.Coulomb friction, or switch at the instants of s.controller(...)")  # fmt: skip


class Chattering:
    """Counts the changes of sign of every kink of a run while its argument stays near 0."""

    def __init__(self, system: System, arguments: StepArguments, tolerance: Callable[[Array], Array], known: Counts) -> None:
        """known: of the run until now, which may consist of many parts."""
        self.system, self.arguments, self.tolerance, self._counts = system, arguments, tolerance, known

    def endless(self, span: float) -> Endless | None:
        """Count those in the last step, which is accepted; what switches without end in a run of this length, s."""
        arguments, counts = self.arguments, self._counts
        negative = arguments.at_nodes < 0
        crossed = arguments.kinks & np.any(negative[1:] != negative[:-1], axis=0)
        for i in sorted({*np.flatnonzero(crossed).tolist(), *counts}):
            noise, largest = arguments.noise(i, self.tolerance)[0], float(np.max(np.abs(arguments.at_nodes[:, i])))
            count, since = counts.pop(i, (0, arguments.t))
            leaves = largest > STAYS * noise
            count = count // 2 if leaves else count + int(crossed[i] and largest > LEAST * noise)
            if count >= MOST:  # the last step crossed
                if arguments.t + arguments.h - since < PART * span and self._jumps(i):
                    return Endless(arguments.switches.names[i], count, arguments.t + arguments.h - since)
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
        """F (k, n) after parts (k,) of the last step, at the same rates."""
        t, h = self.arguments.t, self.arguments.h
        y, out = self.arguments.inside(np.array([0.0, *parts, 1.0])), np.empty((len(parts), self.system.n))
        for i, part in enumerate(parts):
            self.system.residual(t + part * h, y[i + 1], (y[-1] - y[0]) / h, out[i])
        return out
