"""Prismatic joint: one displacement along the axis is free, or prescribed."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import same_attitude, upright
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Joint, params
from mbdae.symbolic.vectors import Expr


class Prismatic(Joint):
    """l slides along k.z without turning. The multiplier of `drive` is the force of the drive on l against k.z, N."""

    params = params(drive=("m", "prescribed relative displacement"))
    coordinate_unit = "m"

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        d = l.r - k.r
        rows = {"offset_x": k.x @ d, "offset_y": k.y @ d} | same_attitude(k, l)
        if self.drive is not None:
            rows["drive"] = k.z @ d - self.drive
        return rows

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return k.z @ (l.r - k.r)
