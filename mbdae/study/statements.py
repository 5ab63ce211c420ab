"""A scene with another number in one of its statements: the recorded statements (`mbdae.scene.record`) are changed and
repeated.

Of a pulse, the begin, width and strength can be varied: it then is the same expression with its time and its values scaled, so
that its edges are known however narrow it has become, and a reference run that restarts at the edges (`extremes/cell.py`)
cannot step over it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.inputs import timed
from mbdae.inputs.breaks import Pulse, pulse_of
from mbdae.inputs.sensed import named_by, number_symbol, numbers_in, paths, with_values
from mbdae.scene.changed import with_statements
from mbdae.scene.record import arguments_of, encode, item_name, read, stored
from mbdae.scene.scene import SceneData
from mbdae.values import array, option

NUMBERS = ("begin", "width", "strength")  #: quantities of a pulse that can be varied
SHORTHANDS = "mass, stiffness, speed, clearance; begin, width, strength of a pulse"


Value = float | Callable[[float], float]  #: a new number, or a function that makes it of the number stated


def changed(scene: SceneData, name: str, value: Value, t_end: float = 1.0) -> tuple[SceneData, float]:
    """(scene with the argument `name` set to a value, factor on the end of its run). name: "item.argument"; further dots lead
    into a joint model or section, numbers into a list. The factor lets a faster drive run for the same number of turns. t_end:
    end of the run (s) in which pulses of inputs are sought. SceneError where the given scene has problems."""
    if scene.problems:  # repeating only the recorded statements could give a scene without the problem
        raise SceneError(scene.problems)
    item, *keys = name.split(".")
    if not keys and item in scene.numbers:
        return _again(scene, _with_number(scene.statements, item, _of(value, scene.numbers[item])), name, value), 1.0
    if not keys:
        raise OptionError(f"vary: '{name}' names no number; add one of its arguments after a dot, such as '{name}.mass'")
    statements = [*scene.statements]
    index, call = call_of(scene, statements, item)
    pulse, factor = varying(call, keys, t_end, name), 1.0
    if keys == ["mass"] and callable(value) and (mass := stated_number(scene, item, "mass")) is not None:
        value = value(mass)
    if pulse is not None:
        call = copy.deepcopy(call)
        pulse.set(call, _of(value, getattr(pulse.pulse, pulse.number)))
    else:
        factor = _set(call, statements[index][0], keys, value, name)
    statements[index] = restated(scene, statements[index][0], call)
    return _again(scene, statements, name, value), factor


def stated_value(scene: SceneData, name: str, t_end: float) -> float:
    """The value of the number `name` (see `changed`) that a scene states."""
    found = list[float]()

    def read(value: float) -> float:
        found.append(value)
        return value

    changed(scene, name, read, t_end)
    return found[0]


def _with_number(data: Any, name: str, value: float) -> Any:
    """Recorded statements, nested plain data, with another value of a named number (`mb.number`)."""
    if isinstance(data, dict) and "expression" in data:
        e = read(data)
        e = e.subs({s: se.Symbol(number_symbol(name, value)) for s in e.free_symbols if (named_by(s) or ("",))[0] == name})
        return stored(e)
    if isinstance(data, dict):
        return {key: _with_number(part, name, value) for key, part in data.items()}
    return [_with_number(part, name, value) for part in data] if isinstance(data, list) else data


def _again(scene: SceneData, statements: list[Any], name: str, value: Value) -> SceneData:
    """The scene with other statements."""
    try:
        made: SceneData = with_statements(scene, statements) or scene._copied(statements)
        return made
    except MbdaeError as scene_problem:
        said = name if callable(value) else f"{name} = {value:g}"
        raise OptionError(f"vary: {said}: {scene_problem}") from scene_problem


def _of(value: Value, stated: float) -> float:
    """The new number in place of the one stated."""
    return value(float(stated)) if callable(value) else value


def call_of(scene: SceneData, statements: list[Any], item: str) -> tuple[int, dict[str, Any]]:
    """Index of the statement that makes an item, and its arguments by name."""
    names = vars(scene).get("_names_stated", ())
    if len(names) != len(statements):
        names = vars(scene)["_names_stated"] = [item_name(s) for s in statements]
    if item not in names:
        raise OptionError(f"vary: there is no item '{item}' in scene '{scene.name}'; it has {items_of(scene)}")
    method, args, kwargs = statements[names.index(item)]
    call = arguments_of(method).by_name(args, kwargs)
    return names.index(item), call | call.pop("further", {})


def restated(scene: SceneData, method: str, call: dict[str, Any]) -> list[Any]:
    """The statement `method(...)` with the arguments `call`, as plain data."""
    return [method, *arguments_of(method).as_call(call)]


def items_of(scene: SceneData) -> str:
    """Names of all items of a scene, in words."""
    return ", ".join(repr(n) for n in (item_name(s) for s in scene.statements) if isinstance(n, str))


def _set(call: dict[str, Any], method: str, keys: list[str], value: Value, name: str) -> float:
    """Set the argument at the path `keys` among the arguments `call` of a statement; returns the factor on the end of the run."""
    if keys[0] == "speed" and len(keys) < 3:
        return _set_speed(call, method, value, name, "".join(keys[1:]))
    if keys == ["mass"] and method in ("rigid_body", "link") and not callable(value):
        if method == "rigid_body" and call["mass"]:  # its inertia in proportion, as for the same body with another density
            call["inertia"] = (np.asarray(call["inertia"], dtype=float) * (value / call["mass"])).tolist()
        call.pop("mass_per_length", None)
        call["mass"] = value
    elif keys == ["stiffness"] and not {"stiffness", "law"} & set(call):
        _set_stiffness(call, value, name)
    elif keys == ["clearance"]:
        fields = _fields(call, "model", ("outer", "inner"), name)
        fields["outer"] = fields["inner"] + _of(value, fields["outer"] - fields["inner"])
    else:
        _descend(call, keys, value, name)
    return 1.0


def _set_stiffness(call: dict[str, Any], value: Value, name: str) -> None:
    """Set the spring stiffness of a joint, the contact stiffness of a clearance, or EA of a beam with its other stiffnesses in
    proportion."""
    if call.get("spring") is not None:
        holder, key = _alone(_by_coordinate(call, "spring"), name, "spring")
        holder[key] = _of(value, holder[key])
    elif "section" in call:
        fields = _fields(call, "section", ("EA",), name)
        factor = _of(value, fields["EA"]) / fields["EA"]
        for key in ("EA", "GA2", "GA3", "GJ", "EI2", "EI3", *(["E"] if fields.get("E") else [])):
            fields[key] *= factor
    else:
        inside = _fields(_fields(call, "model", ("normal",), name), "normal", ("stiffness",), name)
        inside["stiffness"] = _of(value, inside["stiffness"])


def _fields(call: dict[str, Any], key: str, wanted: Sequence[str], name: str) -> dict[str, Any]:
    """A copy, put in their place, of the fields of the object (such as a joint model) that is the argument `key`; OptionError
    where it lacks one of the `wanted`."""
    fields = (call.get(key) or {}).get("fields", {}) if isinstance(call.get(key), dict | None) else {}
    if not all(isinstance(fields.get(w), float | int | dict) for w in wanted):
        raise OptionError(f"'{name}' cannot be varied: this item states no {name.rpartition('.')[2]}, nor {' and '.join(wanted)} "
                          f"in its argument {key}; state it, or vary one of {_listed(call)}")
    call[key] = {**call[key], "fields": {**fields}}
    return call[key]["fields"]  # type: ignore[no-any-return]


def _by_coordinate(call: dict[str, Any], option: str) -> list[tuple[dict[str, Any], str]]:
    """(mapping, key) of every value that a joint's option has: of one value, or of one for each coordinate, in a copy of these
    that is put in their place."""
    stated = call.get(option)
    holder = {**stated["by"]} if isinstance(stated, dict) and "by" in stated else call
    call |= {} if holder is call else {option: {"by": holder}}
    return [(holder, key) for key in ([option] if holder is call else holder) if holder.get(key) is not None]


def _alone(places: list[tuple[dict[str, Any], str]], name: str, word: str) -> tuple[dict[str, Any], str]:
    """The only one of `places`, the values of an option by coordinate; OptionError where there is not exactly one."""
    if not places:
        raise OptionError(f"vary: '{name}': no coordinate of this joint has a {word}; give it one")
    if len(places) > 1:
        options = " or ".join(f"'{name.partition('.')[0]}.{word}.{key}'" for _, key in places)
        raise OptionError(f"vary: '{name}': this joint has a {word} in several coordinates; name one: {options}")
    return places[0]


def _set_speed(call: dict[str, Any], method: str, value: Value, name: str, coordinate: str = "") -> float:
    """Set the speed of a drive, of the start of a joint, or of a body at the start; returns the factor on the end of the run."""
    drive, start = {"revolute": ("angle", "rate0"), "prismatic": ("position", "rate0")}.get(method, ("prescribed", "start_rate"))
    moving = [(h, key) for h, key in _by_coordinate(call, drive) if isinstance(h[key], dict)]
    moving += [(h, key) for h, key in _by_coordinate(call, start) if h[key]]
    moving = [place for place in moving if coordinate in ("", place[1])]
    if moving:
        holder, key = _alone(moving, name, "speed")
        if not isinstance(holder[key], dict):
            before, new = abs(holder[key]), _of(value, holder[key])
            holder[key] = new
            return 1 / abs(_ratio(new, before, name, "the speed"))
        e = timed.expression(with_values(read(holder[key])))
        before = abs(float(timed.values(timed.derivatives(e)[1], np.zeros(1))[0]))
        factor = _ratio(_of(value, before), before, name, "the speed")
        holder[key] = stored(e.subs({timed.TIME: factor * timed.TIME}))
        return 1 / abs(factor)
    for key in ("angular_velocity", "velocity"):
        if not coordinate and call.get(key) is not None and np.linalg.norm(call[key]) > 0:
            size = float(np.linalg.norm(call[key]))
            factor = _ratio(_of(value, size), size, name, "the speed")
            call[key] = (np.asarray(call[key], dtype=float) * factor).tolist()
            return 1 / abs(factor)
    raise OptionError(f"vary: '{name}': the item has no speed at the start: give it a prescribed angle or position, a "
                      f"rate0 or start_rate, a velocity or an angular_velocity; it has {_listed(call)}")


def _ratio(value: float, before: float, name: str, quantity: str) -> float:
    if not before or not value:
        raise OptionError(f"vary: '{name}' = {value:g}: values are multiples of {quantity} stated, {before:g}; neither may be 0")
    return value / before


def _descend(holder: Any, keys: list[str], value: Value, name: str) -> None:
    """Set the number at the path of keys, of which the parts are copied; a list of numbers is scaled so that its largest entry is
    the value."""
    key: Any = keys[0]
    if isinstance(holder, dict) and (part := next((part for part in ("fields", "values", "by") if part in holder), None)):
        holder[part] = holder = copy.copy(holder[part])
    if isinstance(holder, list) and key.isdigit() and int(key) < len(holder):
        key = int(key)
    elif not (isinstance(holder, dict) and key in holder):
        for law in [k for k, v in holder.items() if isinstance(v, dict) and "law" in v] if isinstance(holder, dict) else ():
            holder[law] = copy.copy(holder[law])
            return _descend(holder[law], keys, value, name)
        raise OptionError(f"vary: '{name}': there is no number '{key}' stated; there is {_listed(holder)}")
    if len(keys) > 1:
        holder[key] = copy.copy(holder[key])
        return _descend(holder[key], keys[1:], value, name)
    old = holder[key]
    if isinstance(old, list | tuple):
        entries = option(f"vary: '{name}': its value", old, array, "vary one of its entries, by their numbers after a dot")
        largest = float(np.max(np.abs(entries), initial=0.0))
        holder[key] = (entries * _ratio(_of(value, largest), largest, name, "the largest entry")).tolist()
    elif isinstance(old, dict) and "by" in old:
        raise OptionError(f"vary: '{name}' has values by coordinate; say {' or '.join(repr(f'{name}.{c}') for c in old['by'])}")
    elif isinstance(old, dict) and "expression" in old and (named := sorted(numbers_in(read(old)))):
        raise OptionError(f"vary: '{name}' is made of named numbers; name one: {', '.join(map(repr, named))}")
    elif isinstance(old, bool | str | dict):
        item = name.partition(".")[0]
        raise OptionError(f"vary: '{name}' stands for an expression, an object or a text, not for a number: vary the speed of a "
                          f"motion ('{item}.speed'), the begin, width or strength of a pulse, or a number of an object "
                          f"('{name}.' and its field)")
    elif not isinstance(old, int | float):
        raise OptionError(f"vary: '{name}': no number is stated there")
    else:
        new = _of(value, old)
        holder[key] = int(new) if isinstance(old, int) and new == int(new) else new
    return None


def _listed(holder: Any) -> str:
    if isinstance(holder, list):
        return f"a list of {len(holder)}"
    names = [str(k) for k in holder if k not in ("self", "name")] if isinstance(holder, dict) else []
    return (", ".join(names) or "nothing more") + f"; shorthands: {SHORTHANDS}"


def stated_number(scene: SceneData, item: str, kind: str) -> float | None:
    """The mass, stiffness or speed an item states; None where it states none."""
    index, call = call_of(scene, scene.statements, item)
    method = scene.statements[index][0]
    if kind == "mass":
        body = next((b for b in scene.bodies if b.name == item), None)
        return body.mass if body is not None and method != "beam" else None
    if kind == "speed":
        try:
            return _set_speed({**call}, method, 1.0, item)
        except OptionError:
            return None
    model = call.get("model")
    normal = model.get("fields", {}).get("normal") if isinstance(model, dict) else None
    own = call.get("law", {}).get("values", {})
    springs = _by_coordinate(call, "spring") if len(_by_coordinate(call, "spring")) == 1 else []
    for holder, key in ((call, "stiffness"), (own, "stiffness"), *springs, (call.get("section"), "EA"), (normal, "stiffness")):
        fields = holder.get("fields", holder) if isinstance(holder, dict) else {}
        if fields.get(key) is not None:
            return float(np.max(np.abs(np.asarray(fields[key], dtype=float))))
    return None


# -- pulses: begin, width and strength of inputs of time that change during one interval alone


@dataclass(frozen=True)
class Varying:
    """A pulse in the arguments of a statement, and which of its NUMBERS (`number`) is varied. keys: names of the argument, and of
    entries inside it, in which the expressions of the pulse are."""

    keys: tuple[str, ...]
    pulse: Pulse
    number: str

    def at(self, value: float) -> Pulse:
        """The pulse whose varied number has the given value."""
        return replace(self.pulse, **{self.number: value})

    def set(self, arguments: dict[str, Any], value: float) -> None:
        """Replace the expressions in the arguments of the statement by those of the pulse whose varied number has the given
        value."""
        def exact(number: float) -> Any:  # so that times that are shifted and scaled lose no digit
            return se.Rational(*float(number).as_integer_ratio())

        old, new = self.pulse, self.at(value)
        pace = old.width / new.width if self.number == "width" else 1.0
        time = exact(old.begin) + exact(pace) * (timed.TIME - exact(new.begin))
        size = exact(new.strength / old.strength)
        for holder, key in list(_places(arguments, self.keys)):
            e = timed.expression(with_values(read(holder[key])))
            before = exact(float(timed.values(e, np.zeros(1))[0]))
            holder[key] = encode(before + size * (e.subs({timed.TIME: time}) - before))


def varying(arguments: dict[str, Any], keys: Sequence[str], t_end: float, name: str) -> Varying | None:
    """The pulse in the arguments of a statement, in a run of t_end (s), of which `keys` name a number to vary: ("width",) or, for
    one of several inputs, ("value", "0", "width"). None where `keys` name another argument. name: as the user gave it, for
    messages."""
    *path, number = keys
    if number not in NUMBERS or number in arguments or number in arguments.get("law", {}).get("values", {}):
        return None
    inputs = [timed.expression(with_values(read(holder[key]))) for holder, key in _places(arguments, path)]
    if not inputs:
        return None
    found = pulse_of(inputs, t_end)
    if found is None or not (found.width or number != "width"):
        raise OptionError(f"vary: '{name}': only a pulse has this number, and what is stated there is none: between the start "
                          f"and t = {t_end:g} s it has to be constant, change for some time, and be constant again")
    return Varying(tuple(path), found, number)


def pulses(statements: Any, t_end: float) -> list[Pulse]:
    """The pulses of single expressions in statements, in a run of t_end (s)."""
    alone = [timed.expression(with_values(read(holder[key]))) for holder, key in _places(statements, ())]
    return [found for e in alone if (found := pulse_of([e], t_end)) is not None]


def _places(holder: Any, path: Sequence[str]) -> Iterator[tuple[Any, Any]]:
    """(list or mapping, key) of every expression that depends on time alone, in the nested data `holder` below a path of names
    and indices."""
    for key, value in enumerate(holder) if isinstance(holder, list) else holder.items():
        rest = path[1:] if path and str(key) == path[0] else path
        if isinstance(value, dict) and "expression" in value:
            if not rest and not paths(read(value)):
                yield holder, key
        elif isinstance(value, list | dict):
            yield from _places(value, rest)
