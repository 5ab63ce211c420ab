"""Accelerations of scenes with beams, from stresses that are given: strains computed from positions would have their rounding
errors, which the stiffness of a beam turns into large forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rates
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics

#: strain that rounding errors of positions may cause (1e-14), divided by the relative tolerance with which forces are compared
#: (`steady.STEADY`, 1e-4). In a scene with beams differences of forces are taken relative to the largest force, or to the force
#: that this strain causes in the stiffest beam, where that is larger
UNRESOLVED = 1e-10


@dataclass(frozen=True)
class Dynamics:
    """y and y' (n,) of a system in motion, its accelerations (nu,), and the largest force on a node in N m: a force times the
    scene's length, a torque times 1 rad."""

    y: Array
    yp: Array
    acceleration: Array
    force: float


def stresses_of(m: Mechanics, q: Array, u: Array) -> Array:
    """Stresses (nz,) of all beams, computed from positions and velocities."""
    return np.concatenate([np.zeros(0), *(line.stress(q, u) for line in m.model.lines)])


def dynamics(system: Assembly, m: Mechanics, t: float, q: Array, u: Array, s: Array, z: Array) -> Dynamics:
    """Accelerations and multipliers of a complete index-3 system at time t, positions q, velocities u, internal states s and
    given stresses z."""
    kinds, momentum, at = np.array(system.kinds), slice(m.nq, m.nq + m.nu), np.array([t])
    y, yp, F = np.zeros(system.n), np.zeros(system.n), np.empty(system.n)
    y[kinds == "q"], y[kinds == "v"], y[kinds == "s"], y[kinds == "z"] = q, u, s, z
    yp[kinds == "q"], yp[kinds == "s"] = m.rates(q, u), state_rates(m, t, q, u, s)
    system.residual(t, y, yp, F)
    G = sp.csc_matrix(m.constraint_jacobian(at, q[None])[0])
    K = sp.bmat([[m.mass, G.T], [G, None]], format="csc") if m.m else sp.csc_matrix(m.mass)
    x = splu(K).solve(np.r_[-F[momentum], -m.acceleration_bias(at, q[None], u[None])[0]])
    a, multipliers = x[: m.nu], x[m.nu :]
    yp[momentum] = a
    y[kinds == "lambda"] = multipliers / system.numbering.scaling()
    parts = (np.abs(F[momentum]), np.abs(m.mass @ a), abs(G.T) @ np.abs(multipliers), add_dead_loads(m, np.zeros(m.nu)))
    return Dynamics(y, yp, a, max(float(np.max(part * m.velocity_units, initial=0.0)) for part in parts))


def add_dead_loads(m: Mechanics, force: Array) -> Array:
    """Forces (nu,) with the absolute values of the dead loads of beams added in place: a measure of the size of all forces."""
    for line in m.model.lines:
        np.add.at(force, line.places("u").ravel(), np.abs(line.dead).ravel())
    return force


def unresolved(m: Mechanics) -> float:
    """Largest force, in N m as in `Dynamics`, that rounding errors of the positions can cause in the stiffest beam."""
    stiffest = [1 / min((v for n, v in line.numbers.items() if n.startswith("compliance_N") and v > 0), default=np.inf)
                for line in m.model.lines]  # fmt: skip
    return UNRESOLVED * max(stiffest, default=0.0) * m.model.length


def forces_off(m: Mechanics, acceleration: Array, found: Dynamics) -> Array:
    """(nu,) mass times the difference of the accelerations given and found, relative to the largest force."""
    off: Any = np.abs(m.mass @ (found.acceleration - acceleration)) * m.velocity_units
    return np.asarray(off / max(found.force, unresolved(m), 1e-300))
