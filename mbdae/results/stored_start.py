"""The start of a stored run as plain data: coordinates of joints, and controllers that were under way."""

from __future__ import annotations

from typing import Any

from mbdae.scene.record import encode
from mbdae.scene.replay import Known, decoded
from mbdae.scene.scene import SceneData
from mbdae.system.sampling import UnderWay
from mbdae.system.start.start import Start
from mbdae.values import BadValueError, number, shown, whole


def start_header(start: Start) -> dict[str, Any]:
    """The plain data of a start that go into the header of a file; its arrays are stored separately."""
    controllers = {name: [c.begin, c.calls, encode(c.memory)] for name, c in start.controllers.items()}
    return {"t": start.t, "changes": start.changes, "coordinates": _by_joint(start)} | (
        {"controllers": controllers} if controllers else {})  # fmt: skip


def start_of(header: dict[str, Any], numbers: dict[str, Any], scene: SceneData, known: Known) -> Start:
    """The start from what a file holds."""
    coordinates = _coordinates(header.get("coordinates", {}), scene)
    controllers = {name: _under_way(stored, scene, known) for name, stored in header.get("controllers", {}).items()}
    return Start(**header | {"coordinates": coordinates, "controllers": controllers}, **numbers)


def _under_way(stored: Any, scene: SceneData, known: Known) -> UnderWay:
    begin, calls, memory = stored
    return UnderWay(number(begin), whole(calls), decoded(memory, scene, known))


def _by_joint(start: Start) -> dict[str, dict[str, float]]:
    """Start values of coordinates by joint and name, as a file holds them."""
    found: dict[str, dict[str, float]] = {}
    for (joint, name), value in start.coordinates.items():
        found.setdefault(joint, {})[name] = value
    return found


def _coordinates(stored: dict[str, Any], scene: SceneData) -> dict[tuple[str, str], float]:
    """Start values by joint and name from those that a file holds: tables by name, or (earlier versions) one number."""
    known = {c.name: c.coordinates for c in scene.joints}
    found: dict[tuple[str, str], float] = {}
    for joint, values in stored.items():
        names = known.get(joint, ())
        of_joint = values if isinstance(values, dict) else dict.fromkeys(names[:1], values)
        if joint not in known:
            raise BadValueError(f"the start in the file names joint {shown(joint)}, which the scene in the file does not have")
        if not of_joint or not set(of_joint) <= set(names):
            raise BadValueError(f"the start in the file gives {shown(values)} for joint {shown(joint)}, whose coordinates are "
                                f"{', '.join(names) or 'none'}")  # fmt: skip
        found |= {(joint, name): float(value) for name, value in of_joint.items()}
    return found
