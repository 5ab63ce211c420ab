"""The distance between two motions of a scene, a number without unit in which every error of a run is measured."""

from __future__ import annotations

import numpy as np

from mbdae.system.base import Array
from mbdae.system.model.nodes import Node
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared

Motion = tuple[Array, Array]  #: q (nt, nq), u (nt, nu) of all nodes


def motion_distance(prepared: Prepared, a: Motion, b: Motion) -> Array:
    """(nt,) distance of two motions at the same times: the largest difference of a position over the scene's length, or of an
    angle in rad. In scenes without beams (their velocities contain vibrations) also of velocities, over the larger of length /
    characteristic time and the speed reached; but not while one of the motions is in contact, because an impact that is slightly
    later would count as a large error of velocity."""
    m, (q_a, u_a), (q_b, u_b) = prepared.mechanics, a, b
    worst = np.zeros(len(q_a))
    apart = np.ones(len(q_a), dtype=bool)
    if prepared.contacts:
        apart = ~np.logical_or(touching(m, *a), touching(m, *b))
    for mask, unit in ((~m.rotational, prepared.length), (m.rotational, 1.0)):
        if mask.any() and not m.model.lines:
            reference = max(unit / prepared.time, float(np.max(np.abs(u_b[:, mask]))))
            worst = np.maximum(worst, apart * np.max(np.abs(u_a - u_b)[:, mask], axis=1) / reference)
    for node in m.model.nodes:
        at = slice(node.q, node.q + node.kind.sizes[0])
        worst = np.maximum(worst, position_distance(prepared, node, q_a[:, at], q_b[:, at]))
    return worst


def position_distance(prepared: Prepared, node: Node, a: Array, b: Array) -> Array:
    """(nt,) distance of two positions a, b (nt, size) of a node: displacement over the scene's length, or angle in rad."""
    n, unit = node.kind.translations, prepared.length if node.unit == "m" else 1.0
    apart = np.linalg.norm(a[:, :n] - b[:, :n], axis=1) / unit
    if a.shape[1] == 3 and node.kind.turns:
        apart = np.maximum(apart, np.abs(a[:, 2] - b[:, 2]))
    elif a.shape[1] == 7:
        apart = np.maximum(apart, _angle_between(a[:, 3:], b[:, 3:]))
    return np.asarray(apart)


def touching(mechanics: Mechanics, q: Array, u: Array) -> Array:
    """(nt,) bool: whether any contact of a scene is closed."""
    gaps = gaps_of(mechanics, np.zeros(len(q)), q, u)
    return np.asarray(np.any(np.hstack([gap for gap, _ in gaps.values()]) < 0, axis=1))


def distance(prepared: Prepared, t: Array, a: Array, b: Array) -> Array:
    """(nt,) `motion_distance` of two solutions a, b (nt, n) in the unknowns of any form at times t (nt,)."""
    return motion_distance(prepared, prepared.states(t, a)[:2], prepared.states(t, b)[:2])


def _angle_between(P: Array, Q: Array) -> Array:
    """Angle (nt,) of the rotation between quaternions (nt, 4) of any length."""
    p, q = P / np.linalg.norm(P, axis=1, keepdims=True), Q / np.linalg.norm(Q, axis=1, keepdims=True)
    gap = np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    return np.asarray(4 * np.arcsin(np.clip(gap / 2, 0, 1)))
