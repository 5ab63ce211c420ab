"""Contact of a cylinder with a plane."""

from __future__ import annotations

from mbdae.laws.contact.base import Station
from mbdae.laws.contact.surfaces import SurfaceContact, outside
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Vec


class CylinderOnPlane(SurfaceContact):
    """A cylinder of l with its middle at l.r on a plane of k through k.r normal to k.z; a disc in a planar scene.

    Its axis is along_x l.x + along_y l.y + along_z l.z. The circles at both its ends touch with their deepest points, each with
    the normal law given; a cylinder that stands on an end touches with one point of its rim. Without length it is one circle."""

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
        return 2 if self.length is not None and k.kind.flat else 1

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        along: Vec = ZERO
        for component, axis in ((self.along_x, l.x), (self.along_y, l.y), (self.along_z, l.z)):
            along = along if component is None else along + axis * component
        if self.length is None or k.kind.flat:
            return [(self._station(k, l, along, ZERO), self.ends[0])]
        return [(self._station(k, l, along, along * (sign * self.length / 2)), end)
                for sign, end in zip((-1, 1), self.ends, strict=True)]  # fmt: skip

    def _station(self, k: Frame, l: Frame, along: Vec, shift: Vec) -> Station:
        """The circle in the plane through l.r + shift."""
        _, upwards = outside((k.z - along * (k.z @ along)).named("u"))
        lowest = shift - upwards * self.radius
        penetration = let((k.r - l.r - lowest) @ k.z, "p")
        return self.place(k, l, penetration, -k.z, k.x, lowest + k.z * (penetration / 2))
