r"""A suspension designed on a road: spring and damper of quarter_car.py between comfort, grip and the room that the strut has.

    least    integral of y_b''^2 + (F / 300 kg)^2 dt               F = m_w y_w'' + m_b y_b'', what the wheel load departs by
    within   integral of (y_b - y_w)^2 dt <= t_end (4 mm)^2        travel of the strut

Expected is what the same equations give in SciPy: exact for a road of straight pieces (lsim), Simpson's rule, differences.

Run it:  mbdae run examples/suspension_design.py --out out
"""

import numpy as np
import quarter_car as car
from scipy.optimize import minimize
from scipy.signal import lsim

import mbdae as mb

GRIP, TRAVEL = 300.0, 4e-3  # kg, m
RANGES = {"strut.spring": (2e3, 60e3), "strut.damper": (200.0, 6e3)}  # N/m, N s/m

t_end = 2.0  # s, half of the road
measure = "strut.displacement"
scene = car.scene


def run():
    """The design that is found."""
    load = f"({car.WHEEL}*wheel.acceleration[1] + {car.BODY}*body.acceleration[1])/{GRIP}"
    return mb.design(scene(), minimize=mb.integral(f"body.acceleration[1]**2 + ({load})**2"), to=RANGES, t_end=t_end,
                     bounds=[mb.integral("strut.displacement**2") <= t_end * TRAVEL**2])


def expected(pieces=20):
    """What is made least, m^2/s^3, and the spring, N/m, and damper, N s/m, there; pieces of each straight of the road."""
    t = np.linspace(0, t_end, round(t_end / 0.01) * pieces + 1)
    h = np.interp(t, *np.loadtxt(car.ROAD, delimiter=",", skiprows=1).T)
    weights = np.r_[1, np.tile([4, 2], len(t) // 2)[:-1], 1] * t[1] / 3

    def squares(x):
        springs = np.array([[-car.TYRE - 1e4 * x[0], 1e4 * x[0]], [1e4 * x[0], -1e4 * x[0]]])
        rates = np.hstack([springs, 1e3 * x[1] * np.array([[-1, 1], [1, -1]])]) / [[car.WHEEL], [car.BODY]]
        A = np.vstack([np.eye(4)[2:], rates])
        y = lsim((A, [[0], [0], [car.TYRE / car.WHEEL], [0]], np.eye(4), np.zeros((4, 1))), h, t)[1]
        load, travel = car.TYRE * (h - y[:, 0]), y[:, 1] - y[:, 0]
        return weights @ ((y @ A[3]) ** 2 + (load / GRIP) ** 2), weights @ travel**2 / TRAVEL**2

    rows = {"type": "ineq", "fun": lambda x: t_end - squares(x)[1]}
    found = minimize(lambda x: squares(x)[0], [2.0, 1.2], method="SLSQP", constraints=rows, options={"ftol": 1e-11})
    return found.fun, 1e4 * found.x[0], 1e3 * found.x[1]


def number(d):
    """What is made least, m^2/s^3."""
    return d.minimum, expected()[0], d.error


def picture(d):
    """The acceleration of the body, and the travel of the strut."""
    return d.result.plot("body.acceleration[1]", "strut.displacement")
