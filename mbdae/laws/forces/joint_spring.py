"""Spring and damper on the free coordinate of a joint, turn after turn."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.law import Force, Parameter, Structure, params
from mbdae.symbolic.variation import nearest_turn, rate
from mbdae.symbolic.vectors import Expr


class _OnCoordinate(Force):
    """A law on the free coordinate of the joint it belongs to: its relative motion, or its own unknown."""

    options = ("joint",)

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(self.joint.coordinates)

    def _coordinate(self, k: Frame, l: Frame) -> Expr:
        joint = self.joint.symbolic(Structure())
        for name in self.own_coordinates:
            setattr(joint, name, getattr(self, name))
        return joint.coordinate(k, l)


class JointSpring(_OnCoordinate):
    """V = stiffness (c - rest)^2 / 2 of the joint's coordinate c (angle or displacement); paper Eq. 18, any attitude.

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
        c = self._coordinate(k, l)
        known_modulo_turns = self.joint.coordinate_unit == "rad" and not self.own_coordinates
        if known_modulo_turns and NodeKind.PLANAR not in (k.kind, l.kind):
            c = nearest_turn(c, self.followed)
        return self.stiffness * (c - self.rest) ** 2 / 2

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": rate(self._coordinate(k, l))}

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": self._coordinate(k, l) + self.turns}


class JointDamper(_OnCoordinate):
    """Rayleigh function damping (dc/dt)^2 / 2 of the joint's coordinate c; paper Eq. 19, any attitude."""

    params = params(damping=("N m s/rad or N s/m", "damping"))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        return self.damping * rate(self._coordinate(k, l)) ** 2 / 2
