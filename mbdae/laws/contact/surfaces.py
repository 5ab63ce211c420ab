"""Base of contacts between the surfaces of two bodies that move freely."""

from __future__ import annotations

from math import inf
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.laws.contact.base import DEEP, RESTING, Contact, Station, station
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Impact
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec


class SurfaceContact(Contact):
    """Two surfaces that touch where they overlap, and slide in any direction.

    A law states `stations`. Sensors: `slip` (m/s) and `friction_force` (N) are magnitudes, since there is no preferred direction.
    Friction with internal states has one direction to slide in, so the scene must be planar for it.
    """

    with_joints = True

    @property
    def one_direction(self) -> bool:
        return False

    @property
    def smallest(self) -> float | None:
        """The smallest radius (m) of both surfaces, to which penetrations are compared; None where both are planes or points."""
        return None

    def place(self, k: Frame, l: Frame, penetration: Expr, inward: Vec, across: Vec, at: Vec) -> Station:
        """A place of contact. inward: direction on l in which penetration grows; across: unit vector normal to the plane of a
        planar scene; at: point of contact relative to l.r (a mass point takes no moment: there both forces act at it)."""
        if self.friction is not None and not (k.kind.oriented or l.kind.oriented):
            raise LawError("friction between two point masses has no moment that balances it; use s.rigid_body for one of them, "
                           "or leave friction out")
        if self.friction is not None and self.friction.states and not k.kind.flat:
            raise LawError(f"friction law {type(self.friction).__name__} has internal states for one direction of sliding, "
                           f"but bodies in space slide in two; take a law without states, such as mb.Coulomb")  # fmt: skip
        arm = ZERO if not l.kind.oriented else (at.named("h") if k.kind.oriented else k.r - l.r)
        velocity = self.sliding(k, l, arm, l.r + arm - k.r).named("v")
        return station(penetration, inward, across.cross(inward), velocity, arm)

    def approach(self, k: Frame, l: Frame) -> list[Expr]:
        return [gap for gap, _ in self.gaps(k, l)]

    def observed(self, k: Frame, l: Frame) -> dict[str, list[Expr]]:
        seen = super().observed(k, l)
        for i, (at, end) in enumerate(self.stations(k, l)):
            force, _ = self._normal_force(at)
            rubbing = self._friction(at, end, force)
            seen["slip"][i] = se.sqrt(at.sliding @ at.sliding)
            seen["friction_force"][i] = self.equal(k, l) * se.sqrt(rubbing @ rubbing)
        return seen

    def expected_depth(self, impact: Impact) -> float:
        """Penetration (m) of an impact at the likely speed, or under a known force where that is more."""
        still = float(self.normal.penetration(impact.force))
        moves = impact.mass < inf  # an infinite effective mass: neither of the bodies can move
        return max(float(self.normal.impact(impact.mass, impact.likely_speed)[0]), still) if moves else still

    def summary_of_contact(self) -> str:
        friction = "without friction" if self.friction is None else f"{type(self.friction).__name__} friction"
        return f"{type(self.normal).__name__}, {friction}"

    def refuses_start(self, depth: float, size: float, continued: bool) -> str:
        allowed = (size if self.smallest is None else self.smallest) / DEEP
        if depth <= allowed or continued:
            return ""
        length = "the scene's length" if self.smallest is None else f"its smallest radius of {self.smallest:g} m"
        return f"more than {1 / DEEP:g} of {length}: draw the bodies apart; the normal of a plane points to the side that is free"

    def doubtful_depth(self) -> tuple[float, str, str]:
        if self.smallest is None:
            return super().doubtful_depth()
        return (self.smallest / DEEP, "a tenth of the smallest radius",
                "a stiffer normal law is meant, or the bodies are too heavy or too fast for it")  # fmt: skip


def outside(u: Vec, name: str = "d") -> tuple[Expr, Vec]:
    """Length of a vector from a centre or axis outwards, and its direction; smoothed at 0, so that both have derivatives there.
    name: letter of the length in reports."""
    distance = let(se.sqrt(u @ u + RESTING), name)
    return distance, (u * (1 / distance)).named("n")


def radius(value: Any) -> Expr:
    """A radius, 0 where there is none."""
    return se.Integer(0) if value is None else value
