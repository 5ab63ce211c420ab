"""The geometrically exact beam (Reissner 1972, Simo 1985): shear deformable, with the interpolation along one line element and
the section axes along a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from mbdae.errors import OptionError
from mbdae.laws.bodies import ORDERS
from mbdae.symbolic.law import params
from mbdae.symbolic.line import LineLaw, LinePoint
from mbdae.symbolic.vectors import ZERO, Expr, Vec, components
from mbdae.values import Array

__all__ = ["Beam", "LineLoad"]



@dataclass(frozen=True, eq=False)
class ShapeTable:
    """Shape functions at points of the unit element: xi (points,), values and slopes d/dxi (points, p + 1)."""

    xi: Array
    weights: Array  #: weights of the quadrature (points,), sum 1; zeros where the points are no quadrature
    values: Array
    slopes: Array


@lru_cache(maxsize=16)
def node_positions(order: int) -> Array:
    """xi (p + 1,) of the nodes of an element: ends, and between them the extrema of the Legendre polynomial P_p."""
    if order not in ORDERS:
        raise OptionError(f"order = {order}: a beam element has order 1, 2, 3 or 4; give one of these")
    inner = legendre.Legendre.basis(order).deriv().roots() if order > 1 else np.zeros(0)
    return np.asarray(np.r_[0.0, (np.sort(np.real(inner)) + 1) / 2, 1.0])


def table(order: int, xi: Array, weights: Array | None = None) -> ShapeTable:
    """Shape functions of an element of order p at points xi (points,)."""
    to_coefficients = np.linalg.inv(legendre.legvander(2 * node_positions(order) - 1, order))
    values, slopes = (np.asarray(legendre.legval(2 * xi - 1, c).T, dtype=np.float64)
                      for c in (to_coefficients, 2 * legendre.legder(to_coefficients)))
    return ShapeTable(xi, np.zeros(len(xi)) if weights is None else weights, values, slopes)


@lru_cache(maxsize=16)
def gauss(order: int, points: int) -> ShapeTable:
    """Shape functions of order p at Gauss points. An element needs p points for strains, since p + 1 would lock, and p + 1 for
    mass and loads."""
    xi, weights = legendre.leggauss(points)
    return table(order, (xi + 1) / 2, weights / 2)


def strain_points(order: int) -> ShapeTable:
    """The p Gauss points of strains."""
    return gauss(order, order)


def mass_points(order: int) -> ShapeTable:
    """The p + 1 Gauss points of mass and distributed loads."""
    return gauss(order, order + 1)


#: sine of the angle up to which two directions count as parallel; also bound up to which a component of a unit vector, and 1 plus
#: the cosine between two tangents, count as 0, and the second singular value of a line's tangents and points over the first,
#: which then is straight
PARALLEL = 1e-8
ROUND_OFF = 1e-13  #: unit quaternions whose components all differ by less count as equal


def section_axes(tangents: Array, positions: Array, axis2: Any = None) -> Array:
    """(k, 3, 3) axes 1, 2, 3 as columns at places (k,) along a line.

    axis2: direction whose part normal to the tangent is axis 2. By default axis 3 is the normal of the plane in which the
    line lies; for a straight line z, or x where the line is along z. Along a line in space axis 3 turns with the tangent,
    without twist.
    """
    first = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    if axis2 is None:
        third = _carried(first, _normal(first, positions))
        return np.stack([first, np.cross(third, first), third], axis=-1)
    direction = np.zeros(3)
    direction[: len(axis2)] = axis2
    second = direction - (first @ direction)[:, None] * first
    size = np.linalg.norm(second, axis=1, keepdims=True)
    if np.any(size <= PARALLEL * np.linalg.norm(direction)):
        raise OptionError(f"axis2 = {direction.tolist()} is parallel to the beam somewhere: give a direction across it")
    second = second / size
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _normal(first: Array, positions: Array) -> Array:
    """Unit normal of the plane that fits the line best, of the sign that makes its z component positive (its y where z is 0, its
    x where both are); of a straight line z, or x where the line is along z. first: unit tangents."""
    spread = np.linalg.svd(np.vstack([first, positions - positions[0]]), full_matrices=False)
    if spread[1][1] <= PARALLEL * spread[1][0]:
        return np.asarray(np.eye(3)[2 if np.linalg.norm(first[0, :2]) > PARALLEL else 0])
    normal = spread[2][2]
    leading = next(c for c in normal[::-1] if abs(c) > PARALLEL)
    return np.asarray(normal * np.sign(leading))


def _carried(first: Array, normal: Array) -> Array:
    """Axis 3 (k, 3) along the line: the normal at its start, turned from tangent to tangent without twist. first: unit
    tangents."""
    found = np.empty_like(first)
    before = first[0]
    normal = normal - (normal @ before) * before
    for i, t in enumerate(first):
        both = 1 + before @ t
        if both > PARALLEL:  # opposite tangents fix no rotation: the normal stays
            normal = normal - (normal @ t) / both * (before + t)
        found[i] = normal = normal / np.linalg.norm(normal)
        before = t
    return found


def quaternions(axes: Array) -> Array:
    """(k, 4) unit quaternions of axes (k, 3, 3), each with a positive dot product with the one before."""
    R, K = np.moveaxis(axes, 0, -1), np.empty((4, 4, len(axes)))  # K = 4 P P^T
    K[0, 0] = 1 + R[0, 0] + R[1, 1] + R[2, 2]
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        K[i + 1, i + 1] = 1 + R[i, i] - R[j, j] - R[k, k]
        K[0, i + 1] = K[i + 1, 0] = R[k, j] - R[j, k]
        K[j + 1, k + 1] = K[k + 1, j + 1] = R[k, j] + R[j, k]
    largest = np.argmax(np.einsum("iik->ki", K), axis=1)  # the row with the largest diagonal entry is the most accurate
    P = np.moveaxis(K, -1, 0)[np.arange(len(axes)), largest]
    P = P / np.linalg.norm(P, axis=1, keepdims=True)
    first = 1.0 if P[0, 0] >= 0 else -1.0
    flips = np.where(np.einsum("ki,ki->k", P[1:], P[:-1]) < 0, -1.0, 1.0)
    return np.asarray(P * np.cumprod(np.r_[first, flips])[:, None])


def headings(tangents: Array) -> Array:
    """(k,) angle of the tangents in the plane z = 0, continuous along the line, rad."""
    return np.asarray(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])))


def relative(P: Array, S: Array) -> Array:
    """conj(P) o S (..., 4): the rotation from axes P to axes S; exactly (1, 0, 0, 0) where they agree to round-off."""
    vector = P[..., :1] * S[..., 1:] - S[..., :1] * P[..., 1:] - np.cross(P[..., 1:], S[..., 1:])
    found: Array = np.concatenate([np.sum(P * S, axis=-1, keepdims=True), vector], axis=-1)
    found[np.max(np.abs(P - S), axis=-1) < ROUND_OFF] = [1.0, 0.0, 0.0, 0.0]
    return found


_FORCES = {"N1": "axial force", "N2": "shear force along axis 2", "N3": "shear force along axis 3"}
_MOMENTS = {"M1": "torque", "M2": "bending moment about axis 2", "M3": "bending moment about axis 3"}


class Beam(LineLaw):
    """Geometrically exact beam (Reissner 1972, Simo 1985): shear deformable, any displacement and rotation.

    Strains Gamma = R^T dr/ds and K = axial(R^T dR/ds) in section axes, less those of the reference curve.

    T = mass_per_length v.v / 2 + Omega.J Omega / 2 per length. In the plane N1, N2 and M3 remain.
    """

    params = params(
        mass_per_length=("kg/m", "mass per reference length"),
        J1=("kg m", "rotary inertia per length about axis 1"), J2=("kg m", "about axis 2"), J3=("kg m", "about axis 3"),
        damping=("s", "damping time, by which the rate of the strain adds to it"),
        **{f"compliance_{name}": ("1/N", f"strain per {meaning}; 0 is rigid") for name, meaning in _FORCES.items()},
        **{f"compliance_{name}": ("1/(N m^2)", f"curvature per {meaning}; 0 is rigid") for name, meaning in _MOMENTS.items()},
        **{f"reference_{name}": ("1", f"strain of {name} without stress") for name in _FORCES},
        **{f"reference_{name}": ("1/m", f"curvature of {name} without stress") for name in _MOMENTS},
    )

    def strains(self, x: LinePoint) -> dict[str, Expr]:
        Gamma, K = Vec(*(axis @ x.r_s for axis in x.axes)), x.curvature
        return dict(zip((*_FORCES, *_MOMENTS), (*Gamma, *K), strict=True))

    def kinetic_energy(self, x: LinePoint) -> Expr:
        p, q, r = x.spin
        return self.mass_per_length * (x.v @ x.v) / 2 + (self.J1 * p * p + self.J2 * q * q + self.J3 * r * r) / 2


class LineLoad(LineLaw):
    """A force per reference length on a beam's axis: dead (inertial components), or following the section (its axes 1, 2, 3)."""

    params = params(f1=("N/m", "along x, or axis 1 of the section"), f2=("N/m", "along y, or axis 2"),
                    f3=("N/m", "along z, or axis 3"))
    options = ("following",)

    def load(self, x: LinePoint) -> Vec:
        f = components(self.f1, self.f2, self.f3)
        return sum((axis * c for axis, c in zip(x.axes, f, strict=True)), ZERO) if self.following else f
