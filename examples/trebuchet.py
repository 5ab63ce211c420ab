r"""Which number of a trebuchet lengthens its throw? The derivative of the range by every one of them, from one run.

A counterweight falls on the short arm, the long arm whirls a sling. A stone let go at the height y with the velocity (u, v)
lands at

    x + u (v + sqrt(v^2 + 2 g y)) / g,

an expression of what the run shows at its end. `r.gradient` takes the weights of this number back along the steps of the run,
and through them to masses and places of the scene; each derivative has an error.

Run it:  mbdae run examples/trebuchet.py --out out
"""

import mbdae as mb

WEIGHT, STONE, G = 2000.0, 25.0, 9.81  # kg, kg, m/s^2
RANGE = mb.at_end(f"stone.position[0] + stone.velocity[0]*(stone.velocity[1]"
                  f" + sqrt(stone.velocity[1]**2 + 2*{G}*stone.position[1]))/{G}")

t_end = 1.02  # s, when the sling lets go
measure = "stone.velocity"
KNOWN = 1e-7  # relative, of the number: what differences of runs leave open


def scene(weight=WEIGHT):
    """Long arm down to the left, the sling drawn back under it."""
    s = mb.Scene("trebuchet", gravity=(0, -G, 0))
    arm = s.link("arm", (-4.0, 1.0), (1.0, 6.0), mass=120.0, color="tab:brown")
    bucket = s.rigid_body("counterweight", weight, 0.2 * weight, at=(1.0, 4.5), shape=mb.Box(size=(1.0, 1.0, 1.0)))
    sling = s.link("sling", (-4.0, 1.0), (0.0, 0.5), mass=1.0)
    stone = s.point_mass("stone", STONE, at=(0.0, 0.5))
    s.revolute("axle", s.ground, arm, at=(0, 5))
    s.revolute("hanger", arm, bucket, at=(1.0, 6.0), damper=50.0)
    s.revolute("sling's end", arm, sling, at=(-4.0, 1.0))
    s.spherical("pouch", sling, stone, at=(0.0, 0.5))
    return s


def run():
    """Until the sling lets go."""
    return scene().simulate(t_end, accuracy=1e-7, derivatives=True)


def number(r):
    """Metres of range for a kilogramme of counterweight, m/kg."""
    found = r.gradient(RANGE, to=["counterweight.mass", "stone.mass"])["counterweight.mass"]
    near = [scene(WEIGHT + d).simulate(t_end, accuracy=1e-10).value(RANGE.quantity)[-1] for d in (-20.0, -10.0, 10.0, 20.0)]
    return found.value, (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / 120.0, found.error


def picture(r):
    """The way of the stone."""
    return r.orbit("stone")
