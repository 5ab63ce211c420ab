"""Vectors of three symbolic components in the inertial frame: the language in which laws are stated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import symengine as se

_LET = se.Function("let")
Expr = Any  #: a symengine expression (SymPy expressions are converted on entry)


class Vec:
    """A vector by its inertial components: `a + b`, `2*a`, `a @ b` (dot), `a.cross(b)`, `a.norm()`."""

    __slots__ = ("c",)

    def __init__(self, x: Expr, y: Expr, z: Expr) -> None:
        self.c: tuple[Expr, Expr, Expr] = (se.sympify(x), se.sympify(y), se.sympify(z))

    def __iter__(self) -> Iterator[Expr]:
        return iter(self.c)

    def __getitem__(self, i: int) -> Expr:
        return self.c[i]

    def __add__(self, other: Vec) -> Vec:
        return Vec(*(a + b for a, b in zip(self.c, other.c, strict=True)))

    def __sub__(self, other: Vec) -> Vec:
        return Vec(*(a - b for a, b in zip(self.c, other.c, strict=True)))

    def __neg__(self) -> Vec:
        return Vec(*(-a for a in self.c))

    def __mul__(self, factor: Expr) -> Vec:
        return Vec(*(factor * a for a in self.c))

    __rmul__ = __mul__

    def __truediv__(self, factor: Expr) -> Vec:
        return Vec(*(a / factor for a in self.c))

    def __matmul__(self, other: Vec) -> Expr:
        return self.c[0] * other.c[0] + self.c[1] * other.c[1] + self.c[2] * other.c[2]

    def cross(self, other: Vec) -> Vec:
        """The vector product self x other."""
        a, b = self.c, other.c
        return Vec(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

    def norm(self) -> Expr:
        """Euclidean length."""
        return se.sqrt(self @ self)

    def named(self, name: str = "") -> Vec:
        """The vector with named intermediates for components (see `variation.let`); `name` is its letter in a report (LaTeX)."""
        return Vec(*(c if c.is_Number else _LET(c) for c in self.c))

    def __repr__(self) -> str:
        return f"Vec{self.c}"


def components(*parts: Expr | None) -> Vec:
    """A vector whose absent components (None) are zero."""
    return Vec(*(0 if part is None else part for part in parts))


UNIT = (Vec(1, 0, 0), Vec(0, 1, 0), Vec(0, 0, 1))
ZERO = Vec(0, 0, 0)
