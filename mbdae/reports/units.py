"""Units as products of powers of m, kg and s, with angles of unit 1. Units of what laws state are found by scaling m, kg and s:
a sum whose terms scale differently has no unit. And letters that two pages of a document use for different quantities."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.documents.blocks import Block, Equation, every
from mbdae.errors import MbdaeError
from mbdae.reports.letters import specs_of_coordinates, unit_on
from mbdae.reports.reading import Key, key_of, members
from mbdae.reports.states import SymbolValues, random_state
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.joint import SLIGHT
from mbdae.symbolic.outputs import lowest
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Instance
from mbdae.system.model.numbering import Row as NumberedRow

BASIC = ("m", "kg", "s")
FACTOR = 1.25  #: factor by which a basic unit is scaled
_KNOWN = {"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "rad": (0, 0, 0), "1": (0, 0, 0), "N": (1, 1, -2), "J": (2, 1, -2),
          "W": (2, 1, -3), "Pa": (-1, 1, -2), "Hz": (0, 0, -1)}
_POINTS = 5  #: number of random states from which a unit is found
#: bound below which a value is taken as 0: normal forces are smoothed by SLIGHT (N), so that values that should be 0 are of that
#: size; other values in random states are near 1
_NOTHING = 100 * SLIGHT


class UnitError(MbdaeError):
    """A unit that is not known."""


@dataclass(frozen=True)
class Unit:
    """A unit as powers of m, kg and s."""

    powers: tuple[float, float, float] = (0.0, 0.0, 0.0)
    text: str = field(default="", compare=False)  #: the unit as it was written

    def size(self, scale: Mapping[str, float]) -> float:
        """Size of the unit when the basic units have the given sizes."""
        return float(np.prod([scale[name] ** power for name, power in zip(BASIC, self.powers, strict=True)]))

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(tuple(a - b for a, b in zip(self.powers, other.powers, strict=True)))  # type: ignore[arg-type]

    def __mul__(self, other: Unit) -> Unit:
        return self / (Unit() / other)

    def __str__(self) -> str:
        if self.text:
            return self.text
        shown = [name if power == 1 else f"{name}^{power:g}" for name, power in zip(BASIC, self.powers, strict=True) if power]
        return " ".join(shown) or "1"

    @property
    def of_force(self) -> str:
        """The unit written as a force or moment: N, N m, N m^-1."""
        power = self.powers[0] - 1
        if self.powers[1:] != (1, -2):
            return str(self)
        return "N" if power == 0 else "N m" if power == 1 else f"N m^{power:g}"


def unit(text: str) -> Unit:
    """The unit of a text such as "N m s/rad" or "N/m^1.5"; UnitError where it is none."""
    powers = [0.0, 0.0, 0.0]
    for i, part in enumerate(text.split("/")):
        for word in part.strip(" ()").split():
            match = re.fullmatch(r"(\w+?)(?:\^(-?[\d.]+))?", word)
            if match is None or match[1] not in _KNOWN:
                raise UnitError(f"the unit '{word}' is not known; mbdae knows {', '.join(_KNOWN)}")
            for j, power in enumerate(_KNOWN[match[1]]):
                powers[j] += (1 if i == 0 else -1) * power * float(match[2] or 1)
    return Unit((powers[0], powers[1], powers[2]), text.strip())


def shown(p: NDArray[np.float64]) -> str:
    """Units of entries in words, each once; p: powers of m, kg and s (3, entries)."""
    columns = [c for c in p.T if not np.any(np.isnan(c))]
    return ", ".join(dict.fromkeys(str(Unit(tuple(float(round(x, 3)) + 0 for x in c))) for c in columns)) or "1"  # type: ignore[arg-type]


def scales() -> list[dict[str, float]]:
    """Sizes of the basic units, with one of them scaled at a time."""
    return [{basic: FACTOR if basic == name else 1.0 for basic in BASIC} for name in BASIC]


def powers_of(before: Any, after: Sequence[Any]) -> NDArray[np.float64] | None:
    """Powers of m, kg and s (3, entries) from values (states, entries) before and after scaling each; nan for entries that are 0,
    None where an entry has no unit."""
    found = []
    with np.errstate(all="ignore"):
        for later in after:
            p = np.log(np.where(np.abs(before) > _NOTHING, np.abs(np.divide(later, before)), np.nan)) / np.log(FACTOR)
            mean = np.array([np.mean(c[~np.isnan(c)]) if np.any(~np.isnan(c)) else np.nan for c in p.T])
            if np.nanmax(np.abs(p - mean), initial=0.0) > 1e-6:
                return None
            found.append(mean)
    return np.array(found)


class Dimensions:
    """Units of the quantities that a derived law states.

    coordinates: units of coordinates that are unknowns, by name, where the scene knows more than the law. Raises UnitError for
    a law with a unit that is unknown or left open."""

    def __init__(self, d: Derived, coordinates: Mapping[str, str] | None = None) -> None:
        self.d, self.given = d, random_state(d, points=_POINTS).given
        self.acts_on = units_of_coordinates(d.law) | dict(coordinates or {})
        self.units = self._inputs()
        self.plain = SymbolValues(d, self.given)
        self.scaled = [SymbolValues(d, {n: v * self.units[n].size(scale) if n in self.units else v
                                        for n, v in self.given.items()}) for scale in scales()]
        self._multipliers()

    def _inputs(self) -> dict[str, Unit]:
        """Units, other than 1, of the symbols by name."""
        law, found = self.d.law, dict[str, Unit]()
        on = [*self.acts_on.values()] or [getattr(law, "unit", "")]
        for name, spec in law.params.items():
            stated = unit(unit_on(spec.unit, on))
            found |= {name + end: stated / unit(per) for end, per in (("", "1"), ("_dot", "s"), ("_ddot", "s^2"))}
        found |= {f"state_{name}": unit(spec.unit) for name, spec in law.states.items()}
        own = dict(zip((f.side for f in self.d.frames[len(self.d.sides) :]), self.acts_on.values(), strict=False))
        for f in self.d.frames:
            found |= self._frame(f, own.get(f.side, "m"))
        return found

    @staticmethod
    def _frame(f: Frame, of_coordinate: str) -> dict[str, Unit]:
        place = unit(of_coordinate if f.kind is NodeKind.COORDINATE else "m")
        n = f.kind.translations
        found = {str(s): place for s in f.q[:n]} | {str(s): place / unit("s") for s in f.u[:n]}
        return found | {str(s): unit("1/s") for s in f.u[n:]} | {f"{f.side}_p{i}": unit("m") for i in (1, 2, 3)}

    def _multipliers(self) -> None:
        """Find the units of the multipliers: multiplier times row is an energy, times a row of velocities a power."""
        for row, (_, c) in zip(self.d.rows, lowest(self.d), strict=True):
            found, of = self.of(c), unit("W" if row in self.d.by_rates else "J")
            for state, scale in zip(self.scaled, scales(), strict=True):
                state.given[f"lambda_{row}"] = self.given[f"lambda_{row}"] * (of / (found or Unit())).size(scale)

    def powers(self, e: Expr, by: Callable[[SymbolValues, Expr], Any] = SymbolValues.scalar) -> NDArray[np.float64] | None:
        """Powers of m, kg and s (3,) of an expression, nan where it is 0; None if it has no unit. by: evaluates it in a state."""
        with np.errstate(all="ignore"):  # states in which a law has no value, as a point within a sheave, tell nothing of units
            before, *after = (np.real(by(state, e)).reshape(-1, 1) for state in (self.plain, *self.scaled))
        found = powers_of(before, after)
        return None if found is None else found[:, 0]

    def of(self, e: Expr, by: Callable[[SymbolValues, Expr], Any] = SymbolValues.scalar) -> Unit | None:
        """The unit of an expression; None where it has none or is 0."""
        found = self.powers(e, by)
        if found is None or np.any(np.isnan(found)):
            return None
        return Unit(tuple(float(round(x, 3)) + 0 for x in found))  # type: ignore[arg-type]

    def mixed(self, e: Expr) -> str:
        """The innermost sum or function argument with a wrong unit, in words; empty where there is none."""
        e = se.sympify(e)
        values = self.d.variation.values
        parts = [values[e]] if e in values else [] if isinstance(e, se.Symbol) else list(e.args)
        for part in parts if self.powers(e) is None else ():
            if found := self.mixed(part):
                return found
        units = sorted({u.of_force for part in parts if (u := self.of(part)) is not None})
        if isinstance(e, se.Add) and len(units) > 1:
            return f"adds terms in {' and in '.join(units)}"
        plain = isinstance(e, se.Add | se.Mul | se.Pow | se.Symbol) or units in ([], ["1"])
        return "" if plain else f"is a function of {units[0]}"

    def faults(self) -> list[str]:
        """Stated quantities whose terms have several units, or whose unit is wrong, in words."""
        d = self.d
        stated = [(f"the row {row}", c, "") for row, (_, c) in zip(d.rows, lowest(d), strict=True)]
        stated += [("the energy", d.energy, "J"), ("the dissipated power", d.dissipated_power, "W")]
        stated += [(f"the {what} on {side}", e, u) for side, pair in d.force.items() if side in [f.side for f in d.sides]
                   for what, u, part in zip(("force", "moment"), ("N", "N m"), pair, strict=True) for e in part]
        stated += [(f"the force on the coordinate {name}", d.force[f.side][0][0], str(unit("J") / unit(self.acts_on[name])))
                   for name, f in zip(self.acts_on, d.frames[len(d.sides) :], strict=False)
                   if f.kind is NodeKind.COORDINATE and f.side in d.force]
        return list(dict.fromkeys(said for what, e, wanted in stated if (said := self._fault(what, e, wanted))))

    def _fault(self, what: str, e: Expr, wanted: str) -> str:
        p = self.powers(e)
        if p is None:
            return f"{what} {self.mixed(e) or 'has terms with different units'}"
        if wanted and np.nanmax(np.abs(p - unit(wanted).powers), initial=0.0) > 1e-6:
            return f"{what} has the unit {shown(p[:, None])}, not {wanted}"
        return ""


def units_of_coordinates(law: Any) -> dict[str, str]:
    """Units of the coordinates of a law that are unknowns, by name."""
    specs = specs_of_coordinates(law)
    return {name: specs[name].unit for name in law.own_coordinates}


def dimensions(d: Derived, coordinates: Mapping[str, str] | None = None) -> list[Dimensions]:
    """Units of a law: one case, or two where coordinates may be angles or lengths; none where a unit is unknown, or where sensors
    feed the law, whose units are not known here. coordinates: as in `Dimensions`."""
    known = units_of_coordinates(d.law) | dict(coordinates or {})
    either = [name for name, stated in known.items() if " or " in stated]
    try:
        return [Dimensions(d, known | dict.fromkeys(either, u)) for u in (("rad", "m") if either else ("",)) if not d.feeds]
    except UnitError:
        return []


def unit_in(cases: Sequence[Dimensions], e: Expr, by: Callable[[SymbolValues, Expr], Any] = SymbolValues.scalar) -> list[Unit]:
    """The unit of an expression in every case, each once; empty where it has none in one case."""
    found = [case.of(e, by) for case in cases]
    return [] if None in found else list(dict.fromkeys(found))  # type: ignore[arg-type]


def law_faults(d: Derived, coordinates: Mapping[str, str] | None = None) -> list[str]:
    """Quantities that a law states with wrong units, in words; empty for laws with unknown units."""
    found = [case.faults() for case in dimensions(d, coordinates)]
    return found[0] if found and all(found) else []


# -- one letter, one meaning


def ambiguous(pages: Sequence[tuple[type, Sequence[Sequence[str]], Sequence[Block]]]) -> list[str]:
    """Letters to which two pages give different meanings. A page is its kind, its rows of the table of symbols and its blocks; a
    letter means what its row says or the formula that defines it. Pages of one kind define the same of different laws."""
    found: dict[Key, list[tuple[type, set[tuple[str, ...]]]]] = {}
    for kind, rows, blocks in pages:
        meanings: dict[Key, set[tuple[str, ...]]] = {}
        for cell, *row in rows:
            for letter in (part for formula in re.findall(r"\$([^$]*)\$", cell) for part in re.split(r",\\ |, ", formula)):
                meanings.setdefault(key_of(letter), set()).add(tuple(row))
        for equation in every(Equation, blocks):
            (_, left), *rest = members(key_of(equation.latex))
            if rest and rest[0][0] == "=":
                meanings.setdefault(left, set()).add(rest[0][1])
        for letter, said in meanings.items():
            found.setdefault(letter, []).append((kind, said))
    return [f"${' '.join(letter)}$" for letter, each in found.items()
            if any(kind is not of and not said & other for i, (kind, said) in enumerate(each) for of, other in each[:i])]


# -- Units of quantities in a scene, where it is known on which coordinates laws act


def row_unit(d: Derived, row: int, coordinates: Mapping[str, str] | None = None, effort: bool = False) -> str:
    """Unit of a row: m, 1 for an angle or a cosine; "" where it has none. coordinates: units of the law's coordinates by name;
    effort: give the unit of the multiplier instead, whose product with the row is an energy."""
    found = _units_of_rows(d, tuple((coordinates or {}).items()))[row]
    return " or ".join((unit("J") / u).of_force if effort else str(u) for u in found)


@lru_cache(maxsize=256)
def _units_of_rows(d: Derived, coordinates: tuple[tuple[str, str], ...]) -> list[list[Unit]]:
    cases = dimensions(d, dict(coordinates))
    per = {True: unit("s"), False: unit("1")}  # rows of velocities count by the displacements that they allow
    return [[u * per[row in d.by_rates] for u in unit_in(cases, c)] for row, (_, c) in zip(d.rows, lowest(d), strict=True)]


def unit_of_row(model: Model, row: NumberedRow, effort: bool = False) -> str:
    """Unit of a row of a scene, or of its multiplier (effort=True); see `row_unit`."""
    group = model.groups[row.group]
    return row_unit(group.derived, row.row, units_at(group.instances[row.instance]), effort)


def units_at(instance: Instance) -> dict[str, str]:
    """Units of the coordinates of a law in a scene, by name."""
    law, nodes = instance.law, instance.nodes[len(instance.law.frames) :]
    return {name: node.unit for name, node in zip(law.own_coordinates, nodes, strict=False) if node is not None}


def parameter_unit(instance: Instance, name: str) -> str:
    """Unit of a law's parameter in a scene; one that fits angles and lengths gets the unit for its coordinate."""
    on = [*units_at(instance).values()] or [getattr(instance.law, "unit", "")]
    return unit_on(instance.law.params[name].unit, on)
