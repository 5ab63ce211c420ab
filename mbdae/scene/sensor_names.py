"""Names of sensors: what a text such as "b.position[1]" means in a scene, with its unit.

"item.quantity" reads a whole quantity, "item.quantity[i]" component i of it (0, 1, 2: x, y, z of vectors), "b.rotation[i, j]" an
entry of a matrix. The item may be a place: "beam.at(0.5).position", "hub.at(0.1, 0).velocity[0]". A state, signal or output of a
controller is its name alone."""

from __future__ import annotations

import re
from keyword import iskeyword
from typing import Any, NamedTuple

from mbdae.errors import SceneError
from mbdae.laws.contact.base import Contact
from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.notation import UNITS
from mbdae.scene.components import Body, Connection, Signal
from mbdae.symbolic.law import Force
from mbdae.values import BadValueError

_PLACE = re.compile(r"(?P<item>.+)\.at\((?P<where>[^()]*)\)")
_ENTRY = re.compile(r"(?P<path>.+?)(?P<entry>(\[\s*\d+\s*(,\s*\d+\s*)?\])*)", re.DOTALL)


_PLAIN = re.compile(r"[A-Za-z_]\w*", re.ASCII)  #: names, if no keywords, that Python's syntax allows unchanged
_QUOTED = r'sensor\("(?:[^"\\]|\\.)*"\)'


class SensorName(NamedTuple):
    """item: key of the item or place ("" where the text is one name); quantity: its name ("" where the text ends in a place);
    entry: numbers of the component, () for the whole quantity."""

    item: str
    quantity: str
    entry: tuple[int, ...] = ()


def parsed(text: str) -> SensorName:
    """The parts of the name of a sensor; nothing is looked up."""
    found = _ENTRY.fullmatch(text.strip())
    if found is None:
        return SensorName("", "")
    return SensorName(*split(found["path"]), tuple(int(n) for n in re.findall(r"\d+", found["entry"])))


def spelled(scene: Any, text: str) -> tuple[str, dict[str, str]]:
    """A text in which names of items with spaces, signs or other letters ("my joint") are replaced by plain ones ("item_0_"), and
    a mapping plain name -> name; BadValueError where a name can also be read as an expression of other items ("a-b")."""
    odd = sorted((name for name in scene._by_name if not _PLAIN.fullmatch(name) or iskeyword(name)), key=len, reverse=True)
    if not any(name in text for name in odd):
        return text, {}
    plain = {name: f"item_{i}_" for i, name in enumerate(odd)}

    def replaced(found: re.Match[str]) -> str:
        name = found[0]
        if name not in plain:
            return name
        parts = re.findall(r"\w+", name)
        if len(parts) > 1 and re.search(r"[-+*/]", name) and all(part in scene._by_name for part in parts):
            raise BadValueError(f"'{name}' is the name of an item, and also an expression of the items {', '.join(parts)}: give "
                                f"it another name")  # fmt: skip
        return plain[name]

    names = "|".join(re.escape(name) for name in odd)
    made = re.sub(rf"{_QUOTED}|(?<![\w.])(?:{names})(?!\w)", replaced, text)
    return made, {short: name for name, short in plain.items()}


def split(path: str) -> tuple[str, str]:
    """Item and quantity of "item.quantity"; the item may be a place, "item.at(0.5)"; no quantity where it ends in one."""
    if path.endswith(")"):
        return path, ""
    name, _, quantity = path.rpartition(".")
    return name, quantity


def placed(scene: Any, key: str) -> tuple[Any, Any]:
    """The item of a scene, and where on it: "item", "item.at(s)" with s from 0 to 1, "item.at(x, y)" or "item.at(x, y, z)"."""
    found = None if key in scene._by_name else _PLACE.fullmatch(key)
    if found is None:
        return scene[key], None
    item = scene[found["item"]]
    try:
        where = [float(x) for x in found["where"].split(",")]
    except ValueError:
        where = []
    if not isinstance(item, Body) or len(where) not in (1, 2, 3):
        raise SceneError([f"there is no place '{key}'; give a body and a number from 0 to 1 or a point of 2 or 3 coordinates, "
                          f"as in 'rod.at(0.5)' or 'rod.at(1, 0)'"])  # fmt: skip
    return item, where[0] if len(where) == 1 else where


def rates_of(item: Connection) -> dict[str, str]:
    """Angles and displacements of a joint by the names of the sensors of their rates."""
    names = item.scalars
    return {f"{c}_rate": c for c in names} | ({"rate": names[0]} if len(names) == 1 else {})


def drives_of(item: Connection) -> dict[str, str]:
    """Coordinates of a joint that are prescribed or loaded, by the names of the sensors of the torque or force: "drive", or
    "drive_<coordinate>" where the joint has several coordinates."""
    driven = {*item.prescribed, *(law.name_of_coordinate for law in loads_of(item))}
    return {item.joint.drive_name(c): c for c in item.scalars if c in driven} if item.is_joint else {}


def loads_of(item: Connection) -> list[Any]:
    """The laws of a joint that load a coordinate."""
    return [law for law in item.laws if isinstance(law, OnCoordinate) and law.loads]


def has_length(item: Connection) -> bool:
    """Whether it is a force between two points, one named on each body, whose distance is a length."""
    return not item.is_joint and all(isinstance(law, Force) and not isinstance(law, Contact) and law.at_l is not None
                                     for law in item.laws)  # fmt: skip


def measured(scene: Any, sensor: str) -> tuple[str, str]:
    """What a sensor measures in words, and its SI unit ("" where it has none)."""
    if isinstance(scene._by_name.get(sensor), Signal):
        return sensor, ""
    name, quantity, _ = parsed(sensor)
    item = placed(scene, name)[0]
    if isinstance(item, Connection):
        known = {c: item.unit(c) for c in item.scalars} | {r: f"{item.unit(c)}/s" for r, c in rates_of(item).items()}
        known |= {name: f"N{' m' * (item.unit(c) == 'rad')}" for name, c in drives_of(item).items()}
        known |= {"length": "m", "rate": "m/s"} if has_length(item) else {}
        if quantity in known:
            return "speed" if (quantity, known[quantity]) == ("rate", "m/s") else quantity.replace("_", " "), known[quantity]
    return quantity.replace("_", " "), UNITS.get(quantity, "")
