"""Revolute joint, modified kinematic model: two rotation rows, a third where the angle is prescribed."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import near_angle, same_axis, same_point, turned_by
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import AUGMENTED, Joint, params
from mbdae.symbolic.vectors import Expr


class Turning(Joint):
    """A joint that turns about k.z, its angle prescribed (`drive`) or not."""

    params = params(drive=("rad", "prescribed relative angle phi(t)"))
    coordinate_unit = "rad"

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        wanted = {"axes in the same sense": k.z @ l.z}
        return wanted if self.drive is None else wanted | {"prescribed angle, not its opposite": near_angle(k, l, self.drive)}

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.angle(k, l)


class Revolute(Turning):
    """l turns about k.z. Paper Eqs. 1 and 12 (`drive` is phi(t)).

    The driven row x_k.(x_l sin phi + y_l cos phi) = sin(phi - theta) vanishes at theta = phi + pi too;
    the start refuses that branch (x_k.(x_l cos phi - y_l sin phi) > 0 is required there).
    The multiplier of `drive` is the torque of the drive on l about k.z, N m.
    """

    params = Turning.params | AUGMENTED

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = same_point(k, l) | same_axis(k, l)
        if self.drive is not None:
            rows["drive"] = turned_by(k, l, self.drive)
        return rows
