"""Contact of a cylinder with a plane."""

from __future__ import annotations

import symengine as se

from mbdae.laws.contact.base import Station
from mbdae.laws.contact.surfaces import SurfaceContact
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Vec

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
    )  # fmt: skip

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
        if self.length is None or self._is_disc(k):
            return [(self._station(k, l, along, ZERO), self.ends[0])]
        return [(self._station(k, l, along, along * (sign * self.length / 2)), end)
                for sign, end in zip((-1, 1), self.ends, strict=True)]  # fmt: skip

    def _station(self, k: Frame, l: Frame, along: Vec, shift: Vec) -> Station:
        """The contact of the circle around l.r + shift; along: unit vector of the cylinder's axis."""
        up = (k.z - along * (k.z @ along)).named("u")
        upwards = (up * (se.sqrt(1 + STANDING**2) / let(se.sqrt(up @ up + STANDING**2)))).named("n")
        lowest = shift - upwards * self.radius
        penetration = let((k.r - l.r - lowest) @ k.z, "p")
        return self.place(k, l, penetration, -k.z, k.x, lowest + k.z * (penetration / 2))
