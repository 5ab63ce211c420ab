"""Elements with one node: point mass, rigid body, node of a beam, and the coordinate of a joint as an unknown of its own.
"""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element, params
from mbdae.symbolic.vectors import Expr

__all__ = ["BeamNode", "JointCoordinate", "PointMass", "RigidBody"]

ORDERS = (1, 2, 3, 4)  #: of the interpolation along elements of beams


class PointMass(Element):
    """Point mass: position only.

    T = m v.v / 2."""

    params = params(mass=("kg", "mass"))

    def kinetic_energy(self, b: Frame) -> Expr:
        return self.mass * (b.center_velocity @ b.center_velocity) / 2


class RigidBody(Element):
    """Rigid body with its node at the centre of mass.

    T = m v.v / 2 + Omega.J Omega / 2 with J about the centre of mass in body axes."""

    params = params(
        mass=("kg", "mass"),
        Jxx=("kg m^2", "moment of inertia about body x"), Jyy=("kg m^2", "about body y"), Jzz=("kg m^2", "about body z"),
        Jxy=("kg m^2", "product of inertia, element xy of the matrix"),
        Jxz=("kg m^2", "element xz"), Jyz=("kg m^2", "element yz"),
    )

    def kinetic_energy(self, b: Frame) -> Expr:
        v, (p, q, r) = b.center_velocity, b.spin
        energy = self.mass * (v @ v) / 2 + (self.Jxx * p * p + self.Jyy * q * q + self.Jzz * r * r) / 2
        if self.Jxy is not None:
            energy += self.Jxy * p * q + self.Jxz * p * r + self.Jyz * q * r
        return energy


class JointCoordinate(Element):
    """An unknown without mass: its equation of motion says that the forces on it add to zero."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)


class BeamNode(Element):
    """A node without inertia of its own: the mass of a beam is consistent, spread over the nodes of its elements."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)
