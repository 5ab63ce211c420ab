"""Gravity on a body."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.vectors import Expr, components


class Gravity(Force):
    """V = - m g.r of the centre of mass; k is the ground; components left out are zero."""

    params = params(
        mass=("kg", "mass"), gx=("m/s^2", "field, x"), gy=("m/s^2", "field, y"), gz=("m/s^2", "field, z")
    )  # fmt: skip

    external = True
    loads = True
    at_nodes = True

    def energy(self, k: Frame, l: Frame) -> Expr:
        return -self.mass * (components(self.gx, self.gy, self.gz) @ l.center)
