"""Co-simulation: a hydraulic cylinder of one program moves a mass of another, in steps of 0.2 ms.

The cylinder has two chambers of area A, volumes V1 = V0 + A x, V2 = V0 - A x and the pressures

    p1' = K/V1 (Q - A v - c (p1 - p2)),    p2' = K/V2 (-Q + A v + c (p1 - p2)),

x, v: displacement and speed of the piston, Q: flow of the valve, K: bulk modulus, c: leakage. It pushes with A (p1 - p2).
`Cylinder` knows nothing of mbdae: it is given x and v of the step before and returns a force, held over the next step. The delay
makes the coupling of order one: half the step has half the error. `scene(together=True)` has the pressures as states of the
same scene, so that there is no coupling error: the reference.

Where the valve lets Q through, the piston comes to move with Q/A, less what leaks.

Run it:  mbdae run examples/hydraulic_cylinder.py --out out
"""

import mbdae as mb

MASS, DAMPING = 200.0, 2000.0  # kg, N s/m
AREA, VOLUME, BULK, LEAK = 2e-3, 2e-4, 1.4e9, 2e-12  # m^2, m^3 of a chamber, Pa, m^3/(s Pa)
FLOW, OPENS = 2e-4, 0.02  # m^3/s, after which time constant in s

t_end = 0.3  # s
measure = "slide.displacement"


class Cylinder:
    """The hydraulic part with a step of its own, the classical method of Runge and Kutta."""

    def __init__(self):
        self.t, self.p = 0.0, (0.0, 0.0)

    def rates(self, t, p, x, v):
        """Rates of the pressures, Pa/s."""
        through = FLOW * t / (OPENS + t) - AREA * v - LEAK * (p[0] - p[1])
        return BULK * through / (VOLUME + AREA * x), -BULK * through / (VOLUME - AREA * x)

    def advance(self, dt, x, v):
        """The force on the piston, N, after a step with its displacement x and speed v held."""
        h = dt / 4
        for _ in range(4):
            k = [(0.0, 0.0)]
            for part in (0.0, 0.5, 0.5, 1.0):
                at = [p + part * h * rate for p, rate in zip(self.p, k[-1], strict=True)]
                k.append(self.rates(self.t + part * h, at, x + part * h * v, v))
            self.p = [p + h / 6 * (a + 2 * b + 2 * c + d) for p, a, b, c, d in zip(self.p, *k[1:], strict=True)]
            self.t += h
        return AREA * (self.p[0] - self.p[1])


def scene(together=False):
    """A mass on a slide, pushed by the force u. together: the pressures are states of the scene."""
    s = mb.Scene("hydraulic cylinder", gravity=(0, -9.81, 0))
    mass = s.rigid_body("mass", MASS, 1.0)
    push = s.sensor("u")
    if together:
        x, v, p1, p2 = (s.sensor(name) for name in ("slide.displacement", "slide.rate", "p1", "p2"))
        through = FLOW * mb.t / (OPENS + mb.t) - AREA * v - LEAK * (p1 - p2)
        s.state("p1", BULK * through / (VOLUME + AREA * x), size=1e6)
        s.state("p2", -BULK * through / (VOLUME - AREA * x), size=1e6)
        push = AREA * (p1 - p2)
    else:
        s.signal("u", 0.0)
    s.prismatic("slide", s.ground, mass, at=(0, 0), axis=(1, 0, 0), damper=DAMPING, force=push)
    return s


def coupled(dt):
    """Displacement (m) at the end of steps of dt (s), and the stepper."""
    step, cylinder = scene().stepper(dt), Cylinder()
    for _ in range(round(t_end / dt)):
        step.set(u=cylinder.advance(dt, step["slide.displacement"], step["slide.rate"]))
        step.advance()
    return step["slide.displacement"], step


if __name__ == "__main__":
    exact = scene(together=True).simulate(t_end, accuracy=1e-8)["slide"].displacement[-1]
    for dt in (2e-4, 1e-4, 5e-5):
        print(f"steps of {dt:g} s: off by {coupled(dt)[0] - exact:.2e} m of {exact:.4f} m")
