"""Planar joint."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_axis, tied_angle
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Planar(Joint):
    """l slides in the plane normal to k.z, along k.x and k.y, and turns about k.z."""

    coordinates = params(x=("m", "displacement of l along k.x"), y=("m", "displacement of l along k.y"),
                         angle=("rad", "rotation of l about k.z"))  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("x", self.x).along("y", self.y).about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"offset": k.z @ (l.r - k.r)} | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        return {"x": k.x @ d, "y": k.y @ d, "angle": self.relative_angle(k, l)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr | tuple[Expr, Expr]]:
        d = l.r - k.r
        return {"x": self.x - k.x @ d, "y": self.y - k.y @ d, "angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}
