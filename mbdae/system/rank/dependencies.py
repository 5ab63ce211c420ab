"""Combinations of constraint rows that nearly vanish in a position, and what they mean for the motion there.

The rows B (m, nu) have unit length, in unit displacements (the scene's length, 1 rad). Where a combination w^T B = s v^T with
|w| = |v| = 1 has a small length s, the motion v is hardly forbidden. Prescribed values ask for velocities u with B u = -r, where
r are their rates over the lengths of the rows, and so for the speed -w^T r / s along v: it grows without bound where s goes to 0
and w^T r does not. With the curvature c = w^T g''(v, v) of the rows, another branch of the motion is 2 s / c away along v, and
the states between both violate the rows by s^2 / (2 c) at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mbdae.system.base import Array
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics, in_units
from mbdae.system.rank.rows import smallest_triplets, unit_rows

ASIDE = 1e-4  #: displacement along v, in unit displacements, of the second difference that gives the curvature
SMALLEST = 1e-300  #: least value of a divisor: a singular value or twice a curvature, which may be 0


class Dependency(NamedTuple):
    """A combination of rows: its length s; its coefficients w (m,); the motion v (nu,) in unit displacements; the part (m,) of
    every row in the speed along v that prescribed values ask for, in unit displacements per s; the curvature c."""

    value: float
    rows: Array
    motion: Array
    speeds: Array
    curvature: float

    @property
    def speed(self) -> float:
        """The largest rate of an unknown, in unit displacements per s, that prescribed values ask for by this motion."""
        return float(abs(np.sum(self.speeds)) * np.max(np.abs(self.motion)))

    @property
    def between(self) -> float:
        """Violation of the rows by the states between both branches, over the scene's length or in rad."""
        return self.value**2 / max(2 * self.curvature, SMALLEST)


def dependencies(mechanics: Mechanics, rank: int, t: float, q: Array, below: float = 0.0) -> list[Dependency]:
    """The dependencies of rows at time t (s) and positions q (nq,), the one with the smallest value first: this one, and further
    ones (up to `rows.MOST_TRIPLETS` in all) with values less than `below`. rank: of all rows, redundant ones among them."""
    at, here = np.array([t]), q[None]
    G = mechanics.constraint_matrix(at, q)
    lengths = row_lengths(in_units(mechanics, G))[:, 0]
    rates = mechanics.velocity_residual(at, here, np.zeros((1, mechanics.nu)))[0] / lengths
    found = []
    for value, w, v in smallest_triplets(unit_rows(mechanics, G), rank, below):
        step = ASIDE * v * mechanics.velocity_units
        beside = [mechanics.integrate_positions(q, sign * step) for sign in (1.0, 0.0, -1.0)]
        there, middle, back = (mechanics.position_residual(at, p[None])[0] / lengths for p in beside)
        curvature = abs(float(w @ (there - 2 * middle + back))) / ASIDE**2
        found.append(Dependency(value, w, v, -w * rates / max(value, SMALLEST), curvature))
    return found
