"""Damper on a coordinate of a joint."""

from __future__ import annotations

from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import params
from mbdae.symbolic.variation import rate
from mbdae.symbolic.vectors import Expr


class JointDamper(OnCoordinate):
    """Rayleigh function damping (dc/dt)^2 / 2 of the joint's coordinate c; paper Eq. 19, at any attitude of the bodies."""

    params = params(damping=("N m s/rad or N s/m", "damping"))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        return self.damping * rate(self.value(k, l)) ** 2 / 2
