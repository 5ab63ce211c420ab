"""Bushing: elastic and damped connection of two points in all directions."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec


class Bushing(Force):
    """V = sum k_i d_i^2 / 2 along the axes of k, d the displacement of l's point; damping of the velocity of this
    point as seen from k."""

    params = params(
        kx=("N/m", "stiffness along k.x"), ky=("N/m", "stiffness along k.y"), kz=("N/m", "stiffness along k.z"),
        cx=("N s/m", "damping along k.x"), cy=("N s/m", "damping along k.y"), cz=("N s/m", "damping along k.z"),
    )  # fmt: skip
    axes_of = "k"

    def energy(self, k: Frame, l: Frame) -> Expr:
        if self.kx is None:
            return se.Integer(0)
        return along(k, l.r - k.r, (self.kx, self.ky, self.kz))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.cx is None:
            return se.Integer(0)
        return along(k, l.v - k.v - k.w.cross(l.r - k.r), (self.cx, self.cy, self.cz))


def along(k: Frame, a: Vec, weights: tuple[Expr, Expr, Expr]) -> Expr:
    """Half the weighted sum of squares of the components of a along the axes of k."""
    return sum((w * let(axis @ a) ** 2 / 2 for w, axis in zip(weights, (k.x, k.y, k.z), strict=True)), se.Integer(0))
