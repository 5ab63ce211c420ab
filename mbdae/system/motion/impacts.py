"""Effective masses of impacts: the inertia that a contact force accelerates, along the directions in which it may act."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics

Place = tuple[int, int]  #: numbers of the group and the instance of a law


def approach_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Derivatives, by virtual displacements, of the relative displacements along which the force of a contact may act."""
    if not isinstance(d.law, Force):
        return []
    out: list[tuple[Target, Expr]] = []
    for i, e in enumerate(d.law.approach(*d.sides)):
        for f in d.frames:
            move, turn = d.variation.gradient(f, d.variation.name(e))
            pair = tuple(type(part)(*map(d.variation.resolve, part)) for part in (move, turn))
            out += [(("A", i, *t[1:]), entry) for t, entry in scatter_pair(f, pair)]  # type: ignore[arg-type]
    return out


def approaches(mechanics: Mechanics, t: float, q: Array) -> dict[Place, Array]:
    """For every contact law the rows (directions, nu) at positions q (nq,): rows @ u are the rates of the relative displacements
    along which its force may act."""
    found = {}
    for g, p, values in mechanics.evaluate(approach_outputs, np.array([t]), q[None], np.zeros((1, mechanics.nu))):
        for i in range(len(mechanics.model.groups[g].instances)):
            rows = np.zeros((1 + max(target[1] for target in p.targets), mechanics.nu))
            for o, (_, r, side, column) in enumerate(p.targets):
                rows[r, mechanics.numbering.velocity(("u", side, column), g, i)] += values[0, i, o]
            found[g, i] = rows[np.any(rows != 0, axis=1)]
    return found


def effective_masses(mechanics: Mechanics, t: float, q: Array, with_joints: bool, rows: Sequence[Array]) -> list[float]:
    """Effective masses (kg or kg m^2) of contacts at positions q (nq,), of each the smallest of its directions; infinite where
    nothing can move. rows: of each contact those of `approaches`; with_joints: whether joints tie further inertia to the bodies
    in contact."""
    together = np.concatenate(rows)
    mobility = mechanics.mobility_with_joints(t, q, together) if with_joints else mechanics.mobility(together)
    parts = np.split(mobility, np.cumsum([len(part) for part in rows])[:-1])
    largest = [float(np.max(part, initial=0.0)) for part in parts]
    return [1 / value if value > 0 else np.inf for value in largest]
