"""Contact of two balls, or of a ball with a point."""

from __future__ import annotations

from mbdae.laws.contact.base import Station
from mbdae.laws.contact.surfaces import SurfaceContact, outside, radius
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let


class BallOnBall(SurfaceContact):
    """Two balls with their centres at k.r and l.r; discs in a planar scene.

    u = l.r - k.r, d its length, n = u / d, penetration p = radius_k + radius_l - d; both forces act in the middle of
    the overlap."""

    params = params(
        radius_k=("m", "radius of the ball on k; None: a point"), radius_l=("m", "radius of the ball on l; None: a point"),
    )  # fmt: skip

    @property
    def smallest(self) -> float | None:
        return min((float(r) for r in (self.radius_k, self.radius_l) if r is not None), default=None)

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        distance, normal = outside((l.r - k.r).named("u"))
        penetration = let(radius(self.radius_k) + radius(self.radius_l) - distance, "p")
        return [(self.place(k, l, penetration, -normal, k.z, normal * (penetration / 2 - radius(self.radius_l))), "")]
