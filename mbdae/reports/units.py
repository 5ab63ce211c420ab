"""Units of recorded rows: powers of a length, by the positions, coordinates and parameters that enter."""

from __future__ import annotations

import re

import symengine as se

from mbdae.reports.letters import specs_of_coordinates
from mbdae.reports.statement import Statement
from mbdae.reports.vectors import Atom, Base, NamedVector
from mbdae.symbolic.vectors import Expr


def row_unit(s: Statement, e: Expr) -> str:
    """Unit of the multiplier of a row, whose product with the row is an energy: N m where the row is an angle or a cosine, N
    where it is a length."""
    power = _power(s, e)
    return "N m" if power == 0 else "N" if power == 1 else f"N m^{1 - power:g}"


def _power(s: Statement, e: Expr) -> float:
    """The power of a length that a scalar is."""
    if isinstance(e, se.Symbol):
        if e in s.record.dots:
            return sum(_power_of_atom(s, a) for a in s.record.dots[e])
        return _power(s, s.record.scalars[e]) if e in s.record.scalars else _stated(s, e)
    if isinstance(e, se.Mul):
        return sum(_power(s, a) for a in e.args)
    if isinstance(e, se.Pow):
        return _power(s, e.args[0]) * float(e.args[1]) if e.args[1].is_Number else 0
    if isinstance(e, se.Add):
        return max((_power(s, a) for a in e.args), key=abs)
    return _power(s, e.args[0]) if isinstance(e, se.Piecewise) else 0


def _stated(s: Statement, symbol: Expr) -> float:
    """The power of the unit of a coordinate or parameter: of "m", "m/rad", "m^2", "1/m"."""
    by_symbol = {str(at): specs_of_coordinates(s.law)[name] for name, at in s.coordinates.items()} | dict(s.law.params)
    spec = by_symbol.get(str(symbol))
    found = re.fullmatch(r"(1/)?m(?:\^([0-9.]+))?(?:/rad)?", spec.unit if spec is not None else "")
    return float(found[2] or 1) * (-1 if found[1] else 1) if found else 0


def _power_of_atom(s: Statement, atom: Atom) -> float:
    if isinstance(atom, Base):
        return 1 if atom.kind in ("r", "c", "s") else 0
    if isinstance(atom, NamedVector):
        terms = s.record.vectors[atom.number].terms
        return max((_power(s, c) + _power_of_atom(s, a) for a, c in terms.items()), key=abs, default=0)
    return _power_of_atom(s, atom.left) + _power_of_atom(s, atom.right)
