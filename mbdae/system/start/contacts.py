"""What is known of the contacts of a scene before its run: penetration at the start, and the one to expect."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target, scatter_pair
from mbdae.symbolic.vectors import Expr
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import gaps_of
from mbdae.system.start.start import Start

#: penetration assumed where nothing is known at the start, over the play and over the radius of the pin; the run corrects it
PLAY, PIN = 1e-2, 1e-6
ROUND_OFF = 1e-9  #: speed of two points relative to each other, over their own, below which they move together
DEEP = 10.0  #: a start that penetrates by more than the pin's radius over DEEP is refused


def approach_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Gradients of the relative displacements along which a contact law may act."""
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
class ExpectedContact:
    """A contact before the run. SI units.

    mass: smallest effective mass of an impact in any direction, without the joints; speed: of its two points relative to each
    other; penetration: at the start; force: of the ideal joint in its place, 0 where it is not known."""

    item: str
    law: Any
    mass: float
    speed: float
    penetration: float
    force: float

    @cached_property
    def depth(self) -> float:
        """Penetration (m) of an impact at the speed of the start; without speed that under the force of the ideal joint, or after
        a fall through the play under it, at least a small part of the play."""
        normal, play = self.law.normal, self.law.outer - self.law.inner
        if self.speed * play > 0:
            return float(normal.impact(self.mass, self.speed)[0])
        falling = self.force * play > 0
        fall = float(normal.impact(self.mass, math.sqrt(2 * self.force * play / self.mass))[0]) if falling else 0.0
        return max(float(normal.penetration(self.force)), fall, float(PLAY * play), float(PIN * self.law.inner))

    def summary(self) -> str:
        """The contact in a line."""
        law = self.law
        friction = "without friction" if law.friction is None else f"{type(law.friction).__name__} friction"
        ends = "" if law.length is None else f", at both ends of {law.length:.3g} m"
        return (f"'{self.item}' with {law.outer - law.inner:.3g} m play, {type(law.normal).__name__}, {friction}{ends}; "
                f"penetration of about {self.depth:.1g} m expected")  # fmt: skip

    def _at_start(self) -> str:
        p = self.penetration
        force, energy = (float(e) for e in (self.law.normal.elastic_force(p), self.law.normal.energy(p)))
        return f"penetration of {p:.3g} m ({force:.3g} N, {energy:.3g} J)"

    def problems(self) -> list[str]:
        """Why the start is refused, one sentence each."""
        if self.penetration <= self.law.inner / DEEP:
            return []
        return [f"'{self.item}' starts with a {self._at_start()}, more than {1 / DEEP:g} of the pin's radius "
                f"{self.law.inner:g} m: draw the pin inside the race, or give the clearance that is meant"]  # fmt: skip

    def changes(self) -> list[str]:
        """A sentence on penetration at the start."""
        return [f"'{self.item}' starts with a {self._at_start()}"] if self.penetration > 0 else []


def expected_contacts(mechanics: Mechanics, start: Start, reactions: dict[str, float]) -> list[ExpectedContact]:
    """Every contact of a scene before its run; reactions: size (N) of the force of its ideal joint, by item."""
    found = []
    t, q, u = np.array([start.t]), start.q[None], start.u[None]
    for g, p, values in mechanics.evaluate(approach_outputs, t, q, np.zeros((1, mechanics.nu))):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            rows = np.zeros((1 + max(target[1] for target in p.targets), mechanics.nu))
            for o, (_, r, side, column) in enumerate(p.targets):
                rows[r, mechanics.numbering.velocity(("u", side, column), g, i)] += values[0, i, o]
            rows = rows[np.any(rows != 0, axis=1)]
            mobility = float(np.max(mechanics.mobility(rows), initial=0.0))
            mass = 1 / mobility if mobility > 0 else np.inf
            speed, of_points = np.linalg.norm(rows @ start.u), np.linalg.norm(np.abs(rows) @ np.abs(start.u))
            found.append((instance, mass, float(speed) if speed > ROUND_OFF * of_points else 0.0))
    gaps = gaps_of(mechanics, t, q, u) if found else {}
    return [ExpectedContact(i.item, i.law, mass, speed, max(0.0, -float(gaps[i.item][0].min())), reactions.get(i.item, 0.0))
            for i, mass, speed in found]  # fmt: skip
