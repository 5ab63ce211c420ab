"""Spring and damper between two points."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.vectors import Expr


class PointSpring(Force):
    """V = stiffness (|d| - length)^2 / 2, Rayleigh function damping (d|d|/dt)^2 / 2, d from k's point to l's.

    Without `length` (a spring of zero natural length) V = stiffness d.d / 2 and damping acts on the whole velocity:
    smooth where the points meet.
    """

    params = params(stiffness=("N/m", "stiffness"), damping=("N s/m", "damping"), length=("m", "natural length"))

    def energy(self, k: Frame, l: Frame) -> Expr:
        d = l.r - k.r
        return self.stiffness * (d @ d if self.length is None else (d.norm() - self.length) ** 2) / 2

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        if self.damping is None:
            return super().dissipation(k, l)
        d, v = l.r - k.r, l.v - k.v
        return self.damping * (v @ v if self.length is None else (d @ v) ** 2 / (d @ d)) / 2
