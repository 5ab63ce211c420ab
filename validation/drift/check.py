"""Constraint violation over 10 s, joint by joint."""

from __future__ import annotations

from typing import Any

from runner import Case, Claim, Found
from runs import with_both

import mbdae as mb

claim = Claim("drift", "the stabilised form keeps every joint closed over 10 s at accuracy 1e-8", 1e-9, "m",
              "none needed: the constraints themselves, |g| and |G u| at every step")
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


def two_bodies(joint: str) -> mb.Scene:
    """An arm on a damped revolute, and a rod on it by the joint."""
    s = mb.Scene(joint, gravity=(0, 0, -9.81))
    arm = s.rigid_body("arm", 1.0, (0.02, 0.09, 0.08), at=(0.5, 0, 0))
    rod = s.rigid_body("rod", 0.7, (0.03, 0.07, 0.06), at=(1.5, 0.1, 0))
    s.revolute("A", s.ground, arm, at=(0, 0, 0), axis=(0, 1, 0), damper=0.2)
    JOINTS[joint](s, arm, rod)
    return s


def violation(solver: Any, joint: str) -> list[Found]:
    """Largest violation at the steps, where the equations hold."""
    r = two_bodies(joint).simulate(10.0, solver=solver.at_accuracy(1e-8, "GGL"), outputs=1001)
    inside = r(r.solution.t)
    return [Found(inside.drift.position.max(), quantity="positions"),
            Found(inside.drift.velocity.max(), 1e-8, "m/s", "velocities")]


def cases() -> list[Case]:
    return [case for joint in JOINTS for case in with_both(joint, lambda solver, joint=joint: violation(solver, joint),
                                             slow=joint in ("distance", "driven revolute", "weld"))]
