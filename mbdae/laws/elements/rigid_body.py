"""Rigid body with its node at the centre of mass."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element, params
from mbdae.symbolic.vectors import Expr


class RigidBody(Element):
    """T = m v.v / 2 + Omega.J Omega / 2 with J about the centre of mass in body axes."""

    params = params(
        mass=("kg", "mass"),
        Jxx=("kg m^2", "moment of inertia about body x"), Jyy=("kg m^2", "about body y"), Jzz=("kg m^2", "about body z"),
        Jxy=("kg m^2", "product of inertia, element xy of the matrix"),
        Jxz=("kg m^2", "element xz"), Jyz=("kg m^2", "element yz"),
    )  # fmt: skip

    def kinetic_energy(self, b: Frame) -> Expr:
        v, (p, q, r) = b.center_velocity, b.spin
        energy = self.mass * (v @ v) / 2 + (self.Jxx * p * p + self.Jyy * q * q + self.Jzz * r * r) / 2
        if self.Jxy is not None:
            energy += self.Jxy * p * q + self.Jxz * p * r + self.Jyz * q * r
        return energy
