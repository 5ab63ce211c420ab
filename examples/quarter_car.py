r"""A quarter car on a measured road: body and wheel on springs, the road from a file, against the same equations in SciPy.

With the heights y_w of the wheel and y_b of the body above their rest and the height h(t) of the road,

    m_w y_w'' = k_t (h - y_w) + F,    m_b y_b'' = -F,    F = k (y_b - y_w) + c (y_b' - y_w').

The road is a polyline of 401 points; the run and the reference stop at each of them.

Run it:  mbdae run examples/quarter_car.py --out out
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import mbdae as mb

ROAD = Path(__file__).with_name("road.csv")  # height over time at 20 m/s, m over s; 401 points every 10 ms
BODY, WHEEL = 300.0, 40.0  # kg
SPRING, DAMPER, TYRE = 20e3, 1.2e3, 180e3  # N/m, N s/m, N/m

t_end = 4.0  # s
measure = "strut.displacement"


def scene():
    """Body and wheel slide along y, from where they rest under their weight; the road pushes by the tyre's stiffness times its
    height."""
    road = mb.read_table(ROAD, "t", "height", unit="m")
    s = mb.Scene("quarter car")
    wheel = s.rigid_body("wheel", WHEEL, (1, 1, 1), at=(0, 0.3, 0))
    body = s.rigid_body("body", BODY, (1, 1, 1), at=(0, 0.8, 0))
    s.prismatic("tyre", s.ground, wheel, at=(0, 0.3, 0), axis=(0, 1, 0), spring=TYRE, force=TYRE * road)
    s.prismatic("strut", wheel, body, at=(0, 0.8, 0), axis=(0, 1, 0), spring=SPRING, damper=DAMPER)
    return s


def reference():
    """Largest acceleration of the body, m/s^2, by SciPy, which stops at every point of the road."""
    t, height = np.loadtxt(ROAD, delimiter=",", skiprows=1).T

    def rates(at, y):
        strut = SPRING * (y[1] - y[0]) + DAMPER * (y[3] - y[2])
        return [y[2], y[3], (TYRE * (np.interp(at, t, height) - y[0]) + strut) / WHEEL, -strut / BODY]

    y, largest = np.zeros(4), 0.0
    for a, b in pairwise(t):
        part = solve_ivp(rates, (a, b), y, rtol=1e-10, atol=1e-13, t_eval=np.linspace(a, b, 41))
        largest, y = max(largest, *(abs(rates(x, v)[3]) for x, v in zip(part.t, part.y.T, strict=True))), part.y[:, -1]
    return largest


def run():
    """The whole road."""
    return scene().simulate(t_end, accuracy=1e-6, outputs=801)


def number(r):
    """Largest acceleration of the body, m/s^2."""
    return r.peak("body.acceleration").value, reference()


def picture(r):
    """Deflections of strut and tyre, and the acceleration of the body."""
    return r.plot("tyre.displacement", "strut.displacement", "body.acceleration[1]")
