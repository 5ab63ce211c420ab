r"""A four-bar mechanism driven at constant speed: the angle of its rocker against the closed form.

Crank AB of length a turns by phi(t) = omega t. Coupler BC has length b, rocker CD length c, and D lies at distance d
from A along x. With B = a (sin(-phi), cos(-phi)), drawn with the crank upright, the rocker's tip C is the
intersection of two circles,

    |C - B| = b,    |C - D| = c,

on the side of the line BD on which it is drawn:

    C = D + e (c cos(gamma)) + n (c sin(gamma)),   e = (B - D)/s,  n = e turned by -90 degrees,  s = |B - D|,
    cos(gamma) = (c^2 + s^2 - b^2) / (2 c s).

The motion is prescribed, so what is tested here is the closure of the loop; the forces follow from it.

Run it:  mbdae run examples/four_bar.py --out out
"""

import numpy as np

import mbdae as mb

A, B, C, D = np.array([0, 0]), np.array([0, 0.3]), np.array([0.5, 0.6]), np.array([0.6, 0])  # m
OMEGA = 12.56  # rad/s

t_end = 2.0  # s
measure = "D.angle"


def scene():
    """Three links between four hinges, crank prescribed, a weak torsion spring with damper in C."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank = s.link("crank", A, B, mass=0.3)
    coupler = s.link("coupler", B, C, mass=0.6)
    rocker = s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, crank, at=A, angle=OMEGA * mb.t)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C, spring=2.0, damper=0.01)
    s.revolute("D", s.ground, rocker, at=D)
    return s


def rocker_angle(t):
    """Angle of the rocker from its drawn position, rad (nt,), at times t (nt,) s, from the two circles."""
    a, b, c = (float(np.linalg.norm(p - q)) for p, q in ((A, B), (B, C), (C, D)))
    tip = np.stack([-a * np.sin(OMEGA * t), a * np.cos(OMEGA * t)], axis=1)
    s = np.linalg.norm(tip - D, axis=1)
    e = (tip - D) / s[:, None]
    side = np.stack([e[:, 1], -e[:, 0]], axis=1)
    cosine = (c**2 + s**2 - b**2) / (2 * c * s)
    arm = e * cosine[:, None] + side * np.sqrt(1 - cosine**2)[:, None]
    drawn = C - D
    return np.unwrap(np.arctan2(arm[:, 1], arm[:, 0])) - np.arctan2(drawn[1], drawn[0])


def run():
    """Four turns of the crank."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Swing of the rocker, rad."""
    return np.ptp(r["D"].angle), np.ptp(rocker_angle(r.t))


def picture(r):
    """The mechanism as drawn."""
    return scene().draw()
