"""Contact of a ball, or a point, with a plane."""

from __future__ import annotations

from mbdae.laws.contact.base import Station
from mbdae.laws.contact.surfaces import SurfaceContact, radius
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let


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
