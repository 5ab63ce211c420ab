r"""A flat arch of two springs snaps through: the load at which it does, found by following the states at rest around the fold.

Two springs of natural length l and stiffness k meet at a mass in the middle, b from their feet. At the height y they carry

    P(y) = 2 k y (l / s - 1),    s = sqrt(b^2 + y^2),

which is largest where s^3 = b^2 l. `s.continuation` follows the equilibrium along the load, turns round at the fold and says
where it was, with an error. In the run the load grows slowly past it, and the arch snaps.

Run it:  mbdae run examples/snap_through.py --out out
"""

import math

import mbdae as mb

HALF, HEIGHT, STIFFNESS, MASS = 0.5, 0.2, 2e4, 1.0  # m, m, N/m, kg
LENGTH = math.hypot(HALF, HEIGHT)  # m

t_end = 4.0  # s
measure = "top.position"


def scene(load=100.0 * mb.t):
    """The arch under its load, N, which pushes down; a damper in the guide lets it come to rest."""
    s = mb.Scene("snapping arch")
    top = s.rigid_body("top", MASS, 1e-3, at=(0, HEIGHT))
    s.prismatic("guide", s.ground, top, at=(0, HEIGHT), axis=(0, 1, 0), damper=30.0)
    for name, x in (("left", -HALF), ("right", HALF)):
        s.spring(name, s.ground, top, at_k=(x, 0), at_l=(0, HEIGHT), stiffness=STIFFNESS, length=LENGTH)
    s.force("load", top, (0, -load, 0))
    return s


def run():
    """The load grows by 100 N a second."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Load at the fold, N."""
    s = scene(mb.number("P", 200.0))
    fold = s.continuation("P", (200.0, 400.0), of=s.equilibrium()).folds[0]
    there = (HALF**2 * LENGTH) ** (1 / 3)  # m, length of a spring at the fold
    return fold.value, 2 * STIFFNESS * math.sqrt(there**2 - HALF**2) * (LENGTH / there - 1), fold.error


def picture(r):
    """Height of the arch over time, and speed."""
    return r.plot("top.position[1]", "guide.rate")
