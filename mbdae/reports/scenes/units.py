"""Units of quantities in a scene, where it is known on which coordinates laws act."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from mbdae.reports.letters import unit_on
from mbdae.reports.units import Unit, dimensions, unit, unit_in
from mbdae.symbolic.derive import Derived
from mbdae.system.model.groups import Instance
from mbdae.system.model.model import Model
from mbdae.system.model.numbering import Row


def row_unit(d: Derived, row: int, coordinates: Mapping[str, str] | None = None, effort: bool = False) -> str:
    """Unit of a row: m, 1 for an angle or a cosine; "" where it has none. coordinates: units of the law's coordinates by name;
    effort: give the unit of the multiplier instead, whose product with the row is an energy."""
    found = _units_of_rows(d, tuple((coordinates or {}).items()))[row]
    return " or ".join((unit("J") / u).of_force if effort else str(u) for u in found)


@lru_cache(maxsize=256)
def _units_of_rows(d: Derived, coordinates: tuple[tuple[str, str], ...]) -> list[list[Unit]]:
    cases = dimensions(d, dict(coordinates))
    return [unit_in(cases, g) for g in d.g]


def unit_of_row(model: Model, row: Row, effort: bool = False) -> str:
    """Unit of a row of a scene, or of its multiplier (effort=True); see `row_unit`."""
    group = model.groups[row.group]
    return row_unit(group.derived, row.row, units_at(group.instances[row.instance]), effort)


def units_at(instance: Instance) -> dict[str, str]:
    """Units of the coordinates of a law in a scene, by name."""
    law, nodes = instance.law, instance.nodes[len(instance.law.frames) :]
    return {name: node.unit for name, node in zip(law.own_coordinates, nodes, strict=False) if node is not None}


def parameter_unit(instance: Instance, name: str) -> str:
    """Unit of a law's parameter in a scene; one that fits angles and lengths gets the unit for its coordinate."""
    on = [*units_at(instance).values()] or [getattr(instance.law, "unit", "")]
    return unit_on(instance.law.params[name].unit, on)
