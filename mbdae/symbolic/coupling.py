"""Couplings: laws between the coordinates of joints, such as gears, racks, belts and differentials."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from mbdae.errors import LawError
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.symbolic.part import Parameter
from mbdae.symbolic.vectors import Expr
from mbdae.values import shown

Reference = tuple[str, str]  #: name of a joint, name of one of its coordinates


class Coupling(TwoBodyLaw):
    """A law on coordinates of joints stated by `constraints`: expressions of the coordinates (`self.<name>`) that vanish.

    The forces of its rows act on both bodies of every joint, by virtual work. of: for every coordinate of the law the joint and
    the coordinate there, "joint.coordinate"; a coordinate is 0 as drawn, whole turns of angles count."""

    frames: ClassVar[tuple[str, ...]] = ()
    #: coordinates of joints that the law couples, with their unit (rad, m or either)
    coordinates: ClassVar[Mapping[str, Parameter]] = MappingProxyType({})

    def __init__(self, name: str, of: Mapping[str, Any], **values: Any) -> None:
        super().__init__(name, None, None, **values)
        kind = f"{type(self).__name__} {shown(name)}"
        if not self.own_coordinates:
            raise LawError(f"{kind} couples no coordinates; declare them: coordinates = mb.params(angle=('rad', 'of a wheel'))")
        names = ", ".join(self.own_coordinates)
        example = f"as in of={{'{self.own_coordinates[0]}': 'A.angle', ...}}"
        if not isinstance(of, Mapping):
            raise LawError(f"{kind}: of = {shown(of)} is no dict: say which joint's coordinate each of {names} is, {example}")
        self.of = dict(of)
        if set(self.of) != set(self.own_coordinates):
            raise LawError(f"{kind}: of = {shown(of)} must have the keys {names} and no others: say which joint's coordinate "
                           f"each is, {example}")

    def constraints(self) -> dict[str, Expr]:
        """Expressions of the coordinates that vanish, by name of the row."""
        raise LawError(f"coupling {type(self).__name__} does not state `constraints(self)`: return its rows, "
                       f"{{'name': expression that vanishes}}")

    def rows(self) -> dict[str, Expr]:  # type: ignore[override]
        return self.constraints()

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(self.coordinates)

    def coordinates_in(self, item: str) -> list[Reference]:
        return [self.of[name] for name in self.own_coordinates]
