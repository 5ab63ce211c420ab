"""A parallelogram that is none by delta, and exactly one at delta = 0: it passes its flat positions again and again.

Where crank, coupler and rocker lie in a line, two motions meet: the parallelogram's and that of the crossed linkage. At
delta = 0 they meet exactly, and the constraints lose their rank there. tilt: angle (rad) by which one axis of the same linkage
in space leaves the others' direction: its joints then lock, or nearly so.
"""

import mbdae as mb

CRANK, BASE = 1.0, 2.0  # m

t_end = 4.0  # s, two flat positions
accuracy = 1e-5
vary = {
    "delta": [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 0.0],
    "tilt": [1e-9, 1e-7, 1e-5, 1e-3, 1e-1],
    "A.speed": [1e4],
    "accuracy": [1e-3, 1e-7],
}


def scene(delta=1e-3, tilt=0.0):
    """The crank turns by itself, without gravity; delta: what the rocker is longer than the crank, m."""
    s = mb.Scene("nearly a parallelogram")
    A, B, C, D = (0, 0, 0), (0, CRANK, 0), (BASE, CRANK + delta, 0), (BASE, 0, 0)
    crank = s.link("crank", A, B, mass=1.0)
    coupler = s.link("coupler", B, C, mass=1.0)
    rocker = s.link("rocker", C, D, mass=1.0)
    s.revolute("A", s.ground, crank, at=A, rate0=1.5)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C, axis=(0, tilt, 1))
    s.revolute("D", s.ground, rocker, at=D)
    return s
