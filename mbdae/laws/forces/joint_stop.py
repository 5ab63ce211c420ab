"""Stops at the limits of a coordinate of a joint."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import symengine as se

from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Impact, params
from mbdae.symbolic.variation import let, rate
from mbdae.symbolic.vectors import Expr

#: excess over a limit (rad, or over the scene's length) up to which a start is accepted; a continued run may begin with more
ALLOWED = 1e-6


class _Limit(NamedTuple):
    """A limit of the coordinate. way: how far the coordinate is past it, m or rad, > 0 in contact; rate: time derivative of way;
    overlap: way where it is positive, else 0; sense: 1 for an upper, -1 for a lower limit."""

    way: Expr
    rate: Expr
    overlap: Expr
    sense: int


class JointStop(OnCoordinate):
    """Elastic stops at the limits of the joint's coordinate c: one-sided springs with dampers.

    The coordinate is past a limit by p = c - upper, or p = lower - c. Where p > 0, the force max(0, stiffness p + damping dp/dt)
    pushes it back; nothing acts elsewhere. V = stiffness p^2 / 2. As the coordinate returns, the force ends before p = 0, since
    the damper would then make the stop pull; the energy V left at that instant is lost.

    An impact of an effective mass or inertia m under this force alone lasts 2 a / w, and the speed at its end is exp(-2 z a)
    times that of entry; w = sqrt(stiffness / m), z = damping / (2 m w), a = arccos(z) / sqrt(1 - z^2), or
    arcosh(z) / sqrt(z^2 - 1) where z > 1."""

    params = params(
        stiffness=("N m/rad or N/m", "stiffness"), damping=("N m s/rad or N s/m", "damping"),
        lower=("rad or m", "lower limit of the coordinate; None: there is none"),
        upper=("rad or m", "upper limit of the coordinate; None: there is none"),
    )  # fmt: skip
    dissipative = True
    timeless = True
    with_joints = True

    def _limits(self, k: Frame, l: Frame) -> list[_Limit]:
        """The limits there are, the lower one first."""
        c = let(self.value(k, l), "c")
        speed = rate(self.value(k, l))
        found = []
        for limit, sense in ((self.lower, -1), (self.upper, 1)):
            if limit is not None:
                way = let(sense * (c - limit), "p")
                overlap = let(se.Piecewise((way, way > 0), (0, True)), "a")
                found.append(_Limit(way, let(sense * speed, r"\dot p"), overlap, sense))
        return found

    def _damped(self, at: _Limit) -> Expr:
        """Force of a stop less its elastic part, N or N m, positive where it pushes the coordinate back."""
        total = let(self.stiffness * at.overlap + self.damping * at.rate)
        pressing = se.Piecewise((total, total > 0), (0, True))
        return let(se.Piecewise((pressing - self.stiffness * at.overlap, at.way > 0), (0, True)))

    def energy(self, k: Frame, l: Frame) -> Expr:
        return sum((self.stiffness * at.overlap**2 / 2 for at in self._limits(k, l)), se.Integer(0))

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr] | None:
        if self.damping is None:
            return None
        return self.value(k, l), sum((-at.sense * self._damped(at) for at in self._limits(k, l)), se.Integer(0))

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        if self.damping is None:
            return {}
        return {"impact": sum((self._damped(at) * at.rate for at in self._limits(k, l)), se.Integer(0))}

    # -- as a one-sided law

    def gaps(self, k: Frame, l: Frame) -> list[tuple[Expr, Expr]]:
        return [(-at.way, -at.rate) for at in self._limits(k, l)]

    def approach(self, k: Frame, l: Frame) -> list[Expr]:
        return [self.value(k, l)]

    @property
    def jumps(self) -> bool:
        return bool(self.damping)

    @property
    def gap_unit(self) -> str:
        return self.unit

    def gap_names(self) -> list[str]:
        named = (("lower", self.lower), ("upper", self.upper))
        return [f"{which} limit of {self.name_of_coordinate}" for which, limit in named if limit is not None]

    def contact_duration(self, mass: float, speed: Any) -> Any:
        if math.isinf(mass):
            return math.inf + 0 * speed
        w, _, a = self._impact(mass)
        return 2 * a / w + 0 * speed

    def restitution(self, mass: float) -> float:
        """Speed after an impact of an effective mass or inertia (kg, kg m^2) over that before."""
        _, z, a = self._impact(mass)
        return math.exp(-2 * z * a)

    def _impact(self, mass: float) -> tuple[float, float, float]:
        """w, z and a of an impact (see the class)."""
        w = math.sqrt(self.stiffness / mass)
        z = (self.damping or 0.0) / (2 * mass * w)
        if abs(z - 1) < 1e-6:
            return w, z, 1.0
        return w, z, math.acos(z) / math.sqrt(1 - z * z) if z < 1 else math.acosh(z) / math.sqrt(z * z - 1)

    def expected_depth(self, impact: Impact) -> float:
        if math.isinf(impact.mass):
            return math.inf
        w, z, a = self._impact(impact.mass)
        return impact.likely_speed / w * math.exp(-z * a)

    def elastic_load(self, depth: float) -> tuple[float, float]:
        return self.stiffness * depth, self.stiffness * depth**2 / 2

    def summary_of_contact(self) -> str:
        low, high = ("none" if limit is None else f"{limit:.6g}" for limit in (self.lower, self.upper))
        unit = "N m/rad" if self.unit == "rad" else "N/m"
        turns = ", an unknown of its own so that whole turns count" if self.unit == "rad" else ""
        return f"limits ({low}, {high}) {self.unit} of {self.name_of_coordinate}{turns}, stop of {self.stiffness:.3g} {unit}"

    def refuses_start(self, depth: float, size: float, continued: bool) -> str:
        if continued or depth <= ALLOWED * size:
            return ""
        low, high = ("none" if limit is None else f"{limit:.6g}" for limit in (self.lower, self.upper))
        return (f"its {self.name_of_coordinate} is outside its limits ({low}, {high}) {self.unit}: start it inside them, or "
                f"draw the scene so")  # fmt: skip
