"""The contacts of a scene before its run: penetration at the start, and the penetration to be expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.symbolic.law import Impact
from mbdae.system.base import Array
from mbdae.system.motion.impacts import Place, approaches, effective_masses
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import gaps_of
from mbdae.system.start.start import Start

#: elastic force of a contact at the start, over the weight of its effective mass, up to which its penetration is accepted as that
#: of bodies at rest
RESTS = 10.0
ROUND_OFF = 1e-9  #: relative speed of the bodies in contact, over their own speeds, up to which it counts as round-off


@dataclass(frozen=True)
class ExpectedContact:
    """What is known before the run of one contact law. SI units; rad, rad/s and kg m^2 where its gaps are angles.

    place: numbers of its group and instance; impact: data of its impacts, see `Impact`; penetration: that at the start; weight:
    that of its effective mass (N), 0 where the force is known from the reaction of an ideal joint."""

    item: str
    law: Any
    place: Place
    impact: Impact
    penetration: float
    weight: float = 0.0

    @property
    def size(self) -> float:
        """Size to which its gaps are relative: the scene's length (m), or 1 rad."""
        return self.impact.size

    @property
    def mass(self) -> float:
        """Smallest effective mass of an impact at the start."""
        return self.impact.mass

    @property
    def unit(self) -> str:
        """Unit of its gaps: m or rad."""
        return str(self.law.gap_unit)

    @cached_property
    def depth(self) -> float:
        """Largest penetration to be expected in a run, in `unit`."""
        return float(self.law.expected_depth(self.impact))

    def summary(self) -> str:
        """What the output of `Scene.check` says of the contact after its name: its law and the penetration to be expected."""
        expected = f"of about {self.depth:.1g} {self.unit} expected" if math.isfinite(self.depth) else "not known before the run"
        return f"{self.law.summary_of_contact()}; penetration {expected}"

    def _at_start(self) -> str:
        p, load = self.penetration, self.law.elastic_load(self.penetration)
        unit = "N" if self.unit == "m" else "N m"
        detail = "" if load is None else f" (elastic load {load[0]:.3g} {unit}, energy {load[1]:.3g} J)"
        return f"penetration of {p:.3g} {self.unit}{detail}"

    def problems(self, continued: bool) -> list[str]:
        """Error messages on the penetration at the start, one sentence each. continued: whether the start is the end of another
        run."""
        load = self.law.elastic_load(self.penetration)
        rests = load is not None and load[0] <= RESTS * self.weight
        why = "" if rests else self.law.refuses_start(self.penetration, self.size, continued)
        return [f"'{self.item}' starts with a {self._at_start()}, {why}"] if why else []

    def changes(self) -> list[str]:
        """A sentence on the penetration at the start, if there is any, for `Start.changes`."""
        return [f"'{self.item}' starts with a {self._at_start()}"] if self.penetration > 0 else []


def expected_contacts(mechanics: Mechanics, start: Start, reactions: dict[str, float], time: float) -> list[ExpectedContact]:
    """What is known of every contact law of a scene before its run. reactions: name of a joint with clearance -> reaction (N) of
    the ideal joint in its place; time: characteristic time, s."""
    t, q, u = np.array([start.t]), start.q[None], start.u[None]
    known = approaches(mechanics, start.t, start.q)
    gaps = gaps_of(mechanics, t, q, u) if known else {}
    masses: dict[Place, float] = {}
    for with_joints in (False, True):
        of = {place: rows for place, rows in known.items() if _law(mechanics, place).with_joints is with_joints}
        if of:
            masses |= dict(zip(of, effective_masses(mechanics, start.t, start.q, with_joints, list(of.values())), strict=True))
    found = []
    for (g, i), rows in known.items():
        instance, mass = mechanics.model.groups[g].instances[i], masses[g, i]
        gap = float(gaps[g, i][0].min())
        force = reactions.get(instance.item, 0.0)
        size = mechanics.model.length if instance.law.gap_unit == "m" else 1.0
        impact = Impact(mass, _speed(rows, start.u), force, max(0.0, gap), size, time)
        carries = instance.law.gap_unit == "m" and instance.item not in reactions
        weight = mass * float(np.linalg.norm(mechanics.model.scene.gravity)) if carries else 0.0
        found.append(ExpectedContact(instance.item, instance.law, (g, i), impact, max(0.0, -gap), weight))
    return found


def _law(mechanics: Mechanics, place: Place) -> Any:
    return mechanics.model.groups[place[0]].instances[place[1]].law


def _speed(rows: Array, u: Array) -> float:
    """Speed along the directions of rows (k, nu) at velocities u (nu,); 0 where it is no more than round-off."""
    speed, of_points = np.linalg.norm(rows @ u), np.linalg.norm(np.abs(rows) @ np.abs(u))
    return float(speed) if speed > ROUND_OFF * of_points else 0.0
