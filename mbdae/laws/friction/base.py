"""Base of friction laws: a signed coefficient as a function of the sliding velocity, with internal states if needed."""

from __future__ import annotations

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.part import Part
from mbdae.symbolic.vectors import Expr


class Friction(Part):
    """Friction force on l along the tangent: f_t = - coefficient(v) f_n, v the signed velocity of l relative to k, m/s.

    A law of one's own states `coefficient(v)`, an odd function of v; with internal states (`states`, units by name) also
    `rate(v)`, and `initial(v)` where they do not start at 0. States and parameters are attributes of those names. A law by
    which nothing can stick (a force proportional to v) may say `sticks = False`: solvers need not be prepared for it then.
    """

    sticks = True

    def coefficient(self, v: Expr) -> Expr:
        """Friction coefficient with the sign of the velocity; the friction power is -coefficient(v) v f_n."""
        raise LawError(f"friction law {type(self).__name__} does not state `coefficient(self, v)`: add it; it returns the "
                       f"friction coefficient, with its sign, at a sliding velocity v (m/s)")

    def rate(self, v: Expr) -> dict[str, Expr]:
        """Time derivative of every internal state."""
        return {}

    def initial(self, v: Expr) -> dict[str, Expr]:
        """Start value of every internal state."""
        return {name: se.Integer(0) for name in self.states}

    def stored(self, v: Expr) -> Expr:
        """Energy over normal force stored in the internal states, m."""
        return se.Integer(0)

    def smallest_velocity(self) -> float | None:
        """Velocity (m/s) over which the coefficient changes: the tolerance has to resolve it; None where there is none."""
        return None

    def largest(self) -> float | None:
        """The largest coefficient among speeds up to 1 km/s; None of a law with internal states that does not state it."""
        if self.states:
            return None
        v = se.Symbol("v")
        values = [se.sympify(self.coefficient(v)).subs({v: se.RealDouble(10.0**power)}) for power in range(-6, 4)]
        return None if any(value.free_symbols for value in values) else max(abs(float(value)) for value in values)

    def feeds_at(self) -> float | None:
        """A speed (m/s) at which the law, which has no internal states, drives bodies instead of braking them, or has no finite
        value; None where there is none among those tried. Raises LawError where `coefficient` is no expression of v."""
        v = se.Symbol("v")
        coefficient = se.sympify(self.coefficient(v))
        for speed in (sign * 10.0**power for power in range(-6, 4) for sign in (1, -1)):
            value = coefficient.subs({v: se.RealDouble(speed)})
            if not value.free_symbols and not float(value) * speed >= 0:
                return float(speed)
        return None

    def doubts(self) -> list[str]:
        """Warnings about these parameter values, one sentence each."""
        return []


def magnitude(v: Expr) -> Expr:
    """|v|, differentiable on both sides."""
    return se.Piecewise((v, v > 0), (-v, True))
