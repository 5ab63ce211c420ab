"""Units of recorded rows: a length where positions enter, a pure number where only axes do."""

from __future__ import annotations

from mbdae.reports.statement import Statement
from mbdae.reports.vectors import Base, NamedVector, Record, Vector
from mbdae.symbolic.vectors import Expr


def row_unit(s: Statement, e: Expr) -> str:
    """Unit of the multiplier of a row: N where the row is a length, N m where it is an angle or a cosine."""
    coordinate = any(s.law.coordinates[name].unit == "m" for name, symbol in s.coordinates.items() if symbol in e.free_symbols)
    return "N" if coordinate or _is_length(s.record, e) else "N m"


def _is_length(record: Record, e: Expr) -> bool:
    for symbol in e.free_symbols:
        if symbol in record.dots and any(_reaches(record, Vector(record, {a: 1})) for a in record.dots[symbol]):
            return True
        if symbol in record.scalars and _is_length(record, record.scalars[symbol]):
            return True
    return False


def _reaches(record: Record, a: Vector) -> bool:
    """Whether a vector is a position."""
    for atom in a.terms:
        if isinstance(atom, Base) and atom.kind in ("r", "c", "s"):
            return True
        if isinstance(atom, NamedVector) and _reaches(record, record.vectors[atom.number]):
            return True
    return False
