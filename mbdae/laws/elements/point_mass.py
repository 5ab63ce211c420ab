"""Point mass: position only."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element, params
from mbdae.symbolic.vectors import Expr


class PointMass(Element):
    """T = m v.v / 2."""

    params = params(mass=("kg", "mass"))

    def kinetic_energy(self, b: Frame) -> Expr:
        return self.mass * (b.center_velocity @ b.center_velocity) / 2
