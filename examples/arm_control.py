r"""A six-axis arm under computed torque, and under a sampled PID.

Computed torque: the torques of the model at the accelerations v = q_d'' + 2 w (q_d' - q') + w^2 (q_d - q), stated once by
Newton and Euler's recursion on sensors. The error e = q_d - q then obeys e'' + 2 w e' + w^2 e = 0: from e(0) = e0 and
e'(0) = d0 it is

    e(t) = (e0 + (d0 + w e0) t) exp(-w t).

The sampled PID knows no model; its integral holds the weight.

Run it:  mbdae run examples/arm_control.py --out out
"""

import numpy as np
import sympy as sp

import mbdae as mb

JOINTS = [(0, 0, 0.09), (0, 0.14, 0.09), (0.42, 0.02, 0.09), (0.82, 0.02, 0.09), (0.82, 0.11, 0.09), (0.82, 0.11, 0)]  # m
AXES = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, -1), (0, 1, 0)]
CENTRES = [(0, 0.08, 0.09), (0.21, 0.14, 0.09), (0.62, 0.02, 0.09), (0.82, 0.07, 0.09), (0.82, 0.11, 0.05), (0.82, 0.15, 0)]
MASSES = [3.7, 8.4, 2.3, 1.2, 1.2, 0.2]  # kg
INERTIAS = [(0.01, 0.01, 0.007), (0.015, 0.23, 0.23), (0.004, 0.03, 0.03), *[(0.002,) * 3] * 2, (1e-4,) * 3]  # kg m^2
G, W, START = 9.81, 10.0, 0.2  # m/s^2, rad/s, e(0) in rad
PATH = [START + 0.4 * sp.sin((1 + 0.2 * i) * mb.t) for i in range(6)]  # rad

t_end = 2.0  # s
measure = "q2.angle"


def computed_torque(s):
    """The torque of every joint, N m."""
    def named(v):  # every component gets a name, so that expressions stay short
        return v.applyfunc(lambda x: x if x.is_Number or x.is_Symbol else s.signal(f"x{len(s.signals)}", x))

    q, qd = ([s.sensor(f"q{i}.{what}") for i in range(1, 7)] for what in ("angle", "rate"))
    R, w, spin_up, lift, loads = sp.eye(3), sp.zeros(3, 1), sp.zeros(3, 1), sp.Matrix([0, 0, G]), []
    for i in range(6):
        arm = named(R @ (sp.Matrix(JOINTS[i]) - sp.Matrix(JOINTS[max(i - 1, 0)])))
        lift = named(lift + spin_up.cross(arm) + w.cross(w.cross(arm)))
        axis, path = R @ sp.Matrix(AXES[i]), PATH[i]
        v = sp.diff(path, mb.t, 2) + 2 * W * (sp.diff(path, mb.t) - qd[i]) + W**2 * (path - q[i])
        spin_up, w = named(spin_up + axis * v + w.cross(axis) * qd[i]), named(w + axis * qd[i])
        K = sp.Matrix(3, 3, lambda a, b, n=AXES[i]: -sum(sp.LeviCivita(a, b, c) * n[c] for c in range(3)))
        R = named(R @ (sp.eye(3) + sp.sin(q[i]) * K + (1 - sp.cos(q[i])) * K @ K))
        c, J = named(R @ (sp.Matrix(CENTRES[i]) - sp.Matrix(JOINTS[i]))), sp.diag(*INERTIAS[i])
        force = named(MASSES[i] * (lift + spin_up.cross(c) + w.cross(w.cross(c))))
        own = R.T @ w
        loads.append((arm, axis, named(R @ (J @ (R.T @ spin_up) + own.cross(J @ own)) + c.cross(force)), force))
    torques, force, moment = [], sp.zeros(3, 1), sp.zeros(3, 1)
    for arm, axis, own_moment, own_force in reversed(loads):
        moment, force = named(moment + own_moment), named(force + own_force)
        torques, moment = [axis.dot(moment), *torques], moment + arm.cross(force)
    return torques


def pid(t, *values):
    """A PID for every joint; memory: the integrals of the errors."""
    error = START - np.array(values[:6])
    integral = values[12] + 0.001 * error
    return GAINS * (100 * error - 20 * np.array(values[6:12]) + 200 * integral), integral


GAINS = np.array([4, 6, 2, 0.1, 0.02, 0.003])  # kg m^2


def sampled_pid(s):
    """Names of the torques of a controller that is called every millisecond."""
    sensors = [f"q{i}.{what}" for what in ("angle", "rate") for i in range(1, 7)]
    s.controller("pid", pid, every=0.001, reads=sensors, sets=[f"u{i}" for i in range(1, 7)], memory=np.zeros(6))
    return [f"u{i}" for i in range(1, 7)]


def scene(control=computed_torque):
    """The arm, stretched out as drawn."""
    s, k = mb.Scene("arm", gravity=(0, 0, -G)), "ground"
    for i, torque in enumerate(control(s), start=1):
        l = s.rigid_body(f"link{i}", MASSES[i - 1], INERTIAS[i - 1], at=CENTRES[i - 1])
        s.revolute(f"q{i}", k, l, at=JOINTS[i - 1], axis=AXES[i - 1], torque=torque)
        k = l
    return s


def error(t):
    """e(t) (6, nt) of computed torque, rad."""
    d0 = np.array([float(sp.diff(path, mb.t).subs(mb.t, 0)) for path in PATH])[:, None]
    return (START + (d0 + W * START) * t) * np.exp(-W * t)


def run():
    """The arm under computed torque."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Error of the second joint after 0.3 s, rad."""
    followed = r(0.3)["q2"].angle[0]
    return float(PATH[1].subs(mb.t, 0.3)) - followed, error(0.3)[1, 0]


def picture(r):
    """The arm as drawn, stretched out."""
    return scene().draw()
