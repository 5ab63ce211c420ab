"""Forces and torques of all joints and force elements at once, and their error from the difference of runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbdae.integrators.solution import Solution
from mbdae.results.sensors import reaction_outputs
from mbdae.results.states import States, states_of
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: rounding error of forces, relative to the force that moves the heaviest body by the scene's length in the motion's
#: characteristic time
NO_FORCE = 1e-9


def wrenches(prepared: Prepared, at: States) -> Array:
    """(nt, items, 6) force (N) and torque (N m) of every joint and force element on its body l, as their sensors show them."""
    m, items = prepared.with_all_rows, [c.name for c in prepared.model.scene.connections]
    multipliers = m.accelerations(at.t, at.q, at.u, at.s, at.z)[1]
    total = np.zeros((len(at.t), len(items), 6))
    for g, _, values in m.evaluate(reaction_outputs, at.t, at.q, at.u, at.s, multipliers):
        for i, instance in enumerate(prepared.model.groups[g].instances):
            if instance.item in items:
                total[:, items.index(instance.item)] += values[:, i]
    return total


@dataclass(frozen=True, eq=False)
class OtherRun:
    """States of a run with which the returned run is compared: the error of the latter is `share` times the difference; prepared:
    its scene, where it has another mesh of the beams."""

    states: States
    share: float
    prepared: Prepared | None = None


@dataclass(frozen=True, eq=False)
class ReactionError:
    """The error of the forces and torques of a run, from its difference to other runs; computed when it is called."""

    prepared: Prepared
    solution: Solution
    others: tuple[OtherRun, ...]

    def __call__(self) -> float:
        """Sum of the errors from the other runs, each over the largest force of the run (torques are divided by the length)."""
        return float(sum(other.share * self._difference(other) for other in self.others))

    def _difference(self, other: OtherRun) -> float:
        length = self.prepared.length
        if not self.prepared.model.scene.connections:
            return 0.0
        own = wrenches(self.prepared, states_of(self.prepared, self.solution, other.states.t))
        compared = wrenches(other.prepared or self.prepared, other.states)
        sizes, apart = (np.maximum(np.linalg.norm(w[..., :3], axis=2), np.linalg.norm(w[..., 3:], axis=2) / length)
                        for w in (own, compared - own))  # fmt: skip
        return float(np.max(apart) / max(float(np.max(sizes)), self._smallest_force))

    @property
    def _smallest_force(self) -> float:
        """Force, N, below which forces are rounding errors."""
        m = self.prepared.mechanics
        mass = float(np.max(m.mass.diagonal()[~m.rotational], initial=0.0))
        return max(NO_FORCE * mass * self.prepared.length / self.prepared.time**2, 1e-300)
