"""Kinematic, classical and recursive joints at one state: equal accelerations, forces and torques."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from recursive_scenes import prescribed, random_states, tree_on_free_body, tree_on_ground

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.solution import Stats
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare

R = mb.Recursive()


def of_bodies(prepared: Prepared, velocities: Array) -> Array:
    """(nt, n) of the bodies alone, in the order of the scene."""
    nodes = [n for n in prepared.model.nodes if n.body is not None]
    return np.hstack([velocities[:, n.u : n.u + n.kind.sizes[1]] for n in nodes])


def variants(scene: mb.Scene) -> tuple[Prepared, Prepared, Prepared]:
    """The scene as it is, and with its recursive joints classical and kinematic; nodes of bodies come first in each."""
    names = [c.name for c in scene.joints if c.recursive]
    return prepare(scene), *(prepare(scene.replace(*names, model=m)) for m in (mb.Classical(), mb.Kinematic()))  # type: ignore[return-value]


@pytest.mark.parametrize("scene", [tree_on_ground, tree_on_free_body, prescribed])
def test_accelerations_agree(scene: Callable[[], mb.Scene]) -> None:
    """50 random spatial states with springs, dampers and drives: 1e-12 of the largest acceleration of a body."""
    recursive, classical, kinematic = variants(scene())
    for t, q, u in random_states(recursive, 50, seed=8):
        found = []
        for p in (recursive, classical, kinematic):
            m = p.mechanics
            s = np.zeros((1, len(m.numbering.states)))
            found.append(of_bodies(p, m.accelerations(t, q[:, : m.nq], u[:, : m.nu], s)[0]))
        for other in found[1:]:
            assert np.max(np.abs(other - found[0])) < 1e-12 * np.max(np.abs(found[0]))


def test_the_right_hand_side_is_that_of_the_constrained_equations() -> None:
    """What CVODE integrates, M^-1 of the tree's own kernels, gives the accelerations of the joint coordinates to 1e-12."""
    recursive, classical, _ = variants(tree_on_ground())
    system, nb = system_for(recursive), recursive.all_bodies.numbering
    assert system.rhs is not None
    for t, q, u in random_states(recursive, 50, seed=8):
        m = classical.mechanics
        exact = m.accelerations(t, q[:, : m.nq], u[:, : m.nu], np.zeros((1, 0)))[0][0][nb.of_velocities]
        out = np.empty(system.n)
        system.rhs(float(t[0]), np.r_[q[0][nb.of_positions], u[0][nb.of_velocities]], out)
        assert np.max(np.abs(out[nb.nq :] - exact)) < 1e-12 * np.max(np.abs(exact))
        assert np.max(np.abs(out[: nb.nq] - u[0][nb.of_velocities])) == 0


def test_accelerations_differ_where_a_spring_is_missing() -> None:
    """Negative control: the comparison sees a joint spring of 1 N m/rad."""
    with_spring, without = tree_on_ground(), tree_on_ground()
    without["B"].laws[:] = [law for law in without["B"].laws if "Spring" not in type(law).__name__]
    a, b = prepare(with_spring), prepare(without)
    t, q, u = next(random_states(a, 1, seed=8))
    s = np.zeros((1, len(a.mechanics.numbering.states)))
    difference = of_bodies(a, a.mechanics.accelerations(t, q, u, s)[0]) - of_bodies(b, b.mechanics.accelerations(t, q, u, s)[0])
    assert np.max(np.abs(difference)) > 1e-3


class Held:
    """A solution that holds given unknowns at given times."""

    def __init__(self, t: Array, y: Array) -> None:
        self.t, self.y = t, y

    def __call__(self, t: Any) -> Array:
        return self.y[np.searchsorted(self.t, np.atleast_1d(t))]


def result(prepared: Prepared, t: Array, y: Array) -> Result:
    return Result(prepared, Held(t, y), RunInfo(mb.IDA(), "", Accuracy(None, None), Stats()), t)  # type: ignore[arg-type]


@pytest.mark.parametrize("scene", [tree_on_ground, tree_on_free_body, prescribed])
def test_force_and_torque_sensors_agree(scene: Callable[[], mb.Scene]) -> None:
    """Force, torque and power of every joint and spring, read at equal states of the two models."""
    recursive, _, kinematic = variants(scene())
    states = list(random_states(recursive, 20, seed=9))
    t = np.linspace(0.0, 1.0, len(states))
    q, u = (np.vstack([state[i] for state in states]) for i in (1, 2))
    nb, m = recursive.all_bodies.numbering, kinematic.mechanics
    rest = np.zeros((len(t), len(nb.states)))
    # prescribed coordinates follow from t, which is not the time of the random states
    y = np.hstack([q[:, nb.of_positions], u[:, nb.of_velocities], rest])
    q, u, _ = recursive.states(t, y)
    a = result(recursive, t, y)
    b = result(kinematic, t, np.hstack([q[:, : m.nq], u[:, : m.nu], np.zeros((len(t), len(m.numbering.states)))]))
    compared = 0
    for connection in recursive.model.scene.connections:
        for quantity in ("force", "torque"):
            one, other = getattr(a[connection], quantity), getattr(b[connection], quantity)
            assert np.max(np.abs(one - other)) < 1e-11 * (1 + np.max(np.abs(other))), (connection.name, quantity)
            compared += bool(np.max(np.abs(other)) > 0.1)
    assert compared >= 6
