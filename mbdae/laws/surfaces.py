"""Contacts between the surfaces of two bodies that move freely: ball on ball, ball on cylinder, ball on plane and cylinder on
plane.
"""

from __future__ import annotations

from math import inf
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.laws.contact import DEEP, RESTING, Contact, Station, station
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Impact
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec

__all__ = ["BallOnBall", "BallOnCylinder", "BallOnPlane", "CylinderOnPlane"]


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
                           f"but bodies in space slide in two; take a law without states, such as mb.Coulomb")
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
                "a stiffer normal law is meant, or the bodies are too heavy or too fast for it")


def outside(u: Vec, name: str = "d") -> tuple[Expr, Vec]:
    """Length of a vector from a centre or axis outwards, and its direction; smoothed at 0, so that both have derivatives there.
    name: letter of the length in reports."""
    distance = let(se.sqrt(u @ u + RESTING), name)
    return distance, (u * (1 / distance)).named("n")


def radius(value: Any) -> Expr:
    """A radius, 0 where there is none."""
    return se.Integer(0) if value is None else value


class BallOnBall(SurfaceContact):
    """Two balls with their centres at k.r and l.r; discs in a planar scene.

    u = l.r - k.r, d its length, n = u / d, penetration p = radius_k + radius_l - d; both forces act in the middle of
    the overlap."""

    params = params(
        radius_k=("m", "radius of the ball on k; None: a point"), radius_l=("m", "radius of the ball on l; None: a point"),
    )

    @property
    def smallest(self) -> float | None:
        return min((float(r) for r in (self.radius_k, self.radius_l) if r is not None), default=None)

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        distance, normal = outside((l.r - k.r).named("u"))
        penetration = let(radius(self.radius_k) + radius(self.radius_l) - distance, "p")
        return [(self.place(k, l, penetration, -normal, k.z, normal * (penetration / 2 - radius(self.radius_l))), "")]


class BallOnCylinder(SurfaceContact):
    """A ball of l with its centre at l.r on a cylinder of k with its middle at k.r and its axis along k.z.

    b and h are the distances of the ball's centre from the curved surface and from the plane of the nearer end, positive outside.
    The ball touches the curved surface where only b is positive, the end where only h is, the rim where both are; with its centre
    inside, the surface that is nearer. Without a length there are no ends."""

    params = params(
        radius_k=("m", "radius of the cylinder"), radius_l=("m", "radius of the ball; None: a point"),
        length=("m", "length of the cylinder; None: without ends"),
    )

    @property
    def smallest(self) -> float | None:
        return min(float(r) for r in (self.radius_k, self.radius_l) if r is not None)

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        u = l.r - k.r
        along = let(u @ k.z, "z_a")
        distance, radial = outside((u - k.z * along).named("u"))
        beside = let(distance - self.radius_k, "b_r")
        if self.length is None:
            gap, normal = beside, radial
        else:
            gap, normal = self._with_ends(k, along, beside, radial)
        penetration = let(radius(self.radius_l) - gap, "p")
        return [(self.place(k, l, penetration, -normal, k.z, normal * (penetration / 2 - radius(self.radius_l))), "")]

    def _with_ends(self, k: Frame, along: Expr, beside: Expr, radial: Vec) -> tuple[Expr, Vec]:
        """Distance of the ball's centre from the surface, negative inside, and the unit normal of the surface there. along:
        position of the centre along the axis; beside: its distance from the curved surface; radial: unit vector from the axis to
        it."""
        sense = se.Piecewise((1, along > 0), (-1, True))
        above = let(sense * along - self.length / 2, "h_a")
        corner = let(se.sqrt(beside**2 + above**2 + RESTING), "d_c")

        smaller = let(se.Piecewise((above, above < beside), (beside, True)), "m_e")

        def chosen(rim: Expr, end: Expr, side: Expr) -> Expr:
            return se.Piecewise((rim, smaller > 0), (side, beside > above), (end, True))

        outwards = chosen(beside / corner, se.Integer(0), se.Integer(1))
        upwards = chosen(above / corner, se.Integer(1), se.Integer(0)) * sense
        return let(chosen(corner, above, beside), "g_s"), (radial * outwards + k.z * upwards).named("n")


class BallOnPlane(SurfaceContact):
    """A ball of l with its centre at l.r (a point where it has no radius) on a plane of k through k.r normal to k.z.

    Penetration p = radius - (l.r - k.r) . k.z; both forces act p / 2 above the deepest point of l."""

    params = params(radius=("m", "radius of the ball; None: a point"))

    @property
    def smallest(self) -> float | None:
        return None if self.radius is None else float(self.radius)

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        penetration = let(radius(self.radius) - (l.r - k.r) @ k.z, "p")
        return [(self.place(k, l, penetration, -k.z, k.x, k.z * (penetration / 2 - radius(self.radius))), "")]


STANDING = 1e-3  #: rad, about the tilt over which the contact point moves from the middle of an end to its rim


class CylinderOnPlane(SurfaceContact):
    """A cylinder of l with its middle at l.r on a plane of k through k.r normal to k.z; in a planar scene a disc, or a rectangle.

    Its axis is along_x l.x + along_y l.y + along_z l.z. The circles at both its ends touch at their deepest points, each with a
    normal force of its own. The circle of an end parallel to the plane has no deepest point: there the contact acts at the middle
    of the end and moves to its rim over a tilt of about STANDING rad, so that the cylinder stands. Without length: one circle."""

    params = params(
        radius=("m", "radius"), length=("m", "distance of the circles at its ends; None: one circle"),
        along_x=("1", "component of its axis; None: 0"), along_y=("1", "component of its axis; None: 0"),
        along_z=("1", "component of its axis; None: 0"),
    )

    @property
    def smallest(self) -> float | None:
        return float(self.radius)

    @property
    def ends(self) -> tuple[str, ...]:
        return ("",) if self.length is None else ("_near", "_far")

    def equal(self, k: Frame, l: Frame) -> int:
        return 2 if self.length is not None and self._is_disc(k) else 1

    def _is_disc(self, k: Frame) -> bool:
        """Whether the scene is planar and the cylinder's axis normal to it."""
        return k.kind.flat and self.along_x is not None

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        along: Vec = ZERO
        for component, axis in ((self.along_x, l.x), (self.along_y, l.y), (self.along_z, l.z)):
            along = along if component is None else along + axis * component
        along = along.named("e")
        if self.length is None or self._is_disc(k):
            return [(self._station(k, l, along, ZERO), self.ends[0])]
        return [(self._station(k, l, along, along * (sign * self.length / 2)), end)
                for sign, end in zip((-1, 1), self.ends, strict=True)]

    def _station(self, k: Frame, l: Frame, along: Vec, shift: Vec) -> Station:
        """The contact of the circle around l.r + shift; along: unit vector of the cylinder's axis."""
        up = (k.z - along * (k.z @ along)).named("u")
        upwards = (up * let(se.sqrt(1 + STANDING**2) / se.sqrt(up @ up + STANDING**2))).named("n")
        lowest = shift - upwards * self.radius
        penetration = let((k.r - l.r - lowest) @ k.z, "p")
        return self.place(k, l, penetration, -k.z, k.x, lowest + k.z * (penetration / 2))
