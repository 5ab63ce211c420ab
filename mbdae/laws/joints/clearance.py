"""What a revolute joint with clearance still constrains."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import on_axis, same_axis, turned_by
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Joint, params
from mbdae.symbolic.vectors import Expr


class ClearanceRevolute(Joint):
    """The pin on l stays in the middle of the race on k along k.z and, unless `tilting`, parallel to it.

    Paper Eqs. 1 and 31: three rows in space, none in the plane; where pin and race meet is left to the contact law. With
    `drive` the fourth row turns the pin as in the kinematic model (Eq. 12).
    """

    params = params(drive=("rad", "prescribed relative angle phi(t)"))
    options = ("tilting",)
    coordinate_unit = "rad"

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = {"axial": k.z @ (l.r - k.r)}
        if not self.tilting:
            rows |= same_axis(k, l)
        if self.drive is not None:
            rows["drive"] = turned_by(k, l, self.drive)
        return rows

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l, self.drive)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.angle(k, l)
