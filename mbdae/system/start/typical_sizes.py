"""Typical magnitudes of the unknowns, to which tolerances are relative."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.motion.constrained import largest_entries, row_lengths
from mbdae.system.motion.mechanics import Mechanics, in_units
from mbdae.system.start.rigid_beams import RigidMotions
from mbdae.system.start.start import Start

#: factor by which the scale of mu (stabilising multipliers of GGL) exceeds that of the positions. mu accumulates local errors of
#: the positions and is not smooth: with the scale of the positions BDF rejects every second step (Andrews' squeezer, rtol 1e-9:
#: 19692 steps instead of 1871)
SLACK = 1e5


def characteristic_time(mechanics: Mechanics, start: Start) -> float:
    """Characteristic time of the motion, s: the shortest of unit / speed and sqrt(unit / acceleration) over all velocities at the
    start, unit: the scene's length or 1 rad; 1 s where nothing moves."""
    units, acceleration = mechanics.velocity_units, start.acceleration
    if mechanics.model.lines:  # beams count as rigid bodies, because their elastic modes are faster
        B = RigidMotions(mechanics.model).basis(start.q)
        M = mechanics.mass @ B
        acceleration = B @ np.linalg.lstsq(B.T @ M, M.T @ acceleration, rcond=1e-12)[0]
    rates = np.abs(start.u) / units
    accelerations = np.sqrt(np.abs(acceleration) / units)
    fastest = max(float(np.max(rates, initial=0.0)), float(np.max(accelerations, initial=0.0)))
    return 1 / fastest if fastest > 1e-9 else 1.0


def state_scale(mechanics: Mechanics) -> Array:
    """(ns,) typical magnitude of the internal states, as their laws state it, or 1."""
    groups = mechanics.model.groups
    named = [(groups[g].instances[i].law, groups[g].derived.states[j]) for g, i, j in mechanics.numbering.states]
    return np.array([law.state_scales().get(name, 1.0) for law, name in named])


def multiplier_scales(mechanics: Mechanics, start: Start, T: float) -> tuple[Array, Array]:
    """Scales (m,) of lambda and of mu. That of lambda is the reaction that moves a body by its unit displacement (the scene's
    length or 1 rad) in the characteristic time T (s), or the reaction at the start if that is larger.

    Times the unit displacement of its row this is an energy; the largest energy of all rows is used for every row. A direction
    that carries no load at the start may carry it a quarter turn later, and a tolerance relative to its small value at the start
    would stop IDA there. The scale of mu is SLACK over the displacement that a unit of mu causes."""
    if not mechanics.m:
        return np.zeros(0), np.zeros(0)
    G = mechanics.constraint_matrix(np.array([start.t]), start.q)
    size = row_lengths(in_units(mechanics, G))[:, 0]
    mobility = mechanics.mobility(G)
    force = np.maximum(size / T**2 / np.maximum(mobility, 1e-300), np.abs(start.multipliers))
    move, turn = (largest_entries(G[:, np.flatnonzero(mask)]) for mask in (~mechanics.rotational, mechanics.rotational))
    arm = np.where(move > 0, move / mechanics.model.length, np.where(turn > 0, turn, 1.0))
    return np.max(force * size) / size, SLACK / arm


def stress_scale(mechanics: Mechanics, T: float) -> float:
    """Scale of the stresses of beams, N or N m: the force that moves the mass of the heaviest beam by the scene's length in the
    characteristic time T (s)."""
    if not mechanics.model.lines:
        return 1.0
    mass = max(line.beam.mass for line in mechanics.model.lines)
    return float(mass * mechanics.model.length / T**2)
