"""A driven four-bar with a bob on an elastic strut at its rocker: mass ratios, stiffness, speed, steps, starts."""

import mbdae as mb

A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)  # m
OMEGA = 12.56  # rad/s

t_end = 0.5  # s, one turn
accuracy = 1e-5
vary = {
    "coupler.mass": (1e-9, 1e9),
    "strut.stiffness": (1e2, 1e14),
    "A.speed": [1e1, 1e4],
    "accuracy": [1e-3, 1e-5, 1e-7],
    "step": (1e-1, 1e-9),
    "t_end": [5.0],
    "offset": [1e-6, 1e-2, 1.0, 3.0],
    "rate": [1.0],
}


def scene(offset=0.0, rate=None):
    """offset: angle (rad) at which the crank starts beside the drawing, so that the loop has to be closed; rate: of the
    rocker at the start (rad/s), which the drive contradicts."""
    s = mb.Scene("four-bar with a bob", gravity=(0, -9.81, 0))
    crank = s.link("crank", A, B, mass=0.3)
    coupler = s.link("coupler", B, C, mass=0.6)
    rocker = s.link("rocker", C, D, mass=0.5)
    bob = s.point_mass("bob", 0.1, at=(0.5, 0.4))
    s.revolute("A", s.ground, crank, at=A, angle=OMEGA * mb.t + offset)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C)
    s.revolute("D", s.ground, rocker, at=D, rate0=rate)
    s.spring("strut", rocker, bob, C, (0.5, 0.4), stiffness=1e3)
    return s
