"""What a map of extremes varies: an argument of a statement of the scene, an argument of scene(), or an option of the run.

A scene is data (`mbdae.scene.record`): a varied one is its statements with another number, replayed.
"""

from __future__ import annotations

import copy
import functools
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import MbdaeError, OptionError
from mbdae.extremes.pulses import Pulse, pulses, varying
from mbdae.inputs import timed
from mbdae.scene.replay import Known, replay
from mbdae.scene.scene import SceneData
from mbdae.values import number, option, sequence, shown

OPTIONS = {"accuracy": "accuracy asked", "step": "constant step, s", "t_end": "end of the run, s"}
RUNGS = 7  #: values of a ladder between two bounds at most
SHORTHANDS = "mass, stiffness, speed, clearance; begin, width, strength of a pulse"
Statements = list[Any]


@dataclass(frozen=True)
class Varied:
    """A parameter with its values. scene(value): the scene at that value; t_end: the end of its run, s; stops: times at which
    a run that is to see every pulse of its inputs starts anew, s."""

    name: str
    values: tuple[float, ...]
    scene: Callable[[float], SceneData]
    t_end: Callable[[float], float]
    stops: Callable[[float], list[float]] = lambda value: []


def varied(scene: Any, t_end: float, vary: Mapping[str, Any]) -> list[Varied]:
    """The parameters of `vary`, each checked at all its values."""
    return [_one(scene, t_end, name, _values(name, asked)) for name, asked in checked_vary(vary).items()]


def checked_vary(vary: Any) -> dict[str, Any]:
    """What is to be varied by name; refused where it is no such mapping, or a value is no number."""
    remedy = "give {parameter: (low, high) or [values]}, such as {'coupler.mass': (1e-3, 1e3)}"
    if not isinstance(vary, Mapping) or not vary or not all(isinstance(name, str) for name in vary):
        raise OptionError(f"vary = {shown(vary)}: {remedy}")
    for name, asked in vary.items():
        _values(name, asked)
    return dict(vary)


def stated(scene: Any) -> SceneData:
    """The scene as it is without variation; `scene` is one, or a function that makes it."""
    remedy = "give a mb.Scene, or a function scene(**parameters) with defaults that returns one"
    made = scene
    if callable(scene) and not isinstance(scene, SceneData | type):
        try:
            inspect.signature(scene).bind()
        except (TypeError, ValueError) as error:
            raise OptionError(f"scene = {shown(scene)} cannot be called without arguments ({error}): {remedy}") from error
        made = scene()
    if not isinstance(made, SceneData):
        returned = "" if made is scene else f" returns {shown(made)}"
        raise OptionError(f"scene = {shown(scene)}{returned}: {remedy}")
    return made


def ladder(low: float, high: float) -> tuple[float, ...]:
    """Both bounds and the decades between them, evenly thinned to at most `RUNGS` values."""
    decades = abs(math.log10(high / low))
    steps = max(1, math.ceil(decades - 1e-9)) if decades <= RUNGS - 1 else 0
    if not steps:  # the largest number of whole-decade strides that fits, else as many strides as allowed
        whole = [n for n in range(RUNGS - 1, 0, -1) if abs(decades / n - round(decades / n)) < 1e-9]
        steps = whole[0] if whole else RUNGS - 1
    return tuple(float(f"{low * (high / low) ** (i / steps):.6g}") for i in range(steps + 1))


def _values(name: Any, asked: Any) -> tuple[float, ...]:
    what, remedy = f"vary: '{name}'", "give (low, high) for a ladder of decades, or a list of values"
    if name == "accuracy":
        given = tuple(option(what, asked, sequence, f"{remedy}, each from 1e-12 to 0.1", each=number, least=1e-12, most=1e-1))
    elif name in OPTIONS:
        given = tuple(option(what, asked, sequence, f"{remedy}, each positive, in s", each=number, above=0))
    else:
        given = tuple(option(what, asked, sequence, remedy, each=number))
    if not given:
        raise OptionError(f"{what} = {shown(asked)} is empty: {remedy}")
    if isinstance(asked, tuple) and len(given) == 2:
        if given[0] * given[1] <= 0:
            raise OptionError(f"{what} = {shown(asked)}: a ladder of decades needs two bounds of one sign, different from 0; "
                              f"give a list of values")  # fmt: skip
        return ladder(*given)
    return given


