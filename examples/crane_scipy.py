r"""A crane that sets its load down at rest: the path of the trolley by SciPy's `root`, with the derivatives of the run.

    theta'' = -3 / (2 l) (g sin(theta) + x'' cos(theta)),    x = D s^3 (10 - 15 s + 6 s^2) + s^3 (1 - s)^3 (a + b s),   s = t / T

The two numbers a and b are found such that the load, a rod of length l, hangs still when the trolley stops. `mb.function` makes
the scene a function of them that has a Jacobian. crane_torch.py and crane_jax.py find the same numbers by these packages.

Run it:  mbdae run examples/crane_scipy.py --out out
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

import mbdae as mb

LENGTH, MASS, WAY, G = 4.0, 500.0, 6.0, 9.81  # m, kg, m, m/s^2
NAMES = ["a", "b"]  # m
t_end, measure = 4.0, "rope.angle"  # s


def path(t, a, b):
    """Where the trolley is, m."""
    s = t / t_end
    return WAY * s**3 * (10 - 15 * s + 6 * s**2) + s**3 * (1 - s) ** 3 * (a + b * s)


def scene(a=0.0, b=0.0):
    """Trolley and load; a, b: numbers of the path, m."""
    s = mb.Scene("crane", gravity=(0, -G, 0))
    trolley = s.rigid_body("trolley", 200.0, 50.0, at=(0, 0))
    rail = path(mb.t, mb.number("a", a), mb.number("b", b))
    s.prismatic("rail", s.ground, trolley, at=(0, 0), axis=(1, 0, 0), position=rail)
    s.revolute("rope", trolley, s.link("load", (0, 0), (0, -LENGTH), mass=MASS), at=(0, 0))
    return s


def swing():
    """What is left at the end, angle (rad) and rate (rad/s), as a function of the two numbers."""
    return mb.function(scene(), t_end, of=["rope.angle", "rope.rate"], to=NAMES)


def run():
    """The run with the numbers that leave nothing."""
    f = swing()
    p = root(f, [0.0, 0.0], jac=lambda p: f.jacobian(p), tol=1e-9).x
    return scene(*p).simulate(t_end, outputs=np.linspace(0, t_end, 201))


def expected():
    """The same two numbers, m, by the equation above in SciPy, with differences."""
    h = 3e-4  # s

    def left(p):
        def rates(t, y):
            second = (path(t + h, *p) - 2 * path(t, *p) + path(t - h, *p)) / h**2
            return y[1], -1.5 / LENGTH * (G * np.sin(y[0]) + second * np.cos(y[0]))

        return solve_ivp(rates, (0, t_end), [0.0, 0.0], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]

    return root(left, [0.0, 0.0]).x


def number(r):
    """The number a of the path, m."""
    return r.prepared.model.scene.numbers["a"], expected()[0]


def picture(r):
    """The angle of the load, and the way of the trolley."""
    return r.plot("rope.angle", "rail.displacement")


if __name__ == "__main__":
    print(run().prepared.model.scene.numbers, expected())
