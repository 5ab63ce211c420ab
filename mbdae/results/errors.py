"""The error of everything that a result shows, from the runs that were made beside the one that is returned.

A quantity is read from the run and from each of the others at the same times; the difference, times the share of it that is the
error of the run, is the estimate. It is computed when the quantity is read.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import MbdaeError, warn
from mbdae.results.quantities import Quantity, magnitudes, named, unit_of, value
from mbdae.results.reactions import OtherRun, wrenches
from mbdae.results.states import states_of
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

#: rounding error of forces, relative to the force that moves the heaviest body by the scene's length in the motion's
#: characteristic time
NO_FORCE = 1e-9
#: a quantity that is smaller than this fraction of what the scene has of its kind (force, torque, power, acceleration) counts as
#: that large: what is left of a sum that vanishes has no digits of its own
LEAST = 1e-6
#: rounding error of forces and what follows from them, relative to the largest force of the run
ROUNDED = 1e-11


class Estimate(NamedTuple):
    """error: of a quantity, absolute, in its unit; size: what it is relative to; limit: below which it is rounding."""

    error: float
    size: float
    limit: float = 0.0

    def beyond(self, asked: float) -> bool:
        """Whether the error is above the accuracy asked."""
        return not self.error <= max(asked * self.size, self.limit)


@dataclass(eq=False)
class Errors:
    """The errors of a run, from its differences to other runs; called, it returns that of all reactions."""

    prepared: Prepared
    solution: Solution
    others: tuple[OtherRun, ...]
    told: dict[str, str] = field(default_factory=dict)  #: by quantity: what its reader was told
    _known: dict[str, Estimate | None] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """What `pickle` keeps: the runs and what was told; errors are computed again when they are read."""
        return {"prepared": self.prepared, "solution": self.solution, "others": self.others, "told": self.told, "_known": {}}

    # -- reactions

    def __call__(self) -> float:
        """Error of the forces and torques of all joints and force elements over the largest force of the run (torques are divided
        by the length)."""
        return added((other.kind, other.share * apart / self._largest_force) for other, (_, apart) in self._reactions)

    @cached_property
    def _reactions(self) -> list[tuple[OtherRun, tuple[float, float]]]:
        """Every other run with the largest force at the times of its comparison, and the largest difference, N."""
        return [(other, self._forces(other)) for other in self.others if len(other.times)]

    def _forces(self, other: OtherRun) -> tuple[float, float]:
        if not self.prepared.model.scene.connections:
            return 0.0, 0.0
        scene = other.prepared or self.prepared
        own = wrenches(self.prepared, states_of(self.prepared, self.solution, other.times))
        compared = wrenches(scene, states_of(scene, other.run, other.times))
        size, apart = (float(np.max(np.maximum(np.linalg.norm(w[..., :3], axis=2),
                                               np.linalg.norm(w[..., 3:], axis=2) / self.prepared.length)))
                       for w in (own, compared - own))  # fmt: skip
        return size, apart

    @cached_property
    def _largest_force(self) -> float:
        """Largest force of the run, N; at least that below which forces are rounding errors."""
        m = self.prepared.mechanics
        mass = float(np.max(m.mass.diagonal()[~m.rotational], initial=0.0))
        least = max(NO_FORCE * mass * self.prepared.length / self.prepared.time**2, 1e-300)
        return max([least, *(size for _, (size, _) in self._reactions)])

    # -- any quantity

    def of(self, result: Any, quantity: Quantity) -> Estimate | None:
        """The error of a quantity over the run; None where no other run can be read. result: the run as users see it."""
        if not isinstance(quantity, str):
            return self._estimated(result, quantity)
        if quantity not in self._known:
            self._known[quantity] = self._estimated(result, quantity)
        return self._known[quantity]

    def _estimated(self, result: Any, quantity: Quantity) -> Estimate | None:
        unit, found = unit_of(result, quantity), []
        size = 0.0
        for other in self.others:
            if not len(other.times):
                continue
            try:
                own, compared = (value(one, quantity) for one in self._both(result, other))
            except (MbdaeError, ArithmeticError, LookupError, TypeError, ValueError, AttributeError):
                return None  # a function that reads what other runs do not have
            size = max(size, float(np.max(magnitudes(own), initial=0.0)))
            found.append((other.kind, other.share * float(np.max(magnitudes(difference(own, compared, unit)), initial=0.0))))
        if not found:
            return None
        return Estimate(added(found), max(size, self._scale(unit)), self._rounding(unit))

    def _both(self, result: Any, other: OtherRun) -> tuple[Any, Any]:
        """The run and another one at the times of their comparison, to be read without telling anything."""
        if id(other) not in self._views:
            self._views[id(other)] = tuple(type(result)(prepared, run, None, other.times) for prepared, run in
                                           ((self.prepared, self.solution), (other.prepared or self.prepared, other.run)))  # fmt: skip
        return self._views[id(other)]

    @cached_property
    def _views(self) -> dict[int, tuple[Any, Any]]:
        return {}

    def _scale(self, unit: str) -> float:
        """Least size of a quantity of some unit: motion is relative to length and characteristic time, as its accuracy is."""
        L, T = self.prepared.length, self.prepared.time
        motion = {"m": L, "rad": 1.0, "m/s": L / T, "rad/s": 1 / T}
        return motion[unit] if unit in motion else LEAST * self._typical(unit)

    def _rounding(self, unit: str) -> float:
        return ROUNDED * self._typical(unit)

    def _typical(self, unit: str) -> float:
        """What the scene has of a quantity of some unit; 0 where that is not known."""
        L, T = self.prepared.length, self.prepared.time
        F = self._largest_force
        return {"N": F, "N m": F * L, "N, N m": F, "W": F * L / T, "m/s^2": L / T**2, "rad/s^2": 1 / T**2}.get(unit, 0.0)

    # -- telling

    def tell(self, result: Any, name: str, unit: str, found: Estimate | None, asked: float | None) -> None:
        """Warn once about a quantity whose error is above the accuracy asked."""
        if found is None or asked is None or name in self.told or not found.beyond(asked):
            return
        error = f"{found.error:.1e}{f' {unit}' if unit else ''}" if np.isfinite(found.error) else "of unknown size"
        share = f", {found.error / found.size:.1e} of its largest value" if np.isfinite(found.error) else ""
        self.told[name] = f"{name} has an error of about {error}{share}, where {asked:g} was asked: {self._remedy(asked)}"
        warn(f"scene '{self.prepared.model.scene.name}': {self.told[name]}")

    def _remedy(self, asked: float) -> str:
        if any(other.kind == "window" for other in self.others):
            return ("the motion has the accuracy, this has not, because the run leaves out fast elastic vibrations; a smaller "
                    "accuracy resolves them, or form=mb.GGL(waves=True) with solver=mb.RadauIIA(3)")  # fmt: skip
        return f"the motion has the accuracy, this has not; ask for a smaller one, as accuracy={asked / 10:.0e}"


def difference(own: Array, compared: Array, unit: str) -> Array:
    """Difference of two readings of a quantity; of angles without whole turns."""
    found = compared - own
    return found - 2 * np.pi * np.round(found / (2 * np.pi)) if unit == "rad" else found


def added(found: Iterable[tuple[str, float]]) -> float:
    """Errors by kind of run: runs of one kind show the same error, of which the largest counts; those of several kinds add."""
    largest: dict[str, float] = {}
    for kind, error in found:
        largest[kind] = max(error, largest.get(kind, 0.0))
    return float(sum(largest.values()))
