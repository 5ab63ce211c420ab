"""Names of sensors: what a text such as "b.position[1]" means in a scene, with its unit.

"item.quantity" reads a whole quantity, "item.quantity[i]" component i of it (0, 1, 2: x, y, z of vectors), "b.rotation[i, j]" an
entry of a matrix. The item may be a place: "beam.at(0.5).position", "hub.at(0.1, 0).velocity[0]". A state, signal or output of a
controller is its name alone.

Sensors that loads, states, controllers and events read: found in a scene by their paths, checked before anything is solved.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from keyword import iskeyword
from typing import TYPE_CHECKING, Any, NamedTuple

from mbdae.deferred import Later
from mbdae.errors import OptionError, SceneError, meant
from mbdae.inputs.sensed import paths
from mbdae.laws.on_coordinates import OnCoordinate
from mbdae.notation import LOOPS, UNITS
from mbdae.scene.components import Body, Connection, Controller, Signal
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.values import Array, BadValueError

if TYPE_CHECKING:
    from mbdae.laws.contact import Contact
else:
    Contact = Later("mbdae.laws.contact", "Contact")

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
                                f"it another name")
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
    """The item of a scene, and where on it: "item", "item.at(s)" with s from 0 to 1, "item.at(x, y)" or "item.at(x, y, z)", or
    the name of a frame, which is a place on its body."""
    found = None if key in scene._by_name else _PLACE.fullmatch(key)
    if found is None and key not in scene._by_name and key in scene.frames and not scene.frames[key].body.is_ground:
        return scene.frames[key].body, scene.frames[key].point
    if found is None:
        return scene[key], None
    item = scene[found["item"]]
    try:
        where = [float(x) for x in found["where"].split(",")]
    except ValueError:
        where = []
    if not isinstance(item, Body) or len(where) not in (1, 2, 3):
        raise SceneError([f"there is no place '{key}'; give a body and a number from 0 to 1 or a point of 2 or 3 coordinates, "
                          f"as in 'rod.at(0.5)' or 'rod.at(1, 0)'"])
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
    return not item.is_joint and all(isinstance(law, Force) and type(law).observed is Force.observed and law.at_l is not None
                                     for law in item.laws)


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


def of_motion(scene: Any, sensor: str) -> bool:
    """Whether a sensor shows the motion: positions, axes and velocities of bodies and places, coordinates of joints and lengths
    of forces, with their rates. What contacts measure between surfaces is small beside it."""
    if isinstance(scene._by_name.get(sensor), Signal):
        return False
    name, quantity, _ = parsed(sensor)
    item = placed(scene, name)[0]
    if isinstance(item, Connection):
        return quantity in item.scalars or quantity in rates_of(item) or (quantity in ("length", "rate") and has_length(item))
    return quantity in MOTION or quantity == "on_axis"


MOTION = {"position": (3,), "velocity": (3,), "angular_velocity": (3,), "rotation": (3, 3)}  #: of bodies: quantity -> shape


@dataclass(frozen=True, eq=False)
class Sensed:
    """What a path names: its item, the quantity with its entry, whether it is the rate of a coordinate, and of a body the place
    (3,), m as drawn."""

    item: Any
    quantity: str = ""
    entry: tuple[int, ...] = ()
    rated: bool = False
    point: Array | None = None


def found(scene: Any, path: str) -> Sensed:
    """What a path names in a scene; BadValueError with a sentence where there is nothing that can be read."""
    signal = scene._by_name.get(path)
    if isinstance(signal, Signal):
        return Sensed(signal)
    name, quantity, entry = parsed(path)
    try:
        item, where = placed(scene, name)
    except SceneError:
        raise BadValueError(_unknown(scene, path)) from None
    if isinstance(item, Connection):
        rates = rates_of(item) if isinstance(item.joint, Joint) else {}
        if quantity in item.scalars or quantity in rates:
            return Sensed(item, rates.get(quantity, quantity), rated=quantity in rates)
        _refuse_loop(path, quantity)
        raise BadValueError(_unknown(scene, path))
    if isinstance(item, Body):
        sensed = Sensed(item, quantity, entry, point=None if where is None else item.at(where).point)
        shape = MOTION.get(sensed.quantity)
        if shape is None:
            _refuse_loop(path, sensed.quantity)
            raise BadValueError(_unknown(scene, path))
        if len(sensed.entry) != len(shape) or max(sensed.entry) > 2:
            example = f"{sensed.item.name}.{sensed.quantity}[{', '.join('1' for _ in shape)}]"
            raise BadValueError(f"'{path}' names no component; write it as '{example}', with indices from 0 to 2")
        return sensed
    raise BadValueError(_unknown(scene, path))


def _refuse_loop(path: str, quantity: str) -> None:
    if quantity in LOOPS:
        raise BadValueError(f"'{path}' follows from accelerations and reactions, which depend on the loads themselves (an "
                            f"algebraic loop); read positions, velocities or states, such as a filtered one: "
                            f"s.state(name, rate=...)")
    if quantity in UNITS:
        raise BadValueError(f"'{path}' cannot be read by loads; read the positions and velocities of its bodies instead")


def _unknown(scene: Any, path: str) -> str:
    known = known_paths(scene)
    few = ", ".join(repr(one) for one in known[:12]) + (", ..." if len(known) > 12 else "")
    return f"there is no sensor '{path}': {meant(path, known)}known sensors: {few or 'none'}"


def known_paths(scene: Any) -> list[str]:
    """The sensors that may be read, by path."""
    joints = [f"{c.name}.{q}" for c in scene.joints for q in (*c.scalars, *rates_of(c))]
    bodies = [f"{b.name}.{q}[{', '.join('0' for _ in shape)}]" for b in scene.bodies for q, shape in MOTION.items()]
    return [*(one.name for one in scene.signals), *joints, *bodies]


def refuse_sampled(scene: Any, analysis: str) -> None:
    """Raise OptionError where a scene has a sampled controller: the analysis of this name would leave it out."""
    for one in scene.controllers:
        raise OptionError(f"{analysis}: controller '{one.name}' is a function called every {one.every:g} s, which is possible in "
                          f"s.simulate alone; state its law by expressions of s.sensor and s.state")


def read_by(item: Any) -> list[str]:
    """Paths of the sensors on which a joint, force, signal or controller depends."""
    if isinstance(item, Connection):
        return [path for law in item.laws for key in law.params for path in paths(getattr(law, key))]
    return item.reads() if isinstance(item, Signal) else list(item.reads)


def fed(scene: Any) -> list[tuple[str, list[str]]]:
    """Items that depend on sensors: each in words, with the paths of its sensors."""
    out = [(f"controller '{one.name}'" if isinstance(one, Controller) else f"{one.kind} '{one.name}'", read_by(one))
           for one in (*scene.connections, *scene.signals, *scene.controllers)]
    return [(item, read) for item, read in out if read]


def problems(scene: Any) -> list[str]:
    """Sensors that cannot be read, one sentence each with the item that reads them; signals that depend on themselves."""
    out = []
    for item, read in fed(scene):
        for path in read:
            try:
                found(scene, path)
            except BadValueError as refused:
                out.append(f"{item}: {refused}")
    return out or _circles(scene)


def _circles(scene: Any) -> list[str]:
    """Message about a signal that depends on itself, directly or through others; empty where there is none."""
    needs = {one.name: [p for p in one.reads() if p != one.name or one.kind == "signal"]
             for one in scene.signals if one.kind == "signal"}

    known = set[str]()  # signals found to depend on no circle of signals, which are not followed again

    def walk(name: str, above: tuple[str, ...]) -> str:
        if name in above:
            chain = " -> ".join((*above[above.index(name) :], name))
            return f"signal '{name}' depends on itself ({chain}), an algebraic loop: put a state between, s.state(name, rate=...)"
        if name in known:
            return ""
        found = next((text for path in needs.get(name, ()) if (text := walk(path, (*above, name)))), "")
        if not found:
            known.add(name)
        return found

    return [text for name in needs if (text := walk(name, ()))][:1]


def keep_read_coordinates(scene: Any, read: Iterable[str]) -> None:
    """Make unknowns of the angles that these paths read, so that whole turns are counted, and of the coordinates read that cannot
    be computed from the bodies. A joint may be stated after the item that reads it: `_wanted` of the scene keeps what is read by
    name of the joint, for `keep_wanted`."""
    names = dict[str, None]()
    for path in read:
        name, quantity, _ = parsed(path)
        scene._wanted.setdefault(name, set()).add(quantity)
        names[name] = None
    for name in names:
        keep_wanted(scene, scene._by_name.get(name))


def keep_wanted(scene: Any, c: Any) -> None:
    """Make unknowns of the coordinates that are read of one item, where it is a joint; see `keep_read_coordinates`."""
    wanted = scene._wanted.get(c.name) if isinstance(c, Connection) and c.is_joint else None
    if not wanted or c.loose:
        return
    coordinates = [q for one in wanted for q in [rates_of(c).get(one, one)] if q in c.scalars]
    shown = type(c.joint).coordinate is not Joint.coordinate
    if any(c.unit(q) == "rad" or not shown for q in coordinates):
        for part in (*c.laws, *c.as_kinematic):
            if hasattr(part, "kept"):
                part.kept = True
