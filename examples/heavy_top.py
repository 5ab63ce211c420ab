r"""A spinning heavy top with fixed point (the benchmark of Bruls and Cardona, 2010).

A body of mass m with centre of mass at X = (0, 1, 0) m in its own axes turns about the origin. With the inertia
J0 = J + m (|X|^2 1 - X X^T) about the fixed point, R body to inertial and Omega in body axes, its motion is

    J0 Omega' + Omega x J0 Omega = X x R^T (m g),      R' = R Omega~.

It spins at 150 rad/s about X and precesses under its weight. This ODE in the nine entries of R and three of Omega,
integrated by an explicit Runge-Kutta method, is the reference `centre`; the scene states the same as a free body
and a spherical joint.

Run it:  mbdae compare examples/heavy_top.py --t-end 0.5
"""

import numpy as np
from scipy.integrate import solve_ivp

import mbdae as mb

MASS, INERTIA = 15.0, np.array([0.234375, 0.46875, 0.234375])  # kg, kg m^2 about the centre of mass
X = np.array([0.0, 1.0, 0.0])  # m, centre of mass from the fixed point
SPIN = np.array([0.0, 150.0, -4.61538])  # rad/s, body and inertial axes coincide at the start
GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2

t_end = 1.0  # s
measure = "top.position"


def scene():
    """The top as a free rigid body, held at the origin by a spherical joint."""
    s = mb.Scene("heavy top", gravity=GRAVITY)
    top = s.rigid_body("top", MASS, INERTIA, at=X, velocity=np.cross(SPIN, X), angular_velocity=SPIN)
    s.spherical("tip", s.ground, top, at=(0, 0, 0))
    return s


def centre(t):
    """Centre of mass (nt, 3), m, at increasing times t (nt,) s, from the ODE above."""
    J0 = np.diag(INERTIA) + MASS * (X @ X * np.eye(3) - np.outer(X, X))

    def rate(_, y):
        R, w = y[:9].reshape(3, 3), y[9:]
        torque = np.cross(X, R.T @ (MASS * GRAVITY)) - np.cross(w, J0 @ w)
        return np.r_[(R @ np.cross(w, np.eye(3)).T).ravel(), np.linalg.solve(J0, torque)]

    y = solve_ivp(rate, (0, t[-1]), np.r_[np.eye(3).ravel(), SPIN], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y
    return np.einsum("ijt,j->ti", y[:9].reshape(3, 3, -1), X)


def run():
    """One second."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Height of the centre of mass after half a second, m."""
    return r(0.5)["top"].position[0, 2], centre(np.array([0.0, 0.5]))[-1, 2]


def picture(r):
    """The path of the centre of mass, seen from above."""
    return r.orbit("top")
