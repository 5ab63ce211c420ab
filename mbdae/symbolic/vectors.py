"""Vectors of three symbolic components in the inertial frame: the language in which laws are stated.

Quaternions P = (p0, p) that need not have unit length: the rotation depends on their direction only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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


def rotation_columns(P: Sequence[Expr]) -> tuple[Vec, Vec, Vec]:
    """Columns of R(P) = I + 2 (p0 p~ + p~ p~) / |P|^2: rational, no singularity, any length of P."""
    p0, p1, p2, p3 = P
    s = 2 / (p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    return (
        Vec(1 - s * (p2 * p2 + p3 * p3), s * (p1 * p2 + p0 * p3), s * (p1 * p3 - p0 * p2)),
        Vec(s * (p1 * p2 - p0 * p3), 1 - s * (p1 * p1 + p3 * p3), s * (p2 * p3 + p0 * p1)),
        Vec(s * (p1 * p3 + p0 * p2), s * (p2 * p3 - p0 * p1), 1 - s * (p1 * p1 + p2 * p2)),
    )


def product(a: Sequence[Expr], b: Sequence[Expr]) -> list[Expr]:
    """Quaternion product a o b."""
    u, v = Vec(*a[1:]), Vec(*b[1:])
    return [a[0] * b[0] - u @ v, *(v * a[0] + u * b[0] + u.cross(v))]


def rate_from_body_spin(P: Sequence[Expr], Omega: Vec) -> list[Expr]:
    """P' = 1/2 P o (0, Omega) with the spin in body components."""
    p0, p = P[0], Vec(*P[1:])
    return [-(p @ Omega) / 2, *((Omega * p0 + p.cross(Omega)) / 2)]


def rate_from_spatial_spin(P: Sequence[Expr], omega: Vec) -> list[Expr]:
    """P' = 1/2 (0, omega) o P with the spin in inertial components."""
    p0, p = P[0], Vec(*P[1:])
    return [-(p @ omega) / 2, *((omega * p0 + omega.cross(p)) / 2)]


def body_spin(P: Sequence[Expr], rate: Sequence[Expr]) -> Vec:
    """Omega = 2 vec(P* o P') / |P|^2: the inverse of `rate_from_body_spin`; along a line, its curvature and twist."""
    p, dp = Vec(*P[1:]), Vec(*rate[1:])
    spin: Vec = (dp * P[0] - p * rate[0] - p.cross(dp)) * (2 / (P[0] * P[0] + p @ p))
    return spin


def rotation_per_component(P: Sequence[Expr]) -> list[list[Expr]]:
    """T (3, 4) with delta psi = T delta P (inertial components): the inverse of `rate_from_spatial_spin`."""
    p0, p1, p2, p3 = P
    s = 2 / (p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    return [
        [-s * p1, s * p0, -s * p3, s * p2],
        [-s * p2, s * p3, s * p0, -s * p1],
        [-s * p3, -s * p2, s * p1, s * p0],
    ]
