"""Base of forces on a coordinate of a joint."""

from __future__ import annotations

from typing import ClassVar

from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.law import Force, Structure
from mbdae.symbolic.vectors import Expr


class OnCoordinate(Force):
    """A law on one coordinate of the joint it belongs to: computed from the frames, or an unknown of its own (kept).

    options: joint (its class), coordinate (its name), kept (whether the coordinate is an unknown of its own)."""

    options: ClassVar[tuple[str, ...]] = ("joint", "coordinate", "kept")

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return (self.name_of_coordinate,) if self.kept else ()

    @property
    def name_of_coordinate(self) -> str:
        """Name of the coordinate on which it acts: the option `coordinate`, by default the first of the joint."""
        return str(self.coordinate or next(iter(self.joint.coordinates)))

    @property
    def unit(self) -> str:
        """Unit of the coordinate, rad or m."""
        return str(self.joint.coordinates[self.name_of_coordinate].unit)

    def value(self, k: Frame, l: Frame) -> Expr:
        """Expression of the coordinate, rad or m."""
        if self.kept:
            return getattr(self, self.name_of_coordinate)
        plain = Structure(options=tuple((option, None) for option in self.joint.options))
        return self.joint.symbolic(plain).read(k, l)[self.name_of_coordinate]

    def known_modulo_turns(self, k: Frame, l: Frame) -> bool:
        """Whether the frames show an angle in (-pi, pi] only."""
        return self.unit == "rad" and not self.kept and NodeKind.PLANAR not in (k.kind, l.kind)
