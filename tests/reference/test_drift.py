"""The stabilised form keeps |g| below 1e-9 m and |G u| below 1e-8 over 10 s at accuracy 1e-8, joint by joint."""

from __future__ import annotations

import pytest

import mbdae as mb

JOINTS = {
    "revolute": lambda s, a, b: s.revolute("J", a, b, at=(1, 0, 0), axis=(0, 1, 1)),
    "driven revolute": lambda s, a, b: s.revolute("J", a, b, at=(1, 0, 0), axis=(0, 1, 0), angle=0.5 * mb.t),
    "prismatic": lambda s, a, b: s.prismatic("J", a, b, at=(1, 0, 0), axis=(1, 0, 1), spring=50.0, damper=0.5),
    "spherical": lambda s, a, b: s.spherical("J", a, b, at=(1, 0, 0)),
    "weld": lambda s, a, b: s.weld("J", a, b, at=(1, 0, 0)),
    "distance": lambda s, a, b: s.distance("J", a, b, at_k=(1, 0, 0), at_l=(1.2, 0, 0.3)),
    "fixed orientation": lambda s, a, b: (
        s.fixed_orientation("J", a, b),
        s.spring("S", a, b, (1, 0, 0), (1.2, 0, 0.3), stiffness=80.0, damping=1.0),
    ),
}


@pytest.mark.parametrize("solver", [mb.IDA(), mb.RadauIIA(3)], ids=lambda s: s.label)
@pytest.mark.parametrize("joint", JOINTS)
def test_drift_over_ten_seconds(joint, solver):
    s = mb.Scene(joint, gravity=(0, 0, -9.81))
    arm = s.rigid_body("arm", 1.0, (0.02, 0.09, 0.08), at=(0.5, 0, 0))
    rod = s.rigid_body("rod", 0.7, (0.03, 0.07, 0.06), at=(1.5, 0.1, 0))
    s.revolute("A", s.ground, arm, at=(0, 0, 0), axis=(0, 1, 0), damper=0.2)
    JOINTS[joint](s, arm, rod)
    at_accuracy = solver.at_accuracy(1e-8, "GGL")
    r = s.simulate(10.0, solver=at_accuracy, outputs=1001)
    inside = r(r.solution.t)  # at the steps, where the equations hold
    assert inside.drift.position.max() <= 1e-9
    assert inside.drift.velocity.max() <= 1e-8
