"""Derivatives of recorded vector formulas by the rule delta a = delta psi x a; the results are vector formulas too.

`ForwardDerivative` differentiates forwards (rates, variations), `Dual` backwards (forces). Reports compare both with the derived
equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import symengine as se

from mbdae.errors import internal
from mbdae.reports.vectors import Atom, Base, NamedQuantities, NamedVector, Product, Vector
from mbdae.symbolic.rebuild import nodes, rebuilt
from mbdae.symbolic.vectors import Expr

_ZERO = se.Integer(0)
Quaternion = tuple[Expr, Vector]  #: scalar and vector part
Pair = tuple[Vector, Vector]  #: force at the point of the frame, moment about that point


def _through(e: Expr, leaf: Callable[[Expr], bool]) -> Iterable[tuple[Expr, Expr]]:
    """(de/dsymbol, symbol) for the symbols of e that `leaf` accepts, without those of zero derivative."""
    for symbol in sorted(e.free_symbols, key=str):
        if leaf(symbol):
            partial = tidy(se.diff(e, symbol))
            if partial != 0:
                yield partial, symbol


def _divides(e: Expr) -> bool:
    """Whether a sum stands in a denominator, which would be repeated in every term of the expanded expression."""
    return any(isinstance(node, se.Pow) and isinstance(node.args[0], se.Add) and node.args[1].is_Number and node.args[1] < 0
               for node in nodes(e))


def tidy(e: Expr) -> Expr:
    """The expression with every Piecewise whose cases have one value replaced by that value."""
    def rule(node: Expr, args: list[Expr]) -> Expr | None:
        return args[0] if isinstance(node, se.Piecewise) and all(value == args[0] for value in args[::2]) else None

    return rebuilt(e, rule)


FIXED = ("x", "y", "z", "s", "bx", "by", "bz")  #: kinds of vectors that rotate with their body


def body_of(record: NamedQuantities, atom: Atom) -> str | None:
    """The body to which all terms of a named vector are fixed, so that it rotates with it; None where there is none."""
    parts = record.vectors[atom.number].terms if isinstance(atom, NamedVector) else {}
    sides = {a.side if isinstance(a, Base) and a.kind in FIXED else body_of(record, a) for a in parts}
    return sides.pop() if len(sides) == 1 else None


class ForwardDerivative:
    """Forward derivative. base: function that gives the change of a frame vector; clock: changes of the symbols; turn: kind of
    the rotation vectors in a change ("w": angular velocity, "dpsi": virtual); sign: LaTeX before the letter of a change;
    lettered: whether changes of named scalars have letters too."""

    def __init__(self, record: NamedQuantities, base: Callable[[Base], Vector | None], clock: dict[Expr, Expr], sign: str,
                 turn: str = "", lettered: bool = False) -> None:
        self.record, self.base, self.clock, self.sign, self.turn, self.lettered = record, base, clock, sign, turn, lettered
        self._known: dict[Any, Any] = {}

    def scalar(self, e: Expr) -> Expr:
        """Change of a scalar."""
        e = se.sympify(e)
        total = sum((p * self.clock[s] for p, s in _through(e, self.clock.__contains__)), _ZERO)
        total += sum((p * self._dot(s) for p, s in _through(e, self.record.dots.__contains__)), _ZERO)
        total += sum((p * self._name(s) for p, s in _through(e, self.record.scalars.__contains__)), _ZERO)
        return total if _divides(total) else se.expand(total)

    def _dot(self, symbol: Expr) -> Expr:
        if symbol not in self._known:
            a, b = self.record.dots[symbol]
            self._known[symbol] = self._each(self.atom(a), b) + self._each(self.atom(b), a)
        return self._known[symbol]

    def _each(self, change: Vector, other: Atom) -> Expr:
        """Inner product of a change with a vector, formed term by term: as a whole the change would get a letter of its own."""
        return sum((c * self.record.dot(atom, other) for atom, c in change.terms.items()), _ZERO)

    def _name(self, symbol: Expr) -> Expr:
        if symbol not in self._known:
            value = self.record.scalars[symbol]
            found = _ZERO if isinstance(value, se.floor) else self.scalar(value)
            self._known[symbol] = self.record.name_scalar(found, change=(self.sign, symbol)) if self.lettered else found
        return self._known[symbol]

    def atom(self, atom: Atom) -> Vector:
        """Change of a frame vector, a named vector or a vector product."""
        if atom in self._known:
            return self._known[atom]  # type: ignore[no-any-return]
        if isinstance(atom, Base):
            found = self.base(atom) or self.record.zero()
        elif isinstance(atom, NamedVector):
            found = self._named(atom)
            if len(found.terms) > 1 or any(c != 1 for c in found.terms.values()):
                found = self.record.name_vector(found, (self.sign, atom.number))
        else:
            found = distributed(self.atom(atom.left), atom.right) - distributed(self.atom(atom.right), atom.left)
        self._known[atom] = found
        return found

    def _named(self, atom: NamedVector) -> Vector:
        """Change of a named vector. One that is fixed to a body rotates as a whole: its change is one vector product."""
        value, side = self.record.vectors[atom.number], body_of(self.record, atom)
        if side is None or not self.turn or self.base(Base("x", side)) is None:
            return self.vector(value)
        return distributed(self.record.atom(self.turn, side), atom) + self._stretch(value)

    def _stretch(self, value: Vector) -> Vector:
        """Change of a vector fixed to a body relative to that body."""
        total = Vector(self.record, {a: self.scalar(c) for a, c in value.terms.items()})
        inner = [(self.record.vectors[a.number], c) for a, c in value.terms.items() if isinstance(a, NamedVector)]
        return sum((self._stretch(part) * c for part, c in inner), total)

    def vector(self, a: Vector) -> Vector:
        """Change of a vector."""
        total = self.record.zero()
        for atom, c in a.terms.items():
            total = total + self.atom(atom) * c + Vector(self.record, {atom: self.scalar(c)})
        return total


def distributed(a: Vector, b: Atom) -> Vector:
    """a x b with a multiplied term by term."""
    total = a.record.zero()
    for atom, c in a.terms.items():
        total = total + (Vector(a.record, {atom: c}).cross(Vector(a.record, {b: se.Integer(1)})))
    return total


def times(pairs: dict[str, Pair], factor: Expr) -> dict[str, Pair]:
    """Forces and moments by side, multiplied by a factor."""
    return {side: (force * factor, moment * factor) for side, (force, moment) in pairs.items()}


def summed(record: NamedQuantities, parts: Iterable[dict[str, Pair]]) -> dict[str, Pair]:
    """Sums of forces and moments of all parts, by side."""
    out = {side: (record.zero(), record.zero()) for side in record.sides}
    for pairs in parts:
        out |= {side: (out[side][0] + force, out[side][1] + moment) for side, (force, moment) in pairs.items()}
    return out


@dataclass
class Dual:
    """Backward derivative of a scalar: for every body the factors of its virtual displacement (force) and rotation (moment)."""

    record: NamedQuantities
    velocities: bool = False  #: whether to differentiate by velocities instead of positions
    symbols: tuple[Expr, ...] = ()  #: scalar unknowns by which to differentiate too

    def of(self, e: Expr) -> tuple[dict[str, Pair], dict[Expr, Expr]]:
        """Derivatives of e: force and moment by side, and derivatives by the symbols of `symbols`."""
        zero = self.record.zero
        self.pairs: dict[str, list[Vector]] = {side: [zero(), zero()] for side in self.record.sides}
        self.partial: dict[Expr, Expr] = dict.fromkeys(self.symbols, _ZERO)
        self._scalar(se.sympify(e), se.Integer(1))
        return {side: (pair[0], pair[1]) for side, pair in self.pairs.items()}, self.partial

    def _scalar(self, e: Expr, weight: Expr) -> None:
        for p, s in _through(e, self.partial.__contains__):
            self.partial[s] += weight * p
        for p, s in _through(e, self.record.dots.__contains__):
            a, b = self.record.dots[s]
            for one, other in ((a, b), (b, a)):
                self._atom(one, Vector(self.record, {other: weight * p}))
        for p, s in _through(e, self.record.scalars.__contains__):
            if not isinstance(self.record.scalars[s], se.floor):
                self._through_name(s, weight * p)

    def _through_name(self, symbol: Expr, weight: Expr) -> None:
        """Add the gradient of a named scalar, times `weight`. Forces and moments in it get letters, to be written only once."""
        key = symbol, self.velocities, self.symbols
        cache = self.record.cache
        if key not in cache:
            pairs, partial = Dual(self.record, self.velocities, self.symbols).of(self.record.scalars[symbol])
            kinds = ("v", r"\omega") if self.velocities else ("r", r"\psi")
            cache[key] = {side: tuple(self._named(part, (kind, symbol, side)) for kind, part in zip(kinds, pair, strict=True))
                          for side, pair in pairs.items()}, partial
        pairs, partial = cache[key]
        for side, pair in pairs.items():
            for i in range(2):
                self.pairs[side][i] = self.pairs[side][i] + pair[i] * weight
        for s, p in partial.items():
            self.partial[s] += weight * p

    def _named(self, a: Vector, gradient: tuple[str, Expr, str]) -> Vector:
        if len(a.terms) == 0 or (len(a.terms) == 1 and all(c in (1, -1) for c in a.terms.values())):
            return a
        found = self.record.name_vector(a)
        self.record.gradients[next(iter(found.terms)).number] = gradient  # type: ignore[union-attr]
        return found

    def _atom(self, atom: Atom, dual: Vector) -> None:
        if isinstance(atom, Base):
            self._base(atom, dual)
        elif isinstance(atom, NamedVector):
            side = None if self.velocities else body_of(self.record, atom)
            if side is not None:
                self.pairs[side][1] = self.pairs[side][1] - distributed(dual, atom)
            self._named_terms(atom, dual, side is not None)
        else:
            self._atom(atom.left, -distributed(dual, atom.right))
            self._atom(atom.right, distributed(dual, atom.left))

    def _named_terms(self, atom: NamedVector, dual: Vector, fixed: bool) -> None:
        """Add the derivatives of the terms of a named vector. Of a vector that is fixed to a body (fixed=True) only the factors
        of the terms are differentiated: its rotation is already added as a whole."""
        for inner, c in self.record.vectors[atom.number].terms.items():
            if not fixed:
                self._atom(inner, dual * c)
            elif isinstance(inner, NamedVector):
                self._named_terms(inner, dual * c, fixed)
            if c.free_symbols:
                self._scalar(c, sum((q * self.record.dot(inner, other) for other, q in dual.terms.items()), _ZERO))

    def _base(self, atom: Base, dual: Vector) -> None:
        if atom.kind == "E":
            return
        pair = self.pairs[atom.side]
        if self.velocities:
            if atom.kind in ("v", "w"):
                pair[atom.kind == "w"] = pair[atom.kind == "w"] + dual
        elif atom.kind in ("r", "c"):
            pair[0] = pair[0] + dual
            if atom.kind == "c":  # the arm s leads from the centre to the point of the frame
                pair[1] = pair[1] + distributed(dual, Base("s", atom.side))
        elif atom.kind in (*FIXED, "w"):
            pair[1] = pair[1] - distributed(dual, atom)
        elif atom.kind == "v":
            raise internal("the report cannot differentiate an energy that contains a velocity", NotImplementedError)


def virtual(record: NamedQuantities) -> Callable[[Base], Vector | None]:
    """Changes of frame vectors in a virtual displacement: delta r of the points, delta psi of the bodies."""

    def base(atom: Base) -> Vector | None:
        if atom.kind == "r":
            return record.atom("du", atom.side)
        if atom.kind == "c":
            return record.atom("du", atom.side) - record.atom("dpsi", atom.side).cross(record.atom("s", atom.side))
        if atom.kind in (*FIXED, "w"):
            return record.atom("dpsi", atom.side).cross(Vector(record, {atom: se.Integer(1)}))
        return None

    return base


def actual(record: NamedQuantities, still: tuple[str, ...] = ()) -> Callable[[Base], Vector | None]:
    """Rates of frame vectors without accelerations of the nodes: v for r, omega x (omega x s) for v."""

    def base(atom: Base) -> Vector | None:
        if atom.kind == "E" or atom.side in still:
            return None
        w = record.atom("w", atom.side)
        if atom.kind == "r":
            return record.atom("v", atom.side)
        if atom.kind == "c":
            return record.atom("v", atom.side) - w.cross(record.atom("s", atom.side))
        if atom.kind == "v":
            return w.cross(w.cross(record.atom("s", atom.side)))
        if atom.kind in FIXED:
            return w.cross(Vector(record, {atom: se.Integer(1)}))
        return None

    return base


def inserted(a: Vector, atoms: dict[Base, Vector], symbols: dict[Expr, Expr]) -> Vector:
    """A vector with atoms and symbols replaced and products expanded; named vectors without any of them are kept."""
    record, total = a.record, a.record.zero()
    for atom, c in a.terms.items():
        total = total + _replaced(record, atom, atoms, symbols) * se.sympify(c).subs(symbols)
    return total


def _replaced(record: NamedQuantities, atom: Any, atoms: dict[Base, Vector], symbols: dict[Expr, Expr]) -> Vector:
    plain = Vector(record, {atom: se.Integer(1)})
    if isinstance(atom, Product):
        left, right = (_replaced(record, part, atoms, symbols) for part in (atom.left, atom.right))
        return sum((distributed(left, b) * c for b, c in right.terms.items()), record.zero())
    if isinstance(atom, NamedVector):
        value = inserted(record.vectors[atom.number], atoms, symbols)
        return plain if value.terms == record.vectors[atom.number].terms else value
    return atoms.get(atom, plain)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The quaternion product a o b."""
    (p, u), (q, v) = a, b
    return p * q - dot(u, v), v * p + u * q + cross(u, v)


def cross(u: Vector, v: Vector) -> Vector:
    """The vector product, term by term."""
    return sum((distributed(u, atom) * c for atom, c in v.terms.items()), u.record.zero())


def dot(u: Vector, v: Vector) -> Expr:
    """The inner product, term by term."""
    return sum((p * q * u.record.dot(a, b) for a, p in u.terms.items() for b, q in v.terms.items()), _ZERO)


def factor(a: Vector, of: Vector, move: Base) -> Vector:
    """The vector x with a . of = x . move, for a vector a that is linear in `move`."""
    total = a.record.zero()
    for atom, c in a.terms.items():
        if atom == move:
            total = total + of * c
        elif isinstance(atom, Product) and move in (atom.left, atom.right):
            fixed, sign = (atom.right, 1) if atom.left == move else (atom.left, -1)
            total = total + cross(Vector(a.record, {fixed: se.Integer(sign) * c}), of)
    return total
