r"""Two legs of Theo Jansen's Strandbeest on one crank: the path of a foot against intersections of circles.

Thirteen lengths make eleven rods walk: the crank m moves the rods j and k, the upper triangle (b, d, e) and the rods c, f guide
the lower triangle (g, h, i), whose tip is the foot. Every point lies on two circles about points that are known, on a known
side of the line between them, so that the foot follows from the crank's angle alone. The loops close by themselves.

Run it:  mbdae run examples/strandbeest.py --out out
"""

import numpy as np

import mbdae as mb

A, B, C, D, E, F, G, H, I, J, K, L, M = 1e-2 * np.array(
    [38.0, 41.5, 39.3, 40.1, 55.8, 39.4, 36.7, 65.7, 49.0, 50.0, 61.9, 7.8, 15.0])  # m, Jansen's numbers
RATE = 2 * np.pi / 3  # rad/s of the crank

t_end = 3.0  # s
measure = "left lower.position"


def meet(p, a, q, b, side):
    """The point at the distance a from p and b from q, m; side: 1 to the left of the way from p to q, -1 to the right."""
    way = np.asarray(q) - p
    s = np.linalg.norm(way)
    x = (a**2 - b**2 + s**2) / (2 * s)
    return p + (x * way + side * np.sqrt(a**2 - x**2) * np.array([-way[1], way[0]])) / s


def points(angle):
    """Pin of the crank, pivot, the joints and the foot (2,), m, of the left leg at an angle (rad) of the crank."""
    pin, pivot = M * np.array([np.cos(angle), np.sin(angle)]), np.array([-A, -L])
    top, low = meet(pin, J, pivot, B, -1), meet(pin, K, pivot, C, 1)
    back = meet(top, E, pivot, D, -1)
    knee = meet(back, F, low, G, -1)
    return pin, pivot, top, low, back, knee, meet(knee, H, low, I, -1)


def scene():
    """Both legs drawn with the crank upright; the right one is the mirror image of the left one."""
    s = mb.Scene("Strandbeest", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0, M), mass=0.2)
    s.revolute("drive", s.ground, crank, at=(0, 0), angle=RATE * mb.t)
    for name, mirror in (("left", 1), ("right", -1)):
        pin, pivot, top, low, back, knee, foot = (p * [mirror, 1] for p in points(np.pi / 2))
        rods = [s.link(f"{name} {rod}", p, q, mass=0.1) for rod, p, q in (("j", pin, top), ("k", pin, low), ("c", pivot, low),
                                                                           ("f", back, knee))]
        upper, lower = (s.rigid_body(f"{name} {part}", 0.2, 2e-3, at=np.mean(corners, axis=0))
                        for part, corners in (("upper", (pivot, top, back)), ("lower", (low, knee, foot))))
        s.frame(f"{name} foot", lower, at=foot)
        j, k, c, f = rods
        for i, (one, other, at) in enumerate([
                (crank, j, pin), (crank, k, pin), (s.ground, upper, pivot), (s.ground, c, pivot), (upper, j, top),
                (lower, k, low), (lower, c, low), (upper, f, back), (lower, f, knee)]):
            s.revolute(f"{name} {i}", one, other, at=at)
    return s


def run():
    """One turn of the crank."""
    return scene().simulate(t_end, accuracy=1e-7, outputs=361)


def number(r):
    """Length of a step, m."""
    circles = np.array([points(np.pi / 2 + RATE * t)[-1] for t in r.t])
    return np.ptp(r["left foot"].position[:, 0]), np.ptp(circles[:, 0])


def picture(r):
    """The paths of both feet."""
    return r.orbit("left foot.position")
