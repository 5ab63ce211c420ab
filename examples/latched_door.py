r"""A door that springs shut against its stop, and a latch that keeps it there.

A closer k turns the door (inertia J about the hinge) from rest at the angle phi0 without damping, so it meets the stop with

    omega = phi0 sqrt(k / J).

In the stop w^2 = (k_s + k) / J and z = c_s / (2 J w), and the door leaves it with exp(-2 z arccos(z) / sqrt(1 - z^2)) of
omega, 0.64 of it. The latch is a roller on a spring beside the door: to ride over it takes 9 J. The nose at the door's edge does
so with the 15 J of the closer, and not with the 6 J that the stop leaves.

Run it:  mbdae run examples/latched_door.py --out out
"""

import math

import mbdae as mb

MASS, WIDTH, CLOSER, PHI0 = 20.0, 0.8, 30.0, 1.0  # kg, m, N m/rad, rad
STOP, DAMPING = 4e5, 400.0  # N m/rad, N m s/rad
INERTIA = MASS * WIDTH**2 / 3  # kg m^2 about the hinge

t_end = 2.0  # s
measure = "hinge.angle"


def scene(latch=True):
    """Seen from above; the closed door lies along x, open angles are positive."""
    s = mb.Scene("latched door", space="planar")
    nose, leaf = mb.Sphere(at=(WIDTH, 0), radius=0.02), mb.Box(at=(WIDTH / 2, 0), size=(WIDTH, 0.04))
    door = s.link("door", (0, 0), (WIDTH, 0), mass=MASS, shape=[leaf, nose], color="tab:brown")
    s.revolute("hinge", s.ground, door, at=(0, 0), angle0=PHI0, spring=CLOSER, limits=(0, None),
               stop=mb.Stop(stiffness=STOP, damping=DAMPING))
    if latch:
        roller = s.rigid_body("roller", 0.1, 2e-5, at=(WIDTH + 0.025, 0.03), color="tab:gray")
        s.prismatic("slide", s.ground, roller, at=(WIDTH + 0.025, 0.03), axis=(-1, 0), spring=8e4, damper=20.0)
        s.contact("latch", door, roller, nose, mb.Sphere(radius=0.02), normal=mb.Hertz(1e8, 0.5))
    return s


def speed_at_the_stop():
    """rad/s, without the latch."""
    return PHI0 * math.sqrt(CLOSER / INERTIA)


def rebound():
    """Speed after the stop over that before it, without the latch."""
    z = DAMPING / (2 * math.sqrt(INERTIA * (STOP + CLOSER)))
    return math.exp(-2 * z * math.acos(z) / math.sqrt(1 - z**2))


def run():
    """The door with its latch."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Rate with which a door without latch meets the stop, rad/s."""
    free = scene(latch=False).simulate(t_end, accuracy=1e-7)
    return -free(free["hinge"].contacts.begin[0])["hinge"].rate[0], speed_at_the_stop()


def picture(r):
    """The door is caught."""
    return r.plot("hinge.angle", "latch.normal_force")
