"""Spring on a coordinate of a joint, turn after turn."""

from __future__ import annotations

from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Parameter, params
from mbdae.symbolic.variation import nearest_turn, rate
from mbdae.symbolic.vectors import Expr


class JointSpring(OnCoordinate):
    """V = stiffness (c - rest)^2 / 2 of the joint's coordinate c (angle or displacement); paper Eq. 18, at any attitude.

    In space the angle is known modulo a turn only, unless the joint keeps it as an unknown. One differential state
    follows it (its rate is the rate of the angle), its value selects the turn: no history, safe under rejected steps.
    In the plane no state is needed.
    """

    params = params(
        stiffness=("N m/rad or N/m", "stiffness"), rest=("rad or m", "coordinate without force"),
        turns=("rad", "whole turns of the start angle"),
    )  # fmt: skip
    follows = "followed"
    states = {"followed": Parameter("rad", "angle followed through all turns")}  # noqa: RUF012

    def energy(self, k: Frame, l: Frame) -> Expr:
        c = self.value(k, l)
        if self.known_modulo_turns(k, l):
            c = nearest_turn(c, self.followed)
        return self.stiffness * (c - self.rest) ** 2 / 2

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": rate(self.value(k, l))}

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": self.value(k, l) + self.turns}
