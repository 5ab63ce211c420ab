"""A point on a plane."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class PointOnPlane(Joint):
    """The point of l stays in the plane normal to k.z; all rotations are free. The multiplier is minus the force on l along k.z,
    N."""

    coordinates = params(x=("m", "displacement of the point along k.x"), y=("m", "displacement of the point along k.y"),
                         rotation=("rotation", "rotation of l relative to k"))  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"offset": k.z @ (l.r - k.r)}

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d}