def _number_in(name: str, value: str) -> float:
    """The number in a name such as "scene(n=3).coupler.mass"."""
    try:
        return number(float(value))
    except ValueError:
        raise OptionError(f"vary: '{name}': {value} is not a number, as in 'scene(n=3).A.spring'") from None


def _one(scene: Any, t_end: float, name: str, values: tuple[float, ...]) -> Varied:
    inside = re.fullmatch(r"scene\((\w+)=([^)]+)\)\.(.+)", name)
    if inside:
        own, value, rest = inside.groups()
        _refuse_unknown_argument(scene, own)
        there = functools.partial(scene, **{own: _number_in(name, value)})
        return replace(_one(there, t_end, rest, values), name=name)
    if name in OPTIONS:
        base = stated(scene)
        found = Varied(name, values, lambda value: base, lambda value: value if name == "t_end" else t_end)
    elif "." not in name:
        _refuse_unknown_argument(scene, name)
        found = Varied(name, values, lambda value: stated(scene(**{name: value})), lambda value: t_end)
    else:
        return _of_item(stated(scene), t_end, name, values)
    return replace(found, stops=lambda value: _stops(pulses(found.scene(value).statements, found.t_end(value))))


def _of_item(base: SceneData, t_end: float, name: str, values: tuple[float, ...]) -> Varied:
    """An argument of a statement, or a number of the pulse its inputs of time make."""
    for value in values:
        changed(base, name, value, t_end)  # refuses what cannot be varied before anything runs

    def stops(value: float) -> list[float]:
        s, factor = changed(base, name, value, t_end)
        item, *keys = name.split(".")
        index, call = _call(base, copy.deepcopy(base.statements), item)
        pulse = varying(call.arguments, keys, t_end, name)
        if pulse is None:
            return _stops(pulses(s.statements, t_end * factor))
        others = [statement for i, statement in enumerate(s.statements) if i != index]
        return _stops([pulse.at(value), *pulses(others, t_end)])

    return Varied(name, values, lambda value: changed(base, name, value, t_end)[0],
                  lambda value: t_end * changed(base, name, value, t_end)[1], stops)  # fmt: skip


def _stops(found: list[Pulse]) -> list[float]:
    return sorted({t for pulse in found for t in pulse.stops})


def _refuse_unknown_argument(scene: Any, name: str) -> None:
    own = list(inspect.signature(scene).parameters) if callable(scene) and not isinstance(scene, SceneData) else []
    if name not in own:
        told = f"arguments of scene(): {', '.join(own)}; " if own else "scene() has no arguments; "
        raise OptionError(f"vary: there is nothing named '{name}'; {told}options of the run: {', '.join(OPTIONS)}; "
                          f"or 'item.argument' of an item of the scene: {_items(stated(scene))}")  # fmt: skip


# -- arguments of statements


def changed(scene: SceneData, name: str, value: float, t_end: float = 1.0) -> tuple[SceneData, float]:
    """The scene with the argument `name` ("item.argument", dots go into a model or section, numbers into a list) set, and
    the factor on the length of its run: faster drives run for as many turns, not for as many seconds. Pulses of inputs are
    sought in t_end s."""
    item, *keys = name.split(".")
    statements = copy.deepcopy(scene.statements)
    index, call = _call(scene, statements, item)
    pulse, factor = varying(call.arguments, keys, t_end, name), 1.0
    if pulse is not None:
        pulse.set(call.arguments, value)
    else:
        factor = _set(call.arguments, statements[index][0], keys, value, name)
    statements[index] = [statements[index][0], list(call.args[1:]), dict(call.kwargs)]
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": statements}
    try:
        return replay(data, type(scene), Known(scene.own)), factor
    except MbdaeError as error:
        raise OptionError(f"vary: {name} = {value:g}: {error}") from error


def _call(scene: SceneData, statements: Statements, item: str) -> tuple[int, inspect.BoundArguments]:
    """Where the statement of an item is, and its arguments by name."""
    index = _statement(scene, statements, item)
    method, args, kwargs = statements[index]
    return index, inspect.signature(getattr(type(scene), method)).bind(None, *args, **kwargs)


