"""Quaternions P = (p0, p) that need not have unit length: the rotation depends on their direction only."""

from __future__ import annotations

from collections.abc import Sequence

from mbdae.symbolic.vectors import Expr, Vec


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
