"""Derivatives of the tree program: by complex step, symmetric stiffness, and what both say without the geometric term."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from recursive_scenes import SCENES, SPRING, random_state, spring_chain

import mbdae as mb
from mbdae.formulations import ODE, system_for
from mbdae.kernels.tree_plan import TreePlan, tree_plan
from mbdae.system.base import Array
from mbdae.system.model.nodes import rotation_matrices
from mbdae.system.model.trees import Tree
from mbdae.system.motion.constrained import Evaluator
from mbdae.system.prepare import Prepared, prepare

SEEDS = ("q", "u", "up", "wu", "wq")


def inputs(prepared: Prepared, tree: Tree, plan: TreePlan, rng: np.random.Generator) -> dict[str, Any]:
    """Every input of a tree's program at a random state: numbers of the scene, random accelerations and forces."""
    e = prepared.all_bodies
    t, q, u = random_state(prepared, rng)
    nb = e.numbering
    y, yp = np.zeros((2, 1, nb.n))
    y[:, : nb.nq], y[:, nb.nq : nb.nq + nb.nu], yp[:, nb.nq : nb.nq + nb.nu] = q, u, rng.normal(size=u.shape)
    W = Evaluator(nb).at_states("all", lambda _: np.arange(nb.width), t, y, yp)[0]
    drawn = ("wu", "wq", "force", "own")
    return {str(symbol): complex(rng.normal() if place[0] in drawn else W[e.moved.slot(e.numbering, tree, place)])
            for symbol, place in plan.places.items()}


def evaluated(plan: TreePlan) -> Callable[[dict[str, Any]], dict[str, complex]]:
    """The program step by step in complex numbers: input values -> values of all steps."""
    lines = [f"{name} = {expression}" for name, expression in plan.program.steps.items()]
    code = compile("\n".join(lines), "program", "exec")

    def run(values: dict[str, Any]) -> dict[str, complex]:
        table = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "tan": np.tan, **values}
        exec(code, {}, table)
        return table

    return run


@pytest.mark.parametrize("scene", [*SCENES, spring_chain])
def test_jacobian_of_the_program_by_complex_step(scene: Callable[[], mb.Scene]) -> None:
    """All rows and motions by all inputs; F(x + 1e-30 i) has no cancellation."""
    prepared, rng, step = prepare(scene()), np.random.default_rng(12), 1e-30
    for tree in prepared.all_bodies.moved.trees:
        plan = tree_plan(tree.structure).programmed
        outputs, derivatives = [*plan.rows, *plan.motion], plan.derivatives
        run, values = evaluated(plan), inputs(prepared, tree, plan, rng)
        seeds = [symbol for symbol, place in plan.places.items() if place[0] in SEEDS]
        here = run(values)
        exact = {(target, place): eval(str(e), {}, here).real for target, place, e in derivatives}
        for seed in seeds:
            moved = run({**values, str(seed): values[str(seed)] + 1j * step})
            column = {target: complex(eval(str(e), {}, moved)).imag / step for target, e in outputs}
            size = 1 + max(abs(x) for x in column.values())
            for target, slope in column.items():
                assert abs(exact.get((target, plan.places[seed]), 0.0) - slope) < 1e-12 * size, (target, seed)


def moments(prepared: Prepared, q: Array, u: Array, up: Array) -> tuple[Array, Array]:
    """M (n, 3), axes b (n, 3) of a chain: the moment M a - f of all behind a joint about its point, without its spring."""
    e, m, t = prepared.all_bodies, prepared.mechanics, np.zeros(1)
    all_q, all_u = e.states(t, np.r_[q, u][None])
    w = (e.accelerations(t, q[None], u[None], up[None]) @ m.mass - m.load(t, all_q, all_u, np.zeros((1, 0))))[0]
    joints, nodes = prepared.model.scene.joints, {n.name: n for n in prepared.model.nodes if n.body is not None}
    x = {name: all_q[0, n.q : n.q + 3] for name, n in nodes.items()}
    R = {name: rotation_matrices(all_q[:, n.q + 3 : n.q + 7])[0] for name, n in nodes.items()}
    M, b = np.zeros((len(joints), 3)), np.zeros((len(joints), 3))
    for i, c in enumerate(joints):
        l, law = c.l.name, c.joint
        point = x[l] + R[l] @ (law.at - c.l.drawn.position)
        b[i] = R[l] @ law.axis / np.linalg.norm(law.axis)
        for behind in (joint.l.name for joint in joints[i:]):
            force, torque = np.split(w[nodes[behind].u : nodes[behind].u + 6], 2)
            M[i] += R[behind] @ torque + np.cross(x[behind] - point, force)
    return M, b


