"""Quantities of a result over time: sensors by name, components of them, and expressions and functions of one's own.

A result as a table: a data frame of pandas, a data set of xarray, a file of numbers.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.files import write_file
from mbdae.inputs.measured import FORMULAS
from mbdae.notation import counted
from mbdae.scene.components import BeamLoad, Controller, Signal
from mbdae.scene.sensed import measured, of_motion, spelled
from mbdae.system.base import Array
from mbdae.values import BadValueError, file_to_write, option, shown

Quantity = str | Callable[[Any], Any]
#: functions of expressions; norm and magnitude are lengths of vectors
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "abs", "sign", "minimum", "maximum")},
    "norm": lambda v: np.linalg.norm(v, axis=-1),
}
_SIGNS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.true_divide, ast.Pow: np.power,
}
#: largest number of jumps of a quantity that are looked at where two runs differ; a jump is sought at ACROSS times, then at as
#: many between the two that differ most, and so on: 32^6 times finer than the shift of its instant that is allowed
JUMPS, ACROSS, NARROWINGS = 50, 33, 6
LATEST = 1e-3  #: share of the motion's characteristic time by which jumps of a looser run may be shifted
NAME_A_QUANTITY = ("name a sensor (\"J.angle\", \"b.position[1]\"), give an expression of sensors (\"J.torque[2]*J.rate\"), or a "
                   "function of the result (lambda r: r[\"J\"].angle)")


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
                          f"{counted(len(result.t), 'time')} are expected; {NAME_A_QUANTITY}")
    return np.asarray(found, dtype=float)


def absent(result: Any, quantity: Quantity, read: Iterable[tuple[Array, Array]]) -> float | None:
    """The first time, s, at which a quantity is infinite or no number, in a result or in what was read of it: times (k,) and
    values (k, ...); None where it is finite all along."""
    with result._silently():
        own = result.t, value(result, quantity)
    return min((float(t) for times, values in (own, *read) for t in times[~np.isfinite(magnitudes(values))][:1]), default=None)


class Estimate(NamedTuple):
    """error: of a quantity, absolute, in its unit, rounding at least; size: what it is relative to; limit: that of rounding;
    mesh: the part of the error that a finer mesh shows."""

    error: float
    size: float
    limit: float = 0.0
    mesh: float = 0.0

    @property
    def relative(self) -> float:
        """The error over the size; 0 where it is rounding."""
        return 0.0 if self.error <= self.limit else self.error / self.size if self.size > 0 else np.inf

    def beyond(self, asked: float) -> bool:
        """Whether the error is above the accuracy asked."""
        return not self.error <= max(asked * self.size, self.limit)


def magnitudes(values: Array) -> Array:
    """Magnitudes (k,) of values (k, ...): of numbers, and lengths of vectors."""
    return np.asarray(np.abs(values) if values.ndim == 1 else np.linalg.norm(values.reshape(len(values), -1), axis=1))


def difference(own: Array, compared: Array, unit: str) -> Array:
    """Difference of two readings of a quantity; of angles without whole turns."""
    found = compared - own
    return found - 2 * np.pi * np.round(found / (2 * np.pi)) if unit == "rad" else found


def differences(own: Any, beside: Any, quantity: Quantity, unit: str, asked: float, ratio: float, least: float) -> Array:
    """Magnitudes (nt,) of the differences of a quantity between two runs at the times of both. Where it jumps in the first, of an
    accuracy `asked`, the other may show either side: within that share of the motion's characteristic time, with a tolerance
    `ratio` times as large up to LATEST of it. 0: no jumps; differences up to `least` are not asked about."""
    shift = asked and max(asked, min(asked * ratio, LATEST)) * own.prepared.time
    compared = value(beside, quantity)
    found = magnitudes(difference(value(own, quantity), compared, unit))
    for _ in range(JUMPS):
        k = int(np.argmax(found))
        if not (shift > 0 and found[k] > least):
            break
        t, sides = _jump(own, quantity, unit, float(own.t[k]), shift)
        near, before = np.abs(own.t - t) <= shift, found[k]
        if magnitudes(difference(sides[:1], sides[1:], unit))[0] < before / 2:  # no jump
            break
        either = [magnitudes(difference(one[None], compared[near], unit)) for one in sides]
        found[near] = np.minimum(found[near], np.min(either, axis=0))
        if found[k] > before / 2:
            break
    return found


def _jump(own: Any, quantity: Quantity, unit: str, t: float, shift: float) -> tuple[float, Array]:
    """The instant within `shift` of t at which a quantity of a run varies most, and its values just before and after (2, ...)."""
    first, last = (float(np.clip(t + sign * shift, own.solution.t[0], own.solution.t[-1])) for sign in (-1, 1))
    for _ in range(NARROWINGS):
        at = np.linspace(first, last, ACROSS)
        values = value(own(at), quantity)
        k = int(np.argmax(magnitudes(difference(values[:-1], values[1:], unit))))
        first, last, sides = float(at[k]), float(at[k + 1]), values[k : k + 2]
    return first, sides


def named(quantity: Any) -> str:
    """The name of a quantity in messages and tables."""
    return quantity if isinstance(quantity, str) else str(getattr(quantity, "__name__", "a function"))


def unit_of(result: Any, quantity: Any) -> str:
    """Unit of a sensor; "" for expressions and functions, whose unit is not known."""
    try:
        return measured(result.prepared.model.scene, quantity)[1]
    except (SceneError, AttributeError, TypeError):
        return ""


def moves(result: Any, quantity: Any) -> bool:
    """Whether a quantity is a sensor of the motion; False for expressions and functions."""
    try:
        return of_motion(result.prepared.model.scene, quantity)
    except (SceneError, AttributeError, TypeError):
        return False


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
                      f"the functions {', '.join(FUNCTIONS)}, and sensors may appear")


def _applied(result: Any, node: Any, function: Callable[..., Any], parts: Sequence[Any], names: Mapping[str, str]) -> Any:
    """The value of an operator or function of the nodes `parts`; OptionError where their numbers of components do not fit."""
    given = [_evaluated(result, part, names) for part in parts]
    wanted = getattr(function, "nin", 1)
    if len(given) != wanted:
        raise OptionError(f"'{_said(node, names)}' has {counted(len(given), 'argument')}, but takes {wanted}")
    if function is FUNCTIONS["norm"] and np.ndim(given[0]) < 2:
        raise OptionError(f"'{_said(node, names)}' cannot be formed: norm takes a vector such as b.velocity, "
                          f"and {_said(parts[0], names)} has one number; take abs")
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


AXES = "xyz"
#: sensors that a table contains only where the user names them
NOT_ASKED = ("rotation", "on_axis", "drawn_position", "drawn_rotation", "arm", "on_steps")


class Column(NamedTuple):
    """One quantity: its name, unit, and values (nt, ...)."""

    name: str
    unit: str
    values: Array

    def parts(self) -> list[tuple[str, Array]]:
        """Names and values (nt,) of its components: x, y, z of vectors, indices of other arrays."""
        flat = self.values.reshape(len(self.values), -1)
        if self.values.ndim == 1:
            return [(self.name, flat[:, 0])]
        letters = AXES if flat.shape[1] == 3 else range(flat.shape[1])
        return [(f"{self.name}.{letter}", flat[:, i]) for i, letter in enumerate(letters)]


def columns(result: Any, sensors: Sequence[Quantity], further: dict[str, Quantity]) -> list[Column]:
    """The quantities named, those of `further` under their keywords; every sensor where none is."""
    if not sensors and not further:
        return [Column(name, unit_of(result, name), result.read(name)) for name in every(result)]
    asked = [(named(one), one) for one in sensors] + list(further.items())
    return [Column(name, unit_of(result, one), value(result, one)) for name, one in asked]


def every(result: Any) -> list[str]:
    """Names of all sensors that have numbers at the result's times, in the order of the items."""
    found = []
    for item in result.prepared.model.scene._items:
        if isinstance(item, BeamLoad | Controller):
            continue
        if isinstance(item, Signal):
            found.append(item.name)
            continue
        sensor = result[item.name]
        names = [n for n in dir(sensor) if not n.startswith("_") and n not in NOT_ASKED]
        found += [f"{item.name}.{name}" for name in sorted(names) if _is_series(result, sensor, name)]
    return found


