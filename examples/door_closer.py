r"""A door closer from what a sensor on the door showed: spring, damper and dry friction of its hinge, with their errors.

    I phi'' = -k phi - c phi' - mu N r tanh(r phi' / v_c),    I = m b^2 / 3

The measurements are made here from this equation by SciPy, with errors of 2 mrad, so that the numbers are known. The fit begins
at numbers that are off by a third to a half.

Run it:  mbdae run examples/door_closer.py --out out
"""

import numpy as np
from scipy.integrate import solve_ivp

import mbdae as mb

MASS, WIDTH, RADIUS, PRESS, SLOW = 25.0, 0.9, 0.02, 250.0, 2e-3  # kg, m, m, N, m/s
TRUE = {"hinge.spring": 30.0, "hinge.damper": 6.0, "hinge.friction.mu": 0.3}  # N m/rad, N m s/rad, 1
OPEN, ERROR = 1.2, 2e-3  # rad

t_end = 3.0  # s
measure = "hinge.angle"
WITHIN = 1e-2  # relative, of the number: three standard deviations of the spring


def scene(spring=20.0, damper=9.0, mu=0.2):
    """The door as first guessed, open."""
    s = mb.Scene("door closer")
    leaf = s.link("leaf", (0, 0), (WIDTH, 0), mass=MASS)
    s.revolute("hinge", s.ground, leaf, at=(0, 0), spring=spring, damper=damper, angle0=OPEN,
               friction=mb.Coulomb(mu=mu, v_c=SLOW), radius=RADIUS, normal_force=PRESS)
    return s


def measured(seed=0):
    """Times (60,), s, and what the sensor showed, rad."""
    k, c, mu = TRUE.values()

    def rates(t, y):
        torque = -k * y[0] - c * y[1] - mu * PRESS * RADIUS * np.tanh(RADIUS * y[1] / SLOW)
        return [y[1], torque / (MASS * WIDTH**2 / 3)]

    t = np.linspace(0.05, t_end, 60)
    angle = solve_ivp(rates, (0, t_end), [OPEN, 0.0], method="LSODA", rtol=1e-10, atol=1e-12, t_eval=t).y[0]
    return t, angle + ERROR * np.random.default_rng(seed).normal(size=len(t))


def fitted(seed=0):
    """The numbers of the hinge, with their standard deviations."""
    return mb.fit(scene(), {"hinge.angle": measured(seed)}, to=list(TRUE), sigma=ERROR)


def run():
    """The door as fitted."""
    return fitted().result


def number(r):
    """Stiffness of the spring, N m/rad."""
    return fitted().values["hinge.spring"], TRUE["hinge.spring"]


def picture(r):
    """The fitted motion."""
    return r.plot("hinge.angle", "hinge.rate")


if __name__ == "__main__":
    print(fitted())
