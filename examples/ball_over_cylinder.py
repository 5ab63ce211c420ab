r"""A ball rolls over the top of a fixed cylinder and leaves it.

A solid ball (radius r) that rolls from rest at the top of a cylinder (radius R) without slipping has at the angle phi

    v^2 = 10/7 g (R + r) (1 - cos phi),

and leaves where the normal force m (g cos phi - v^2 / (R + r)) vanishes: cos phi = 10/17, 53.97 degrees; a mass that slides
without friction leaves at cos phi = 2/3, 48.19 degrees. Here a small speed starts it, which the energy accounts for.

Run it:  mbdae run examples/ball_over_cylinder.py --accuracy 1e-4 --out out
"""

import math

import mbdae as mb

BIG, SMALL, MASS, G, START = 0.5, 0.1, 1.0, 9.81, 0.1  # m, m, kg, m/s^2, m/s
LAW = mb.Hertz(1e11, 0.5)

t_end = 1.4  # s
measure = "ball.position"
WITHIN = 2e-3  # relative, of the number: elastic contact ends a little later


def scene(mu=100.0):
    """A ball at the top, pressed in by its weight; mu: of friction, 0 for none, large for rolling to the end."""
    s = mb.Scene("ball over cylinder", gravity=(0, -G, 0), space="planar")
    at = (0, BIG + SMALL - LAW.penetration(MASS * G))
    spin = -START / SMALL if mu else 0.0
    ball = s.rigid_body("ball", MASS, 0.4 * MASS * SMALL**2, at=at, velocity=(START, 0), angular_velocity=(0, 0, spin))
    s.contact("drum", s.ground, ball, mb.Cylinder(at=(0, 0), radius=BIG, length=0.4), mb.Sphere(radius=SMALL), normal=LAW,
              friction=mb.Coulomb(mu, 1e-4) if mu else None)
    return s


def leaves(rolls=True):
    """The angle (rad) from the top at which it leaves."""
    ratio = 5 / 7 if rolls else 1.0  # share of the kinetic energy that is translation
    return math.acos((2 * ratio + START**2 / (G * (BIG + SMALL))) / (1 + 2 * ratio))


def left(result):
    """The angle (rad) at which the first contact of a run ends."""
    x, y, _ = result(result["drum"].contacts.end[0])["ball"].position[0]
    return math.atan2(x, y)


def run():
    """The ball that rolls."""
    return scene().simulate(t_end, accuracy=1e-4)


def number(r):
    """Angle at which it leaves, rad."""
    return left(r), leaves()


def picture(r):
    """Force of the contact, and spin."""
    return r.plot("drum.normal_force", "ball.angular_velocity")
