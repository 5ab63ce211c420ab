r"""An engine with an elastic connecting rod in steady running: the force in its bearing, without waiting for steadiness.

A run that begins with a straight, unstrained rod rings for turns: its first peak is almost twice that of steady running.
`s.periodic` finds the turn that returns to its own start, `start="relaxed"` begins without ringing. Both tell the same peak, and
each its error.

Run it:  mbdae run examples/engine_rod.py --out out
"""

import math

import mbdae as mb

CRANK, ROD, TURNS = 0.05, 0.2, 50.0  # m, m, 1/s
STEEL = mb.Section.rectangular(0.02, 0.01, E=210e9, nu=0.3, rho=7850.0, damping=1e-6)

t_end = 1 / TURNS  # s
measure = "B.force"
KNOWN = 2e-5  # relative, of the number: the error of the relaxed start


def scene():
    """Crank at a constant rate, elastic rod, piston."""
    s = mb.Scene("engine", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (CRANK, 0), mass=2.0)
    rod = s.beam("rod", (CRANK, 0), (CRANK + ROD, 0), section=STEEL, elements=2)
    piston = s.rigid_body("piston", 0.5, 1e-3, at=(CRANK + ROD, 0), shape=mb.Box(size=(0.05, 0.06, 0.06)))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=2 * math.pi * TURNS * mb.t)
    s.revolute("B", crank, rod, at=(CRANK, 0))
    s.revolute("C", rod, piston, at=(CRANK + ROD, 0))
    s.prismatic("D", s.ground, piston, at=(CRANK + ROD, 0), axis=(1, 0, 0))
    return s


def run():
    """The steady turn."""
    return scene().periodic(t_end, accuracy=1e-4, of=["B.force"])


def number(r):
    """Largest force in the big end, N."""
    relaxed = scene().simulate(t_end, accuracy=1e-4, start="relaxed", of=["B.force"])
    return r.peak("B.force").value, relaxed.peak("B.force").value, r.error("B.force")


def picture(r):
    """Forces in both bearings of the rod over the turn."""
    return r.plot("B.force", "C.force")
