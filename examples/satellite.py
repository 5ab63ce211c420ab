r"""A satellite from an MJCF file turns without any torque from outside: its arm goes round once, and the hull has turned back.

Momentum and angular momentum stay 0. With the reduced mass u = M m / (M + m), the moments I and i of hull and arm about their
centres, and c from the hinge to the arm's centre, that means for the rates w of the hull and p of the hinge

    (I + i + u c^2) w + (i + u c^2) p = 0,

so that a whole turn of the arm turns the hull by -2 pi (i + u c^2) / (I + i + u c^2), whatever its pace.

Needs the extra robots. Run it:  mbdae run examples/satellite.py --out out
"""

import math
from pathlib import Path

import mbdae as mb

MJCF = Path(__file__).with_name("satellite.xml")
HULL, ARM, CENTRE, HULL_MOMENT, ARM_MOMENT = 40.0, 5.0, 0.4, 2.5, 0.3  # kg, kg, m, kg m^2, kg m^2

t_end = 4.0  # s
measure = "hull.rotation"


def scene():
    """The satellite of the file; its shoulder turns once, and begins and ends at rest."""
    x = mb.t / t_end
    s = mb.read_mjcf(MJCF)
    s.couple("turn", {"shoulder.angle": 1}, 2 * math.pi * (10 * x**3 - 15 * x**4 + 6 * x**5))
    return s


def run():
    """One turn of the arm."""
    return scene().simulate(t_end, accuracy=1e-8)


def number(r):
    """Angle by which the hull has turned, rad."""
    rotation = r["hull"].rotation[-1]
    arm = ARM_MOMENT + HULL * ARM / (HULL + ARM) * CENTRE**2
    return math.atan2(rotation[1, 0], rotation[0, 0]), -2 * math.pi * arm / (HULL_MOMENT + arm)


def picture(r):
    """Rate of the hull."""
    return r.plot("hull.angular_velocity", "shoulder.angle")
