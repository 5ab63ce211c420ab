r"""A crane whose trolley is driven to 3 m and stopped there by a lock: how far the load swings.

The drive holds a speed, F = c (v - x'). The run ends where the trolley has come to 3 m; a second scene, in which it is held
there, goes on from that state. The lock stops the trolley by an impulse; rope and load keep their angular momentum about the
pivot. From then on they are a pendulum of inertia I and first moment S = sum m d, which swings to

    cos(a) = cos(a0) - I w0^2 / (2 g S),

a0 and w0 its angle and rate just after the lock.

Run it:  mbdae run examples/crane.py --out out
"""

import math

import mbdae as mb

TROLLEY, ROPE, LOAD, LENGTH, SIZE = 60.0, 4.0, 200.0, 5.0, 8.0  # kg, kg, kg, m, kg m^2 of the load
DRIVE, SPEED, STOP, G = 600.0, 1.2, 3.0, 9.81  # N s/m, m/s, m, m/s^2

t_end = 20.0  # s
measure = "pivot.angle"
UNTIL = f"rail.displacement > {STOP}"


def scene(held=None):
    """The crane; held: where the trolley is locked, m; None: it is driven."""
    s = mb.Scene("crane", gravity=(0, -G, 0))
    trolley = s.rigid_body("trolley", TROLLEY, 1.0, at=(0, 0))
    rope = s.link("rope", (0, 0), (0, -LENGTH), mass=ROPE)
    load = s.rigid_body("load", LOAD, SIZE, at=(0, -LENGTH))
    drive = {"force": DRIVE * (SPEED - s.sensor("rail.rate"))} if held is None else {"position": held}
    s.prismatic("rail", s.ground, trolley, at=(0, 0), axis=(1, 0, 0), **drive)
    s.revolute("pivot", trolley, rope, at=(0, 0))
    s.weld("hook", rope, load, at=(0, -LENGTH))
    return s


def runs(accuracy=1e-8):
    """The run to the stop, and the one behind it, with the instants at which the swing turns."""
    first = scene().simulate(t_end, accuracy=accuracy, until=UNTIL)
    second = scene(held=STOP).simulate(t_end, accuracy=accuracy, start=first, record="pivot.rate == 0")
    return first, second


def swing(angle, rate):
    """Largest angle of the pendulum (rad) from an angle (rad) and a rate (rad/s)."""
    inertia = ROPE * LENGTH**2 / 3 + LOAD * LENGTH**2 + SIZE
    moment = ROPE * LENGTH / 2 + LOAD * LENGTH
    return math.acos(math.cos(angle) - inertia * rate**2 / (2 * G * moment))


run = runs


def number(r):
    """Largest angle of the swing after the stop, rad."""
    second = r[1]
    return second.peak("pivot.angle").value, swing(second["pivot"].angle[0], second["pivot"].rate[0])


def picture(r):
    """Angle of the rope and place of the trolley until it is stopped."""
    return r[0].plot("rail.displacement", "pivot.angle", "rail.drive")
