"""The contacts of assembled equations, as solvers watch them: gap, gap rate and duration of an impact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.kernels import plan
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.evaluation import Evaluation
from mbdae.system.base import Array
from mbdae.system.motion.states import gap_outputs


@dataclass(frozen=True)
class ContactPlace:
    """One place of contact: the item it belongs to, its law with numbers, its effective mass (kg)."""

    item: str
    law: Any
    mass: float


class ContactGuards:
    """Gap, gap rate and duration of an impact at every place of contact."""

    def __init__(self, system: Assembly, masses: dict[str, float]) -> None:
        gathers, kernels = [], []
        self.places: list[ContactPlace] = []
        for g, group in enumerate(system.model.groups):
            p = plan(group.derived, gap_outputs)
            if not p.targets:
                continue
            gathers.append(system.numbering.gather(g, p.all_inputs))
            kernels.append(p.kernel)
            self.places += [ContactPlace(instance.item, instance.law, masses[instance.item])
                            for instance in group.instances for _ in p.targets[::2]]  # fmt: skip
        self._batch = system.batch(1)
        self._evaluation = Evaluation(self._batch.W, gathers, kernels)
        self._zero = np.zeros(system.n)

    @property
    def names(self) -> tuple[str, ...]:
        """The joint of every place."""
        return tuple(place.item for place in self.places)

    def __call__(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        """Gap (m), its rate (m/s) and the duration (s) of an impact at that rate, (places,) each."""
        self._batch.fill(np.array([t]), y, self._zero)
        pairs = self._evaluation.values().reshape(-1, 2)
        gap, rate = pairs[:, 0].copy(), pairs[:, 1].copy()
        duration = [float(p.law.contact_duration(p.mass, v)) for p, v in zip(self.places, rate, strict=True)]
        return gap, rate, np.array(duration)
