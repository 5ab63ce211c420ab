"""Measured inputs: tables as expressions of `mb.t`, from arrays or from a file."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, naming_arguments
from mbdae.inputs import tables
from mbdae.inputs.deferred_time import sympy_time
from mbdae.inputs.tables import Table
from mbdae.inputs.timed import after
from mbdae.values import BadValueError, option, path, shown, text

TIME_UNITS = ("s", "sec", "second", "seconds")
#: SI unit -> other units of the same quantity that files may state, each with its size in the SI unit
FACTORS: dict[str, dict[str, float]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    "m/s": {"mm/s": 1e-3, "km/h": 1 / 3.6}, "m/s^2": {"mm/s^2": 1e-3},
    "rad": {"mrad": 1e-3, "deg": np.pi / 180, "°": np.pi / 180},
    "rad/s": {"deg/s": np.pi / 180, "°/s": np.pi / 180, "rpm": np.pi / 30},
    "N": {"mN": 1e-3, "kN": 1e3, "MN": 1e6}, "N m": {"N mm": 1e-3, "Nmm": 1e-3, "Nm": 1.0, "kN m": 1e3, "kNm": 1e3},
    "Pa": {"kPa": 1e3, "bar": 1e5, "MPa": 1e6, "GPa": 1e9}, "kg": {"t": 1e3},
}  # fmt: skip
SI = {other: si for si, factors in FACTORS.items() for other in factors}
_HEAD = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
FORMULAS = ("=", "+", "-", "@")  #: first signs of names that spreadsheets take for formulas
LONGEST_LIST = 12  #: most columns that a message lists


@naming_arguments
def table(t: Any, values: Any, kind: str = "linear", outside: str = "hold") -> Any:
    """A table as an expression of `mb.t`: in any drive, load or parameter, alone or inside of an expression.

    t (n,): times in s, rising; values (n,): in SI units of what takes them. kind: "linear" between the points, "cubic" (the
    monotone cubic PCHIP, whose slope is continuous: for prescribed motions), "step" (a value holds until the next point).
    outside: "hold" the first and the last value, "periodic" (the last value is the first), or "error": a run that goes beyond the
    table is refused before it begins. With `.subs(mb.t, 2*mb.t - 1)` it is read at another pace or from another instant.
    OptionError where the points are not rising, not finite or fewer than two."""
    try:
        found = tables.known(Table(t, values, kind, outside))
    except BadValueError as wrong_argument:
        raise OptionError(f"mb.table: {wrong_argument}") from None
    return _function(found.name, 0)(sympy_time())


@naming_arguments
def read_table(file: Any, t: str, value: str, kind: str = "linear", outside: str = "hold", unit: str | None = None) -> Any:
    """A table from two columns of a file of numbers, with the names of the columns in its first line: see `mb.table`.

    Columns are divided by commas, semicolons, tabs or blanks; lines that begin with # are left out. t, value: names of columns,
    which may state a unit behind them: "F [N]". unit: the SI unit of the values, such as "N": a column in a known multiple of it
    (mm, deg, kN, ...) is converted; a unit that the column states itself leaves its values as they are. Times in ms or min are
    converted to s. OptionError where the file or a column is missing, an entry is no number, a unit cannot be converted, or the
    column states one that is not SI and `unit` is not given."""
    place = option("file", file, path, "give the path of a file of numbers with names of columns in its first line")
    names = [option(name, x, text, "give the name of a column") for name, x in (("t", t), ("value", value))]
    head, rows = _rows(place)
    columns = [_column(place, head, name) for name in names]
    factors = [_factor(place, head[c], x, i == 0) for i, (c, x) in enumerate(zip(columns, ("s", unit), strict=True))]
    times, values = ([factor * _number(place, line, head[c], row, c) for line, row in rows]
                     for c, factor in zip(columns, factors, strict=True))  # fmt: skip
    try:
        found = tables.known(Table(times, values, kind, outside))
    except BadValueError as wrong_points:
        t_name, value_name = (shown(head[c]) for c in columns)
        raise OptionError(f"'{place}', columns {t_name} (t) and {value_name} (values): {wrong_points}") from None
    return _function(found.name, 0)(sympy_time())


# ---- files -----------------------------------------------------------------------------------------------------------------


def _rows(place: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Names of the columns, and the entries of each row with the number of its line in the file."""
    try:
        lines = place.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise OptionError(f"the table '{place}' cannot be read: {error.strerror}; give the path of a file that exists and that "
                          f"you may read") from None  # fmt: skip
    except UnicodeDecodeError:
        raise OptionError(f"the table '{place}' is no text in UTF-8; save it as CSV in UTF-8") from None
    kept = [(i, line) for i, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise OptionError(f"the table '{place}' is empty, or has comments (#) alone: give a file with names of columns in "
                          f"its first line and numbers below")  # fmt: skip
    sign = next((s for s in (";", ",", "\t") if s in kept[0][1]), None)
    split = [row if sign else " ".join(row).split() for row in csv.reader((line for _, line in kept), delimiter=sign or " ")]
    if not sign:
        split[0] = _with_units(split[0])
    return [_plain(h.strip()) for h in split[0]], [(i, row) for (i, _), row in zip(kept[1:], split[1:], strict=True)]


def _plain(head: str) -> str:
    """A name without the apostrophe by which it is no formula to spreadsheets (`Result.to_csv` writes it)."""
    return head[1:] if head[:1] == "'" and head[1:2] in FORMULAS else head


def _with_units(words: list[str]) -> list[str]:
    """Names of columns from words, where a word in brackets is the unit of the name before it."""
    found: list[str] = []
    for word in words:
        if found and word.startswith(("[", "(")):
            found[-1] += f" {word}"
        else:
            found.append(word)
    return found


def _column(place: Path, head: Sequence[str], name: str) -> int:
    """Index of the column with a name, which may be given with its unit or without."""
    found = [i for i, h in enumerate(head) if name.strip() in (h, _HEAD.fullmatch(h)["name"])]  # type: ignore[index]
    if len(found) == 1:
        return found[0]
    columns = ", ".join(repr(h) for h in head[:LONGEST_LIST]) + (", ..." if len(head) > LONGEST_LIST else "")
    if found:
        raise OptionError(f"'{place}' has several columns {name!r} among {columns}; rename one of them in the file")
    raise OptionError(f"'{place}' has no column {name!r}; give one of its columns {columns}")


def _factor(place: Path, head: str, wanted: str | None, is_time: bool) -> float:
    """Factor from the unit that a column states to the one that is wanted; 1 where neither says anything."""
    stated = (_HEAD.fullmatch(head)["unit"] or "").strip()  # type: ignore[index]
    if stated == (wanted or "") or (is_time and stated in ("", *TIME_UNITS)) or (wanted is None and stated not in SI):
        return 1.0
    if wanted is not None and stated in FACTORS.get(wanted, ()):
        return FACTORS[wanted][stated]
    column = f"column {head!r} of '{place}'"
    if not stated:
        raise OptionError(f"{column} states no unit to convert to unit={wanted!r}; leave unit= out to take its numbers as they "
                          f"stand, or name the column '{head} [...]' in the file, with their unit")  # fmt: skip
    if wanted is None:
        raise OptionError(f"{column} is in {stated!r}; give unit={SI[stated]!r} to have it converted, or unit={stated!r} to "
                          f"take its numbers as they stand")  # fmt: skip
    if is_time:
        raise OptionError(f"{column} is in {stated!r}, which is not converted to s; give times in s, {', '.join(FACTORS['s'])}")
    raise OptionError(f"{column} is in {stated!r}, which cannot be converted to unit={wanted!r}; convert the column in the file, "
                      f"or give unit={stated!r} to take its numbers as they stand")  # fmt: skip


def _number(place: Path, line: int, head: str, row: Sequence[str], column: int) -> float:
    try:
        return float(row[column])
    except (IndexError, ValueError):
        at = f"'{place}', line {line}, column {head!r}"
        if column < len(row):
            raise OptionError(f"{at}: {row[column]!r} is no number; correct it, or leave the line out") from None
        raise OptionError(f"{at}: the entry is missing; complete the line, or leave it out") from None


# ---- SymPy -----------------------------------------------------------------------------------------------------------------


@cache
def _function(name: str, order: int) -> Any:
    """SymPy's function of a table, or of a derivative of it."""
    from sympy.core.function import AppliedUndef, UndefinedFunction

    class AppliedTable(AppliedUndef):  # type: ignore[misc]
        """A table as a function in SymPy: with derivatives and, where the argument is a number, a value."""

        def fdiff(self, argindex: int = 1) -> Any:
            return _function(name, order + 1)(*self.args)

        def _eval_derivative(self, s: Any) -> Any:
            return self.fdiff() * self.args[0].diff(s)

        def _eval_evalf(self, prec: int) -> Any:
            import sympy

            if not self.args[0].is_number:
                return None
            at = np.array([float(self.args[0])])
            found = tables.named(self.func.__name__)
            return None if found is None else sympy.Float(float(found.table.lookup(at, after(at), found.order)[0]))

    return UndefinedFunction(name if order == 0 else f"{name}_d{order}", bases=(AppliedTable,))
