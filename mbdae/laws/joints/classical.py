"""Revolute joint, classical model: the relative angle is an unknown of its own."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import near_angle, same_axis, same_point, turned_by
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import AUGMENTED, Joint, Parameter, params
from mbdae.symbolic.vectors import Expr


class ClassicalRevolute(Joint):
    """l turns about k.z; three rotation rows for the unknowns of l and the angle, a fourth where it is prescribed.

    Paper Eqs. 1, 10 and 11: k.x.(l.x sin phi + l.y cos phi) = sin(phi - theta) = 0 ties the massless unknown phi to the
    bodies, phi(t) - phi = 0 prescribes it. The first also vanishes half a turn off; the start refuses that branch.
    The multipliers of both rows are torques on l about k.z, N m: that of `drive` is the torque of the drive, as in the
    kinematic model. The row of phi reads lambda(angle) - lambda(drive) + stiffness phi + damping dphi/dt = 0.
    """

    params = params(drive=("rad", "prescribed relative angle phi(t)")) | AUGMENTED
    coordinates = {"phi": Parameter("rad", "relative angle, an unknown without mass")}  # noqa: RUF012
    coordinate_unit = "rad"
    twist = (0, 1)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        rows = same_point(k, l) | same_axis(k, l)
        rows["angle"] = turned_by(k, l, self.phi)
        if self.drive is not None:
            rows["drive"] = self.drive - self.phi
        return rows

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"axes in the same sense": k.z @ l.z, "angle, not its opposite": near_angle(k, l, self.phi)}

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.phi
