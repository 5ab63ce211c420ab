"""The time at which conditions of inputs, such as t < 1, are evaluated inside a run."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np


class ConditionTime:
    """The time at which conditions of inputs, such as t < 1, are evaluated. `time`: a fixed one within the present part of a run
    between two breaks, so that a condition does not change at the end of a step; None: just after the time at which the equations
    are evaluated, but before `end`, the end of the run."""

    def __init__(self) -> None:
        self.read = np.array([nan, inf])  #: (time, end), s, an array whose address the native evaluation holds; NaN: time is None

    @property
    def time(self) -> float | None:
        """The time in the present part of a run, s, or None."""
        return None if isnan(self.read[0]) else float(self.read[0])

    @time.setter
    def time(self, value: float | None) -> None:
        """Set the time, s, or None."""
        self.read[0] = nan if value is None else value

    @property
    def end(self) -> float:
        """The end of the run, s."""
        return float(self.read[1])

    @end.setter
    def end(self, value: float) -> None:
        """Set the end of the run, s."""
        self.read[1] = value
