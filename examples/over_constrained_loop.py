r"""Bennett's linkage: four hinges in space, none parallel, and yet a mechanism.

Four bodies in a loop of four hinges have 6 * 3 - 5 * 4 = -2 freedoms by counting. If opposite links are equal, with lengths a
and b and twists alpha and beta of their hinges, and a / sin(alpha) = b / sin(beta), the loop moves all the same: three of the
twenty rows say nothing new, in every position. With the angles p and q between neighbouring links Bennett found (1914)

    tan(p/2) tan(q/2) = sin((beta + alpha)/2) / sin((beta - alpha)/2).

Hinge 1 is turned at constant speed; the angle of hinge 2 is compared with this formula over a turn.

Run it:  mbdae run examples/over_constrained_loop.py --out out
"""

import math

import numpy as np

import mbdae as mb

A, ALPHA, BETA = 0.6, 0.6, 1.3  # m, rad, rad
LENGTHS, TWISTS = (A, A * math.sin(BETA) / math.sin(ALPHA)), (ALPHA, BETA)
FIRST, RATE = 1.0, math.pi  # rad as drawn, rad/s

t_end = 2.0  # s, one turn
measure = "hinge 2.angle"


def second(first):
    """Angle q in (0, 2 pi) from p, both in rad."""
    ratio = math.sin((BETA + ALPHA) / 2) / math.sin((BETA - ALPHA) / 2)
    return np.mod(2 * np.arctan(ratio / np.tan(np.asarray(first) / 2)), 2 * np.pi)


def hinges():
    """Places (4, 3) m and directions (4, 3) of the hinges as drawn."""
    place, frame, found = np.zeros(3), np.eye(3), []
    for i, angle in enumerate((FIRST, second(FIRST), -FIRST, -second(FIRST))):
        found.append((place, frame[:, 2]))
        c, s, ct, st = math.cos(angle), math.sin(angle), math.cos(TWISTS[i % 2]), math.sin(TWISTS[i % 2])
        turned = frame @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        place, frame = place + LENGTHS[i % 2] * turned[:, 0], turned @ np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    return tuple(np.array(part) for part in zip(*found, strict=True))


def scene():
    """Three links; the fourth is the ground."""
    s = mb.Scene("Bennett's linkage", gravity=(0, 0, -9.81))
    places, axes = hinges()
    bodies = [s.ground, *(s.link(f"link {i}", places[i - 1], places[i], mass=1.0) for i in (1, 2, 3)), s.ground]
    for i, (place, axis) in enumerate(zip(places, axes, strict=True)):
        drive = {"angle": RATE * mb.t} if i == 0 else {}
        s.revolute(f"hinge {i + 1}", bodies[i], bodies[i + 1], at=place, axis=axis, **drive)
    return s


def run():
    """One turn."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Angle of hinge 2 after 0.7 of a turn, rad."""
    at = 0.7 * t_end
    expected = np.unwrap(second(FIRST + RATE * np.linspace(0, at, 400)))
    return r(at)["hinge 2"].angle[0], expected[-1] - expected[0]


def picture(r):
    """The linkage as drawn."""
    return scene().draw()
