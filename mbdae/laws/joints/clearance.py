"""The constraints that remain in a revolute joint with clearance."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_axis, tied_angle
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.vectors import Expr


class ClearanceRevolute(Joint):
    """The pin on l stays in the middle of the race on k along k.z and, unless `tilting`, parallel to it.

    Paper Eqs. 1 and 31: three rows in space, none in the plane; where pin and race meet is determined by the contact law. With
    `drive` the fourth row turns the pin as in the kinematic model (Eq. 12).
    """

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    options = ("tilting",)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = {"axial": k.z @ (l.r - k.r)}
        return rows if self.tilting else rows | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.relative_angle(k, l)

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        return {"angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}
