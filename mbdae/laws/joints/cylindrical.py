"""Cylindrical joint."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import on_axis, same_axis, tied_angle
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Cylindrical(Joint):
    """l slides along k.z and turns about it."""

    coordinates = params(displacement=("m", "displacement of l along k.z"), angle=("rad", "rotation of l about k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement).about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l) | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": k.z @ (l.r - k.r), "angle": self.relative_angle(k, l)}

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr | tuple[Expr, Expr]]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r), "angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}
