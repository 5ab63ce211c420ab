r"""A shaft with an unbalanced disk: how far it is bent out at every speed.

A steel shaft of length L, clamped in its bearings at both ends, carries a disk of mass m in the middle whose centre of mass lies
e off the axis. At the speed w the bent shaft turns as a whole, and the displacement y of the disk is steady in a frame that turns
with it: stiffness and centrifugal force balance,

    k y = m w^2 (y + e) + 13/35 m_s w^2 y,      k = 192 E I / L^3,

with 13/35 of the shaft's own mass m_s for the deflection curve of a clamped beam. It grows without bound towards the critical
speed w_c = sqrt(k / (m + 13/35 m_s)). `equilibrium(frame="hub")` finds the bent shaft at rest in the frame of the hub.

Run it:  mbdae run examples/whirling_shaft.py --out out
"""

import math
from dataclasses import replace

import numpy as np

import mbdae as mb

LENGTH, RADIUS, E, DENSITY = 1.0, 0.008, 210e9, 7850.0  # m, m, Pa, kg/m^3
DISK, INERTIA, OFF = 8.0, (0.04, 0.02, 0.02), 1e-4  # kg, kg m^2, m
STIFFNESS = 192 * E * math.pi * RADIUS**4 / 4 / LENGTH**3  # N/m
MOVED = DISK + 13 / 35 * DENSITY * math.pi * RADIUS**2 * LENGTH  # kg
CRITICAL = math.sqrt(STIFFNESS / MOVED)  # rad/s
SPEEDS = np.array([0.2, 0.5, 0.7, 0.8, 0.85, 0.9]) * CRITICAL

t_end = 0.2  # s
measure = "drive.angle"
WITHIN = 1e-3  # relative, of the number: the deflection curve of the shaft is that of a clamped beam only nearly


def scene(speed=0.6 * CRITICAL):
    """Shaft along x, driven at its left end; the right bearing lets it slide. The slender shaft is nearly without shear."""
    s = mb.Scene("whirling shaft")
    section = mb.Section.circular(RADIUS, E=E, nu=0.3, rho=DENSITY)
    section = replace(section, GA2=1e3 * section.GA2, GA3=1e3 * section.GA3)
    hub = s.rigid_body("hub", 0.1, (1e-4, 1e-4, 1e-4), at=(0, 0, 0))
    shaft = s.beam("shaft", (0, 0, 0), (LENGTH, 0, 0), section=section, elements=2, order=3, axis2=(0, 1, 0))
    disk = s.rigid_body("disk", DISK, INERTIA, at=(LENGTH / 2, OFF, 0),
                        shape=mb.Cylinder(axis=(1, 0, 0), radius=0.1, length=0.03))
    s.revolute("drive", s.ground, hub, at=(0, 0, 0), axis=(1, 0, 0), angle=speed * mb.t)
    s.weld("coupling", hub, shaft, at=(0, 0, 0))
    s.weld("mount", shaft, disk, at=(LENGTH / 2, 0, 0))
    s.cylindrical("bearing", s.ground, shaft, at=(LENGTH, 0, 0), axis=(1, 0, 0))
    return s


def formula(speed):
    """Displacement of the disk towards its heavy side by the balance above, m."""
    return DISK * OFF * speed**2 / (STIFFNESS - MOVED * speed**2)


def run():
    """Displacements (m) of the disk in steady rotation at all speeds."""
    return np.array([scene(speed).equilibrium(frame="hub")["disk"].position[0, 1] - OFF for speed in SPEEDS])


def number(found):
    """Displacement at 0.8 of the critical speed, mm."""
    return 1e3 * found[3], 1e3 * formula(SPEEDS[3])


def picture(found):
    """Displacement over speed: points found, lines by the formula."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.subplots()
    part = np.linspace(0.1, 0.92, 200)
    axes.plot(part, 1e3 * formula(part * CRITICAL), color="#0072B2", label="balance of forces")
    axes.plot(SPEEDS / CRITICAL, 1e3 * found, "o", color="#D55E00", label="mbdae, steady rotation")
    axes.set(xlabel="speed over critical speed", ylabel="displacement of the disk [mm]")
    axes.grid(True, color="0.9")
    axes.legend()
    return figure
