"""Quantities of a result over time: sensors by name, components of them, and expressions and functions of one's own."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.notation import counted
from mbdae.scene.components import Signal
from mbdae.scene.sensor_names import measured, spelled
from mbdae.system.base import Array
from mbdae.values import BadValueError, shown

Quantity = str | Callable[[Any], Any]
#: functions of expressions; norm and magnitude are lengths of vectors
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "abs", "sign", "minimum", "maximum")},
    "norm": lambda v: np.linalg.norm(v, axis=-1),
}  # fmt: skip
_SIGNS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.true_divide, ast.Pow: np.power,
}  # fmt: skip
NAME_A_QUANTITY = ("name a sensor (\"J.angle\", \"b.position[1]\"), give an expression of sensors (\"J.torque[2]*J.rate\"), or a "
                   "function of the result (lambda r: r[\"J\"].angle)")  # fmt: skip


def value(result: Any, quantity: Quantity) -> Array:
    """A quantity at the result's times, (nt,) or (nt, n); OptionError or SceneError where it is none."""
    if callable(quantity):
        try:
            found = np.asarray(quantity(result), dtype=float)
        except (TypeError, ValueError) as error:
            raise OptionError(f"{named(quantity)} gives no numbers: {error}; {NAME_A_QUANTITY}") from error
    elif isinstance(quantity, str):
        found = np.asarray(_of_text(result, quantity))
    else:
        raise OptionError(f"{shown(quantity)} is no quantity: {NAME_A_QUANTITY}")
    if found.shape[:1] != result.t.shape or found.dtype.kind not in "fi":
        raise OptionError(f"{named(quantity)} is not a quantity over time: it has the shape {found.shape}, where numbers at "
                          f"{counted(len(result.t), 'time')} are expected; {NAME_A_QUANTITY}")  # fmt: skip
    return np.asarray(found, dtype=float)


def magnitudes(values: Array) -> Array:
    """Magnitudes (k,) of values (k, ...): of numbers, and lengths of vectors."""
    return np.asarray(np.abs(values) if values.ndim == 1 else np.linalg.norm(values.reshape(len(values), -1), axis=1))


def named(quantity: Any) -> str:
    """The name of a quantity in messages and tables."""
    return quantity if isinstance(quantity, str) else str(getattr(quantity, "__name__", "a function"))


def unit_of(result: Any, quantity: Any) -> str:
    """Unit of a sensor; "" for expressions and functions, whose unit is not known."""
    try:
        return measured(result.prepared.model.scene, quantity)[1]
    except (SceneError, AttributeError, TypeError):
        return ""


def _of_text(result: Any, text: str) -> Any:
    """A sensor, or an expression of sensors."""
    try:
        return result.read(text)
    except SceneError:
        plain, names = _spelled(result, text)
        tree = _parsed(plain)
        if tree is None or isinstance(tree, ast.Name | ast.Constant) or _path(tree, names) is not None:
            raise
        return _evaluated(result, tree, names)


def _spelled(result: Any, text: str) -> tuple[str, dict[str, str]]:
    try:
        return spelled(result.prepared.model.scene, text)
    except BadValueError as two_meanings:
        raise OptionError(f"'{text}' cannot be read: {two_meanings}") from None


def _parsed(text: str) -> Any:
    """The syntax tree of a text that is an expression; None for other text."""
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def _path(node: Any, names: Mapping[str, str]) -> str | None:
    """The name of the sensor that a node of the syntax tree stands for; None where it is no sensor. names: plain name used in the
    text -> name of the item (see `sensor_names.spelled`)."""
    inner = node.value if isinstance(node, ast.Subscript) else node
    if not isinstance(inner, ast.Attribute):
        return None
    head, dot, rest = ast.unparse(node).partition(".")
    return names.get(head, head) + dot + rest


def _evaluated(result: Any, node: Any, names: Mapping[str, str]) -> Any:
    """The value of a node of the syntax tree: operators, `FUNCTIONS`, numbers, t, pi and sensors; names as in `_path`."""
    path = _path(node, names)
    if path is not None:
        return result.read(path)
    if isinstance(node, ast.Name) and isinstance(result.prepared.model.scene._by_name.get(names.get(node.id, node.id)), Signal):
        return result.read(names.get(node.id, node.id))
    if isinstance(node, ast.Name) and node.id in ("t", "pi"):
        return result.t if node.id == "t" else np.pi
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner = _evaluated(result, node.operand, names)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp) and type(node.op) in _SIGNS:
        return _applied(result, node, _SIGNS[type(node.op)], (node.left, node.right), names)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS and not node.keywords:
        return _applied(result, node, FUNCTIONS[node.func.id], node.args, names)
    raise OptionError(f"'{_said(node, names)}' is no part of an expression of sensors: signs + - * / **, numbers, t, pi, "
                      f"the functions {', '.join(FUNCTIONS)}, and sensors may appear")  # fmt: skip


def _applied(result: Any, node: Any, function: Callable[..., Any], parts: Sequence[Any], names: Mapping[str, str]) -> Any:
    """The value of an operator or function of the nodes `parts`; OptionError where their numbers of components do not fit."""
    given = [_evaluated(result, part, names) for part in parts]
    wanted = getattr(function, "nin", 1)
    if len(given) != wanted:
        raise OptionError(f"'{_said(node, names)}' has {counted(len(given), 'argument')}, but takes {wanted}")
    if function is FUNCTIONS["norm"] and np.ndim(given[0]) < 2:
        raise OptionError(f"'{_said(node, names)}' cannot be formed: norm takes a vector such as b.velocity, "
                          f"and {_said(parts[0], names)} has one number; take abs")  # fmt: skip
    if len({np.shape(value) for value in given if np.ndim(value)}) > 1:
        sizes = ", ".join(f"{_said(part, names)} has {_components(value)}" for part, value in zip(parts, given, strict=True))
        raise OptionError(f"'{_said(node, names)}' cannot be formed: {sizes}; name components, as in b.position[1]")
    with np.errstate(all="ignore"):
        return function(*given)


def _said(node: Any, names: Mapping[str, str]) -> str:
    """A part of an expression as it was written."""
    return re.sub(r"\bitem_\d+_", lambda found: names.get(found[0], found[0]), ast.unparse(node))


def _components(value: Any) -> str:
    """How many numbers a value has at a time."""
    shape = np.shape(value)[1:]
    return " x ".join(map(str, shape)) + " components" if shape else "one number"
