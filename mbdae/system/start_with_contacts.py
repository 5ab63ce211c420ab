"""Typical magnitudes of the unknowns, to which tolerances are relative.

The contacts of a scene before its run: penetration at the start, and the penetration to be expected.

Joints with clearance replaced by ideal joints: a start for their scene, and the reactions of the ideal joints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.symbolic.law import Impact
from mbdae.system.base import Array
from mbdae.system.changes import RigidMotions
from mbdae.system.model.feedback import FLAT, scene_length
from mbdae.system.model.model import build
from mbdae.system.model.numbering import constraint_rows
from mbdae.system.motion.constrained import largest_entries, row_lengths
from mbdae.system.motion.mechanics import InstanceNumber, Mechanics, approaches, effective_masses, in_units
from mbdae.system.motion.states import gaps_of
from mbdae.system.nearest import start_positions
from mbdae.system.start import Start, Starter

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


def scales(prepared: Any, system: Any) -> Array:
    """(n,) typical magnitude of every unknown of an `Assembly` of a `Prepared` scene, in its own unit."""
    mechanics, T, nb, spec = prepared.mechanics, prepared.time, system.numbering, system.spec
    q, u = nb.of_positions, nb.of_velocities
    blocks = {
        "q": mechanics.position_units[q], "v": mechanics.velocity_units[u] / T, "s": state_scale(mechanics),
        "z": np.full(len(nb.stresses), stress_scale(mechanics, T)),
    }
    if "lambda" in spec.blocks:
        kept = nb.rows_among(mechanics.rows)
        force, reach = (scale[kept] for scale in _multiplier_scales(mechanics, prepared, T))
        force = force / nb.scaling()  # the unknown of a row that its law scales is the multiplier divided by this scaling
        blocks |= {"lambda": force * T, "mu": reach} if spec.derivatives else {"lambda": force, "mu": reach / T}
    return np.concatenate([blocks[kind] for kind in ("q", "v", "s", "z", *spec.blocks)])


def sizes_of_rows(mechanics: Mechanics, start: Start) -> tuple[Any, Array, Array]:
    """G (m, nu) at the start, the lengths (m,) of its rows in unit displacements, and SLACK over the displacement (m,) that a
    unit of mu causes."""
    G = mechanics.constraint_matrix(np.array([start.t]), start.q)
    move, turn = (largest_entries(G[:, np.flatnonzero(mask)]) for mask in (~mechanics.rotational, mechanics.rotational))
    arm = np.where(move > 0, move / mechanics.model.length, np.where(turn > 0, turn, 1.0))
    return G, row_lengths(in_units(mechanics, G))[:, 0], SLACK / arm


def _multiplier_scales(mechanics: Mechanics, prepared: Any, T: float) -> tuple[Array, Array]:
    """Scales (m,) of lambda and of mu. That of lambda is the reaction that moves a body by its unit displacement (the scene's
    length or 1 rad) in the characteristic time T (s), or the reaction at the start if that is larger.

    Times the unit displacement of its row this is an energy; the largest energy of all rows is used for every row. A direction
    that carries no load at the start may carry it a quarter turn later, and a tolerance relative to its small value at the start
    would stop IDA there. The scale of mu is SLACK over the displacement that a unit of mu causes."""
    if not mechanics.m:
        return np.zeros(0), np.zeros(0)
    G, size, reach = prepared.sizes_of_rows
    mobility = mechanics.mobility(G)
    force = np.maximum(size / T**2 / np.maximum(mobility, 1e-300), np.abs(prepared.start.multipliers))
    return np.max(force * size) / size, reach


def stress_scale(mechanics: Mechanics, T: float) -> float:
    """Scale of the stresses of beams, N or N m: the force that moves the mass of the heaviest beam by the scene's length in the
    characteristic time T (s)."""
    if not mechanics.model.lines:
        return 1.0
    return float(max(line.beam.mass for line in mechanics.model.lines) * mechanics.model.length / T**2)


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
    place: InstanceNumber
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
        """What the output of `Scene.check` says of the contact after its name: its law, whether its force jumps, and the
        penetration to be expected."""
        expected = f"of about {self.depth:.1g} {self.unit} expected" if math.isfinite(self.depth) else "not known before the run"
        jumps = "; its force jumps as it closes, and runs have no derivatives" if self.law.jumps else ""
        return f"{self.law.summary_of_contact()}{jumps}; penetration {expected}"

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
    masses: dict[InstanceNumber, float] = {}
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


def _law(mechanics: Mechanics, place: InstanceNumber) -> Any:
    return mechanics.model.groups[place[0]].instances[place[1]].law


def _speed(rows: Array, u: Array) -> float:
    """Speed along the directions of rows (k, nu) at velocities u (nu,); 0 where it is no more than round-off."""
    speed, of_points = np.linalg.norm(rows @ u), np.linalg.norm(np.abs(rows) @ np.abs(u))
    return float(speed) if speed > ROUND_OFF * of_points else 0.0


@dataclass
class IdealStart:
    """A start with every pin centred in its bearing: q, u of all nodes; changes: sentences on what was changed to close loops;
    reactions: name of a joint -> magnitude of the reaction of its ideal joint, N."""

    q: Array
    u: Array
    changes: list[str]
    reactions: dict[str, float] = field(default_factory=dict)


def ideal_start(scene: SceneData, kept: dict[str, str], t0: float) -> IdealStart:
    """The start of a scene with joints with clearance: its pins are centred and move as with ideal joints at time t0 (s).

    A pin that is a point mass drawn off the centre keeps its position, and a body whose velocity the user states keeps it: the
    joint is then not replaced by an ideal one for positions, or for velocities. kept: recursive joints treated as kinematic ->
    why."""
    closed = {c.name: "clearance" for c in scene.joints if c.loose and not _off_centre(c, scene)}
    starter = Starter(_mechanics(scene, kept | closed), t0)
    q = start_positions(starter)
    starter.check_branches(q)
    moving = {name: why for name, why in closed.items() if not _has_velocity(scene[name])}
    together = starter if moving == closed else Starter(_mechanics(scene, kept | moving), t0, changes=starter.changes)
    u = together.consistent_velocities(q)
    return IdealStart(q, u, starter.changes, _reactions(together, q, u, moving))


def _mechanics(scene: SceneData, kept: dict[str, str]) -> Mechanics:
    model = build(scene, kept)
    return Mechanics(model, constraint_rows(model))


def _off_centre(c: Connection, scene: SceneData) -> bool:
    """Whether the pin is a point mass that is drawn off the centre of the bearing."""
    return c.l.is_point and float(np.linalg.norm(c.l.drawn.position - c.joint.at)) > FLAT * scene_length(scene)


def _has_velocity(c: Connection) -> bool:
    return bool(c.k.given_velocity or c.l.given_velocity)


def _reactions(starter: Starter, q: Array, u: Array, joints: dict[str, str]) -> dict[str, float]:
    """Name of an ideal joint, of those in `joints` -> magnitude of its reaction at the start, N."""
    mechanics = starter.mechanics
    if not mechanics.m or not joints:
        return {}
    _, multipliers = mechanics.accelerations(starter.t, q[None], u[None], starter.states(q, u)[None])
    found = dict.fromkeys(joints, 0.0)
    for row, value in zip(mechanics.rows, multipliers[0], strict=True):
        joint, _, name = row.name.rpartition(".")
        if joint in found and name in ("x", "y", "z"):
            found[joint] = float(np.hypot(found[joint], value))
    return found
