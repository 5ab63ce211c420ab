r"""A door closer from what a sensor on the door showed: spring, damper and dry friction of its hinge, with their errors.

    I phi'' = -k phi - c phi' - mu N r tanh(r phi' / v_c),    I = m b^2 / 3

The measurements are made from this equation by SciPy, with errors of 2 mrad. The fit begins at numbers that are off by a third to
a half; the true ones lie within its 95 % intervals as often as that says.

Run it:  mbdae run examples/door_closer.py --out out
"""

import numpy as np
from scipy.integrate import solve_ivp

import mbdae as mb

MASS, WIDTH, RADIUS, PRESS, SLOW = 25.0, 0.9, 0.02, 250.0, 2e-3  # kg, m, m, N, m/s
TRUE = {"hinge.spring": 30.0, "hinge.damper": 6.0, "hinge.friction.mu": 0.3}  # N m/rad, N m s/rad, 1
OPEN, ERROR = 1.2, 2e-3  # rad
t_end, measure = 3.0, "hinge.angle"  # s


def scene(spring=20.0, damper=9.0, mu=0.2):
    """The door as first guessed, open."""
    s = mb.Scene("door closer")
    leaf, dry = s.link("leaf", (0, 0), (WIDTH, 0), mass=MASS), mb.Coulomb(mu=mu, v_c=SLOW)
    s.revolute("hinge", s.ground, leaf, at=(0, 0), spring=spring, damper=damper, angle0=OPEN, friction=dry, radius=RADIUS,
               normal_force=PRESS)
    return s


def measured(seed=0):
    """Times (60,), s, and what the sensor showed, rad."""
    def rates(t, y, k, c, mu):
        return [y[1], -(k * y[0] + c * y[1] + mu * PRESS * RADIUS * np.tanh(RADIUS * y[1] / SLOW)) / (MASS * WIDTH**2 / 3)]

    t = np.linspace(0.05, t_end, 60)
    angle = solve_ivp(rates, (0, t_end), [OPEN, 0.0], "LSODA", t, rtol=1e-10, atol=1e-12, args=[*TRUE.values()]).y[0]
    return t, angle + ERROR * np.random.default_rng(seed).normal(size=len(t))


def fitted(seed=0):
    """The numbers of the hinge, with their standard deviations."""
    return mb.fit(scene(), {"hinge.angle": measured(seed)}, to=list(TRUE), sigma=ERROR)


run = fitted


def number(f):
    """Friction of the hinge, with its 99.9 % interval."""
    return (value := f.values["hinge.friction.mu"]), TRUE["hinge.friction.mu"], f.interval(0.999)["hinge.friction.mu"][1] - value


def picture(f):
    """What the sensor showed, and the fitted motion."""
    return f.plot()


if __name__ == "__main__":
    print(door := fitted(), door.interval(0.95))
