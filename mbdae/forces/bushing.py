"""Bushing: elastic and damped connection of two bodies in all directions."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec


class Bushing(Force):
    """V = sum k_i d_i^2 / 2 + sum c_i rho_i^2 / 2 along the axes of k.

    d: displacement of l's point; rho: Rodrigues vector 2 tan(theta/2) n of the relative rotation, the rotation
    vector to third order, finite below half a turn. Damping on the velocity of l seen from k and on the relative
    angular velocity.
    """

    params = params(
        kx=("N/m", "stiffness along k.x"), ky=("N/m", "along k.y"), kz=("N/m", "along k.z"),
        cx=("N s/m", "damping along k.x"), cy=("N s/m", "along k.y"), cz=("N s/m", "along k.z"),
        rx=("N m/rad", "rotational stiffness about k.x"), ry=("N m/rad", "about k.y"), rz=("N m/rad", "about k.z"),
        sx=("N m s/rad", "rotational damping about k.x"), sy=("N m s/rad", "about k.y"), sz=("N m s/rad", "about k.z"),
    )  # fmt: skip

    axes_of = "k"

    def energy(self, k: Frame, l: Frame) -> Expr:
        energy = _along(k, l.r - k.r, (self.kx, self.ky, self.kz))
        if self.rx is not None:
            sine = Vec(k.y @ l.z, k.z @ l.x, k.x @ l.y) - Vec(k.z @ l.y, k.x @ l.z, k.y @ l.x)
            half = let(4 / (1 + k.x @ l.x + k.y @ l.y + k.z @ l.z)) / 2
            energy += sum(c * let(-half * s) ** 2 / 2 for c, s in zip((self.rx, self.ry, self.rz), sine, strict=True))
        return energy

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        power = se.Integer(0)
        if self.cx is not None:
            power += _along(k, l.v - k.v - k.w.cross(l.r - k.r), (self.cx, self.cy, self.cz))
        if self.sx is not None:
            power += _along(k, l.w - k.w, (self.sx, self.sy, self.sz))
        return power


def _along(k: Frame, a: Vec, weights: tuple[Expr, Expr, Expr]) -> Expr:
    """Half the weighted sum of squares of the components of a along the axes of k."""
    return sum((w * let(axis @ a) ** 2 / 2 for w, axis in zip(weights, (k.x, k.y, k.z), strict=True)), se.Integer(0))
