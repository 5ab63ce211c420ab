r"""A tippe top turns over: friction at a sphere whose centre of mass lies below its middle.

The top (radius R, centre of mass e below the middle, moments A across and C about its axis) spins on a table. Sliding friction
raises its centre of mass. Forces at the point of contact may be any: of the angular momentum L about the centre of mass the part
along the line from there to the contact is kept, Jellett's constant

    J = L . (R z - e axis).

Run it:  mbdae run examples/tippe_top.py --out out
"""

import numpy as np

import mbdae as mb

RADIUS, BELOW, MASS, ACROSS, AXIAL, SPIN, G = 0.02, 0.004, 0.02, 2.6e-6, 3.2e-6, 160.0, 9.81  # m, m, kg, kg m^2 twice, rad/s
LAW = mb.Hertz(1e7, 0.5)

t_end = 3.0  # s
measure = "top.position"


def scene():
    """The top upright but for 0.1 rad, pressed in by its weight."""
    s = mb.Scene("tippe top", gravity=(0, 0, -G))
    axis = np.array([np.sin(0.1), 0, np.cos(0.1)])
    middle = np.array([0, 0, RADIUS - LAW.penetration(MASS * G)])
    moments = ACROSS * np.eye(3) + (AXIAL - ACROSS) * np.outer(axis, axis)
    stem = mb.Cylinder(at=middle + 0.022 * axis, axis=axis, radius=0.004, length=0.016)
    top = s.rigid_body("top", MASS, moments, at=middle - BELOW * axis, angular_velocity=SPIN * axis, color="tab:red",
                       shape=[mb.Sphere(at=middle, radius=RADIUS), stem])
    s.contact("table", s.ground, top, mb.Plane(), mb.Sphere(at=middle, radius=RADIUS), normal=LAW, friction=mb.Coulomb(0.3, 1e-2))
    return s


def jellett(r):
    """Jellett's constant over time, kg m^3/s."""
    top, axis0 = r["top"], np.array([np.sin(0.1), 0, np.cos(0.1)])
    axis = top.rotation @ top.rotation[0].T @ axis0
    w = top.angular_velocity
    momentum = ACROSS * w + (AXIAL - ACROSS) * np.einsum("ti,ti->t", w, axis)[:, None] * axis
    return np.einsum("ti,ti->t", momentum, RADIUS * np.array([0, 0, 1]) - BELOW * axis)


def run():
    """Three seconds, in which it comes to stand on its stem's side."""
    return scene().simulate(t_end, accuracy=1e-5, outputs=601)


def number(r):
    """Jellett's constant at the end, kg m^3/s."""
    kept = jellett(r)
    return kept[-1], kept[0]


def picture(r):
    """Height of the centre of mass, and the rates."""
    return r.plot("top.position[2]", "top.angular_velocity")