def _statement(scene: SceneData, statements: Statements, item: str) -> int:
    names = [_name_of(s) for s in statements]
    if item not in names:
        raise OptionError(f"vary: there is no item '{item}' in scene '{scene.name}'; it has {_items(scene)}")
    return names.index(item)


def _name_of(statement: Any) -> Any:
    _, args, kwargs = statement
    first = args[0] if args else kwargs.get("name")
    return first["name"] if isinstance(first, dict) and "law" in first else first


def _items(scene: SceneData) -> str:
    return ", ".join(repr(n) for n in (_name_of(s) for s in scene.statements) if isinstance(n, str))


def _set(call: dict[str, Any], method: str, keys: list[str], value: float, name: str) -> float:
    """Set one argument of a call; returns the factor on the length of the run."""
    if keys == ["speed"]:
        return _set_speed(call, method, value, name)
    if keys == ["mass"] and method in ("rigid_body", "link"):
        _set_mass(call, method, value)
    elif keys == ["stiffness"] and not {"stiffness", "law"} & set(call):
        _set_stiffness(call, value, name)
    elif keys == ["clearance"]:
        fields = _fields(call, "model", ("outer", "inner"), name)
        fields["outer"] = fields["inner"] + value
    else:
        _descend(call, keys, value, name)
    return 1.0


def _set_mass(call: dict[str, Any], method: str, value: float) -> None:
    """Mass with the inertia in proportion: the same body of another density."""
    if method == "rigid_body" and call["mass"]:
        call["inertia"] = (np.asarray(call["inertia"], dtype=float) * (value / call["mass"])).tolist()
    call.pop("mass_per_length", None)
    call["mass"] = value


def _set_stiffness(call: dict[str, Any], value: float, name: str) -> None:
    """Of a joint: its spring, or the contact of its clearance; of a beam: all stiffnesses in proportion, EA the value."""
    if call.get("spring") is not None:
        call["spring"] = value
    elif "section" in call:
        fields = _fields(call, "section", ("EA",), name)
        factor = value / fields["EA"]
        for key in ("EA", "GA2", "GA3", "GJ", "EI2", "EI3"):
            fields[key] *= factor
    else:
        normal = _fields(call, "model", ("normal",), name)["normal"]
        _fields({"normal": normal}, "normal", ("stiffness",), name)["stiffness"] = value


def _fields(call: Mapping[str, Any], key: str, wanted: Sequence[str], name: str) -> dict[str, Any]:
    """The fields of an object that is an argument."""
    fields = (call.get(key) or {}).get("fields", {}) if isinstance(call.get(key), dict | None) else {}
    if not all(isinstance(fields.get(w), float | int | dict) for w in wanted):
        raise OptionError(f"vary: '{name}' needs a {key} with {' and '.join(wanted)}, which this item does not have; "
                          f"it has {_listed(call)}")  # fmt: skip
    return dict.__getitem__(call[key], "fields") if isinstance(call[key], dict) else fields


def _set_speed(call: dict[str, Any], method: str, value: float, name: str) -> float:
    """Speed of a drive, of a held start rate, or of a body's start; the run is as many times shorter."""
    motion = {"revolute": "angle", "prismatic": "position"}.get(method, "")
    drive = call.get(motion)
    if isinstance(drive, dict) and "expression" in drive:
        e = timed.expression(se.sympify(drive["expression"]))
        before = abs(float(timed.values(timed.derivatives(e)[1], np.zeros(1))[0]))
        factor = _ratio(value, before, name)
        call[motion] = {"expression": str(e.subs({timed.TIME: factor * timed.TIME}))}
        return 1 / abs(factor)
    if motion and call.get("rate0"):
        before, call["rate0"] = abs(call["rate0"]), value
        return 1 / abs(_ratio(value, before, name))
    for key in ("angular_velocity", "velocity"):
        if call.get(key) is not None and np.linalg.norm(call[key]) > 0:
            factor = _ratio(value, float(np.linalg.norm(call[key])), name)
            call[key] = (np.asarray(call[key], dtype=float) * factor).tolist()
            return 1 / abs(factor)
    raise OptionError(f"vary: '{name}': the item has no speed at the start: give it a prescribed angle or position, a rate0, "
                      f"a velocity or an angular_velocity; it has {_listed(call)}")  # fmt: skip


