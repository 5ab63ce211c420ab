"""Contacts: places where two bodies may touch, each with a normal law and a friction law; the base of normal laws, a repulsive
force between two bodies that overlap; and Hertz contact with Hunt-Crossley damping.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Force
from mbdae.symbolic.part import Parameter, Part, checked_value, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec
from mbdae.values import number

__all__ = ["Hertz", "Normal"]


#: a start is refused where bodies penetrate by more than 1/DEEP of the smallest radius (of the pin in a race; without a radius:
#: of the scene's length), except contacts at rest and, unless a pin is concerned, continued runs. A run with a deeper
#: penetration has a warning, if there is a radius; with a pin already beyond the clearance, where that is smaller and not 0
DEEP = 10.0
RESTING = 1e-24  #: added to squares of sliding speeds, m^2/s^2, and of distances, m^2: their roots have derivatives at 0 then
CENTRED = 1e-40  #: added to the square of the distance of the centres of pin and race, m^2: its root has derivatives at 0 then


@dataclass(frozen=True)
class Station:
    """A place where the bodies may touch. Expressions of the frames; SI units."""

    penetration: Expr  #: m, positive in contact
    rate: Expr  #: time derivative of the penetration
    overlap: Expr  #: penetration where positive, else 0
    inward: Vec  #: unit vector (in contact): penetration grows as l moves along it; the normal force on l is against it
    tangent: Vec  #: unit vector (in contact) along which friction acts if it has internal states or `one_direction` holds
    sliding: Vec  #: velocity of l relative to k at the contact, without its normal part
    slip: Expr  #: component of `sliding` along the tangent
    arm: Vec  #: from l.r to the point where the force on l acts


def begins_with_force(force: Callable[[Expr], Expr]) -> bool:
    """Whether a force, as a function of the penetration, is another one than 0 at the penetration 0."""
    p = se.Symbol("penetration")
    return bool(se.sympify(force(p)).subs({p: 0}) != 0)


def station(penetration: Expr, inward: Vec, tangent: Vec, velocity: Vec, arm: Vec) -> Station:
    """A place of contact from its penetration and the velocity of the material point of l there relative to that of k."""
    rate = let(velocity @ inward, r"\dot a")
    overlap = let(se.Piecewise((penetration, penetration > 0), (0, True)), "a")
    slip = let(velocity @ tangent, "v_t")
    return Station(penetration, rate, overlap, inward, tangent, velocity - inward * rate, slip, arm)


class Contact(Force):
    """Bodies that touch at one or several places: `stations` says where, the normal and friction law how.

    On l act a normal force f_n, a function of the penetration and its rate, against `inward`, and friction against the sliding
    velocity; their opposites act on k at the same point, so that moments balance. Where `one_direction` holds, and for friction
    with internal states, friction acts along the tangent of each place only.
    """

    options = ("normal", "friction")
    dissipative = True
    timeless = True

    def own_states(self) -> Mapping[str, Parameter]:
        return {name + end: spec for part in self.parts for name, spec in part.states.items() for end in self.ends}

    def state_scales(self) -> dict[str, float]:
        return {name + end: scale for name, scale in super().state_scales().items() for end in self.ends}

    @property
    def ends(self) -> tuple[str, ...]:
        """Suffixes that distinguish the friction states of the places by name."""
        return ("",)

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        """The places where the bodies may touch, each with the suffix of its states."""
        raise LawError(f"contact {type(self).__name__} does not state `stations(self, k, l)`: add it; it returns the "
                       f"places where the bodies may touch, as that of JournalContact does")

    def equal(self, k: Frame, l: Frame) -> int:
        """Number of equal places for which each station stands: 2 where symmetry makes the contact at both ends the same."""
        return 1

    @property
    def one_direction(self) -> bool:
        """Whether friction acts along the tangents of the places only, not against the whole sliding velocity."""
        return True

    @staticmethod
    def sliding(k: Frame, l: Frame, from_l: Vec, from_k: Vec) -> Vec:
        """Velocity of the material point of l at the point of contact relative to that of k, m/s; from_l, from_k: vectors from
        l.r and from k.r to the point of contact, m."""
        return (l.v + l.w.cross(from_l)) - (k.v + k.w.cross(from_k))

    # -- forces

    def _normal_force(self, at: Station) -> tuple[Expr, Expr]:
        """Normal force f_n, N, and the part of it that is not elastic; both 0 where the surfaces are apart."""
        elastic = self._while_touching(at, self.normal.elastic_force)
        damped = self._while_touching(at, lambda p: self.normal.damping_force(p, at.rate))
        if damped == 0:
            return let(elastic, "f_n"), se.Integer(0)
        total = let(elastic + damped)
        force = let(se.Piecewise((total, total > 0), (0, True)), "f_n")
        return force, force - elastic

    @staticmethod
    def _while_touching(at: Station, force: Callable[[Expr], Expr]) -> Expr:
        """A force (N) of the overlap, which is 0 where the surfaces are apart: a law that begins with a force, such as a damper
        beside a spring, would act there at a distance."""
        e = force(at.overlap)
        return se.Piecewise((e, at.penetration > 0), (0, True)) if begins_with_force(force) else e

    def _friction_of(self, end: str) -> Any:
        return self.friction.with_states(**{name: getattr(self, name + end) for name in self.friction.states})

    def _friction(self, at: Station, end: str, force: Expr) -> Vec:
        """Friction force on l: against the whole sliding velocity, or along the tangent."""
        if self.friction is None:
            return ZERO
        if self.one_direction or self.friction.states:
            along, coefficient = at.tangent, let(self._friction_of(end).coefficient(at.slip))
        else:
            speed = let(se.sqrt(at.sliding @ at.sliding + RESTING))
            along, coefficient = at.sliding, let(self.friction.coefficient(speed) / speed)
        rubbing: Vec = along * (-coefficient * force)
        return rubbing

    def energy(self, k: Frame, l: Frame) -> Expr:
        return self.equal(k, l) * sum((self.normal.energy(at.overlap) for at, _ in self.stations(k, l)), se.Integer(0))

    def wrench(self, k: Frame, l: Frame) -> tuple[Vec, Vec]:
        force, torque = ZERO, ZERO
        for at, end in self.stations(k, l):
            normal, damped = self._normal_force(at)
            part = ((at.inward * (-damped) + self._friction(at, end, normal)) * self.equal(k, l)).named("f")
            force, torque = force + part, torque + at.arm.cross(part)
        return force, torque

    # -- friction states

    def _of_states(self, k: Frame, l: Frame, what: str) -> dict[str, Expr]:
        out: dict[str, Expr] = {}
        for at, end in self.stations(k, l):
            out |= {name + end: e for name, e in getattr(self._friction_of(end), what)(at.slip).items()}
        return out

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return self._of_states(k, l, "rate")

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return self._of_states(k, l, "initial")

    # -- gaps and sensors

    def gaps(self, k: Frame, l: Frame) -> list[tuple[Expr, Expr]]:
        return [(-at.penetration, -at.rate) for at, _ in self.stations(k, l)]

    @property
    def jumps(self) -> bool:
        rate = se.Symbol("rate")
        return begins_with_force(lambda p: self.normal.elastic_force(p) + self.normal.damping_force(p, rate))

    def contact_duration(self, mass: float, speed: Any) -> Any:
        return self.normal.impact(mass, speed)[1]

    def elastic_load(self, depth: float) -> tuple[float, float]:
        return float(self.normal.elastic_force(depth)), float(self.normal.energy(depth))

    def observed(self, k: Frame, l: Frame) -> dict[str, list[Expr]]:
        equal = self.equal(k, l)
        seen: dict[str, list[Expr]] = {}
        for at, end in self.stations(k, l):
            force, _ = self._normal_force(at)
            rubbing = self._friction(at, end, force)
            own = {"gap": -at.penetration, "gap_rate": -at.rate, "normal_force": equal * force, "slip": at.slip,
                   "friction_force": equal * (rubbing @ at.tangent),
                   "friction_power": -equal * (rubbing @ at.sliding)}
            for name, e in own.items():
                seen.setdefault(name, []).append(e)
        return seen

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        total = {"impact": se.Integer(0), "friction": se.Integer(0)}
        for at, end in self.stations(k, l):
            force, damped = self._normal_force(at)
            total["impact"] += self.equal(k, l) * damped * at.rate
            total["friction"] -= self.equal(k, l) * (self._friction(at, end, force) @ at.sliding)
        return total


class Normal(Part):
    """Base of normal contact laws: a repulsive force between two bodies that overlap.

    Normal force f_n = max(0, dV/dp + damping_force(p, rate)) of the penetration p > 0, m, and its rate, m/s.

    A law of one's own states `energy(p)`, and `damping_force(p, rate)` where it loses energy.
    """

    def energy(self, p: Expr) -> Expr:
        """Elastic energy of a penetration p >= 0, J."""
        raise LawError(f"normal law {type(self).__name__} does not state `energy(self, p)`: add it; it returns the "
                       f"elastic energy (J) of a penetration p (m)")

    def damping_force(self, p: Expr, rate: Expr) -> Expr:
        """Damping force, which is added to the elastic one, N."""
        return se.Integer(0)

    def elastic_force(self, p: Expr) -> Expr:
        """dV/dp, N."""
        x = se.Symbol("penetration")
        return se.diff(self.energy(x), x).subs({x: p})

    def penetration(self, force: float) -> float:
        """Static penetration under a force (N), m."""
        raise LawError(f"normal law {type(self).__name__} does not state `penetration(self, force)`: add it; it returns the "
                       f"penetration (m) at rest under a force (N)")

    def impact(self, mass: float, speed: Any) -> tuple[Any, Any]:
        """Largest penetration (m) and duration (s) of an elastic impact of an effective mass (kg) at a speed (m/s)."""
        raise LawError(f"normal law {type(self).__name__} does not state `impact(self, mass, speed)`: add it; it returns the "
                       f"largest penetration (m) and the duration (s) of an elastic impact")


#: duration of an elastic impact, times its speed, over the largest penetration: 2 int_0^1 dx / sqrt(1 - x^2.5)
DURATION = 2.9432751796


class Hertz(Normal):
    """Hertz contact with Hunt-Crossley damping.

    f_n = stiffness p^(3/2) (1 + damping p'), V = 2/5 stiffness p^(5/2); Eqs. 45-48 of the paper; at least 0: it never pulls.

    `damping` is lambda_h, s/m (mu in Eqs. 46 and 48). The paper is "Modified models for revolute
    joints coupling flexibility of links in multibody systems". Hertz's law holds for contact at a point; the contact of a pin
    that nearly fills its race is stiffer and more linear.
    """

    params = params(
        stiffness=("N/m^1.5", "contact stiffness"), damping=("s/m", "damping: the elastic force is taken 1 + damping rate times"),
    )

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
