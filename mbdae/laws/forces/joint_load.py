"""Torque of a motor, force of an actuator on a coordinate of a joint."""

from __future__ import annotations

from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import params
from mbdae.symbolic.vectors import Expr


class JointLoad(OnCoordinate):
    """A torque or force on l that does work as the joint's coordinate grows, and its opposite on k."""

    params = params(load=("N m or N", "torque or force on the coordinate"))
    loads = True

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr]:
        return self.value(k, l), self.load
