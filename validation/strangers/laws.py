"""Laws and controllers of a user's own that drawn scenes take."""

from __future__ import annotations

from typing import Any

import mbdae as mb

__all__ = ["Holding", "QuarticSpring"]


class QuarticSpring(mb.Force):
    """V = stiffness (d.d)^2 / 4, d from k's point to l's."""

    params = mb.params(stiffness=("N/m^3", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


class Holding:
    """A sampled controller that holds a coordinate: gain (target - value) - rate_gain rate."""

    def __init__(self, gain: float, rate_gain: float, target: float) -> None:
        self.gain, self.rate_gain, self.target = gain, rate_gain, target

    def __call__(self, t: float, value: float, rate: float) -> float:
        return self.gain * (self.target - value) - self.rate_gain * rate
