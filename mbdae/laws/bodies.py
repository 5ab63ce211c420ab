"""What carries unknowns: elements with one node (point mass, rigid body, node of a beam, the coordinate of a joint as an unknown
of its own), states of control that are integrated with the motion, outputs of sampled controllers held between two instants; and
expressions of sensors that controllers, events and loads read.
"""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Element, TwoBodyLaw, params
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.part import Parameter
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
    """An unknown of its own: its equation of motion says that the forces on it add to zero, or to what a rotor needs that moves
    with it alone.

    T = rotor c'^2 / 2 of a coordinate c."""

    params = params(rotor=("kg m^2 or kg", "inertia of the coordinate's own, such as a motor's times its gear ratio squared"))

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0) if self.rotor is None else self.rotor * b.center_velocity[0] ** 2 / 2


class BeamNode(Element):
    """A node without inertia of its own: the mass of a beam is consistent, spread over the nodes of its elements."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)


class InternalState(TwoBodyLaw):
    """A state of a controller, filter or actuator, integrated with the motion.

    d value / dt = rate. The law acts on no bodies; its rate is an expression of sensors."""

    frames = ()
    params = params(rate=("1/s", "time derivative"), start=("1", "value at the start"), size=("1", "typical magnitude"))
    states = {"value": Parameter("1", "value")}  # noqa: RUF012
    keeps_states = True
    sticks = False

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.rate}

    def initial(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.start}

    def state_scales(self) -> dict[str, float]:
        return {"value": float(self.size)}


class HeldOutput(InternalState):
    """A state that is constant between the instants at which a sampled controller sets it."""

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": se.Integer(0)}


class Observed(TwoBodyLaw):
    """A value that is computed and exerts no force."""

    frames = ()
    params = params(value=("1", "what is observed"))

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)


def observed_value(d: Derived) -> list[tuple[Target, Expr]]:
    """The value as an output of the law's kernel; none for other laws."""
    return [(("observed",), se.Symbol("value"))] if isinstance(d.law, Observed) else []
