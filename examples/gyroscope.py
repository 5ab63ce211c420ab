r"""A spinning rotor on a gimbal, let go with its axis level: it dips, precesses and rises again.

The rotor (mass m, inertia C about its axis) spins at w on an arm of length l; A is its inertia about the pivot across the axis.
The gimbal turns about the vertical by phi, and the arm dips by d below the level. Released with phi' = d' = 0, two quantities
are kept: the angular momentum about the vertical, A phi' cos^2(d) - C w sin(d) = 0, and the energy,

    A (d'^2 + phi'^2 cos^2(d)) / 2 - m g l sin(d) = 0.

Where the arm is lowest d' = 0, and with u = sin(d) and p = C^2 w^2 / (2 A m g l) both give u = (1 - u^2) / p, so that

    sin(d) = -p/2 + sqrt(p^2/4 + 1).

Run it:  mbdae run examples/gyroscope.py --out out
"""

import math

import mbdae as mb

MASS, ARM, AXIAL, ACROSS = 1.2, 0.15, 1.5e-3, 9e-4  # kg, m, kg m^2 about the spin axis and across it
SPIN, G = 250.0, 9.81  # rad/s, m/s^2

t_end = 1.5  # s
measure = "dip.angle"


def scene():
    """Fork and arm without mass; the rotor at the end of the arm, along x as drawn."""
    s = mb.Scene("gyroscope", gravity=(0, 0, -G))
    fork = s.rigid_body("fork", 0.0, (0, 0, 0), at=(0, 0, 0))
    arm = s.rigid_body("arm", 0.0, (0, 0, 0), at=(ARM / 2, 0, 0))
    disk = mb.Cylinder(axis=(1, 0, 0), radius=0.05, length=0.02)
    rotor = s.rigid_body("rotor", MASS, (AXIAL, ACROSS, ACROSS), at=(ARM, 0, 0), shape=disk)
    s.revolute("precession", s.ground, fork, at=(0, 0, 0), axis=(0, 0, 1))
    s.revolute("dip", fork, arm, at=(0, 0, 0), axis=(0, 1, 0))
    s.revolute("spin", arm, rotor, at=(ARM, 0, 0), axis=(1, 0, 0), rate0=SPIN)
    return s


def run():
    """The arm let go."""
    return scene().simulate(t_end, accuracy=1e-8, outputs=1501)


def number(r):
    """Angle by which the arm dips, at most, rad."""
    across = ACROSS + MASS * ARM**2
    p = (AXIAL * SPIN) ** 2 / (2 * across * MASS * G * ARM)
    return r.peak("dip.angle").value, math.asin(math.sqrt(p**2 / 4 + 1) - p / 2)


def picture(r):
    """The gyroscope as it is let go."""
    return scene().draw(hide=["fork"])
