"""A tree as a scene of the package, in any joint models, and what the package says of it in a state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import sympy as sp
from scipy.spatial.transform import Rotation

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.laws import joints
from mbdae.results.sensors import wrenches
from mbdae.results.states import States
from mbdae.system.prepare import Prepared, prepare
from oracles.trees import DRIVE, FORCE, GROUND, LEAD, TORQUE, Answer, Array, State, Tree, Wave, far

LAWS: dict[str, Any] = {
    "revolute": joints.Revolute, "prismatic": joints.Prismatic, "cylindrical": joints.Cylindrical, "screw": joints.Screw,
    "universal": joints.Universal, "planar": joints.Planar, "spherical": joints.Spherical, "free": joints.Free,
    "point_on_line": joints.PointOnLine, "point_on_plane": joints.PointOnPlane, "fixed_orientation": joints.FixedOrientation,
}
MODELS = ("kinematic", "classical", "recursive", "mixed")
OPTIONS = ("spring", "damper", "load")


def text(wave: Wave) -> Any:
    """A wave as an expression of time."""
    return wave.constant + wave.slope * mb.t + wave.height * sp.sin(2 * mb.t)


def models_of(tree: Tree, model: str) -> list[Any]:
    """The model of every joint; joints that do not admit one are kinematic."""
    cycle = {"kinematic": [mb.Kinematic()], "classical": [mb.Classical()], "recursive": [mb.Recursive()],
             "mixed": [mb.Recursive(), mb.Kinematic(), mb.Classical()]}[model]
    chosen = [cycle[i % len(cycle)] for i in range(len(tree.branches))]
    return [mb.Kinematic() if isinstance(m, mb.Classical) and b.of.rotates else m
            for m, b in zip(chosen, tree.branches, strict=True)]


def scene_of(tree: Tree, model: str, number: int = 0) -> mb.Scene:
    """The scene with its joints in a model."""
    s = mb.Scene(f"tree {number}", gravity=tuple(tree.gravity), space="planar" if tree.flat else "spatial")
    bodies = [s.point_mass(f"b{i}", b.mass, at=b.centre) if b.inertia is None else
              s.rigid_body(f"b{i}", b.mass, b.inertia, at=b.centre, rotation=b.rotation)
              for i, b in enumerate(tree.branches)]
    bodies.append(s.ground)
    for i, (b, chosen) in enumerate(zip(tree.branches, models_of(tree, model), strict=True)):
        k, l = (bodies[b.parent], bodies[i]) if b.outer == "l" else (bodies[i], bodies[b.parent])
        if b.kind == "weld":
            s.weld(f"J{i}", k, l, at=b.at)
            continue
        names = [name for name, _, _ in b.of.steps]
        on = {option: {name: x for name, x in zip(names, getattr(b, option), strict=True) if x} or None for option in OPTIONS}
        s.joint(LAWS[b.kind], f"J{i}", k, l, at=b.at, axis=b.axes[:, 2], axis_x=b.axes[:, 0], model=chosen,
                prescribed={names[n]: text(DRIVE) for n in b.driven} or None, **on,
                **({"lead": LEAD} if b.kind == "screw" else {}))
    for i, spring in enumerate(tree.springs):
        s.spring(f"S{i}", bodies[spring.k], bodies[spring.l], spring.at_k, spring.at_l, stiffness=spring.stiffness,
                 damping=spring.damping, length=spring.length)
    if tree.pushed is not None:
        force = [*map(text, FORCE[:2]), 0 if tree.flat else text(FORCE[2])]
        s.force("push", bodies[tree.pushed[0]], force, at=tree.pushed[1])
    if tree.twisted is not None:
        torque = [*([0, 0] if tree.flat else map(text, TORQUE[:2])), text(TORQUE[2])]
        s.torque("twist", bodies[tree.twisted], torque, frame="body")
    return s


def unknowns(tree: Tree, prepared: Prepared, state: State, at: Answer) -> tuple[Array, Array]:
    """Positions (nq,) and velocities (nu,) of all nodes of a prepared scene, in a state whose bodies the reference has placed."""
    model, turns = prepared.model, _turns(tree, state)
    q, u = np.zeros(model.nq), np.zeros(model.nu)
    for i, body in enumerate(model.scene.bodies):
        node = model.node(body)
        size, speeds = node.kind.sizes
        if tree.flat:
            q[node.q : node.q + size] = np.r_[at.r[i, :2], body.heading + turns[i]][:size]
            u[node.u : node.u + speeds] = np.r_[at.v[i, :2], at.w[i, 2]][:speeds]
        else:
            q[node.q : node.q + size] = np.r_[at.r[i], Rotation.from_matrix(at.R[i]).as_quat()[[3, 0, 1, 2]]][:size]
            u[node.u : node.u + speeds] = np.r_[at.v[i], at.R[i].T @ at.w[i]][:speeds]
    for node, i, name in _coordinates(tree, prepared):
        branch = tree.branches[i]
        if name == "rotation":
            q[node.q : node.q + 4] = Rotation.from_matrix(state.rotations[i]).as_quat()[[3, 0, 1, 2]]
            spin = state.spins[i] if branch.sign > 0 else -state.rotations[i].T @ state.spins[i]
            u[node.u : node.u + 3] = spin  # of l relative to k along the joint's axes in l
        else:
            n = [step for step, _, _ in branch.of.steps].index(name)
            q[node.q], u[node.u] = state.values[i][n], state.rates[i][n]
    return q, u


def _turns(tree: Tree, state: State) -> list[float]:
    """Angle by which every body of a planar tree has turned."""
    found: list[float] = []
    for b, values in zip(tree.branches, state.values, strict=True):
        own = sum(v * b.axes[2, 2] for (_, kind, _), v in zip(b.of.steps, values, strict=True) if kind == "turn")
        found.append((found[b.parent] if b.parent != GROUND else 0.0) + b.sign * own)
    return found


def _coordinates(tree: Tree, prepared: Prepared) -> Iterator[tuple[Any, int, str]]:
    """Nodes of joint coordinates with the number of their branch and their name."""
    for i, b in enumerate(tree.branches):
        for name in [*(step for step, _, _ in b.of.steps), *(["rotation"] if b.of.rotates else [])]:
            node = prepared.model.coordinate_node(f"J{i}", name)
            if node is not None:
                yield node, i, name


def off(tree: Tree, prepared: Prepared, state: State, exact: Answer) -> dict[str, float]:
    """How far the package is off, in the same state: accelerations, forces of joints and of drives, and what is integrated, each
    over the largest acceleration or force."""
    q, u = unknowns(tree, prepared, state, exact)
    t, s = np.array([state.t]), np.zeros((1, len(prepared.mechanics.numbering.states)))
    a, multipliers = (found[0] for found in prepared.with_all_rows.accelerations(t, q[None], u[None], s))
    expected, known = _expected(tree, prepared, exact)
    size = max(np.max(np.abs(exact.a)), 1e-3)
    force = max(np.max(np.abs(exact.wrench)), 1e-3)
    names = [c.name for c in prepared.model.scene.connections]
    shown = wrenches(prepared, States(t, q[None], u[None], s, None))[0][[names.index(f"J{i}") for i in range(len(tree.branches))]]
    wrench = exact.wrench * ([1, 1, 0, 0, 0, 1] if tree.flat else [1] * 6)
    points = np.array([b.inertia is None for b in tree.branches])
    wrench[points, 3:] = shown[points, 3:] = 0.0  # a point mass takes no torque, but the carrier's point may be named
    rows = [row.name for row in prepared.with_all_rows.rows]
    driven = [(multipliers[rows.index(name)], value) for name, value in _drives(tree, exact).items() if name in rows]
    found = {"accelerations": far(a[known], expected[known], size), "reactions": far(shown, wrench, force),
             "drives": max((far(*pair, force) for pair in driven), default=0.0)}
    system = system_for(prepared)
    if system.rhs is not None and not prepared.rows:
        nb, out = prepared.all_bodies.numbering, np.empty(system.n)
        system.rhs(state.t, np.r_[q[nb.of_positions], u[nb.of_velocities]], out)
        of = nb.of_velocities
        found["right-hand side"] = far(out[nb.nq :][known[of]], expected[of][known[of]], size)
    return found


def _drives(tree: Tree, exact: Answer) -> dict[str, float]:
    """Forces of prescribed coordinates by the names of their rows."""
    return {f"J{i}.{LAWS[tree.branches[i].kind].drive_name(tree.branches[i].of.steps[n][0])}": force
            for (i, n), force in exact.drives.items()}


def _expected(tree: Tree, prepared: Prepared, exact: Answer) -> tuple[Array, Array]:
    """Accelerations (nu,) of all nodes, and which of them are known: those of free rotations are seen in their bodies."""
    a, known = np.zeros(prepared.model.nu), np.ones(prepared.model.nu, dtype=bool)
    for i, body in enumerate(prepared.model.scene.bodies):
        node = prepared.model.node(body)
        own = np.r_[exact.a[i, :3], exact.R[i].T @ exact.a[i, 3:]]
        speeds = node.kind.sizes[1]
        a[node.u : node.u + speeds] = (own[[0, 1, 5]] if tree.flat else own)[:speeds]
    for node, i, name in _coordinates(tree, prepared):
        if name == "rotation":
            known[node.u : node.u + 3] = False
        else:
            a[node.u] = exact.second[i][[step for step, _, _ in tree.branches[i].of.steps].index(name)]
    return a, known


def compared(tree: Tree, model: str, states: list[State], exact: list[Answer], number: int = 0) -> dict[str, float]:
    """The largest differences over some states."""
    prepared = prepare(scene_of(tree, model, number))
    worst: dict[str, float] = {}
    for state, answer in zip(states, exact, strict=True):
        for name, value in off(tree, prepared, state, answer).items():
            worst[name] = max(worst.get(name, 0.0), value)
    return worst
