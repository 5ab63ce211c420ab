"""A pendulum that is a steel beam: slenderness, stiffness up to 1e14 N, speed, accuracy."""

import mbdae as mb

LENGTH = 1.0  # m

t_end = 0.6  # s
accuracy = 1e-4
vary = {
    "slenderness": [10.0, 100.0, 1000.0],
    "rod.stiffness": (1e4, 1e14),
    "hinge.speed": [1e2, 1e4],
    "accuracy": [1e-2, 1e-3, 1e-5],
    "step": (1e-1, 1e-9),
    "t_end": [3.0],
}


def scene(slenderness=100.0):
    """A beam with a square section, hinged at one end, released from the horizontal with a small rate."""
    h = LENGTH / slenderness
    s = mb.Scene("steel pendulum", gravity=(0, -9.81, 0))
    rod = s.beam("rod", (0, 0), (LENGTH, 0), section=mb.Section.rectangular(h, h, E=210e9, nu=0.3, rho=7850), elements=2)
    s.revolute("hinge", s.ground, rod, at=(0, 0), rate0=1.0)
    return s
