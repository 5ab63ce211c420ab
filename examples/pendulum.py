r"""A uniform rod swinging about a hinge at its end, released from 135 degrees.

The physical pendulum obeys

    I theta'' = -m g d sin(theta),      I = m L^2 / 3,  d = L / 2.

Released at rest from the amplitude theta0, it returns after the period

    T = 4 sqrt(I / (m g d)) K(k),       k = sin(theta0 / 2),

with Legendre's complete elliptic integral of the first kind K(k). `period_measured` reads the same number
from a simulation: the angle passes zero every half period.

Run it:  mbdae run examples/pendulum.py --out out
"""

import math

import numpy as np
from scipy.special import ellipk

import mbdae as mb

MASS, LENGTH, G = 1.0, 1.0, 9.81  # kg, m, m/s^2
AMPLITUDE = math.radians(135)  # rad

t_end = 6.0  # s
measure = "hinge.angle"


def scene(amplitude=AMPLITUDE):
    """The rod, drawn hanging; the start angle (rad) is held, the rate starts at zero."""
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (0, -LENGTH), mass=MASS)
    s.revolute("hinge", s.ground, rod, at=(0, 0), angle0=amplitude)
    return s


def period_exact(amplitude=AMPLITUDE):
    """Period in s by the elliptic integral (scipy takes the parameter k^2)."""
    inertia, arm = MASS * LENGTH**2 / 3, LENGTH / 2
    return 4 * math.sqrt(inertia / (MASS * G * arm)) * float(ellipk(math.sin(amplitude / 2) ** 2))


def period_measured(result):
    """Twice the mean time in s between passages of the angle through zero, each found by Newton's method."""
    angle = result["hinge"].angle
    before = np.flatnonzero(angle[:-1] * angle[1:] < 0)
    t = result.t[before]
    for _ in range(6):
        there = result(t)["hinge"]
        t = t - there.angle / there.rate
    return 2 * float(t[-1] - t[0]) / (len(t) - 1)


def run():
    """Six seconds from 135 degrees."""
    return scene().simulate(t_end, accuracy=1e-8)


def number(r):
    """Period, s."""
    return period_measured(r), period_exact()


def picture(r):
    """Angle and rate."""
    return r.plot("hinge.angle", "hinge.rate")
