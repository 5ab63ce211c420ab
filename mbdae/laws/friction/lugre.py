"""LuGre friction: bristles that deflect, slip and store energy.

C. Canudas de Wit, H. Olsson, K.J. Astrom, P. Lischinsky, IEEE Trans. Automat. Contr. 40 (1995) 419.
"""

from __future__ import annotations

import math

import symengine as se

from mbdae.errors import warn
from mbdae.laws.friction.base import Friction, magnitude
from mbdae.symbolic.part import Parameter, checked_value, params
from mbdae.symbolic.vectors import Expr
from mbdae.values import flag, number


class LuGre(Friction):
    """coefficient = sigma0 z + sigma1(v) z' + sigma2 v, z' = v - |v| z / g(v), v with its sign.

    These are Eqs. 49-54 of "Modified models for revolute joints coupling flexibility of links in multibody systems".

    g(v) = (mu_k + (mu_s - mu_k) exp(-|v/v_s|^gamma)) / sigma0. With `damping_decay` sigma1(v) = sigma1 exp(-(v/v_s)^2):
    a constant sigma1 feeds energy above v = 4 mu_k (sigma1 + sigma2) / sigma1^2 and changes impacts. The bristle
    deflection z is a state of the equations of motion, solved with the error control of the solver.
    """

    params = params(
        mu_k=("1", "coefficient of fast sliding"), mu_s=("1", "coefficient of breaking away"), v_s=("m/s", "Stribeck velocity"),
        sigma0=("1/m", "stiffness of the bristles over the normal force"), sigma1=("s/m", "their damping over the normal force"),
        sigma2=("s/m", "viscous coefficient over the normal force"),
    )  # fmt: skip
    options = ("gamma", "damping_decay")
    states = {"z": Parameter("m", "deflection of the bristles")}  # noqa: RUF012

    def __init__(self, mu_k: float, mu_s: float, v_s: float, sigma0: float, sigma1: float, sigma2: float = 0.0,
                 gamma: float = 2, damping_decay: bool = True) -> None:  # fmt: skip
        values = {"mu_k": mu_k, "mu_s": mu_s, "v_s": v_s, "sigma0": sigma0, "sigma1": sigma1, "sigma2": sigma2}
        exponent = checked_value("LuGre", "gamma", gamma, number, "give the Stribeck curve's exponent (2 is usual)",
                                 least=0.5, most=4)  # fmt: skip
        falls = checked_value("LuGre", "damping_decay", damping_decay, flag, "give True or False")
        super().__init__(**values, gamma=exponent, damping_decay=falls)
        for key in ("mu_k", "mu_s", "v_s", "sigma0"):
            self.number(key, "above 0")
        for key in ("sigma1", "sigma2"):
            setattr(self, key, self.number(key, why="friction would feed energy") or None)
        if self.mu_s < self.mu_k:
            raise self.refuse("mu_s", f"is below mu_k = {self.mu_k:g}: breaking away takes at least the force of sliding; give "
                                      f"at least mu_k")  # fmt: skip
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
        sense = se.Piecewise((1, v > 0), (-1, v < 0), (0, True))
        return {"z": self._curve(v) * sense}

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
                         f"{limit:.2g} m/s of sliding, and impacts differ; use damping_decay=True")  # fmt: skip
        elif sigma1 * self.v_s > bound:
            found.append(f"LuGre: sigma1 v_s = {sigma1 * self.v_s:.2g} exceeds 4 sqrt(2 e) mu_k = {bound:.2g}, and beyond that "
                         f"friction may create energy: take sigma1 of at most {bound / self.v_s:.3g} s/m")  # fmt: skip
        if self.mu_s / self.sigma0 > 1e-3:
            found.append(f"LuGre: sigma0 = {self.sigma0:g} 1/m lets the bristles deflect by {self.mu_s / self.sigma0:.2g} m "
                         f"before they slip (mu_s / sigma0): take a larger sigma0, a stiffness over the normal force, "
                         f"unless this is meant")  # fmt: skip
        return found
