"""Chattering: equations that jump where an argument vanishes, and drive the argument back to zero from both sides.

On-off control, and friction by sign(rate) where a body sticks, keep the motion at the point of switching. Steps then cross the
jump again and again, each by as little as the tolerance allows, and the run hardly advances. Other arguments that vanish often
leave zero in between.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mbdae.integrators.watched.arguments import NODES, StepArguments
from mbdae.system.base import Array, System

#: chattering: MOST changes of sign within PART of the run; at a lower rate a run has less than 1e4 of them, which it can afford
MOST, PART = 100, 1e-2
#: STAYS: an argument remains at zero while it is below so many times its change by the tolerance (measured: 3, in one of some
#: hundred steps 12); otherwise half of the count is dropped. LEAST: crossings by less than this part of that change (round-off of
#: a body at rest) do not count
STAYS, LEAST = 30.0, 1e-4
#: HALVINGS of the step locate a change of sign; JUMPS: change of the equations across it, over their change in the
#: whole step, above which the equations jump
HALVINGS, JUMPS = 40, 1e-3

#: number of a kink -> changes of sign until now, and the time (s) of the first
Counts = dict[int, tuple[int, float]]


class Endless(NamedTuple):
    """A chattering argument: its item, the number of changes of sign, and the time (s) they took."""

    item: str
    times: int
    span: float

    def told(self) -> str:
        """The message on it."""
        return (f"'{self.item}' switches without end: {self.times} times within {self.span:.1e} s, while the motion "
                "stays there to within the tolerance. Its value jumps there and drives the motion back from both sides, "
                "as on-off control and friction by the sign of a rate do: give the jump a width, as in tanh(x/width), state "
                "mb.Coulomb friction, or switch at the instants of s.controller(...)")  # fmt: skip


class Chattering:
    """Counts the changes of sign of every kink of a run while its argument stays near 0."""

    def __init__(self, system: System, arguments: StepArguments, tolerance: Callable[[Array], Array], known: Counts) -> None:
        """known: counts of the run until now, whose parts share them."""
        self.system, self.arguments, self.tolerance, self._counts = system, arguments, tolerance, known

    def endless(self, span: float) -> Endless | None:
        """Count the changes of sign in the last step, which is accepted. Returns what chatters in a run of `span` s, or None."""
        arguments, counts = self.arguments, self._counts
        negative = arguments.at_nodes < 0
        crossed = arguments.kinks & np.any(negative[1:] != negative[:-1], axis=0)
        for i in sorted({*np.flatnonzero(crossed).tolist(), *counts}):
            noise, largest = arguments.noise(i, self.tolerance)[0], float(np.max(np.abs(arguments.at_nodes[:, i])))
            count, since = counts.pop(i, (0, arguments.t))
            leaves = largest > STAYS * noise
            count = count // 2 if leaves else count + int(crossed[i] and largest > LEAST * noise)
            if count >= MOST:  # the last step had a change of sign
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
        """F (k, n) at parts (k,) of the last step, all with the same rates."""
        t, h = self.arguments.t, self.arguments.h
        y, out = self.arguments.inside(np.array([0.0, *parts, 1.0])), np.empty((len(parts), self.system.n))
        for i, part in enumerate(parts):
            self.system.residual(t + part * h, y[i + 1], (y[-1] - y[0]) / h, out[i])
        return out
