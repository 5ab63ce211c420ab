r"""A planetary gearbox under a table of torques: sun driven, ring held, the carrier turns a fan.

With the ring at rest Willis' equation w_S - w_C = -z_R / z_S (w_R - w_C) gives w_S = i w_C with i = 1 + z_R / z_S. The planets
are without mass, and the fan takes the torque d w_C, so that

    (J_C + i^2 J_S) w_C' = i T(t) - d w_C,

which is solved on each straight piece of the table T(t).

Run it:  mbdae run examples/gearbox_torques.py --out out
"""

import numpy as np

import mbdae as mb

SUN, RING = 24, 72  # teeth; one turn of the carrier takes 1 + RING/SUN = 4 turns of the sun
J_SUN, J_CARRIER, DRAG = 0.02, 0.3, 0.05  # kg m^2, kg m^2, N m s/rad
TIMES, TORQUES = [0.0, 1.0, 1.5, 4.0, 6.0], [0.0, 8.0, 3.0, 3.0, 0.0]  # s, N m on the sun

t_end = 8.0  # s
measure = "C.rate"
WITHIN = 1e-6  # relative, of the number


def scene():
    """Sun and carrier about one axis, coupled by Willis' equation."""
    s = mb.Scene("planetary gearbox")
    sun = s.rigid_body("sun", 2.0, (J_SUN, J_SUN, J_SUN), at=(0, 0, 0))
    carrier = s.rigid_body("carrier", 5.0, (J_CARRIER, J_CARRIER, J_CARRIER), at=(0, 0, 0))
    s.revolute("S", s.ground, sun, at=(0, 0, 0), axis=(0, 0, 1), torque=mb.table(TIMES, TORQUES))
    s.revolute("C", s.ground, carrier, at=(0, 0, 0), axis=(0, 0, 1), damper=DRAG)
    s.couple("mesh", {"S.angle": SUN, "C.angle": -(SUN + RING)})
    return s


def exact():
    """Rate of the carrier at the end, rad/s."""
    i = 1 + RING / SUN
    J, w = J_CARRIER + i**2 * J_SUN, 0.0
    for a, b, p, q in zip(TIMES, [*TIMES[1:], t_end], TORQUES, [*TORQUES[1:], TORQUES[-1]], strict=True):
        slope, k = i * (q - p) / (b - a), DRAG / J
        steady = lambda t, a=a, p=p, slope=slope: (i * p + slope * (t - a)) / DRAG - slope * J / DRAG**2  # noqa: E731
        w = steady(b) + (w - steady(a)) * np.exp(-k * (b - a))
    return w


def run():
    """The whole table."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Rate of the carrier at the end, rad/s."""
    return r["C"].rate[-1], exact()


def picture(r):
    """Rates of sun and carrier."""
    return r.plot("S.rate", "C.rate", "S.drive")
