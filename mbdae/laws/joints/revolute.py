"""Revolute joint."""

from __future__ import annotations

from mbdae.laws.joints.clearance import ClearanceRevolute
from mbdae.laws.joints.coincidence import same_axis, same_point, tied_angle
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import AUGMENTED, params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Revolute(Joint):
    """l turns about k.z. Paper Eqs. 1, 10 to 12 (`drive` is phi(t), `angle` the unknown phi of the classical model).

    The row that holds the angle, x_k.(x_l sin phi + y_l cos phi) = sin(phi - theta), vanishes at theta = phi + pi too;
    the start refuses that branch (x_k.(x_l cos phi - y_l sin phi) > 0 is required there).
    The multipliers of `drive` and of `angle` are torques on l about k.z, N m: that of `drive` is the torque of the drive.
    """

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    params = AUGMENTED
    loose = ClearanceRevolute
    optional = tuple(AUGMENTED)

    def motion(self, from_k: Motion) -> Motion:
        return from_k.about("z", self.angle)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return same_point(k, l) | same_axis(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.relative_angle(k, l)

    def ties(self, k: Frame, l: Frame) -> dict[str, tuple[Expr, Expr]]:
        return {"angle": tied_angle(k, l, self.angle)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z}
