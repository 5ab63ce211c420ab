"""Spring and damper between two points."""

from __future__ import annotations

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.vectors import Expr


class PointSpring(Force):
    """V = stiffness (|d| - length)^2 / 2, Rayleigh function damping (d|d|/dt)^2 / 2, d from k's point to l's.

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
                           "points may meet")  # fmt: skip
        d, v = l.r - k.r, l.v - k.v
        return self.damping * (d @ v) ** 2 / (d @ d) / 2