def stiffness(prepared: Prepared, state: tuple[Array, Array, Array], geometric: bool) -> Array:
    """d(b.M + spring)/dq by differences of order 8; without the geometric term the axes b stand still (Eq. 29 as printed)."""
    q, u, up = state
    b0, h, weights = moments(prepared, *state)[1], 2e-3, (4 / 5, -1 / 5, 4 / 105, -1 / 280)

    def rows(q: Array) -> Array:
        M, b = moments(prepared, q, u, up)
        return np.asarray(np.sum((b if geometric else b0) * M, axis=1) + SPRING * q)

    columns = [sum(w * (rows(q + (k + 1) * h * d) - rows(q - (k + 1) * h * d)) for k, w in enumerate(weights)) / h
               for d in np.eye(len(q))]
    return np.array(columns).T


def asymmetry(K: Array) -> float:
    return float(np.max(np.abs(K - K.T)) / np.max(np.abs(K)))


def equilibrium(system: Any) -> Array:
    """q where the chain hangs at rest in its springs, by Newton on the residual."""
    n = system.n // 2
    y, still, F = np.zeros(system.n), np.zeros(system.n), np.empty(system.n)
    for _ in range(50):
        system.residual(0.0, y, still, F)
        y[:n] -= np.linalg.solve(system.jacobian_parts(0.0, y, still)[0][n:, :n], F[n:])
        if np.max(np.abs(F)) < 1e-12:
            return y[:n].copy()
    raise AssertionError("no equilibrium")


def test_stiffness_is_symmetric_at_a_loaded_equilibrium() -> None:
    """A potential has a symmetric second derivative; without the geometric term it would not be."""
    prepared = prepare(spring_chain())
    system = system_for(prepared, ODE())
    q, rest = equilibrium(system), np.zeros(system.n // 2)
    K = system.jacobian_parts(0.0, np.r_[q, rest], np.zeros(system.n))[0][len(q) :, : len(q)]
    assert np.max(np.abs(q)) > 0.3  # the springs carry moments: the term does not vanish
    assert asymmetry(K) < 1e-12
    state = (q, rest, rest)
    full, fixed = (stiffness(prepared, state, geometric) for geometric in (True, False))
    assert np.max(np.abs(K - full)) < 1e-9 * np.max(np.abs(K))
    assert asymmetry(fixed) > 1e-2
    assert np.max(np.abs(K - fixed)) > 1e-2 * np.max(np.abs(K))


def test_geometric_term_is_seen_in_motion_too() -> None:
    """Away from rest inertia forces load the joints as well: the axis of a joint turns with the bodies before it."""
    prepared, rng = prepare(spring_chain()), np.random.default_rng(2)
    system = system_for(prepared, ODE())
    _, q, u = random_state(prepared, rng)
    up = rng.normal(size=q.shape)
    exact = system.jacobian_parts(0.0, np.r_[q[0], u[0]], np.r_[u[0], up[0]])[0][q.size :, : q.size]
    full, fixed = (stiffness(prepared, (q[0], u[0], up[0]), geometric) for geometric in (True, False))
    assert np.max(np.abs(exact - full)) < 2e-10 * np.max(np.abs(exact))
    assert np.max(np.abs(exact - fixed)) > 1e-2 * np.max(np.abs(exact))
