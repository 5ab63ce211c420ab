"""One-sided laws of a scene: their gaps during a run, what is known of them before it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.kernels import plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.evaluation import Evaluation
from mbdae.system.assembled.scene_system import SceneSystem
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.start.start import Start

#: penetration assumed where nothing is known at the start, over the play and over the radius of the pin; the run corrects it
PLAY, PIN = 1e-2, 1e-6
ROUND_OFF = 1e-9  #: speed of two points relative to each other, over their own, below which they move together
DEEP = 10.0  #: a start that penetrates by more than the pin's radius over DEEP is refused


def gap_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Gap (m) and rate (m/s) of every place where a one-sided law may act."""
    if not isinstance(d.law, Force):
        return []
    pairs = d.law.gaps(*d.sides)
    resolve, name = d.variation.resolve, d.variation.name
    return [((what, i), resolve(name(e))) for i, pair in enumerate(pairs) for what, e in zip(("gap", "rate"), pair, strict=True)]


def gaps_of(mechanics: Mechanics, t: Array, q: Array, u: Array) -> dict[str, tuple[Array, Array]]:
    """By item: gaps (m) and rates (m/s) of its places of contact at states (nt,), (nt, places) each."""
    found = {}
    for g, _, values in mechanics.evaluate(gap_outputs, t, q, u):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            found[instance.item] = values[:, i, ::2], values[:, i, 1::2]
    return found


def approach_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Gradients of the relative displacements along which a one-sided law may act."""
    if not isinstance(d.law, Force):
        return []
    out: list[tuple[Target, Expr]] = []
    for i, e in enumerate(d.law.approach(*d.sides)):
        for f in d.sides:
            move, turn = d.variation.gradient(f, d.variation.name(e))
            pair = tuple(type(part)(*map(d.variation.resolve, part)) for part in (move, turn))
            out += [(("A", i, *t[1:]), entry) for t, entry in scatter_pair(f, pair)]  # type: ignore[arg-type]
    return out


@dataclass(frozen=True)
class Place:
    """One place of contact: the item it belongs to, its law with numbers, its effective mass (kg)."""

    item: str
    law: Any
    mass: float


@dataclass(frozen=True)
class Approach:
    """Of a one-sided law: its numbers, the smallest mass (kg) that meets an impact along any direction with the joints left
    out, and the speed (m/s) of its two points relative to each other."""

    law: Any
    mass: float
    speed: float


def approaches(mechanics: Mechanics, start: Start) -> dict[str, Approach]:
    """By item."""
    found: dict[str, Approach] = {}
    t, q = np.array([start.t]), start.q[None]
    for g, p, values in mechanics.evaluate(approach_outputs, t, q, np.zeros((1, mechanics.nu))):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            rows = np.zeros((1 + max(target[1] for target in p.targets), mechanics.nu))
            for o, (_, r, side, column) in enumerate(p.targets):
                rows[r, mechanics.numbering.velocity(("u", side, column), g, i)] += values[0, i, o]
            rows = rows[np.any(rows != 0, axis=1)]
            mobility = float(np.max(mechanics.mobility(rows), initial=0.0))
            mass = 1 / mobility if mobility > 0 else np.inf
            speed, of_points = np.linalg.norm(rows @ start.u), np.linalg.norm(np.abs(rows) @ np.abs(start.u))
            found[instance.item] = Approach(instance.law, mass, float(speed) if speed > ROUND_OFF * of_points else 0.0)
    return found


@dataclass(frozen=True)
class Expected:
    """What is known of a contact before the run. SI units.

    depth: penetration expected, m; penetration: at the start, with the force (N) and elastic energy (J) it means.
    """

    item: str
    law: Any
    mass: float
    depth: float
    penetration: float

    def told(self) -> str:
        """The contact in a line."""
        law = self.law
        friction = "without friction" if law.friction is None else f"{type(law.friction).__name__} friction"
        ends = "" if law.length is None else f", at both ends of {law.length:.3g} m"
        return (f"'{self.item}' with {law.outer - law.inner:.3g} m play, {type(law.normal).__name__}, {friction}{ends}; "
                f"penetration of about {self.depth:.1g} m expected")  # fmt: skip

    def _held(self) -> str:
        p = self.penetration
        force, energy = (float(e) for e in (self.law.normal.elastic_force(p), self.law.normal.energy(p)))
        return f"penetration of {p:.3g} m ({force:.3g} N, {energy:.3g} J)"

    def problems(self) -> list[str]:
        """Starts that cannot be meant."""
        if self.penetration <= self.law.inner / DEEP:
            return []
        return [f"'{self.item}' starts with a {self._held()}, more than {1 / DEEP:g} of the pin's radius {self.law.inner:g} m: "
                f"draw the pin inside the race, or give the clearance that is meant"]  # fmt: skip

    def changes(self) -> list[str]:
        """What the user should know of the start."""
        return [f"'{self.item}' starts with a {self._held()}"] if self.penetration > 0 else []


def expected_contacts(mechanics: Mechanics, start: Start, reactions: dict[str, float]) -> list[Expected]:
    """What to expect of every contact of a scene."""
    found = approaches(mechanics, start)
    gaps = gaps_of(mechanics, np.array([start.t]), start.q[None], start.u[None]) if found else {}
    deep = {item: max(0.0, -float(gap.min())) for item, (gap, _) in gaps.items()}
    return [Expected(item, a.law, a.mass, _depth(a, reactions.get(item, 0.0)), deep[item]) for item, a in found.items()]


def _depth(a: Approach, force: float) -> float:
    """Penetration (m) of an impact at the speed of the start; without one that under the force (N) of the ideal joint, or after
    a fall through the play under it, at least a small part of the play."""
    normal, play = a.law.normal, a.law.outer - a.law.inner
    if a.speed * play > 0:
        return float(normal.impact(a.mass, a.speed)[0])
    fall = float(normal.impact(a.mass, math.sqrt(2 * force * play / a.mass))[0]) if force * play > 0 else 0.0
    return max(float(normal.penetration(force)), fall, float(PLAY * play), float(PIN * a.law.inner))


class Contacts:
    """The guards of a system: gap, gap rate and duration of an impact at every place of contact."""

    def __init__(self, system: SceneSystem, masses: dict[str, float]) -> None:
        gathers, kernels = [], []
        self.places: list[Place] = []
        for g, group in enumerate(system.model.groups):
            p = plan(group.derived, gap_outputs)
            if not p.targets:
                continue
            gathers.append(system.numbering.gather(g, p.all_inputs))
            kernels.append(p.kernel)
            self.places += [Place(instance.item, instance.law, masses[instance.item])
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
