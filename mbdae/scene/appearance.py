"""How bodies look: their shapes and colours. No force follows from it; a contact states its own shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.scene import reading
from mbdae.scene.components import Array, Body
from mbdae.scene.reading import Argument
from mbdae.scene.shapes import Point, Shape
from mbdae.values import BadValueError, array, shown

ROUNDING = 1e-15  #: a direction whose length deviates from 1 by at most this is not scaled to length 1 again
GIVE_A_SHAPE = "give mb.Plane, mb.Cylinder, mb.Sphere, mb.Point or mb.Box"
READERS: dict[str, Callable[[Any], str]] = {}  #: "color" -> function that reads a colour, entered by the package that draws


def shape(arg: Argument, value: Any) -> Shape:
    """Reader of a shape: returns it with plain values, a point, directions of length 1, and lengths above 0."""
    if not isinstance(value, Shape) or type(value) is Shape:
        arg.wrong(f"{shown(value)} is no shape", GIVE_A_SHAPE)
        return Point()
    found: dict[str, Any] = {}
    for key, given in vars(value).items():
        part = arg.part(f"{arg.option}.{key}")
        if key in ("radius", "length"):
            found[key] = None if given is None and key == "length" else reading.quantity("m", "positive")(part, given)
        elif key in ("normal", "axis"):
            found[key] = _unit(reading.direction(part, given))
        elif key == "size":
            found[key] = _edges(part, given)
        elif given is not None:
            found[key] = (reading.rotation if key == "rotation" else reading.point)(part, given)
    return replace(value, **found)


def _unit(direction: Array) -> Array:
    """The direction at length 1; a unit vector is returned unchanged, so that a stored scene repeats its numbers exactly."""
    return direction if abs(np.linalg.norm(direction) - 1) <= ROUNDING else reading.unit(direction)


def _edges(arg: Argument, value: Any) -> Array:
    """Reader of the lengths (3,), m, of the edges of a box; that along z is 0 where two are given."""
    try:
        found = array(value)
        if found.shape not in ((2,), (3,)) or (found < 0).any() or not found.any():
            raise BadValueError(shown(value))
    except BadValueError as value_and_reason:
        arg.wrong(value_and_reason, "give three lengths in m, 0 or more and not all 0, or two for a plate in the plane z = 0")
        return np.ones(3)
    return np.append(found, np.zeros(3 - len(found)))


def shapes(arg: Argument, value: Any) -> tuple[Shape, ...]:
    """Reader of the shapes of a body: one, or a list of them."""
    given = list(value) if isinstance(value, list | tuple) else [value]
    found = [shape(arg if len(given) == 1 else arg.part(f"{arg.option}[{i}]"), one) for i, one in enumerate(given)]
    return tuple(found)


def color(arg: Argument, value: Any) -> str:
    """Reader of a colour: "#rrggbb", from a text that matplotlib knows or from 3 or 4 numbers (an opacity is ignored).
    matplotlib's grey levels, numbers written as texts, are refused: no argument takes numbers as texts."""
    try:
        named = isinstance(value, str) and not value.strip().replace(".", "").isdigit()
        return READERS["color"](value if named else tuple(array(value, (3,), (4,)).tolist()))
    except ValueError as refused:
        told = isinstance(refused, BadValueError) and shown(value) in str(refused)
        remedy = "give a colour as matplotlib does: 'tab:blue', 'red', '#1f77b4', 'C0', or (r, g, b) from 0 to 1"
        arg.wrong(refused if told else shown(value), remedy)
        return "#000000"


def placed(one: Any, point: Array) -> Any:
    """The shape with its point `at`; where it has none, at `point` (3,), m, as drawn."""
    return one if one.at is not None else replace(one, at=np.array(point, dtype=float))


def looking(body: Body, shape: tuple[Shape, ...] | None, color: str | None) -> Body:
    """The body with its shapes and colour."""
    body.shapes = None if shape is None else tuple(placed(one, body.drawn.position) for one in shape)
    body.color = color
    return body
