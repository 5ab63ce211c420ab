"""Beams in free flight keep energy, momentum and angular momentum to the tolerance in time, alone and joined."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.results.result import Result
from mbdae.scene.components import JointModel
from mbdae.system.base import Array
from mbdae.system.model.nodes import rotation_matrices

SOFT = mb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=50.0, EI2=50.0, EI3=80.0, mass_per_length=1.0, rotary_inertia=0.01)


def flight(joined: bool, model: JointModel | None = None) -> mb.Scene:
    """Two quadratic elements per beam; the start turns about no principal axis."""
    s = mb.Scene("flight", space="spatial")
    a = s.beam("a", (0, 0, 0), (1, 0, 0), section=SOFT, elements=2, velocity=(1, 0.5, 0.2), angular_velocity=(1, 2, 3))
    if joined:
        b = s.beam("b", (1, 0, 0), (2, 0, 0), section=SOFT, elements=2)
        s.revolute("J", a, b, at=(1, 0, 0), axis=(0, 1, 1), model=model, rate0=5.0)
    return s


def momenta(r: Result) -> tuple[Array, Array]:
    """Momentum and angular momentum about the origin (nt, 3)."""
    m = r.prepared.mechanics
    p, angular = np.zeros((len(r.t), 3)), np.zeros((len(r.t), 3))
    by_u = np.asarray((m.mass @ r.u.T).T)
    for node, _ in m.model.bodies:
        force, turning = by_u[:, node.u : node.u + 3], by_u[:, node.u + 3 : node.u + 6]
        R = rotation_matrices(r.q[:, node.q + 3 : node.q + 7])
        p += force
        angular += np.cross(r.q[:, node.q : node.q + 3], force) + np.einsum("tij,tj->ti", R, turning)
    return p, angular


MODELS = (mb.Kinematic(), mb.Classical(), mb.Recursive())


@pytest.mark.parametrize(("joined", "model"), [(False, None), *((True, m) for m in MODELS)])
def test_what_nothing_changes_stays(joined: bool, model: JointModel | None) -> None:
    r = flight(joined, model).simulate(0.25, accuracy=1e-8)
    p, angular = momenta(r)
    assert r.accuracy.met
    assert np.max(np.abs(r.energy.balance)) < 1e-7 * r.energy.total[0]
    assert r.energy.potential.max() > (1e-3 if joined else 1e-6) * r.energy.total[0]  # the beams bend
    assert np.max(np.abs(angular - angular[0])) < 1e-7 * np.linalg.norm(angular[0])
    assert np.max(np.abs(p - p[0])) < 1e-10
