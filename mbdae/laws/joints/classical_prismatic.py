"""Prismatic joint that keeps its displacement as an unknown of its own."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_attitude, upright
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Joint, Parameter, params
from mbdae.symbolic.vectors import Expr


class ClassicalPrismatic(Joint):
    """l slides along k.z without turning; the displacement x is a massless unknown, k.z.(r_l - r_k) - x = 0 ties it.

    A further row, x - x(t) = 0, prescribes it. The multipliers of both are forces on l against k.z, N: that of `drive` is the
    force of the drive, as in the kinematic model. The row of x reads lambda(drive) - lambda(displacement) + ... = 0.
    """

    params = params(drive=("m", "prescribed relative displacement"))
    coordinates = {"x": Parameter("m", "relative displacement, an unknown without mass")}  # noqa: RUF012
    coordinate_unit = "m"
    twist = (1, 0)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        rows = {"offset_x": k.x @ d, "offset_y": k.y @ d} | same_attitude(k, l)
        rows["displacement"] = k.z @ d - self.x
        if self.drive is not None:
            rows["drive"] = self.x - self.drive
        return rows

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.x
