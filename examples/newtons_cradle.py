r"""Newton's cradle: five steel balls, of which the first passes all it has to the last.

Balls of equal mass that meet one after the other exchange their speeds, whatever the law of their contact, as long as nothing is
lost: Hertz without damping. A millimetre between them keeps the impacts apart, so that the last ball rises as far as the first
one fell; the pendulums between swing no further than that millimetre.

Run it:  mbdae run examples/newtons_cradle.py --out out
"""

import mbdae as mb

RADIUS, MASS, LENGTH, GAP, COUNT, RAISED = 0.05, 4.0, 0.5, 1e-3, 5, 0.6  # m, kg, m, m, 1, rad

t_end = 2.8  # s
measure = "pivot 5.angle"


def scene():
    """The first ball is drawn aside."""
    s = mb.Scene("Newton's cradle", gravity=(0, -9.81, 0))
    balls = []
    for i in range(COUNT):
        x = i * (2 * RADIUS + GAP)
        balls.append(s.rigid_body(f"ball {i + 1}", MASS, 0.4 * MASS * RADIUS**2, at=(x, 0), color="tab:gray"))
        s.revolute(f"pivot {i + 1}", s.ground, balls[-1], at=(x, LENGTH), angle0=-RAISED if i == 0 else 0.0)
    for i in range(COUNT - 1):
        s.contact(f"contact {i + 1}", *balls[i : i + 2], mb.Sphere(radius=RADIUS), mb.Sphere(radius=RADIUS), normal=mb.Hertz(5e9))
    return s


def run():
    """To and fro, a little more than once."""
    return scene().simulate(t_end, accuracy=1e-6, outputs=561)


def number(r):
    """Angle to which the last ball rises, rad."""
    peak = r.peak("pivot 5.angle")
    return peak.value, RAISED


def picture(r):
    """Angles of the first and of the last ball."""
    return r.plot("pivot 1.angle", "pivot 3.angle", "pivot 5.angle")
