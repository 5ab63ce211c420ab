"""Vectors without components: a law is stated with them as with `symbolic.vectors.Vec`, and their operations are recorded.

A vector is a sum of scalars times atoms: frame vectors (r, v, x, y, z, omega of k and l), inertial axes, named vectors and
products of two atoms. Scalars are symengine expressions: an inner product is a symbol whose factors the record stores, so laws
may use any function of it. A sum that enters a product gets a name (d = r_l - r_k), as `let` names scalars.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import symengine as se

from mbdae.symbolic.vectors import Expr, Vec

ZERO, _ONE = se.Integer(0), se.Integer(1)
_ORDER = {kind: i for i, kind in enumerate(("r", "s", "c", "x", "y", "z", "v", "w", "du", "dpsi", "E"))}


class Base(NamedTuple):
    """A vector of kind `kind` of a frame (`side`, such as "k" or "l"), or an inertial axis ("E", "x" to "z")."""

    kind: str
    side: str


class NamedVector(NamedTuple):
    """A vector with a name of its own; the record stores its value under this number."""

    number: int


class Product(NamedTuple):
    """The vector product of two atoms."""

    left: Atom
    right: Atom


Atom = Base | NamedVector | Product


def _place(atom: Atom) -> tuple[Any, ...]:
    """Sort key of atoms: frame vectors, then named vectors, then products."""
    if isinstance(atom, Base):
        return (0, atom.side, _ORDER.get(atom.kind, len(_ORDER)), atom.kind)
    return (1, atom.number) if isinstance(atom, NamedVector) else (2, _place(atom.left), _place(atom.right))


def _turning(atom: Atom) -> tuple[Any, ...]:
    """Sort key of the factors of a vector product: rotation vectors first."""
    return (not (isinstance(atom, Base) and atom.kind in ("w", "dpsi", "al")), _place(atom))


AXES = tuple(Base("E", side) for side in "xyz")


class NamedQuantities:
    """Intermediate quantities of one law: inner products, named scalars, named vectors."""

    def __init__(self, sides: tuple[str, ...] = ("k", "l")) -> None:
        self.sides = sides  #: names of the frames: those of the bodies, then those of free rotations that are unknowns
        self.dots: dict[Expr, tuple[Atom, Atom]] = {}  #: symbol of an inner product -> its two factors
        self.scalars: dict[Expr, Expr] = {}  #: symbol of a named scalar -> its expression
        self.vectors: dict[int, Vector] = {}  #: number of a named vector -> its value
        self.labels: dict[Expr | int, str] = {}  #: letters that a law gives to named scalars and vectors
        #: vectors that are gradients of named scalars: (kind, scalar, side)
        self.gradients: dict[int, tuple[str, Expr, str]] = {}
        self.resolve: Callable[[Expr], Expr] = lambda e: e  #: replaces intermediate results inside a scalar by their names
        self.cache: dict[Any, Any] = {}  #: gradients of named scalars, computed once
        #: vectors and scalars that are derivatives of another: (sign in LaTeX, number or symbol of the other)
        self.changes: dict[Any, tuple[str, Any]] = {}
        self.flat = False  #: whether all frame vectors lie in the plane normal to the third inertial axis

    def atom(self, kind: str, side: str) -> Vector:
        """A vector of a frame."""
        return Vector(self, {Base(kind, side): _ONE})

    def zero(self) -> Vector:
        """The zero vector."""
        return Vector(self, {})

    def axis(self, i: int) -> Vector:
        """An inertial axis."""
        return Vector(self, {AXES[i]: _ONE})

    def lift(self, a: Vec) -> Vector:
        """A vector given by inertial components, as a sum of atoms."""
        if isinstance(a, Vector):
            return a
        return Vector(self, {axis: c for axis, c in zip(AXES, a.c, strict=True) if c != 0})

    def dot(self, a: Atom, b: Atom) -> Expr:
        """The symbol of the inner product of two atoms."""
        if isinstance(a, Base) and isinstance(b, Base) and a.kind == b.kind == "E":
            return _ONE if a == b else ZERO
        a, b = sorted((a, b), key=_place)
        if isinstance(a, Base) and a.kind == "E":
            a, b = b, a
        if self.flat and AXES[2] in (a, b) and self.in_plane(b if a == AXES[2] else a):
            return ZERO
        for symbol, factors in self.dots.items():
            if factors == (a, b):
                return symbol
        symbol = se.Symbol(f"dot{len(self.dots) + 1}")
        self.dots[symbol] = (a, b)
        return symbol

    def in_plane(self, atom: Atom) -> bool:
        """Whether a vector of a planar record has no component along the normal of the plane."""
        if isinstance(atom, Product):
            return (atom.left == AXES[2]) != (atom.right == AXES[2])
        if isinstance(atom, NamedVector):
            return all(map(self.in_plane, self.vectors[atom.number].terms))
        return atom != AXES[2]

    def single(self, a: Vector) -> Vector:
        """The vector as a factor of a product; a sum gets a name."""
        return a if len(a.terms) <= 1 else self.known(a)

    def known(self, a: Vector) -> Vector:
        """The named vector that stands for this vector; where there is none yet, a new one."""
        a = Vector(self, {atom: self.resolve(c) for atom, c in a.terms.items()})
        for number, value in self.vectors.items():
            if value.terms == a.terms:
                return Vector(self, {NamedVector(number): _ONE})
            if value.terms == (-a).terms:
                return Vector(self, {NamedVector(number): -_ONE})
        return self.name_vector(a)

    def name_vector(self, a: Vector, change: tuple[str, int] | None = None) -> Vector:
        """The vector under a new name; change: (sign, number) of the vector whose derivative it is."""
        number = len(self.vectors) + 1
        if change is not None:
            self.changes[number] = change
        self.vectors[number] = a
        return Vector(self, {NamedVector(number): _ONE})

    def name_scalar(self, e: Expr, label: str = "", change: tuple[str, Expr] | None = None) -> Expr:
        """A scalar under a name; numbers and symbols are kept, inner products too unless the law gives them a letter; change:
        (sign, symbol) of the scalar whose derivative it is."""
        if e.is_Number or (isinstance(e, se.Symbol) and not (label and e in self.dots)):
            return e
        for name, value in self.scalars.items():
            if value == e:
                return name
        name = se.Symbol(f"scalar{len(self.scalars) + 1}")
        self.scalars[name] = e
        if change is not None:
            self.changes[name] = change
        if label:
            self.labels[name] = label
        return name


class Vector(Vec):
    """A sum of scalars times atoms, with the operations of `Vec`."""

    __slots__ = ("record", "terms")

    def __init__(self, record: NamedQuantities, terms: dict[Atom, Expr]) -> None:
        self.record = record
        self.terms = {atom: c for atom, c in terms.items() if c != 0}

    @property
    def c(self) -> tuple[Expr, Expr, Expr]:  # type: ignore[override]
        return tuple(self @ self.record.axis(i) for i in range(3))

    def __iter__(self) -> Iterator[Expr]:
        return iter(self.c)

    def __getitem__(self, i: int) -> Expr:
        return self.c[i]

    def __add__(self, other: Vec) -> Vector:
        terms = dict(self.terms)
        for atom, c in self.record.lift(other).terms.items():
            terms[atom] = se.expand(terms.get(atom, ZERO) + c) if atom in terms else c
        return Vector(self.record, terms)

    __radd__ = __add__

    def __neg__(self) -> Vector:
        return self * -1

    def __sub__(self, other: Vec) -> Vector:
        return self + (-self.record.lift(other))

    def __rsub__(self, other: Vec) -> Vector:
        return -self + other

    def __mul__(self, factor: Expr) -> Vector:
        return Vector(self.record, {atom: se.sympify(factor) * c for atom, c in self.terms.items()})

    __rmul__ = __mul__

    def __truediv__(self, factor: Expr) -> Vector:
        return self.__mul__(1 / se.sympify(factor))

    def __matmul__(self, other: Vec) -> Expr:
        a, b = self.record.single(self), self.record.single(self.record.lift(other))
        return sum((p * q * self.record.dot(i, j) for i, p in a.terms.items() for j, q in b.terms.items()), ZERO)

    def __rmatmul__(self, other: Vec) -> Expr:
        return self @ other

    def cross(self, other: Vec) -> Vector:
        a, b = self.record.single(self), self.record.single(self.record.lift(other))
        total = self.record.zero()
        for i, p in a.terms.items():
            for j, q in b.terms.items():
                if i != j:
                    flipped = _turning(j) < _turning(i)
                    atom = Product(j, i) if flipped else Product(i, j)
                    total = total + Vector(self.record, {atom: -p * q if flipped else p * q})
        return total

    def norm(self) -> Expr:
        return se.sqrt(self @ self)

    def named(self, name: str = "") -> Vector:
        if not self.terms or (len(self.terms) == 1 and _ONE in self.terms.values()):
            return self
        found = self.record.known(self)
        ((atom, _),) = found.terms.items()
        if name and isinstance(atom, NamedVector):
            self.record.labels.setdefault(atom.number, name)
        return found

    def __repr__(self) -> str:
        return f"Vector({self.terms})"
