r"""A pendulum stands on its head, because its pivot is shaken (Kapitza, 1951).

A rod of length l on a pivot that moves by a sin(w t) obeys, near the upright position,

    theta'' = (g - a w^2 sin(w t)) theta / l0,    l0 = 2 l / 3.

Its coefficients are periodic: no frozen instant tells whether it stands, the Floquet multipliers do. They lie on the unit circle
here, so that it sways slowly about upright. The frequency of that is compared with SciPy's solution of this equation.

Run it:  mbdae run examples/kapitza.py --out out
"""

import math

import numpy as np
import sympy
from scipy.integrate import solve_ivp

import mbdae as mb

LENGTH, SHAKE, RATE, G = 0.3, 0.02, 250.0, 9.81  # m, m, rad/s, m/s^2
PERIOD = 2 * math.pi / RATE  # s

t_end = 3.0  # s
measure = "pin.angle"


def scene(angle0=0.0, damper=0.0):
    """The rod upright; angle0: where it starts, rad; damper: in the pin, N m s/rad."""
    s = mb.Scene("Kapitza's pendulum", gravity=(0, -G, 0))
    pivot = s.rigid_body("pivot", 1.0, 1e-3, at=(0, 0))
    rod = s.link("rod", (0, 0), (0, LENGTH), mass=0.2)
    s.prismatic("shaker", s.ground, pivot, at=(0, 0), axis=(0, 1, 0), position=SHAKE * sympy.sin(RATE * mb.t))
    s.revolute("pin", pivot, rod, at=(0, 0), angle0=angle0, damper=damper)
    return s


def run():
    """Let go at 40 degrees, with a little damping."""
    return scene(math.radians(40), 0.012).simulate(t_end, accuracy=1e-6, outputs=1501)


def number(r):
    """Angular frequency at which it sways about upright, rad/s."""
    found = scene().floquet(PERIOD)
    rates = lambda t, y: [y[1], (G - SHAKE * RATE**2 * math.sin(RATE * t)) * y[0] / (2 * LENGTH / 3)]  # noqa: E731
    ends = [solve_ivp(rates, (0, PERIOD), start, rtol=1e-11, atol=1e-13).y[:, -1] for start in np.eye(2)]
    sways = math.acos((ends[0][0] + ends[1][1]) / 2) / PERIOD
    return found.angular_frequencies.max(), sways, found.errors.max()


def picture(r):
    """The angle comes to rest upright."""
    return r.plot("pin.angle")
