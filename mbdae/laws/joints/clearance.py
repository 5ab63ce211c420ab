"""The constraints that remain in a revolute joint with clearance."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_axis, turned_by
from mbdae.laws.joints.revolute import Turning
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.vectors import Expr


class ClearanceRevolute(Turning):
    """The pin on l stays in the middle of the race on k along k.z and, unless `tilting`, parallel to it.

    Paper Eqs. 1 and 31: three rows in space, none in the plane; where pin and race meet is determined by the contact law. With
    `drive` the fourth row turns the pin as in the kinematic model (Eq. 12).
    """

    options = ("tilting",)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = {"axial": k.z @ (l.r - k.r)}
        if not self.tilting:
            rows |= same_axis(k, l)
        if self.drive is not None:
            rows["drive"] = turned_by(k, l, self.drive)
        return rows
