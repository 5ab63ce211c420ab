"""Planar scenes of beams and free bodies whose motions out of the plane are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import mbdae as mb

E, NU, RHO = 70e9, 0.3, 2700.0


@dataclass(frozen=True)
class Planar:
    """A planar scene, the word that is right for its motions out of the plane, and the frame in which it rests."""

    name: str
    make: Callable[[], mb.Scene]
    right: str
    frame: str | None = None


def strip(height: float, width: float) -> mb.Section:
    """A strip of aluminium, `height` in the plane and `width` across it, m."""
    return mb.Section.rectangular(width, height, E=E, nu=NU, rho=RHO)


def on_edge(share: float, height: float, width: float, length: float) -> mb.Scene:
    """A cantilever on edge with a load at its end: it buckles sideways at 4.013 sqrt(EI2 GJ) / L^2."""
    section = strip(height, width)
    s = mb.Scene(f"strip on edge at {share:g} of its load")
    beam = s.beam("strip", (0, 0), (length, 0), section=section, elements=5)
    s.weld("root", s.ground, beam, at=(0, 0))
    s.force("load", beam.at(1.0), (0, -share * 4.013 * np.sqrt(section.EI2 * section.GJ) / length**2, 0))
    return s


def column(share: float, angle: float) -> mb.Scene:
    """A column whose weak axis lies in the plane: clamped, free end loaded, pi^2 EI2 / (4 L^2)."""
    section, length = strip(0.03, 0.004), 0.6
    end = length * np.array([np.cos(angle), np.sin(angle)])
    s = mb.Scene(f"column at {share:g} of Euler's load")
    beam = s.beam("column", (0, 0), tuple(end), section=section, elements=4)
    s.weld("root", s.ground, beam, at=(0, 0))
    push = -share * np.pi**2 * section.EI2 / (4 * length**2) * end / length
    s.force("load", beam.at(1.0), (*push, 0))
    return s


def under_its_weight(share: float) -> mb.Scene:
    """A standing column under its weight: buckles at q L^3 = 7.837 EI2."""
    section, g = strip(0.03, 0.001), 9.81
    length = float(np.cbrt(share * 7.837 * section.EI2 / (g * section.mass_per_length)))
    s = mb.Scene(f"column at {share:g} of its own weight", gravity=(0, -g, 0))
    beam = s.beam("column", (0, 0), (0, length), section=section, elements=4)
    s.weld("root", s.ground, beam, at=(0, 0))
    return s


def spinning(axis: int) -> mb.Scene:
    """A free body that spins about its least, middle or largest axis, which is normal to the plane."""
    moments = np.roll([0.2, 0.5, 0.6], 2 - axis)
    s = mb.Scene(f"free body about its axis {axis}")
    s.rigid_body("body", 2.0, tuple(moments), at=(0.3, 0.1), angular_velocity=(0, 0, 7.0))
    return s


def between_springs(preload: float) -> mb.Scene:
    """A mass between two springs along x, pushed (negative) or pulled by `preload` N, and held in the plane by a third along y:
    across the plane the stiffness is 2 preload / L."""
    s = mb.Scene(f"mass between springs at {preload:g} N")
    mass = s.point_mass("mass", 1.0, at=(0, 0))
    for name, x in (("left", -1.0), ("right", 1.0)):
        s.spring(name, s.ground, mass, (x, 0), (0, 0), stiffness=1e4, length=1.0 - preload / 1e4)
    s.spring("guide", s.ground, mass, (0, -1), (0, 0), stiffness=5e3)
    return s


def blade(rate: float, section: mb.Section, inwards: bool = False) -> mb.Scene:
    """A blade on a hub that turns: outwards it flaps about the plane, stiffened by its own pull; inwards its weight in the
    turning axes pushes it."""
    s = mb.Scene(f"blade {'inwards' if inwards else 'outwards'} at {rate:g} rad/s")
    hub = s.rigid_body("hub", 1.0, (1.0, 1.0, 1.0))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=rate * mb.t)
    ends = ((1.0, 0), (0.2, 0)) if inwards else ((0.1, 0), (1.0, 0))
    beam = s.beam("blade", *ends, section=section, elements=4)
    s.weld("root", hub, beam, at=ends[0])
    return s


def inwards_limit(section: mb.Section) -> float:
    """Rate, rad/s, at which a blade from 1 m inwards to 0.2 m buckles out of the plane: EI w'''' + (N w')' = 0 by Ritz's method,
    with the push N(s) = m W^2 integral of the radius from the free end; powers s^2 .. s^9."""
    length, root, n = 0.8, 1.0, 8
    x, weight = np.polynomial.legendre.leggauss(30)
    x, weight = length * (x + 1) / 2, weight * length / 2
    # radius at s is root - s; push at s: integral from s to length of (root - a) da
    push = root * (length - x) - (length**2 - x**2) / 2
    powers = np.arange(2, 2 + n)
    first = powers[:, None] * (x / length) ** (powers[:, None] - 1) / length
    second = (powers * (powers - 1))[:, None] * (x / length) ** (powers[:, None] - 2) / length**2
    bending, geometric = (second * weight) @ second.T * section.EI2, (first * weight * push) @ first.T * section.mass_per_length
    return float(np.sqrt(1 / np.max(np.linalg.eigvals(np.linalg.solve(bending, geometric)).real)))


def cases() -> list[Planar]:
    """All scenes."""
    thin = strip(0.03, 0.002)
    limit = inwards_limit(thin)
    found: list[Any] = [
        (lambda a=a: on_edge(*a), a[0] < 1) for a in
        ((0.9, 0.05, 0.002, 1.0), (1.1, 0.05, 0.002, 1.0), (1.5, 0.05, 0.002, 1.0), (0.6, 0.08, 0.002, 1.5),
         (1.02, 0.06, 0.0015, 0.7))]
    found += [(lambda a=a, d=d: column(a, d), a < 1) for a, d in ((0.97, 0.0), (1.03, 0.0), (0.8, 1.1), (2.0, 0.7))]
    found += [(lambda a=a: under_its_weight(a), a < 1) for a in (0.95, 1.05)]
    found += [(lambda a=a: spinning(a), a != 1) for a in range(3)]
    found += [(lambda a=a: between_springs(a), a > 0) for a in (20.0, -20.0)]
    out = [Planar(f"{i:02d} {make().name}", make, "stable" if good else "unstable") for i, (make, good) in enumerate(found)]
    out = [Planar(c.name, c.make, c.right, "body") if "free body" in c.name else c for c in out]
    turning = [(5.0, False, True), (60.0, False, True), (0.97 * limit, True, True), (1.03 * limit, True, False)]
    out += [Planar(f"{len(out) + i:02d} blade", lambda r=r, w=w: blade(r, thin, w), "stable" if good else "unstable", "hub")
            for i, (r, w, good) in enumerate(turning)]
    return out
