"""Typical magnitudes of the unknowns: what a tolerance is relative to."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.mechanics import Mechanics
from mbdae.system.start import Start


def characteristic_time(mechanics: Mechanics, start: Start) -> float:
    """The shortest of: unit over speed, root of unit over acceleration, at the start; 1 s where nothing moves."""
    units = mechanics.velocity_units
    rates = np.abs(start.u) / units
    accelerations = np.sqrt(np.abs(start.acceleration) / units)
    fastest = max(float(np.max(rates, initial=0.0)), float(np.max(accelerations, initial=0.0)))
    return 1 / fastest if fastest > 1e-9 else 1.0


def position_scale(mechanics: Mechanics) -> Array:
    """(nq,) the scene's length for positions, 1 for quaternions and angles."""
    scale = np.ones(mechanics.nq)
    for node in mechanics.model.nodes:
        scale[node.q : node.q + (2 if node.kind.flat else 3)] = mechanics.model.length
    return scale


def multiplier_scales(mechanics: Mechanics, start: Start, T: float) -> tuple[Array, Array]:
    """(m,) of lambda (constraint force of a characteristic acceleration, at least its start value) and of mu."""
    if not mechanics.m:
        return np.zeros(0), np.zeros(0)
    G = mechanics.constraint_jacobian(np.array([start.t]), start.q[None])[0]
    size = np.sqrt(np.sum((G * mechanics.velocity_units) ** 2, axis=1))
    size[size == 0] = 1.0
    mobility = np.einsum("ij,ji->i", G, np.linalg.solve(mechanics.weight, G.T))
    force = np.maximum(size / T**2 / np.maximum(mobility, 1e-300), np.abs(start.multipliers))
    reach = np.array([np.min(mechanics.velocity_units[row != 0] / np.abs(row[row != 0]), initial=np.inf) for row in G])
    return force, np.where(np.isfinite(reach), reach, 1.0)
