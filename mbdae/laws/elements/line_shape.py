"""Interpolation along one line element: Lagrange polynomials of order p over xi in [0, 1] and Gauss quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from mbdae.errors import OptionError

Array = NDArray[np.float64]
ORDERS = (1, 2, 3, 4)


@dataclass(frozen=True, eq=False)
class Table:
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


def table(order: int, xi: Array, weights: Array | None = None) -> Table:
    """Shape functions of an element of order p at points xi (points,)."""
    to_coefficients = np.linalg.inv(legendre.legvander(2 * node_positions(order) - 1, order))
    values, slopes = (np.asarray(legendre.legval(2 * xi - 1, c).T, dtype=np.float64)
                      for c in (to_coefficients, 2 * legendre.legder(to_coefficients)))  # fmt: skip
    return Table(xi, np.zeros(len(xi)) if weights is None else weights, values, slopes)


@lru_cache(maxsize=16)
def gauss(order: int, points: int) -> Table:
    """Shape functions of order p at Gauss points. An element needs p points for strains, since p + 1 would lock, and p + 1 for
    mass and loads."""
    xi, weights = legendre.leggauss(points)
    return table(order, (xi + 1) / 2, weights / 2)


def strain_points(order: int) -> Table:
    """The p Gauss points of strains."""
    return gauss(order, order)


def mass_points(order: int) -> Table:
    """The p + 1 Gauss points of mass and distributed loads."""
    return gauss(order, order + 1)
