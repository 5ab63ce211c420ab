r"""A joint of your own: a nut on a screw, stated by its coordinate and its motion.

With one degree of freedom s (travel) the nut turns by phi = s / p, p the pitch in m/rad. Under gravity along the
axis its kinetic energy is m s'^2 / 2 + J (s'/p)^2 / 2, so it falls with the constant acceleration

    s'' = g / (1 + J / (m p^2)).

The motion takes the axes of k to those of l: along the axis by s, about it by s / p. Rows, turn after turn, speeds,
reactions and sensors follow from it, in every joint model, and so do springs, drives and friction on the coordinate
(`s.joint(Screw, ..., damper=...)`).

Run it:  mbdae run examples/screw.py --out out
"""

import mbdae as mb

PITCH, MASS, INERTIA, G = 0.01, 2.0, 3e-4, 9.81  # m/rad, kg, kg m^2 about the axis, m/s^2

t_end = 2.0  # s
measure = "nut.position"


class Screw(mb.Joint):
    """l travels `pitch` metres along k.z for every radian it turns about it."""

    params = mb.params(pitch=("m/rad", "travel per angle"))
    coordinates = mb.params(displacement=("m", "travel of l along k.z"))

    def motion(self, from_k):
        return from_k.along("z", self.displacement).about("z", self.displacement / self.pitch)


def scene():
    """A nut on a vertical screw; the axis points down, so the travel is positive."""
    s = mb.Scene("screw", gravity=(0, 0, -G))
    nut = s.rigid_body("nut", MASS, (INERTIA, INERTIA, INERTIA), at=(0, 0, 0), shape=mb.Box(size=(0.08, 0.08, 0.03)))
    s.joint(Screw, "thread", s.ground, nut, at=(0, 0, 0), axis=(0, 0, -1), pitch=PITCH)
    return s


def travel(t):
    """Travel in m at time t in s, from rest."""
    return G / (1 + INERTIA / (MASS * PITCH**2)) * t**2 / 2


def run():
    """Two seconds of fall."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Travel in two seconds, m."""
    return r["thread"].displacement[-1], travel(t_end)


def picture(r):
    """Travel and rate."""
    return r.plot("thread.displacement", "nut.velocity")