def _is_series(result: Any, sensor: Any, name: str) -> bool:
    try:
        values = getattr(sensor, name)
    except OptionError:
        return False
    return isinstance(values, np.ndarray) and values.shape[:1] == result.t.shape and values.dtype.kind == "f"


def to_dataframe(result: Any, sensors: Sequence[Quantity], further: dict[str, Quantity]) -> Any:
    """A pandas.DataFrame over the time; `attrs["units"]` has the units by column."""
    pandas = library("pandas")
    parts = [(name, column.unit, values) for column in columns(result, sensors, further) for name, values in column.parts()]
    frame = pandas.DataFrame({name: values for name, _, values in parts}, index=pandas.Index(result.t, name="t"))
    frame.attrs["units"] = {"t": "s"} | {name: unit for name, unit, _ in parts}
    return frame


def to_xarray(result: Any, sensors: Sequence[Quantity], further: dict[str, Quantity]) -> Any:
    """An xarray.Dataset with the coordinate t; vectors have the dimension "axis" (x, y, z), units are attributes."""
    xarray, data = library("xarray"), {}
    axis: dict[str, list[str]] = {}
    for column in columns(result, sensors, further):
        names = ["axis" if n == 3 and i == 0 and column.values.ndim == 2 else f"{column.name}_{i}"
                 for i, n in enumerate(column.values.shape[1:])]
        axis |= {"axis": list(AXES)} if "axis" in names else {}
        data[column.name] = (("t", *names), column.values, {"units": column.unit} if column.unit else {})
    found = xarray.Dataset(data, coords={"t": ("t", result.t, {"units": "s"}), **axis})
    found.attrs["scene"] = result.prepared.model.scene.name
    return found


def to_csv(result: Any, path: Any, sensors: Sequence[Quantity], further: dict[str, Quantity]) -> None:
    """Columns divided by commas, their names with units in the first line: `mb.read_table` reads them."""
    place = option("path", path, file_to_write, "give the path of a file, such as 'run.csv', in a folder that exists")
    found = [("t [s]", result.t)]
    for column in columns(result, sensors, further):
        found += [(f"{name} [{column.unit}]" if column.unit else name, values) for name, values in column.parts()]
    head = ",".join(_quoted(name) for name, _ in found)
    rows = [",".join(map(repr, row)) for row in np.stack([values for _, values in found], axis=1).tolist()]
    write_file(place, "\n".join([head, *rows]) + "\n")


def _quoted(name: str) -> str:
    # spreadsheets take a head that begins so for a formula, and an apostrophe before it for the sign of a text
    name = f"'{name}" if name.startswith(FORMULAS) else name
    return '"' + name.replace('"', '""') + '"' if any(sign in name for sign in ',"\n') else name


def library(name: str) -> Any:
    """A library for tables; OptionError where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise OptionError(f"{name} cannot be imported: pip install 'mbdae[data]', or write a file with r.to_csv(path)") from None
