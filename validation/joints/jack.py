"""Screw jack: a spindle turns in a bearing, a nut that is kept from turning carries the load.

Unrolled, the thread is a wedge of angle phi, tan phi = lead / (2 pi r). Equilibrium on the wedge with friction at the angle rho,
tan rho = mu: the torque W r tan(phi + rho) lifts the load W, W r tan(phi - rho) holds it back as it goes down.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import mbdae as mb

WEIGHT, RADIUS, MASS, SPINDLE = 1000.0, 0.012, 100.0, 2e-3  # N, m, kg, kg m^2
CREEP = 1e-4  #: m/s, transition of the friction


def jack(lead: float, mu: float, turning: float | None = None, torque: float | None = None, outwards: bool = True) -> mb.Scene:
    """The nut lifts the load where the spindle turns positively: the thread is left-handed where lead is positive.

    turning: prescribed speed of the spindle, rad/s; else it turns freely under a torque, N m. outwards: the nut is l."""
    s = mb.Scene("screw jack", gravity=(0, 0, -WEIGHT / MASS))
    spindle = s.rigid_body("spindle", 1.0, (0.01, 0.01, SPINDLE), at=(0, 0, 0.2))
    nut = s.rigid_body("nut", MASS, (1.0, 1.0, 1.0), at=(0, 0, 0.3))
    s.revolute("bearing", s.ground, spindle, at=(0, 0, 0), angle=None if turning is None else turning * mb.t, torque=torque)
    s.prismatic("guide", s.ground, nut, at=(0, 0, 0.3), axis=(0, 0, 1))
    rubs = {"friction": mb.Coulomb(mu, CREEP), "radius": RADIUS} if mu else {}
    s.screw("thread", *((spindle, nut) if outwards else (nut, spindle)), at=(0, 0, 0.3), axis=(0, 0, 1), lead=-lead, **rubs)
    return s


def errors() -> Iterator[tuple[str, float]]:
    """Travel of the nut, torque that turns the spindle, torque of the guide and losses: relative errors at constant speed."""
    for lead in (0.005, -0.02):  # self-locking with mu = 0.12, and not
        for mu in (0.0, 0.03, 0.12):
            for turning in (8.0, -8.0):
                r = jack(lead, mu, turning, outwards=mu != 0.03).simulate(0.5, accuracy=1e-9, outputs=6)
                phi, lifts = np.arctan(lead / (2 * np.pi * RADIUS)), np.sign(turning * lead)
                torque = WEIGHT * RADIUS * np.tan(abs(phi) + lifts * np.arctan(mu)) * np.sign(lead)
                case = f"lead {lead:g}, mu {mu:g}, {'up' if lifts > 0 else 'down'}"
                yield f"{case}: travel", np.max(np.abs(r["guide"].displacement - lead * turning * r.t / (2 * np.pi))) / abs(lead)
                size = WEIGHT * RADIUS * np.tan(abs(phi) + np.arctan(mu))
                yield f"{case}: torque", np.max(np.abs(r["bearing"].torque[:, 2] - torque)) / size
                yield f"{case}: guide", np.max(np.abs(r["guide"].torque[:, 2] + torque)) / size
                work = torque * turning * r.t[-1]
                lifted = WEIGHT * lead * turning * r.t[-1] / (2 * np.pi)
                yield f"{case}: lost work", abs(r.energy.friction[-1] - (work - lifted)) / abs(lifted)
    yield from free()


def free() -> Iterator[tuple[str, float]]:
    """A torque that lifts, and the load alone that turns a steep spindle: m p^2 and the inertia of the spindle are accelerated by
    the torque and the tangents."""
    for torque, mu, lead in ((6.0, 0.12, 0.005), (0.0, 0.05, 0.02)):
        r = jack(lead, mu, torque=torque).simulate(0.2, accuracy=1e-9, outputs=5)
        p, up = lead / (2 * np.pi), 1.0 if torque else -1.0
        held = RADIUS * np.tan(np.arctan(p / RADIUS) + up * np.arctan(mu))  # torque over axial force
        second = (torque - WEIGHT * held) / (SPINDLE + MASS * p * held)  # the axial force is WEIGHT + MASS p second
        rate, t = r["bearing"].rate[1:], r.t[1:]  # the friction has settled
        yield f"torque {torque:g}, lead {lead:g}: acceleration", np.max(np.abs(np.diff(rate) / np.diff(t) / second - 1))
