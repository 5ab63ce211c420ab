"""Applied force and torque on a body."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.vectors import ZERO, Vec, components

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
