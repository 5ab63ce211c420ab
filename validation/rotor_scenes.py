"""A flexible rotor in anisotropic bearings, ideal or with clearance, for claims and tests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mbdae as mb

TUBE = mb.Section.tube(outer=0.05, inner=0.045, E=210e9, nu=0.3, rho=7800.0)
SLENDER = replace(TUBE, GA2=1e3 * TUBE.GA2, GA3=1e3 * TUBE.GA3)  #: practically without shear, as Euler and Bernoulli assume
R, MIDDLE, T, AXIS = (0, 0, 0), (3, 0, 0), (6, 0, 0), (1, 0, 0)


def _rotor(speed: float, eccentricity: float, section: mb.Section, order: int) -> tuple[mb.Scene, Any]:
    """Shaft along x, disk, and the drive at R; the housing there comes first, so that it spins the shaft and not the reverse."""
    s = mb.Scene("rotor")
    s.rigid_body("housing", 0.0, (0, 0, 0), at=R)
    shaft = s.beam("shaft", R, T, section=section, elements=6, order=order, axis2=(0, 1, 0))
    disk = s.rigid_body("disk", 70.573, (2.0325024, 1.0309539, 1.0309539), at=(3, eccentricity, 0))
    s.weld("mount", shaft, disk, at=MIDDLE)
    s.revolute("R", "housing", shaft, at=R, axis=AXIS, angle=speed * mb.t)
    return s, shaft


def rotor_on_springs(stiffness: Any, speed: float = 24.0, eccentricity: float = 0.0, section: mb.Section = SLENDER,
                     order: int = 3) -> mb.Scene:
    """Both ends of the shaft on springs along y and z (N/m), without damping and without clearance."""
    s, shaft = _rotor(speed, eccentricity, section, order)
    s.bushing("bearing R", s.ground, "housing", at=R, stiffness=(1e7, *stiffness, 1e6, 0, 0))
    s.bushing("bearing T", s.ground, shaft, at=T, stiffness=(0, *stiffness, 0, 0, 0))
    return s


def rotor_with_clearance(friction: Any = None, clearance: float = 8e-4, damping: float = 0.3, section: mb.Section = TUBE,
                         order: int = 2) -> mb.Scene:
    """1 mm of eccentricity; the pin at T has play in a race of 2 kg on springs and dampers."""
    s, shaft = _rotor(24.0, 1e-3, section, order)
    race = s.rigid_body("race", 2.0, (2e-3, 1e-3, 1e-3), at=T)
    s.bushing("bearing R", s.ground, "housing", at=R, stiffness=(1e7, 2e5, 1e5, 1e6, 0, 0), damping=(200, 200, 200, 1e3, 0, 0))
    s.bushing("bearing T", s.ground, race, at=T, stiffness=(0, 2e5, 1e5, 1e6, 0, 0), damping=(0, 200, 200, 1e3, 0, 0))
    model = mb.Clearance(outer=0.08 + clearance, inner=0.08, normal=mb.Hertz(1e9, damping), friction=friction)
    s.revolute("T", race, shaft, at=T, axis=AXIS, rate0=24.0, model=model)
    return s
