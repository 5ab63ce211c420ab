"""Rotational bushing: elastic and damped connection of two attitudes about all axes."""

from __future__ import annotations

import symengine as se

from mbdae.laws.forces.bushing import along
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec


class RotationalBushing(Force):
    """V = sum c_i rho_i^2 / 2 about the axes of k; damping on the relative angular velocity.

    rho is the Rodrigues vector 2 tan(theta/2) n of the relative rotation by the angle theta about the axis n: it differs
    from the rotation vector theta n by terms of third order, and is finite below half a turn.
    """

    params = params(
        rx=("N m/rad", "stiffness about k.x"), ry=("N m/rad", "stiffness about k.y"), rz=("N m/rad", "stiffness about k.z"),
        sx=("N m s/rad", "damping about k.x"), sy=("N m s/rad", "damping about k.y"), sz=("N m s/rad", "damping about k.z"),
    )  # fmt: skip
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
