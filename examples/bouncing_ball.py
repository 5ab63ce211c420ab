r"""A ball that hops over a floor: heights, times and lengths of its hops from the coefficient of restitution.

Hertz contact with Hunt-Crossley damping returns a share e of the speed of an impact, which depends on it:

    (1 - d e) exp(d e) = (1 + d) exp(-d),  d = damping * speed.

`coefficient_of_restitution` solves this. From the height h the ball meets the floor with v = sqrt(2 g h); the n-th hop begins
with v_n = e(v_(n-1)) v_(n-1), rises by v_n^2 / 2 g and takes 2 v_n / g. Friction turns the ball until it rolls: after many
impacts its point of contact rests, and of a speed v0 without spin 5/7 are left.

Run it:  mbdae run examples/bouncing_ball.py --out out
"""

import math

import numpy as np

import mbdae as mb

RADIUS, MASS, HEIGHT, SPEED, G = 0.1, 1.0, 1.0, 0.7, 9.81  # m, kg, m under the ball, m/s, m/s^2
LAW = mb.Hertz(1e10, damping=0.05)

t_end = 3.0  # s
measure = "ball.position"
WITHIN = 1e-3  # relative, of the number: an impact takes a millisecond


def scene():
    """A ball thrown along x over a plane."""
    s = mb.Scene("bouncing ball", gravity=(0, 0, -G))
    J = 0.4 * MASS * RADIUS**2
    ball = s.rigid_body("ball", MASS, (J, J, J), at=(0, 0, HEIGHT + RADIUS), velocity=(SPEED, 0, 0), color="tab:orange")
    s.contact("floor", s.ground, ball, mb.Plane(), mb.Sphere(radius=RADIUS), normal=LAW, friction=mb.Coulomb(0.4, 1e-3))
    return s


def hops(count):
    """(begin s, height m) of the first hops after the fall, impacts taken as instants."""
    speed, time, found = math.sqrt(2 * G * HEIGHT), math.sqrt(2 * HEIGHT / G), []
    for _ in range(count):
        speed *= LAW.coefficient_of_restitution(speed)
        found.append((time, speed**2 / (2 * G)))
        time += 2 * speed / G
    return found


def run():
    """Three seconds."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Height of the first hop, m."""
    impacts = r["floor"].contacts
    between = np.linspace(impacts.end[0], impacts.begin[1], 400)
    return np.max(r(between)["ball"].position[:, 2]) - RADIUS, hops(1)[0][1]


def picture(r):
    """Height and speed."""
    return r.plot("ball.position[2]", "ball.velocity[0]")
