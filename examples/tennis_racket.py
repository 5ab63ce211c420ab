r"""A body that spins about its intermediate axis turns over, again and again, without a torque (Dzhanibekov's effect).

With moments A < B < C and the rates p, q, r about the axes of the body, Euler's equations keep energy and angular momentum,

    2 T = A p^2 + B q^2 + C r^2,    h^2 = A^2 p^2 + B^2 q^2 + C^2 r^2,

and q is an elliptic function of time (sn where h^2 > 2 B T, as here), so that it changes its sign after every

    2 K(m) sqrt(A B C / ((C - B) (h^2 - 2 A T))),    m = (B - A) (2 C T - h^2) / ((C - B) (h^2 - 2 A T)).

Run it:  mbdae run examples/tennis_racket.py --out out
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk

import mbdae as mb

A, B, C = 1.0e-4, 2.5e-4, 3.3e-4  # kg m^2 about handle, intermediate axis, and the third one
RATES = np.array([0.0, 6.0, 0.06])  # rad/s about these axes at the start

t_end = 6.0  # s
measure = "nut.angular_velocity"


def scene():
    """A wing nut in free flight."""
    s = mb.Scene("wing nut")
    shape = [mb.Box(size=(0.10, 0.012, 0.012)), mb.Box(at=(0.045, 0, 0), size=(0.014, 0.09, 0.012))]
    s.rigid_body("nut", 0.2, (A, B, C), at=(0, 0, 0), angular_velocity=RATES, shape=shape)
    return s


def rate(r, t):
    """Rate about the intermediate axis, rad/s, at a time."""
    nut = r(t)["nut"]
    return float(nut.rotation[0][:, 1] @ nut.angular_velocity[0])


def run():
    """Six seconds, in which it turns over three times."""
    return scene().simulate(t_end, accuracy=1e-8, outputs=601)


def number(r):
    """Time from one turn to the next, s."""
    seen = [rate(r, t) for t in r.t]
    zeros = [brentq(lambda t: rate(r, t), r.t[i], r.t[i + 1], xtol=1e-12) for i in np.flatnonzero(np.diff(np.sign(seen)))]
    energy, momentum = np.array([A, B, C]) @ RATES**2, np.array([A, B, C]) ** 2 @ RATES**2  # 2 T and h^2
    below = (C - B) * (momentum - A * energy)
    return zeros[1] - zeros[0], 2 * ellipk((B - A) * (C * energy - momentum) / below) * np.sqrt(A * B * C / below)


def picture(r):
    """Rates in inertial axes."""
    return r.plot("nut.angular_velocity")
