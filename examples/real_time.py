"""A loop in real time: an inverted pendulum on a cart, held upright by a controller outside of the scene, every 2 ms.

Every step has to be computed before the next one is due. The loop measures its longest step and the margin: the part of the
period that it leaves. `run(paced=True)` waits for the clock, as with hardware in the loop; without, it goes as fast as it can.

The gains place all four poles of the linearised pendulum, for the force u = k . (x, v, angle, rate), so that a small angle is
forgotten.

Run it:  mbdae run examples/real_time.py --out out
"""

import time

import mbdae as mb

PERIOD = 2e-3  # s
GAINS = (10.0, 12.0, -90.0, -25.0)  # N/m, N s/m, N, N s

t_end = 4.0  # s
measure = "pin.angle"


def scene():
    """A rod upright on a cart; 0.1 rad off."""
    s = mb.Scene("cart", gravity=(0, -9.81, 0))
    cart = s.rigid_body("cart", 1.0, 0.1)
    rod = s.link("rod", (0, 0), (0, 1), mass=0.3)
    s.signal("u", 0.0)  # N
    s.prismatic("rail", s.ground, cart, at=(0, 0), axis=(1, 0, 0), force="u")
    s.revolute("pin", cart, rod, at=(0, 0), angle0=0.1)
    return s


def run(seconds=t_end, paced=False):
    """The stepper after so many seconds, and the margin: the part of a period that its longest step leaves."""
    step, worst = scene().stepper(PERIOD), 0.0
    step.advance()  # what is compiled at first use is ready
    step.reset()
    names = ("rail.displacement", "rail.rate", "pin.angle", "pin.rate")
    [step[name] for name in names]
    due = time.perf_counter()
    for _ in range(round(seconds / PERIOD)):
        begin = time.perf_counter()
        step.set(u=sum(gain * step[name] for gain, name in zip(GAINS, names, strict=True)))
        step.advance()
        worst = max(worst, time.perf_counter() - begin)
        due += PERIOD
        while paced and time.perf_counter() < due:
            pass
    return step, 1 - worst / PERIOD


if __name__ == "__main__":
    step, margin = run(paced=True)
    print(f"angle {step['pin.angle']:.1e} rad after {step.t:g} s, estimated error {step.error:.1e}, margin {100 * margin:.0f} %")
