"""Forces on and between bodies: applied forces and torques, gravity, the spring between two points, bushings of points and of
attitudes, and the load distributed along a line element.
"""

from __future__ import annotations

import symengine as se

from mbdae.errors import LawError
from mbdae.laws.on_coordinates import (
    Differential,
    Gear,
    JointDamper,
    JointFriction,
    JointLoad,
    JointSpring,
    JointStop,
    Rack,
    WeightedSum,
)
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec, components

__all__ = ["AppliedForce", "AppliedTorque", "Bushing", "Differential", "Gear", "Gravity", "JointDamper", "JointFriction",
           "JointLoad", "JointSpring", "JointStop", "PointSpring", "Rack", "RotationalBushing", "WeightedSum"]


_FORCE = params(fx=("N", "force, x"), fy=("N", "force, y"), fz=("N", "force, z"))
_TORQUE = params(mx=("N m", "torque, x"), my=("N m", "torque, y"), mz=("N m", "torque, z"))


def _resolved(l: Frame, value: Vec, following: bool) -> Vec:
    """The value in inertial axes, or along the axes of the body it follows."""
    return l.x * value[0] + l.y * value[1] + l.z * value[2] if following else value


class AppliedForce(Force):
    """Force at a point of l; with `following` its components turn with the body. k is the ground."""

    params = _FORCE
    options = ("following",)
    external = True
    axes_of = "l"
    loads = True

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return _resolved(l, components(self.fx, self.fy, self.fz), self.following), ZERO


class AppliedTorque(Force):
    """Torque on l; with `following` its components turn with the body. k is the ground."""

    params = _TORQUE
    options = ("following",)
    external = True
    axes_of = "l"
    loads = True

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        return ZERO, _resolved(l, components(self.mx, self.my, self.mz), self.following)


class Gravity(Force):
    """Gravity on a body.

    V = - m g.r of the centre of mass; k is the ground; components left out are zero."""

    params = params(
        mass=("kg", "mass"), gx=("m/s^2", "field, x"), gy=("m/s^2", "field, y"), gz=("m/s^2", "field, z")
    )

    external = True
    loads = True
    at_nodes = True

    def energy(self, k: Frame, l: Frame) -> Expr:
        return -self.mass * (components(self.gx, self.gy, self.gz) @ l.center)


class PointSpring(Force):
    """Spring and damper between two points.

    V = stiffness (|d| - length)^2 / 2, Rayleigh function damping (d|d|/dt)^2 / 2, d from k's point to l's.

    Without `length` (a spring of zero natural length) V = stiffness d.d / 2, smooth where the points meet. The damper acts
    along d, which has no direction where the points meet; for points that may meet use a bushing.
    """

    params = params(stiffness=("N/m", "stiffness"), damping=("N s/m", "damping"), length=("m", "natural length"))

    def undefined_at(self) -> tuple[str, ...]:
        return () if self.length is None else ("points together",)

    def energy(self, k: Frame, l: Frame) -> Expr:
        d = l.r - k.r
        return self.stiffness * (d @ d if self.length is None else (d.norm() - self.length) ** 2) / 2

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.damping is None:
            return super().dissipation(k, l)
        if self.length is None:
            raise LawError("a damper between two points needs a natural length: give length > 0 (m), or use a bushing where the "
                           "points may meet")
        d, v = l.r - k.r, l.v - k.v
        return self.damping * (d @ v) ** 2 / (d @ d) / 2


class Bushing(Force):
    """Bushing: elastic and damped connection of two points in all directions.

    V = sum k_i d_i^2 / 2 along the axes of k, d the displacement of l's point; damping of the velocity of this
    point as seen from k."""

    params = params(
        kx=("N/m", "stiffness along k.x"), ky=("N/m", "stiffness along k.y"), kz=("N/m", "stiffness along k.z"),
        cx=("N s/m", "damping along k.x"), cy=("N s/m", "damping along k.y"), cz=("N s/m", "damping along k.z"),
    )
    axes_of = "k"

    def energy(self, k: Frame, l: Frame) -> Expr:
        return se.Integer(0) if self.kx is None else along(k, l.r - k.r, (self.kx, self.ky, self.kz))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.cx is None:
            return se.Integer(0)
        return along(k, l.v - k.v - k.w.cross(l.r - k.r), (self.cx, self.cy, self.cz))


def along(k: Frame, a: Vec, weights: tuple[Expr, Expr, Expr]) -> Expr:
    """Half the weighted sum of squares of the components of a along the axes of k."""
    return sum((w * let(axis @ a) ** 2 / 2 for w, axis in zip(weights, (k.x, k.y, k.z), strict=True)), se.Integer(0))


class RotationalBushing(Force):
    """Rotational bushing: elastic and damped connection of two attitudes about all axes.

    V = sum c_i rho_i^2 / 2 about the axes of k; damping on the relative angular velocity.

    rho is the Rodrigues vector 2 tan(theta/2) n of the relative rotation by the angle theta about the axis n: it differs
    from the rotation vector theta n by terms of third order, and is finite below half a turn.
    """

    params = params(
        rx=("N m/rad", "stiffness about k.x"), ry=("N m/rad", "stiffness about k.y"), rz=("N m/rad", "stiffness about k.z"),
        sx=("N m s/rad", "damping about k.x"), sy=("N m s/rad", "damping about k.y"), sz=("N m s/rad", "damping about k.z"),
    )
    axes_of = "k"

    def undefined_at(self) -> tuple[str, ...]:
        return ("half turn",)

    def energy(self, k: Frame, l: Frame) -> Expr:
        if self.rx is None:
            return se.Integer(0)
        twice_sine = Vec(k.y @ l.z - k.z @ l.y, k.z @ l.x - k.x @ l.z, k.x @ l.y - k.y @ l.x)
        trace = let(k.x @ l.x + k.y @ l.y + k.z @ l.z)
        squares = sum((c * let(s) ** 2 / 2 for c, s in zip((self.rx, self.ry, self.rz), twice_sine, strict=True)), se.Integer(0))
        return let(2 / (1 + trace)) ** 2 * let(squares)

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        return se.Integer(0) if self.sx is None else along(k, l.w - k.w, (self.sx, self.sy, self.sz))
