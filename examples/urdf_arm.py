r"""A robot from its URDF: a scene like any other, and the equations of its tree, compared with those of the textbook.

`mb.read_urdf` reads links, joints, limits and damping; what the scene says otherwise than the file is listed in `scene.told`.
The arm is let go level, falls and swings until the dampers of its joints have stopped it. Its tree gives the torques tau of any
motion; for two links with centres at c1, c2 and an elbow at l1 from the shoulder, h = m2 l1 c2,

    tau_2 = (J2 + h cos q2) a1 + J2 a2 + h sin(q2) v1^2 + m2 g c2 cos(q1 + q2),    J2 = I2 + m2 c2^2.

Needs the extra robots. Run it:  mbdae run examples/urdf_arm.py --out out
"""

import math
from pathlib import Path

import mbdae as mb

URDF = Path(__file__).with_name("two_links.urdf")
Q, V, A, G = (0.4, 0.9), (1.5, -2.0), (3.0, 1.0), 9.81  # rad, rad/s, rad/s^2, m/s^2

t_end = 5.0  # s
measure = "elbow.angle"


def scene():
    """The arm of the file, level."""
    return mb.read_urdf(URDF)


def run():
    """The arm let go."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Torque of the elbow at a state of motion, N m."""
    m2, l1, c2 = 1.5, 0.4, 0.18
    h, J2 = m2 * l1 * c2, 0.02 + m2 * c2**2
    wanted = (J2 + h * math.cos(Q[1])) * A[0] + J2 * A[1] + h * math.sin(Q[1]) * V[0] ** 2 + m2 * G * c2 * math.cos(Q[0] + Q[1])
    return scene().tree().inverse_dynamics(Q, V, A)[1], wanted


def picture(r):
    """Angles of shoulder and elbow."""
    return r.plot("shoulder.angle", "elbow.angle")
