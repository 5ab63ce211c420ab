"""Spring and damper on the free coordinate of a joint, turn after turn."""

from __future__ import annotations

from typing import ClassVar

from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.law import Force, Parameter, Structure, params
from mbdae.symbolic.variation import nearest_turn, rate
from mbdae.symbolic.vectors import Expr


class JointSpring(Force):
    """V = stiffness (c - rest)^2 / 2 of the joint's coordinate c (angle or displacement); paper Eq. 18, any attitude.

    In space the angle is known modulo a turn only. One differential state follows it (its rate is the rate of the
    angle), its value selects the turn: no history, safe under rejected steps. In the plane no state is needed.
    """

    params = params(
        stiffness=("N m/rad or N/m", "stiffness"), rest=("rad or m", "coordinate without force"),
        turns=("rad", "whole turns of the start angle"),
    )  # fmt: skip
    options = ("joint",)
    states: ClassVar[dict[str, Parameter]] = {"followed": Parameter("rad", "angle followed through all turns")}

    def _coordinate(self, k: Frame, l: Frame) -> Expr:
        return self.joint.symbolic(Structure()).coordinate(k, l)

    def energy(self, k: Frame, l: Frame) -> Expr:
        c = self._coordinate(k, l)
        if self.joint.coordinate_unit == "rad" and NodeKind.PLANAR not in (k.kind, l.kind):
            c = nearest_turn(c, self.followed)
        return self.stiffness * (c - self.rest) ** 2 / 2

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": rate(self._coordinate(k, l))}

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": self._coordinate(k, l) + self.turns}


class JointDamper(Force):
    """Rayleigh function damping (dc/dt)^2 / 2 of the joint's coordinate c; paper Eq. 19, any attitude."""

    params = params(damping=("N m s/rad or N s/m", "damping"))
    options = ("joint",)

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        c = self.joint.symbolic(Structure()).coordinate(k, l)
        return self.damping * rate(c) ** 2 / 2
