"""Shafts with one and two joints of Cardan, by the closed forms of every textbook on them.

A cross keeps the pins of both shafts perpendicular. Where the pin of the driving shaft starts normal to the plane of the shafts,
tan(out) = cos(bend) tan(in); where it starts in that plane, tan(out) = tan(in) / cos(bend). Both are tan(out) = c tan(in), with

    d out / d in = c / D,   d2 out / d in2 = c (1 - c^2) sin(2 in) / D^2,   D = cos(in)^2 + c^2 sin(in)^2.

Two joints at equal bends multiply the factors c: with the forks of the shaft between them in one plane 1, else that of
one, squared.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import mbdae as mb

BEND, SPEED, INERTIA = 0.6, 7.0, 0.35  # rad, rad/s, kg m^2 of the last shaft about its axis
T_END = 1.2  # s, more than a turn
NORMAL = np.array([0.0, 1.0, 0.0])  #: to the plane of the shafts
FIRST, SECOND = np.array([0.0, 0.0, 1.0]), np.array([np.sin(BEND), 0.0, np.cos(BEND)])


def shafts(first_pin: np.ndarray, second_pin: np.ndarray | None = None) -> mb.Scene:
    """Shafts in bearings, the first at a constant speed: two, or three where the second joint has a pin, on the shaft between."""
    s = mb.Scene("shafts")
    axes = [FIRST, SECOND] if second_pin is None else [FIRST, SECOND, FIRST]
    ends = np.vstack([-FIRST, np.zeros(3), np.cumsum(axes[1:], axis=0)])
    bodies = []
    for i, axis in enumerate(axes):
        R = np.column_stack([np.cross(NORMAL, axis), NORMAL, axis])
        bodies.append(s.rigid_body(f"shaft {i}", 1.0, (0.2, 0.2, INERTIA), at=(ends[i] + ends[i + 1]) / 2, rotation=R))
    s.revolute("in", s.ground, bodies[0], at=ends[0], axis=axes[0], angle=SPEED * mb.t)
    for i, pin in enumerate([first_pin] if second_pin is None else [first_pin, second_pin]):
        s.universal(f"cross {i}", bodies[i], bodies[i + 1], at=ends[i + 1], axis=axes[i], axis_l=axes[i + 1], pin=pin)
    s.revolute("out", s.ground, bodies[-1], at=ends[-1], axis=axes[-1])
    return s


def errors() -> Iterator[tuple[str, float]]:
    """Angle, speed and torque of the drive: relative errors."""
    c, in_plane, of_second = np.cos(BEND), np.cross(NORMAL, FIRST), np.cross(NORMAL, SECOND)
    cases = {"pin normal to the plane": (shafts(NORMAL), c, 1), "pin in the plane": (shafts(in_plane), 1 / c, 1),
             "pin by default": (shafts(None), c, 1), "forks in one plane": (shafts(NORMAL, of_second), 1.0, 2),
             "forks in one plane, turned": (shafts(in_plane, NORMAL), 1.0, 2),
             "forks at right angles": (shafts(NORMAL, NORMAL), c**2, 2),
             "forks at right angles, turned": (shafts(in_plane, of_second), c**-2, 2)}
    for name, (s, factor, crosses) in cases.items():
        r = s.simulate(T_END, accuracy=1e-9, outputs=25)
        a = SPEED * r.t
        out, ratio, slope = transmission(a, factor)
        yield f"{name}: angle", np.max(np.abs(np.angle(np.exp(1j * (r["out"].angle - out)))))
        yield f"{name}: speed", np.max(np.abs(r["out"].rate - SPEED * ratio)) / SPEED
        torque = INERTIA * SPEED**2 * ratio * slope  # the power of the drive accelerates the shafts behind the first
        if crosses == 2:
            middle = transmission(a, 1 / c if "turned" in name else c)
            torque = torque + INERTIA * SPEED**2 * middle[1] * middle[2]
        yield f"{name}: torque", np.max(np.abs(r["in"].torque[:, 2] - torque)) / (INERTIA * SPEED**2)


def transmission(a: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle out of the angle in, its first and its second derivative."""
    D = np.cos(a) ** 2 + c**2 * np.sin(a) ** 2
    return np.arctan2(c * np.sin(a), np.cos(a)), c / D, c * (1 - c**2) * np.sin(2 * a) / D**2
