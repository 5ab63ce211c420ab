"""The statements of a scene as plain data: recorded as they are made, stored as JSON, replayed into an equal scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from importlib import import_module
from types import FunctionType
from typing import Any, TypeVar

import numpy as np
import symengine as se

from mbdae.errors import SceneError
from mbdae.inputs import timed
from mbdae.scene.components import Body, Place
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part

F = TypeVar("F", bound=Callable[..., Any])
Statement = list[Any]  #: [method, positional arguments, keyword arguments], JSON-able


def statement(method: F) -> F:
    """Record the calls of a public method of a scene in `scene.statements`; calls between methods are not recorded."""

    @wraps(method)
    def recorded(self: Any, *args: Any, **kwargs: Any) -> Any:
        if self.recording:
            self.statements.append([method.__name__, [encode(a) for a in args], {k: encode(v) for k, v in kwargs.items()}])
        before, self.recording = self.recording, False
        try:
            return method(self, *args, **kwargs)
        finally:
            self.recording = before

    return recorded  # type: ignore[return-value]


def encode(value: Any) -> Any:
    """JSON-able form of an argument."""
    if value is None or isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, Body):
        return {"body": value.name}
    if isinstance(value, Place):
        return {"place": value.body.name, "point": value.point.tolist()}
    if isinstance(value, Law):
        return _encode_law(value)
    if isinstance(value, type):
        return {"class": _path(value)}
    if isinstance(value, FunctionType):
        return {"class": _path(value)}
    if isinstance(value, list | tuple):
        return [encode(v) for v in value]
    if isinstance(value, np.ndarray | np.generic) and value.dtype != object:
        return value.tolist()
    if isinstance(value, np.ndarray):
        return [encode(v) for v in value]
    if isinstance(value, Part):
        return {"object": _path(type(value)), "fields": {key: encode(v) for key, v in value.values().items() if v is not None}}
    if is_dataclass(value):
        return {"object": _path(type(value)), "fields": {f.name: encode(getattr(value, f.name)) for f in fields(value)}}
    return _encode_expression(value)


def _encode_expression(value: Any) -> Any:
    try:
        e = timed.expression(value)
    except (TypeError, ValueError):
        return {"unreadable": repr(value)}
    if not e.free_symbols:
        return float(e)
    return {"expression": str(timed.with_fractions(e))}  # text keeps 15 digits of a number, a fraction keeps all


def _encode_law(law: Law) -> dict[str, Any]:
    own = {key: encode(getattr(law, key)) for key in (*law.params, *law.options)}
    places = {key: encode(getattr(law, key, None)) for key in ("k", "l", "at", "axis")}
    return {"law": _path(type(law)), "name": law.name, "at_l": encode(getattr(law, "at_l", None)), **places, "values": own}


def _path(cls: type | FunctionType) -> str:
    return f"{cls.__module__}:{cls.__qualname__}"


def found(path: str) -> Any:
    """The class "module:qualname" names; imports its module."""
    module, _, name = path.partition(":")
    try:
        value: Any = import_module(module)
        for part in name.split("."):
            value = getattr(value, part)
    except (ImportError, AttributeError) as error:
        raise SceneError([f"class {path} cannot be imported ({error}); make its module importable before loading"]) from error
    return value


def decode(value: Any, scene: Any) -> Any:
    """The argument an encoded value stands for, in `scene`."""
    if isinstance(value, list):
        return [decode(v, scene) for v in value]
    if not isinstance(value, dict):
        return value
    if "body" in value:
        return scene[value["body"]]
    if "place" in value:
        return Place(scene[value["place"]], np.array(value["point"]))
    if "expression" in value:
        return se.sympify(value["expression"])
    if "class" in value:
        return found(value["class"])
    if "object" in value:
        return found(value["object"])(**{k: decode(v, scene) for k, v in value["fields"].items()})
    if "law" in value:
        return _decode_law(value, scene)
    raise SceneError([f"a stored argument cannot be read: {value}"])


def _decode_law(value: dict[str, Any], scene: Any) -> Law:
    law: Law = object.__new__(found(value["law"]))
    places = {key: decode(value[key], scene) for key in ("k", "l", "at", "axis")}
    parameters = {key: decode(v, scene) for key, v in value["values"].items()}
    for key, v in {"name": value["name"], **places, **parameters}.items():
        setattr(law, key, v)
    if value["at_l"] is not None:
        law.at_l = np.asarray(decode(value["at_l"], scene), dtype=float)  # type: ignore[attr-defined]
    law.compose()
    return law


def replay(data: dict[str, Any], scene_class: Callable[..., Any]) -> Any:
    """A scene from its data: {"name", "gravity", "space", "statements"}."""
    scene = scene_class(data["name"], gravity=data["gravity"], space=data["space"])
    for method, args, kwargs in data["statements"]:
        getattr(scene, method)(*[decode(a, scene) for a in args], **{k: decode(v, scene) for k, v in kwargs.items()})
    return scene
