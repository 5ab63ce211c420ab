r"""The lightest counterweights with which a motor of 1.2 N m turns a four-bar; without any it would need 3.4 N m.

The torque follows from the power, tau w = d/dt (T + V) along the motion that the two circles of four_bar.py give, and is linear
in the masses: tau = tau_0(t) + m_1 tau_1(t) + m_2 tau_2(t). The least m_1 + m_2 with |tau| <= 1.2 N m at 4000 positions of the
crank is a linear programme; `mb.design` knows nothing of that.

Run it:  mbdae run examples/lightest_four_bar.py --out out
"""

import four_bar as bar
import numpy as np
from scipy.optimize import linprog

import mbdae as mb

SPEED, MOTOR, G = 2.0, 1.2, 9.81  # rad/s, N m, m/s^2
LINKS = {"crank": ("A", "B", 0.3), "coupler": ("B", "C", 0.6), "rocker": ("C", "D", 0.5)}  # ends, kg
BEHIND = {"A": ("crank", "B", 0.5), "D": ("rocker", "C", 0.4)}  # weight behind A as far as half the crank, behind D .4 rocker

t_end = 2 * np.pi / SPEED  # s, one turn
measure = "A.drive"


def scene():
    """The four-bar with weights of 1 kg on crank and rocker."""
    s, at = mb.Scene("balanced four-bar", gravity=(0, -G, 0)), {name: getattr(bar, name) for name in "ABCD"}
    for name, (p, q, mass) in LINKS.items():
        s.link(name, at[p], at[q], mass=mass)
    for name, k, l in ("A", s.ground, "crank"), ("B", "crank", "coupler"), ("C", "coupler", "rocker"), ("D", s.ground, "rocker"):
        s.revolute(name, k, l, at=at[name], angle=SPEED * mb.t if name == "A" else None)
    for pivot, (link, end, share) in BEHIND.items():
        place = at[pivot] + share * (at[pivot] - at[end])
        s.weld(f"bolt {pivot}", link, s.point_mass(f"weight {pivot}", 1.0, at=place), at=place)
    return s


def run():
    """The design that is found."""
    return mb.design(scene(), minimize=mb.mass("weight A", "weight D"), bounds=[mb.largest("A.drive") <= MOTOR], t_end=t_end,
                     to={f"weight {name}.mass": (0.01, 5.0) for name in BEHIND})


def expected(count=4000):
    """The least mass, kg, by the linear programme."""
    t, ends = np.arange(count) * t_end / count, bar.C - bar.D

    def rate(x):
        return np.fft.ifft(1j * SPEED * np.fft.fftfreq(count, 1 / count) * np.fft.fft(x.T)).real.T

    def torque(p, q):  # of a uniform rod of 1 kg from p to q
        return rate(np.sum(rate(p) ** 2 + rate(p) * rate(q) + rate(q) ** 2, axis=1) / 6 + G * (p + q)[:, 1] / 2) / SPEED

    tip = bar.D + (ends @ [1, 1j] * np.exp(1j * bar.rocker_angle(SPEED * t / bar.OMEGA))).view(float).reshape(-1, 2)
    at = {"A": 0 * tip, "B": bar.B[1] * np.stack([-np.sin(SPEED * t), np.cos(SPEED * t)], axis=1), "C": tip, "D": 0 * tip + bar.D}
    links = sum(mass * torque(at[p], at[q]) for p, q, mass in LINKS.values())
    weights = np.stack([torque(p := (1 + share) * at[k] - share * at[q], p) for k, (_, q, share) in BEHIND.items()], axis=1)
    return linprog([1, 1], np.vstack([weights, -weights]), np.r_[MOTOR - links, MOTOR + links]).fun


def number(d):
    """Mass of both weights, kg; within what a design lets a bound be passed by."""
    return d.minimum, expected(), 2e-4 * d.minimum


def picture(d):
    """The torque of the motor between its bounds."""
    return d.plot()
