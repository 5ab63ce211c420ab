"""Distance joint: a massless rod with ball ends."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.vectors import Expr


class Distance(Joint):
    """The points of k and l keep their distance `length` (> 0). The multiplier is the compression of the rod, N."""

    params = params(length=("m", "distance as drawn"))

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"length": (l.r - k.r).norm() - self.length}

    def undefined_at(self) -> tuple[str, ...]:
        return ("points together",)
