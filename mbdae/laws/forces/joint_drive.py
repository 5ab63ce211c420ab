"""Torque of a motor on a revolute joint, force of an actuator on a prismatic joint."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.vectors import ZERO, Vec


class JointTorque(Force):
    """Torque on l about the common axis, its opposite on k; work is torque times rate on the joint's manifold."""

    params = params(torque=("N m", "torque on l about the joint axis"))

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return ZERO, (k.z + l.z) * (self.torque / 2)


class JointForce(Force):
    """Force on l along the axis of k, its opposite on k."""

    params = params(force=("N", "force on l along the joint axis"))

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return k.z * self.force, ZERO
