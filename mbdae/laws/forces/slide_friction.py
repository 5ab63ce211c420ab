"""Friction along the axis of a prismatic joint under a given normal force."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec


class SlideFriction(Force):
    """Force -coefficient(v) normal_force on l along k.z, v the rate of the displacement, m/s; its opposite on k."""

    params = params(normal_force=("N", "force that presses l on k"))
    options = ("friction",)
    dissipative = True

    def _sliding(self, k: Frame, l: Frame) -> Expr:
        return let(k.z @ (l.v - k.v - k.w.cross(l.r - k.r)))

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec] | None:
        if self.friction is None:
            return None
        return k.z * self._force(k, l), ZERO

    def _force(self, k: Frame, l: Frame) -> Expr:
        """Friction force on l along k.z, N."""
        return let(-self.friction.coefficient(self._sliding(k, l)) * self.normal_force)

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {} if self.friction is None else {"friction": -self._force(k, l) * self._sliding(k, l)}

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.rate(self._sliding(k, l)))

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.initial(self._sliding(k, l)))
