"""Recorded formulas in numbers, at many states at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.reports.vectors import Atom, Base, NamedVector, Record, Vector
from mbdae.symbolic.functions import complex_atan2
from mbdae.symbolic.vectors import Expr

_RELATIONS = {"LessThan": np.less_equal, "StrictLessThan": np.less, "Equality": np.equal, "Unequality": np.not_equal}
Values = dict[str, NDArray[Any]]


def value(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """Value of a scalar, real or complex; `get` gives the values of symbols."""
    if isinstance(e, se.Symbol):
        return get(e)
    if e.is_Number or e == se.pi or e == se.E:
        return float(e)
    if isinstance(e, se.Piecewise):
        return _chosen(e, get)
    a = [value(x, get) for x in e.args]
    if isinstance(e, se.Add):
        return sum(a[1:], a[0])
    if isinstance(e, se.Mul):
        out = a[0]
        for factor in a[1:]:
            out = out * factor
        return out
    if isinstance(e, se.Pow):
        return _raised(a[0], a[1])
    name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
    if name in ("let", "UnevaluatedExpr"):
        return a[0]
    if name in _RELATIONS:
        return _RELATIONS[name](np.real(a[0]), np.real(a[1]))
    if name == "floor":
        return np.floor(np.real(a[0]))
    if name == "atan2":
        return complex_atan2(a[0], a[1])
    return getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name))(*a)


def _raised(base: Any, exponent: Any) -> Any:
    if isinstance(exponent, float) and exponent == int(exponent):
        return base ** int(exponent) if exponent > 0 else 1.0 / base ** int(-exponent)
    return base**exponent


def _chosen(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """Value of a Piecewise; cases whose condition does not hold may be undefined."""
    conditions, values = [], []
    with np.errstate(all="ignore"):
        for result, condition in zip(e.args[::2], e.args[1::2], strict=True):
            conditions.append(True if str(condition) == "True" else value(condition, get))
            values.append(value(result, get))
        shape = np.broadcast_shapes(*(np.shape(x) for x in (*conditions, *values)))
        return np.select([np.broadcast_to(c, shape) for c in conditions], [np.broadcast_to(v, shape) for v in values])


class Numbers:
    """Values of the formulas of a record at many states at once: `atoms` (points, 3), symbols (points,)."""

    def __init__(self, record: Record, atoms: Callable[[Base], NDArray[Any]], symbols: Callable[[str], Any],
                 known: Mapping[Base, NDArray[Any]] | None = None) -> None:  # fmt: skip
        self.record, self.atoms, self.symbols = record, atoms, symbols
        self._known: dict[Any, Any] = dict(known or {})

    def scalar(self, e: Expr) -> Any:
        """Value of a scalar."""
        return value(se.sympify(e), self._symbol)

    def _symbol(self, symbol: Expr) -> Any:
        if symbol not in self._known:
            if symbol in self.record.dots:
                a, b = (self.atom(x) for x in self.record.dots[symbol])
                self._known[symbol] = np.sum(a * b, axis=-1)
            elif symbol in self.record.scalars:
                self._known[symbol] = self.scalar(self.record.scalars[symbol])
            else:
                self._known[symbol] = self.symbols(str(symbol))
        return self._known[symbol]

    def atom(self, atom: Atom) -> NDArray[Any]:
        """Value of an atom."""
        if atom not in self._known:
            if isinstance(atom, Base):
                axis = atom.kind == "E"
                self._known[atom] = np.eye(3)["xyz".index(atom.side)] if axis else self.atoms(atom)
            elif isinstance(atom, NamedVector):
                self._known[atom] = self.vector(self.record.vectors[atom.number])
            else:
                self._known[atom] = np.cross(self.atom(atom.left), self.atom(atom.right))
        found: NDArray[Any] = self._known[atom]
        return found

    def vector(self, a: Vector) -> NDArray[Any]:
        """Value of a vector."""
        total: NDArray[Any] = np.zeros(3)
        for atom, c in a.terms.items():
            total = total + np.asarray(self.scalar(c))[..., None] * self.atom(atom)
        return total
