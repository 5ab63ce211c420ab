"""A crane lifts a load on four falls: a rope from a drum over the boom's pulleys and a hook block of two.

The rope carries a quarter of the load, and the load rises by a quarter of what the drum winds. The drum, of radius R, is driven
at w = 2 rad/s after a smooth start; the hook then rises with R w / 4, and the tension is m g / 4.

Run it:  mbdae run examples/hook_block.py --out out
"""

import mbdae as mb

G, LOAD, R, PULLEY, DEPTH = 9.81, 2000.0, 0.25, 0.2, 8.0  # m/s^2, kg, m, m, m
RATE, STARTS = 2.0, 1.0  # rad/s of the drum, s until it has it
STIFFNESS, DAMPING = 4e6, 1e6  # N, N s

t_end = 4.0  # s
measure = "hook.position"
WITHIN = 3e-3  # relative, of the number: the rope to the drum is not upright


def scene():
    """The hook block is guided, so that it does not swing."""
    s = mb.Scene("hook block", gravity=(0, -G, 0))
    hook = s.rigid_body("hook", LOAD, 50.0, at=(0, -DEPTH))
    drum = s.rigid_body("drum", 200.0, 8.0, at=(-3, 0))
    x = mb.t / STARTS
    turned = RATE * STARTS * (x**3 - x**4 / 2)  # rad, of the smooth start: half of RATE * STARTS at its end
    s.revolute("axle", s.ground, drum, at=(-3, 0), angle=_then(turned, RATE * STARTS / 2 + RATE * (mb.t - STARTS)))
    s.prismatic("guide", s.ground, hook, at=(0, -DEPTH), axis=(0, 1, 0))
    s.rope("rope", drum, s.ground, at_k=(-3, 0), at_l=(2 * PULLEY, 0), radius_k=-R, stiffness=STIFFNESS, damping=DAMPING,
           over=[(s.ground, -PULLEY, (-3 * PULLEY, 0)), (hook, PULLEY, (-PULLEY, -DEPTH)), (s.ground, -PULLEY, (0, 0)),
                 (hook, PULLEY, (PULLEY, -DEPTH))])
    return s


def _then(first, second):
    """The first expression until the start is over, then the second."""
    import sympy

    return sympy.Piecewise((first, mb.t < STARTS), (second, True))


def run():
    """Four seconds of hoisting."""
    return scene().simulate(t_end, accuracy=1e-5, of=["rope.tension"])


def number(r):
    """Tension of the rope at the end, N."""
    return r["rope"].tension[-1], LOAD * G / 4


def picture(r):
    """Rate of the hook, and the tension."""
    return r.plot("guide.rate", "rope.tension")


if __name__ == "__main__":
    r = scene().simulate(t_end, accuracy=1e-6)
    print(f"rises with {r['guide'].rate[-1]:.4f} m/s; R w / 4 = {R * RATE / 4:.4f} m/s")
    print(f"tension {r['rope'].tension[-1]:.1f} N; m g / 4 = {LOAD * G / 4:.1f} N")
