"""Stability of a planar scene against motions that leave its plane, which its own equations do not have.

The same scene in space, at the same state, is linearised; motions in the plane and out of it do not influence each other there,
and those out of it are looked at alone.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from mbdae.analysis.elastic import stresses_of
from mbdae.analysis.frame import IDENTITY, attitude, body_of, frame_at
from mbdae.analysis.modes import growth, softest_beam
from mbdae.analysis.pencil import Pencil, complete_system
from mbdae.analysis.reduced import errors_of, free_basis, reduced
from mbdae.analysis.spectrum import Spectrum, spectrum
from mbdae.analysis.state import pencil_with_errors, structure
from mbdae.errors import MbdaeError, warn
from mbdae.formulations.index3 import Index3
from mbdae.scene.components import Beam
from mbdae.scene.scene import SceneData
from mbdae.scene.topology import not_joined
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.beams import drawn_quaternion
from mbdae.system.model.nodes import Node
from mbdae.system.model.rotations import quaternion_product, turned
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared, modelled, prepare
from mbdae.system.start.start import Start

LEAST = 1e-9  #: a moment of inertia of at most this part of the largest of a body counts as none
LOOK = "give True to have the stability of a planar scene against motions out of its plane looked at, or False"
#: what a print of a planar scene says, by what was found
OUT_OF_PLANE = {"stable": "planar: motions out of the plane are stable", "unstable": "planar: motions out of the plane grow",
                None: "planar: motions out of the plane are not looked at"}  # fmt: skip


def looked_at(prepared: Prepared, frame: str) -> str | None:
    """"stable" or "unstable": whether small motions out of the plane of a planar scene grow at the state of `prepared`, which
    rests or moves steadily in the frame of that name; None where there are none, or nothing is known. Growth is told by a
    warning."""
    model = prepared.model
    if not model.planar or not (model.lines or not_joined(model.scene)):
        return None
    try:
        found = _spectrum(prepared, frame)
    except (MbdaeError, ArithmeticError, RuntimeError, TypeError, ValueError):
        return None  # in space the scene lacks what the plane does not ask for, or it contains what cannot be copied
    if found is None or found.stable is None:
        return None
    if not found.stable:
        worst = int(np.argmax(found.values.real))
        rate = f" by {found.values[worst].real:.4g}/s" if found.values[worst].real > found.errors[worst] else ""
        warn(f"scene '{model.scene.name}' is planar, and small motions out of its plane grow{rate} here: what it says of this "
             "state holds while something keeps it in the plane; Scene(..., space='spatial') has these motions")  # fmt: skip
    return "stable" if found.stable else "unstable"


def _spectrum(planar: Prepared, frame: str) -> Spectrum | None:
    """The spectrum of the motions out of the plane; None where there are none, or an inertia that counts is not stated."""
    scene, unknown = _in_space(planar.model.scene)
    start = _state_in_space(planar, scene)
    prepared = prepare(scene, start)
    m, (t, q, u, s) = prepared.mechanics, (start.t, start.q, start.u, prepared.start.s)
    if len(s) != len(prepared.mechanics.numbering.states):
        return None
    axes = frame_at(prepared.model, body_of(scene, frame), q, u)
    system = complete_system(m, Index3().spec())
    state = (t, q, u, s, stresses_of(m, q, u))
    whole = pencil_with_errors(system, m, axes, state, True)
    p, places = _cut(whole, _across(m, whole))
    if not len(places):
        return None
    moving = [n.name for n in prepared.model.nodes if n.kind is NodeKind.SPATIAL and n.name in unknown
              and np.isin(np.arange(n.u + 3, n.u + 5), places).any()]  # fmt: skip
    known = structure(system, m, axes, state, places)
    if m.model.lines:
        found = growth(p, softest_beam(m.model), known)
    else:
        units = m.velocity_units[places]
        equations = reduced(p, free_basis(p.constraints, units))
        if not len(equations.M):
            return None
        found = spectrum(equations, errors_of(p, equations, units), None, known)
    at_rest = not axes.turns and not np.any(u)
    return found if at_rest or not moving else replace(found, stable=None)


def _in_space(scene: SceneData) -> tuple[SceneData, set[str]]:
    """A copy of the scene in space, and the bodies that have no inertia about some axis, because one about z alone is stated or
    they are slender: there they are given that of their largest. At rest it does not decide what is stable."""
    found, unknown = copy.deepcopy(scene), set()
    found.space = "spatial"
    for body in (b for b in found.bodies if b.inertia is not None and not b.is_point and not isinstance(b, Beam)):
        moments, axes = np.linalg.eigh(np.asarray(body.inertia))
        if moments[-1] > 0 and moments[0] <= LEAST * moments[-1]:
            vars(body)["inertia"] = (axes * np.where(moments <= LEAST * moments[-1], moments[-1], moments)) @ axes.T
            unknown.add(body.name)
    return found, unknown


def _state_in_space(planar: Prepared, scene: SceneData) -> Start:
    """The state of a planar scene as one of the same scene in space."""
    here, start, model = planar.model, planar.start, modelled(scene)[0]
    q, u = np.zeros(model.nq), np.zeros(model.nu)
    flat = {node.name: node for node in here.nodes}
    for node in model.nodes:
        if node.name not in flat:
            continue
        other = flat[node.name]
        own, old = (slice(n.q, n.q + n.kind.sizes[0]) for n in (node, other))
        speed, slow = (slice(n.u, n.u + n.kind.sizes[1]) for n in (node, other))
        q[own], u[speed] = _node_in_space(node, other, start.q[old], start.u[slow])
    names = tuple(planar.mechanics.numbering.states.values())
    return Start(start.t, q, u, start.s, np.zeros_like(u), np.zeros(0), names=names)


def _node_in_space(node: Node, flat: Node, q: Array, u: Array) -> tuple[Array, Array]:
    """Positions and velocities of a node in space from those of the same node in the plane."""
    if node.kind is NodeKind.COORDINATE:
        return q, u
    n = node.kind.translations
    found, speed = np.zeros(node.kind.sizes[0]), np.zeros(node.kind.sizes[1])
    found[: min(n, 2)], speed[: min(n, 2)] = q[:2], u[:2]
    if node.kind is NodeKind.SPATIAL:
        assert flat.body is not None
        angle = np.arctan2(*attitude(replace(flat, q=0), q)[1::-1, 0]) - np.arctan2(*flat.body.drawn.rotation[1::-1, 0])
        found[3:] = quaternion_product(turned(IDENTITY, np.array([0.0, 0.0, angle])), drawn_quaternion(node.body))
        speed[3:] = attitude(replace(node, q=0), found).T @ np.array([0.0, 0.0, u[2]])
    return found, speed


def _across(m: Mechanics, p: Pencil) -> NDArray[np.bool_]:
    """Which unknowns of the pencil take part in motions out of the plane: z and rotations about x and y of all nodes, and what is
    coupled with them."""
    first = np.zeros(p.A.shape[0], dtype=bool)
    for node in m.model.nodes:
        if node.kind is not NodeKind.COORDINATE:
            size, n = node.kind.sizes[1], node.kind.translations
            first[node.u + np.array([2, *range(n, size - 1)] if n == 3 else [], dtype=int)] = True
    assert p.errors is not None
    joined = (abs(p.A) > p.errors.A) + (abs(p.E) > p.errors.E)
    label = connected_components(joined, directed=False)[1]
    return np.isin(label, np.unique(label[first]))


def _cut(p: Pencil, keep: NDArray[np.bool_]) -> tuple[Pencil, NDArray[np.intp]]:
    """The pencil of some of its unknowns, and the displacements (of all) among them."""
    assert p.errors is not None
    at = np.flatnonzero(keep)
    new = np.cumsum(keep) - 1
    places = {kind: new[own[keep[own]]] for kind, own in p.places.items()}
    displaced = p.places["p"][keep[p.places["p"]]]
    cut: list[Any] = [Pencil(x.E[at][:, at], x.A[at][:, at], places, p.C[displaced][:, displaced]) for x in (p, p.errors)]
    return replace(cut[0], errors=cut[1]), displaced
