"""Joints with clearance replaced by ideal joints: a start for their scene, and the reactions of the ideal joints."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.model.model import FLAT, build, scene_length
from mbdae.system.model.numbering import constraint_rows
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.start.nearest import start_positions
from mbdae.system.start.start import Starter


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
    mechanics = _mechanics(scene, kept | closed)
    starter = Starter(mechanics, t0)
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
