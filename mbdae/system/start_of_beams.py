"""A start with bent beams, where no rigid motion of the beams closes the loops or follows the prescribed motions.

Loops of beams may be drawn or driven so that they close only if beams bend, such as a four-bar with one hinge that is not
parallel to the others. Positions are then those of least elastic energy, and velocities minimise the same quadratic form of the
stiffness, as in a quasi-static motion. Rigid motions cost no elastic energy: a small weight on the inertia makes them unique.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mbdae.deferred import sp
from mbdae.system.base import Array
from mbdae.system.changes import cheapest, largest_violation
from mbdae.system.motion.mechanics import Mechanics, in_units

#: assumed ratio of the motion's frequency to the lowest bending frequency. Its square weighs the inertia against the stiffness
SLOW = 0.01
STEPS = 50
#: size of a step of Newton's method (rad, or over the scene's length) up to which it has converged, if the loops are closed too
CONVERGED = 1e-9


def can_bend(mechanics: Mechanics) -> bool:
    """Whether a scene has beams and none of their strains is rigid."""
    lines = mechanics.model.lines
    return bool(lines) and not any(line.beam.section.rigid for line in lines)


class Bending:
    """Of a scene with beams at positions q (nq,): stiffness matrix, elastic forces, and mass matrix times a small weight."""

    def __init__(self, mechanics: Mechanics, q: Array) -> None:
        self.units = mechanics.velocity_units
        self.inertia = SLOW**2 * _lowest(mechanics) * sp.csc_matrix(mechanics.weight)
        self.weight = stiffness(mechanics, q) + self.inertia
        self.force = mechanics.elastic_force(q)

    def least(self, A: Array, right: Array, pull: Array) -> Array:
        """Displacement x (nu,) with A x = right (m,) that minimises x^T W x / 2 - pull^T x, where W is stiffness plus weighted
        inertia; A (m, nu) may have redundant rows."""
        return cheapest(self.weight, self.units, A, right, pull)


def stiffness(mechanics: Mechanics, q: Array) -> sp.csc_matrix:
    """Stiffness matrix (nu, nu) of all beams at positions q (nq,), per virtual displacement."""
    parts: list[Any] = []
    for line in mechanics.model.lines:
        K = line.stiffness(q)
        at = line.places("u").reshape(len(K), -1)
        a, b = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        parts.append((((K + K.transpose(0, 2, 1)) / 2).ravel(), a.ravel(), b.ravel()))
    values, rows, columns = (np.concatenate(of) for of in zip(*parts, strict=True))
    return sp.csc_matrix((values, (rows, columns)), shape=(mechanics.nu,) * 2)


def closed_by_bending(mechanics: Mechanics, q: Array, closure: Callable[[Array], Array], jacobian: Callable[[Array], Array],
           within: float) -> Array | None:
    """Positions (nq,) of least elastic energy that satisfy closure(q) = 0 (m,), found by Newton's method from q; None where it
    fails. jacobian(q) (m, nu): derivative of closure by displacements; within: largest violation, over the scene's length or
    rad."""
    for _ in range(STEPS):
        bending, A, g = Bending(mechanics, q), jacobian(q), closure(q)
        off = largest_violation(g, in_units(mechanics, A))
        x = bending.least(A, -g, bending.force)
        step = float(np.max(np.abs(x) / mechanics.velocity_units))
        if off <= within and step <= CONVERGED:
            return q
        factor = min(1.0, 0.5 / max(step, 1e-300))
        while factor > 1e-4:
            moved = mechanics.integrate_positions(q, factor * x)
            if largest_violation(closure(moved), in_units(mechanics, A)) < max(off, within) * (1 + 1e-9) or off <= 1e-6:
                break
            factor /= 2
        else:
            return None
        q = moved
    return None


def _lowest(mechanics: Mechanics) -> float:
    """Square of the lowest bending frequency of all beams, (rad/s)^2, estimated as EI / (mass per length * length^4)."""
    beams = [line.beam for line in mechanics.model.lines]
    lengths = [float(np.sum(np.linalg.norm(np.diff(beam.outline, axis=0), axis=1))) for beam in beams]
    sections = [beam.section for beam in beams]
    return float(min(min(s.EI2, s.EI3) / s.mass_per_length / l**4 for s, l in zip(sections, lengths, strict=True)))
