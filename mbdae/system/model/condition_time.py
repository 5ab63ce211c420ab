"""The time at which conditions of inputs are read inside a run."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np


class ConditionTime:
    """Time at which conditions of inputs (t < 1 and the like) are evaluated: `time`, inside the part of a run between two breaks;
    None: just after the time of every evaluation, but before `end`, the end of the run."""

    def __init__(self) -> None:
        self.read = np.array([nan, inf])  #: (time, end) as the native evaluation reads them; NaN where time is None

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
