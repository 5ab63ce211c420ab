"""Sensors that loads, states, controllers and events read: found in a scene by their paths, checked before anything is solved."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from mbdae.errors import OptionError
from mbdae.inputs.sensed import paths
from mbdae.scene.components import Array, Body, Connection
from mbdae.symbolic.joint import Joint
from mbdae.values import BadValueError

MOTION = {"position": (3,), "velocity": (3,), "angular_velocity": (3,), "rotation": (3, 3)}  #: of bodies, with their shapes
#: what follows from accelerations: known when the loads are, so that no load can depend on it
LOOPS = ("force", "torque", "power", "acceleration", "angular_acceleration", "drive", "gap", "normal_force")
_ENTRY = re.compile(r"(?P<path>.*?)(?P<entry>(\[\s*\d+\s*(,\s*\d+\s*)?\])*)")
_PLACE = re.compile(r"(?P<item>.+)\.at\((?P<where>[^()]*)\)")


@dataclass(frozen=True, eq=False)
class Sensed:
    """What a path names: its item, the quantity with its entry, whether it is the rate of a coordinate, and of a body the place
    (3,), m as drawn."""

    item: Any
    quantity: str = ""
    entry: tuple[int, ...] = ()
    rated: bool = False
    point: Array | None = None


def rates_of(item: Connection) -> dict[str, str]:
    """Angles and displacements of a joint by the names of the sensors of their rates."""
    names = item.scalars
    return {f"{c}_rate": c for c in names} | ({"rate": names[0]} if len(names) == 1 else {})


def found(scene: Any, path: str) -> Sensed:
    """What a path names in a scene; BadValueError with a sentence where there is nothing that can be read."""
    plain, entry = split_entry(path)
    signal = next((one for one in scene.signals if one.name == path), None)
    if signal is not None:
        return Sensed(signal)
    name, _, quantity = plain.rpartition(".")
    item, point = _placed(scene, name)
    if isinstance(item, Connection):
        return _of_connection(scene, path, item, quantity)
    if isinstance(item, Body):
        return _of_body(scene, path, Sensed(item, quantity, entry, point=point))
    raise BadValueError(_unknown(scene, path))


def split_entry(path: str) -> tuple[str, tuple[int, ...]]:
    """A path without the component it names at its end, "b.position[1]", and the component."""
    whole = _ENTRY.fullmatch(path)
    assert whole is not None  # every text has this form
    return whole["path"], tuple(int(n) for n in re.findall(r"\d+", whole["entry"]))


def _placed(scene: Any, name: str) -> tuple[Any, Array | None]:
    """The item of a name, or of "body.at(s)", "body.at(x, y, z)", and the place there; None where there is none."""
    items = {one.name: one for one in [scene.ground, *scene.bodies, *scene.connections]}
    if name in items:
        return items[name], None
    place = _PLACE.fullmatch(name)
    item = items.get(place["item"]) if place else None
    if place is None or not isinstance(item, Body):
        return None, None
    try:
        where = [float(x) for x in place["where"].split(",")]
    except ValueError:
        return None, None
    return item, item.at(where[0] if len(where) == 1 else where).point


def _of_connection(scene: Any, path: str, item: Connection, quantity: str) -> Sensed:
    rates = rates_of(item) if isinstance(item.joint, Joint) else {}
    if quantity in item.scalars or quantity in rates:
        return Sensed(item, rates.get(quantity, quantity), rated=quantity in rates)
    _refuse_loop(path, quantity)
    raise BadValueError(_unknown(scene, path))


def _of_body(scene: Any, path: str, sensed: Sensed) -> Sensed:
    shape = MOTION.get(sensed.quantity)
    if shape is None:
        _refuse_loop(path, sensed.quantity)
        raise BadValueError(_unknown(scene, path))
    if len(sensed.entry) != len(shape) or max(sensed.entry) > 2:
        one = f"{sensed.item.name}.{sensed.quantity}[{', '.join('1' for _ in shape)}]"
        raise BadValueError(f"'{path}' is no single number; say which component, such as '{one}' (from 0 to 2)")
    return sensed


def _refuse_loop(path: str, quantity: str) -> None:
    if quantity.partition("[")[0] in LOOPS:
        raise BadValueError(f"'{path}' follows from accelerations and reactions, which depend on the loads themselves (an "
                            f"algebraic loop); read positions, velocities or states, such as a filtered one: "
                            f"s.state(name, rate=...)")  # fmt: skip


def _unknown(scene: Any, path: str) -> str:
    known = known_paths(scene)
    close = get_close_matches(path, known, 1)
    meant = f"did you mean '{close[0]}'? " if close else ""
    few = ", ".join(repr(one) for one in known[:12]) + (", ..." if len(known) > 12 else "")
    return f"there is no sensor '{path}': {meant}There are {few or 'none'}"


def known_paths(scene: Any) -> list[str]:
    """The sensors that may be read, by path."""
    joints = [f"{c.name}.{q}" for c in scene.joints for q in (*c.scalars, *rates_of(c))]
    bodies = [f"{b.name}.{q}[{', '.join('0' for _ in shape)}]" for b in scene.bodies for q, shape in MOTION.items()]
    return [*(one.name for one in scene.signals), *joints, *bodies]


def refuse_sampled(scene: Any, what: str) -> None:
    """Raise OptionError where a scene has a sampled controller, of which `what` would know nothing."""
    for one in scene.controllers:
        raise OptionError(f"{what}: controller '{one.name}' is a function called every {one.every:g} s, which only runs know; "
                          f"state its law as feedback, with s.sensor and s.state, or use s.simulate")  # fmt: skip


def fed(scene: Any) -> list[tuple[str, list[str]]]:
    """What depends on sensors: the item in words, and the paths."""
    out = [(f"{c.kind} '{c.name}'", paths(getattr(law, key))) for c in scene.connections for law in c.laws for key in law.params]
    out += [(f"{one.kind} '{one.name}'", one.reads()) for one in scene.signals]
    out += [(f"controller '{one.name}'", list(one.reads)) for one in scene.controllers]
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
    """Signals that depend on themselves."""
    needs = {one.name: [p for p in one.reads() if p != one.name or one.kind == "signal"]
             for one in scene.signals if one.kind == "signal"}  # fmt: skip

    def walk(name: str, above: tuple[str, ...]) -> str:
        if name in above:
            way = " -> ".join((*above[above.index(name) :], name))
            return f"signal '{name}' depends on itself ({way}), an algebraic loop: put a state between, s.state(name, rate=...)"
        return next((text for path in needs.get(name, ()) if (text := walk(path, (*above, name)))), "")

    return [text for name in needs if (text := walk(name, ()))][:1]


def keep_read_coordinates(scene: Any, further: Sequence[str] = ()) -> None:
    """Angles that are read, by `further` paths too, and coordinates that bodies do not show, become unknowns of their own: whole
    turns count."""
    read = {path for _, some in fed(scene) for path in some} | set(further)
    for c in scene.joints:
        wanted = [q for path in read if path.rpartition(".")[0] == c.name
                  for q in [rates_of(c).get(path.rpartition(".")[2], path.rpartition(".")[2])] if q in c.scalars]  # fmt: skip
        shown = type(c.joint).coordinate is not Joint.coordinate
        if not c.loose and any(c.unit(q) == "rad" or not shown for q in wanted):
            for part in (*c.laws, *c.as_kinematic):
                if hasattr(part, "kept"):
                    part.kept = True
