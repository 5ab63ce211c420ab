"""Prismatic joint."""

from __future__ import annotations

from mbdae.laws.joints.coincidence import on_axis, same_attitude, upright
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import Expr


class Prismatic(Joint):
    """l slides along k.z without turning. The multiplier of `drive` is the force of the drive on l along k.z, N."""

    coordinates = params(displacement=("m", "displacement of l along k.z"))

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self.displacement)

    def constraints(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return on_axis(k, l) | same_attitude(k, l)

    def coordinate(self, k: Frame, l: Frame) -> Expr:
        return k.z @ (l.r - k.r)

    def ties(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"displacement": self.displacement - k.z @ (l.r - k.r)}

    def branches(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return upright(k, l)
