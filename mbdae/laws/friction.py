"""Friction laws: their base, a signed coefficient as a function of the sliding velocity; Coulomb friction made continuous; and
LuGre, bristles that deflect, slip and store energy.
"""

from __future__ import annotations

import math

import symengine as se

from mbdae.errors import LawError, warn
from mbdae.symbolic.part import Parameter, Part, checked_value, params
from mbdae.symbolic.vectors import Expr
from mbdae.values import flag, number

__all__ = ["Coulomb", "Friction", "LuGre"]


class Friction(Part):
    """Base of friction laws: a signed coefficient as a function of the sliding velocity, with internal states if needed.

    Friction force on l along the tangent: f_t = - coefficient(v) f_n, v the signed velocity of l relative to k, m/s.

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


SATURATED = 20.0  #: magnitude of the argument beyond which tanh is 1 or -1 in double precision


class Coulomb(Friction):
    """Coulomb friction made continuous.

    coefficient = mu tanh(v / v_c), paper Eq. 51; dissipative at every velocity, without stiction.

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


class LuGre(Friction):
    """LuGre friction: bristles that deflect, slip and store energy.

    coefficient = sigma0 z + sigma1(v) z' + sigma2 v, z' = v - |v| z / g(v), v with its sign.

    These are Eqs. 49-54 of "Modified models for revolute joints coupling flexibility of links in multibody systems".

    g(v) = (mu_k + (mu_s - mu_k) exp(-|v/v_s|^gamma)) / sigma0. With `damping_decay` sigma1(v) = sigma1 exp(-(v/v_s)^2):
    a constant sigma1 feeds energy above v = 4 mu_k (sigma1 + sigma2) / sigma1^2 and changes impacts. The bristle
    deflection z is a state of the equations of motion, solved with the error control of the solver.
    """

    params = params(
        mu_k=("1", "coefficient of fast sliding"), mu_s=("1", "coefficient of breaking away"), v_s=("m/s", "Stribeck velocity"),
        sigma0=("1/m", "stiffness of the bristles over the normal force"), sigma1=("s/m", "their damping over the normal force"),
        sigma2=("s/m", "viscous coefficient over the normal force"),
    )
    options = ("gamma", "damping_decay")
    states = {"z": Parameter("m", "deflection of the bristles")}  # noqa: RUF012

    def __init__(self, mu_k: float, mu_s: float, v_s: float, sigma0: float, sigma1: float, sigma2: float = 0.0,
                 gamma: float = 2, damping_decay: bool = True) -> None:
        values = {"mu_k": mu_k, "mu_s": mu_s, "v_s": v_s, "sigma0": sigma0, "sigma1": sigma1, "sigma2": sigma2}
        exponent = checked_value("LuGre", "gamma", gamma, number, "give the Stribeck curve's exponent (2 is usual)",
                                 least=0.5, most=4)
        falls = checked_value("LuGre", "damping_decay", damping_decay, flag, "give True or False")
        super().__init__(**values, gamma=exponent, damping_decay=falls)
        for key in ("mu_k", "mu_s", "v_s", "sigma0"):
            self.number(key, "above 0")
        for key in ("sigma1", "sigma2"):
            setattr(self, key, self.number(key, why="friction would feed energy") or None)
        if self.mu_s < self.mu_k:
            raise self.refuse("mu_s", f"is below mu_k = {self.mu_k:g}: breaking away takes at least the force of sliding; give "
                                      f"at least mu_k")
        for doubt in self.doubts():
            warn(doubt)

    def _curve(self, v: Expr) -> Expr:
        """g(v), m."""
        x = (v / self.v_s) ** 2
        fall = se.exp(-x) if self.gamma == 2 else se.exp(-((x + 1e-30) ** (self.gamma / 2)))
        return (self.mu_k + (self.mu_s - self.mu_k) * fall) / self.sigma0

    def rate(self, v: Expr) -> dict[str, Expr]:
        return {"z": v - magnitude(v) * self.z / self._curve(v)}

    def coefficient(self, v: Expr) -> Expr:
        mu = self.sigma0 * self.z
        if self.sigma1 is not None:
            decay = se.exp(-((v / self.v_s) ** 2)) if self.damping_decay else 1
            mu += self.sigma1 * decay * self.rate(v)["z"]
        return mu if self.sigma2 is None else mu + self.sigma2 * v

    def initial(self, v: Expr) -> dict[str, Expr]:
        return {"z": self._curve(v) * se.Piecewise((1, v > 0), (-1, v < 0), (0, True))}

    def stored(self, v: Expr) -> Expr:
        return self.sigma0 * self.z**2 / 2

    def state_scales(self) -> dict[str, float]:
        return {"z": self.mu_k / self.sigma0}

    def smallest_velocity(self) -> float:
        return float(self.v_s)

    def largest(self) -> float:
        return float(self.mu_s)

    def doubts(self) -> list[str]:
        sigma1, sigma2 = self.sigma1 or 0.0, self.sigma2 or 0.0
        if not sigma1:
            return []
        found = []
        bound = 4 * math.sqrt(2 * math.e) * self.mu_k
        if not self.damping_decay:
            limit = 4 * self.mu_k * (sigma1 + sigma2) / sigma1**2
            found.append(f"LuGre: with damping_decay=False, sigma1 = {sigma1:g} s/m creates energy above "
                         f"{limit:.2g} m/s of sliding, and impacts differ; use damping_decay=True")
        elif sigma1 * self.v_s > bound:
            found.append(f"LuGre: sigma1 v_s = {sigma1 * self.v_s:.2g} exceeds 4 sqrt(2 e) mu_k = {bound:.2g}, and beyond that "
                         f"friction may create energy: take sigma1 of at most {bound / self.v_s:.3g} s/m")
        if self.mu_s / self.sigma0 > 1e-3:
            found.append(f"LuGre: sigma0 = {self.sigma0:g} 1/m lets the bristles deflect by {self.mu_s / self.sigma0:.2g} m "
                         f"before they slip (mu_s / sigma0): take a larger sigma0, a stiffness over the normal force, "
                         f"unless this is meant")
        return found
