"""Friction on a coordinate of a joint under a given normal force."""

from __future__ import annotations

from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import params
from mbdae.symbolic.variation import let, rate
from mbdae.symbolic.vectors import Expr


class JointFriction(OnCoordinate):
    """Force -coefficient(v) normal_force against the sliding velocity v: the rate of a displacement, or of an angle times
    `radius`, which is the lever of the force."""

    params = params(normal_force=("N", "force that presses l on k"), radius=("m", "radius at which friction acts"))
    options = (*OnCoordinate.options, "friction")
    dissipative = True

    def _lever(self) -> Expr:
        return self.radius if self.unit == "rad" else 1

    def _sliding(self, k: Frame, l: Frame) -> Expr:
        return let(self._lever() * rate(self.value(k, l)))

    def _force(self, k: Frame, l: Frame) -> Expr:
        """Friction force on l at the rubbing surface, N."""
        return let(-self.friction.coefficient(self._sliding(k, l)) * self.normal_force)

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr] | None:
        return None if self.friction is None else (self.value(k, l), self._force(k, l) * self._lever())

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {} if self.friction is None else {"friction": -self._force(k, l) * self._sliding(k, l)}

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.rate(self._sliding(k, l)))

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.initial(self._sliding(k, l)))
