"""Coulomb friction made continuous."""

from __future__ import annotations

import symengine as se

from mbdae.laws.friction.base import Friction
from mbdae.symbolic.part import params
from mbdae.symbolic.vectors import Expr

SATURATED = 20.0  #: magnitude of the argument beyond which tanh is 1 or -1 in double precision


class Coulomb(Friction):
    """coefficient = mu tanh(v / v_c), paper Eq. 51; dissipative at every velocity, without stiction.

    Below some v_c a body creeps where it should stick: the model errs by about v_c times the time it would stick.
    """

    params = params(mu=("1", "friction coefficient of fast sliding"), v_c=("m/s", "velocity of the transition"))

    def __init__(self, mu: float, v_c: float) -> None:
        super().__init__(mu=mu, v_c=v_c)
        self.number("mu", why="friction would feed energy")
        self.number("v_c", "above 0", "it smooths the change of sign; about 1e-3 of the sliding velocity is usual")

    def coefficient(self, v: Expr) -> Expr:
        x = v / self.v_c
        return self.mu * se.Piecewise((1, x > SATURATED), (-1, x < -SATURATED), (se.tanh(x), True))

    def smallest_velocity(self) -> float:
        return float(self.v_c)
