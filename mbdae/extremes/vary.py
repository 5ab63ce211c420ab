"""Parameters that a map of extremes varies: an argument of a statement of the scene, of scene(), or an option of the run."""

from __future__ import annotations

import copy
import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mbdae.errors import OptionError
from mbdae.extremes.values import OPTIONS
from mbdae.scene.record import item_name
from mbdae.scene.scene import SceneData
from mbdae.sweep.pulses import Pulse, pulses, varying
from mbdae.sweep.statements import call_of, changed, items_of, stated_number
from mbdae.values import number, shown

FEW = 4  #: largest number of items of a kind that are varied by default


@dataclass(frozen=True)
class Varied:
    """A parameter with its values. scene(value): the scene at that value; t_end(value): end of its run, s; stops(value): times
    (s) at which a reference restarts, so that it steps over no pulse of the inputs."""

    name: str
    values: tuple[float, ...]
    scene: Callable[[float], SceneData]
    t_end: Callable[[float], float]
    stops: Callable[[float], list[float]] = lambda value: []


def varied(scene: Any, t_end: float, values: Mapping[str, Sequence[float]]) -> list[Varied]:
    """The parameters with their values, each checked at all of them."""
    return [_one(scene, t_end, name, tuple(asked)) for name, asked in values.items()]


def stated(scene: Any) -> SceneData:
    """The scene without variation; `scene` is a scene, or a function that returns one."""
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
    """A parameter named item.argument: an argument of the statement, or a number (begin, width, strength) of a pulse in that
    statement's inputs."""
    for value in values:
        changed(base, name, value, t_end)  # refuses a parameter that cannot be varied before any run starts

    def stops(value: float) -> list[float]:
        s, factor = changed(base, name, value, t_end)
        item, *keys = name.split(".")
        index, call = call_of(base, copy.deepcopy(base.statements), item)
        pulse = varying(call, keys, t_end, name)
        if pulse is None:
            return _stops(pulses(s.statements, t_end * factor))
        others = [statement for i, statement in enumerate(s.statements) if i != index]
        return _stops([pulse.at(value), *pulses(others, t_end)])

    return Varied(name, values, lambda value: changed(base, name, value, t_end)[0],
                  lambda value: t_end * changed(base, name, value, t_end)[1], stops)  # fmt: skip


def _stops(found: list[Pulse]) -> list[float]:
    return sorted({t for pulse in found for t in pulse.stops})


def _number_in(name: str, value: str) -> float:
    """The number that `value` states, the text "3" in a name such as "scene(n=3).coupler.mass"; OptionError for other text."""
    try:
        return number(float(value))
    except ValueError:
        raise OptionError(f"vary: '{name}': the argument {value} of scene(...) is not a number; give one, as in "
                          f"'scene(n=3).A.spring'") from None


def _refuse_unknown_argument(scene: Any, name: str) -> None:
    own = list(inspect.signature(scene).parameters) if callable(scene) and not isinstance(scene, SceneData) else []
    if name not in own:
        told = f"arguments of scene(): {', '.join(own)}; " if own else "scene() has no arguments; "
        raise OptionError(f"vary: there is nothing named '{name}'; {told}options of the run: {', '.join(OPTIONS)}; "
                          f"or 'item.argument' of an item of the scene: {items_of(stated(scene))}")  # fmt: skip


def default_vary(scene: SceneData) -> dict[str, list[float]]:
    """Default values: accuracies and constant steps; masses, stiffnesses and speeds stated in the scene, times fixed factors."""
    found: dict[str, list[float]] = {"accuracy": [1e-3, 1e-5, 1e-7], "step": [1e-2, 1e-4, 1e-6, 1e-8]}
    for kind, factors in (("mass", (1e-6, 1e-3, 1.0, 1e3, 1e6)), ("stiffness", (1.0, 1e3, 1e6)), ("speed", (1.0, 10.0, 100.0))):
        items = [name for name in (item_name(s) for s in scene.statements) if isinstance(name, str)]
        of_kind = [(name, now) for name in items if (now := stated_number(scene, name, kind))]
        for name, now in of_kind[:FEW]:
            found[f"{name}.{kind}"] = [now * f for f in factors]
    return found
