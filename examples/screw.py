r"""A joint of your own: a nut on a screw, in about twenty lines outside the package.

With one degree of freedom s (travel) the nut turns by phi = s / p, p the pitch in m/rad. Under gravity along the
axis its kinetic energy is m s'^2 / 2 + J (s'/p)^2 / 2, so it falls with the constant acceleration

    s'' = g / (1 + J / (m p^2)).

Rows are what vanishes: two offsets (the nut stays on the axis), two rotations (it stays upright), and the thread.
The angle an attitude shows repeats after a turn, so a row such as "angle - s / p" would hold for one turn only.
The thread row here removes the turns made by the travel and asks the rest to be zero,

    x_k . (x_l sin(phi) + y_l cos(phi)) = sin(phi - theta) = 0,     phi = s / p,

which holds turn after turn, as smoothly as the sine does.

Run it:  mbdae run examples/screw.py --out out
"""

import symengine as se

import mbdae as mb

PITCH, MASS, INERTIA, G = 0.01, 2.0, 3e-4, 9.81  # m/rad, kg, kg m^2 about the axis, m/s^2

t_end = 2.0  # s
measure = "nut.position"


class Screw(mb.Joint):
    """l travels `pitch` metres along k.z for every radian it turns about it."""

    params = mb.params(pitch=("m/rad", "travel per angle"))
    coordinate_unit = "m"

    def constraints(self, k, l):
        d = l.r - k.r
        phi = (k.z @ d) / self.pitch
        rows = {"offset_x": k.x @ d, "offset_y": k.y @ d, "upright_x": k.x @ l.z, "upright_y": k.y @ l.z}
        return rows | {"thread": k.x @ (l.x * se.sin(phi) + l.y * se.cos(phi))}

    def branches(self, k, l):
        phi = (k.z @ (l.r - k.r)) / self.pitch
        return {"upright": k.z @ l.z, "thread, not half a turn off": k.x @ (l.x * se.cos(phi) - l.y * se.sin(phi))}

    def coordinate(self, k, l):
        return k.z @ (l.r - k.r)


def scene():
    """A nut on a vertical screw; the axis points down, so the travel is positive."""
    s = mb.Scene("screw", gravity=(0, 0, -G))
    nut = s.rigid_body("nut", MASS, (INERTIA, INERTIA, INERTIA), at=(0, 0, 0))
    s.add(Screw("thread", s.ground, nut, at=(0, 0, 0), axis=(0, 0, -1), pitch=PITCH))
    return s


def travel(t):
    """Travel in m at time t in s, from rest."""
    return G / (1 + INERTIA / (MASS * PITCH**2)) * t**2 / 2
