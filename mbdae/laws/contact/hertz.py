"""Hertz contact with Hunt-Crossley damping.

Damping: K.H. Hunt, F.R.E. Crossley, J. Appl. Mech. 42 (1975) 440.
"""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
import symengine as se

from mbdae.laws.contact.normal import Normal
from mbdae.symbolic.part import checked_value, params
from mbdae.symbolic.vectors import Expr
from mbdae.values import number

#: duration of an elastic impact, times its speed, over the largest penetration: 2 int_0^1 dx / sqrt(1 - x^2.5)
DURATION = 2.9432751796


class Hertz(Normal):
    """f_n = stiffness p^(3/2) (1 + damping p'), V = 2/5 stiffness p^(5/2); Eqs. 45-48 of the paper; at least 0: it never pulls.

    `damping` is lambda_h, s/m (mu in Eqs. 46 and 48). The paper is "Modified models for revolute
    joints coupling flexibility of links in multibody systems". Hertz's law holds for contact at a point; the contact of a pin
    that nearly fills its race is stiffer and more linear.
    """

    params = params(
        stiffness=("N/m^1.5", "contact stiffness"), damping=("s/m", "damping over the elastic force: force 1 + damping rate"),
    )  # fmt: skip

    def __init__(self, stiffness: float, damping: float = 0.0) -> None:
        super().__init__(stiffness=stiffness, damping=damping)
        self.number("stiffness", "above 0")
        self.damping = self.number("damping", why="every impact would gain energy") or None

    @classmethod
    def restitution(cls, stiffness: float, e: float, v: float) -> Self:
        """The law whose exit speed is e times the impact speed v (m/s), exactly: see `coefficient_of_restitution`."""
        item = "Hertz.restitution"
        ratio = checked_value(item, "e", e, number, "give the coefficient of restitution, above 0 and up to 1", above=0, most=1)
        speed = checked_value(item, "v", v, number, "give the impact speed at which e holds, above 0, m/s", above=0)
        return cls(stiffness, _damping_of(ratio) / speed)

    def coefficient_of_restitution(self, v: float) -> float:
        """e, exit speed over impact speed v (m/s), the solution of (1 - d e) exp(d e) = (1 + d) exp(-d) with d = damping v; it
        falls with v."""
        item = "Hertz.coefficient_of_restitution"
        d = (self.damping or 0.0) * checked_value(item, "v", v, number, "give the impact speed, above 0, m/s", above=0)
        if d == 0:
            return 1.0
        low, high = 0.0, min(1.0, 1 / d)
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (middle, high) if _kept(-d * middle) > _kept(d) else (low, middle)
        return low

    def energy(self, p: Expr) -> Expr:
        return se.Rational(2, 5) * self.stiffness * p ** se.Rational(5, 2)

    def damping_force(self, p: Expr, rate: Expr) -> Expr:
        if self.damping is None:
            return se.Integer(0)
        return self.stiffness * p ** se.Rational(3, 2) * self.damping * rate

    def penetration(self, force: float) -> float:
        return float((force / self.stiffness) ** (2 / 3))

    def impact(self, mass: float, speed: Any) -> tuple[Any, Any]:
        v = np.maximum(np.abs(speed), 1e-300)  # without a speed depth and duration are 0
        depth = (1.25 * mass * v**2 / self.stiffness) ** 0.4
        return depth, DURATION * depth / v


def _kept(x: float) -> float:
    """ln(1 + x) - x, which is equal at entry and exit of an impact: x = damping times rate of penetration, d and -d e."""
    return math.log1p(x) - x


def _damping_of(e: float) -> float:
    """d = damping v with the coefficient of restitution e, by bisection of the exact relation."""
    low, high = 0.0, 1.0

    def returns_more(d: float) -> bool:
        return d * e < 1 and _kept(-d * e) > _kept(d)

    if e == 1:
        return 0.0
    while returns_more(high):
        high *= 2
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if returns_more(middle) else (low, middle)
    return (low + high) / 2
