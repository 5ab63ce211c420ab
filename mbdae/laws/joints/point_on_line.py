"""A point on a line."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import on_axis
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class PointOnLine(Joint):
    """The point of l slides along k.z; all rotations are free."""

    coordinates = params(displacement=("m", "displacement of the point along k.z"),
                         rotation=("rotation", "rotation of l relative to k"))  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement).turned(self.rotation)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": k.z @ (l.r - k.r)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r)}
