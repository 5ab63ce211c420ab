"""Contact of a ball, or a point, with a cylinder."""

from __future__ import annotations

import symengine as se

from mbdae.laws.contact.base import RESTING, Station
from mbdae.laws.contact.surfaces import SurfaceContact, outside, radius
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec


class BallOnCylinder(SurfaceContact):
    """A ball of l with its centre at l.r on a cylinder of k with its middle at k.r and its axis along k.z.

    b and h are the distances of the ball's centre from the curved surface and from the plane of the nearer end, positive outside.
    The ball touches the curved surface where only b is positive, the end where only h is, the rim where both are; with its centre
    inside, the surface that is nearer. Without a length there are no ends."""

    params = params(
        radius_k=("m", "radius of the cylinder"), radius_l=("m", "radius of the ball; None: a point"),
        length=("m", "length of the cylinder; None: without ends"),
    )  # fmt: skip

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
