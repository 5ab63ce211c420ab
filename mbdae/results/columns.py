"""A result as a table: a data frame of pandas, a data set of xarray, a file of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import OptionError
from mbdae.files import write_file
from mbdae.inputs.measured import FORMULAS
from mbdae.results.quantities import Quantity, named, unit_of, value
from mbdae.scene.components import BeamLoad, Controller, Signal
from mbdae.system.base import Array
from mbdae.values import file_to_write, option

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
    pandas = _library("pandas")
    parts = [(name, column.unit, values) for column in columns(result, sensors, further) for name, values in column.parts()]
    frame = pandas.DataFrame({name: values for name, _, values in parts}, index=pandas.Index(result.t, name="t"))
    frame.attrs["units"] = {"t": "s"} | {name: unit for name, unit, _ in parts}
    return frame


def to_xarray(result: Any, sensors: Sequence[Quantity], further: dict[str, Quantity]) -> Any:
    """An xarray.Dataset with the coordinate t; vectors have the dimension "axis" (x, y, z), units are attributes."""
    xarray, data = _library("xarray"), {}
    axis: dict[str, list[str]] = {}
    for column in columns(result, sensors, further):
        names = ["axis" if n == 3 and i == 0 and column.values.ndim == 2 else f"{column.name}_{i}"
                 for i, n in enumerate(column.values.shape[1:])]  # fmt: skip
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


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise OptionError(f"{name} cannot be imported: pip install 'mbdae[data]', or write a file with r.to_csv(path)") from None