def _ratio(value: float, before: float, name: str) -> float:
    if not before or not value:
        raise OptionError(f"vary: '{name}' = {value:g}: speeds are multiples of the one stated, {before:g}; neither may be 0")
    return value / before


def _descend(holder: Any, keys: list[str], value: float, name: str) -> None:
    """Set the number that the keys lead to; a list of numbers keeps its ratios, its largest entry becomes the value."""
    key: Any = keys[0]
    if isinstance(holder, dict) and ("fields" in holder or "values" in holder):
        holder = holder.get("fields", holder.get("values"))
    if isinstance(holder, list) and key.isdigit() and int(key) < len(holder):
        key = int(key)
    elif not (isinstance(holder, dict) and key in holder):
        law = next((v for v in holder.values() if isinstance(v, dict) and "law" in v), None) if isinstance(holder, dict) else None
        if law is not None:
            return _descend(law, keys, value, name)
        raise OptionError(f"vary: '{name}': there is no number '{key}' stated; there is {_listed(holder)}")
    if len(keys) > 1:
        return _descend(holder[key], keys[1:], value, name)
    old = holder[key]
    if isinstance(old, list):
        size = np.max(np.abs(np.asarray(old, dtype=float)))
        holder[key] = (np.asarray(old, dtype=float) * _ratio(value, float(size), name)).tolist()
    elif isinstance(old, bool | str | dict):
        raise OptionError(f"vary: '{name}' is not a number; a motion is varied by its 'speed', a pulse by its "
                          f"'begin', 'width' or 'strength', an object by 'item.argument.field'")
    else:
        holder[key] = int(value) if isinstance(old, int) and value == int(value) else value
    return None


def _listed(holder: Any) -> str:
    if isinstance(holder, list):
        return f"a list of {len(holder)}"
    names = [str(k) for k in holder if k not in ("self", "name")] if isinstance(holder, dict) else []
    return (", ".join(names) or "nothing more") + f"; shorthands: {SHORTHANDS}"


# -- what a scene offers by itself


def default_vary(scene: SceneData) -> dict[str, Any]:
    """Accuracies and constant steps; masses, stiffnesses and speeds of what the scene states, by factors."""
    found: dict[str, Any] = {"accuracy": [1e-3, 1e-5, 1e-7], "step": [1e-2, 1e-4, 1e-6, 1e-8]}
    for kind, factors in (("mass", (1e-6, 1e-3, 1.0, 1e3, 1e6)), ("stiffness", (1.0, 1e3, 1e6)), ("speed", (1.0, 10.0, 100.0))):
        items = [name for name in (_name_of(s) for s in scene.statements) if isinstance(name, str)]
        of_kind = [(name, now) for name in items if (now := current(scene, name, kind))]
        for name, now in of_kind[:FEW]:
            found[f"{name}.{kind}"] = [now * f for f in factors]
    return found


FEW = 4  #: items of a kind that are varied where the user names none


def current(scene: SceneData, item: str, kind: str) -> float | None:
    """The mass, stiffness or speed an item states; None where it states none."""
    index, bound = _call(scene, scene.statements, item)
    method, call = scene.statements[index][0], bound.arguments
    if kind == "mass":
        body = next((b for b in scene.bodies if b.name == item), None)
        return body.mass if body is not None and method != "beam" else None
    if kind == "speed":
        try:
            return _set_speed(copy.deepcopy(call), method, 1.0, item)
        except OptionError:
            return None
    model = call.get("model")
    normal = model.get("fields", {}).get("normal") if isinstance(model, dict) else None
    section = call.get("section")
    own = call.get("law", {}).get("values", {})
    for holder, key in ((call, "stiffness"), (own, "stiffness"), (call, "spring"), (section, "EA"), (normal, "stiffness")):
        fields = holder.get("fields", holder) if isinstance(holder, dict) else {}
        if fields.get(key) is not None:
            return float(np.max(np.abs(np.asarray(fields[key], dtype=float))))
    return None
