r"""A coin rolls in a circle, leaning inwards: rows of velocities, which no position contains.

A thin disc (radius r, moments C = m r^2 / 2 about its axle, A = C / 2 across it) whose plane is inclined by theta to the table
rolls in a circle of radius R. Its centre goes round at R - r cos(theta) with the rate W, and the balance of angular momentum
about the centre asks for

    W^2 sin(theta) (C (R / r - cos(theta)) + A cos(theta) + m r (R - r cos(theta))) = m g r cos(theta).

Run it:  mbdae run examples/rolling_coin.py --out out
"""

import numpy as np

import mbdae as mb

RADIUS, MASS, CIRCLE, THETA, G = 0.1, 0.3, 0.25, np.radians(65), 9.81  # m, kg, m, rad, m/s^2
AXIAL = MASS * RADIUS**2 / 2  # kg m^2
ACROSS, CENTRE = AXIAL / 2, CIRCLE - RADIUS * np.cos(THETA)  # kg m^2; m, of the circle of the coin's centre
W = np.sqrt(MASS * G * RADIUS * np.cos(THETA) / np.sin(THETA)
            / (AXIAL * (CIRCLE / RADIUS - np.cos(THETA)) + ACROSS * np.cos(THETA) + MASS * RADIUS * CENTRE))  # rad/s

t_end = 2 * np.pi / W  # s, once round
measure = "coin.position"


def scene():
    """The coin touches the table on the x axis and leans towards the middle."""
    s = mb.Scene("rolling coin", gravity=(0, 0, -G))
    axle, at = np.array([np.sin(THETA), 0, np.cos(THETA)]), (CENTRE, 0, RADIUS * np.sin(THETA))
    moments = ACROSS * np.eye(3) + (AXIAL - ACROSS) * np.outer(axle, axle)
    coin = s.rigid_body("coin", MASS, moments, at=at, velocity=(0, W * CENTRE, 0), color="tab:orange",
                        angular_velocity=W * np.array([0, 0, 1]) - W * CIRCLE / RADIUS * axle,
                        shape=mb.Cylinder(axis=axle, radius=RADIUS, length=0.01))
    s.rolling("edge", s.ground, coin, at=at, axis=axle, radius=RADIUS)
    return s


def run():
    """Once round the circle."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """How far the coin's centre is from the middle after one turn, m."""
    return np.hypot(*r["coin"].position[-1, :2]), CENTRE


def picture(r):
    """The path of the coin's centre, seen from above."""
    return r.orbit("coin.position")
