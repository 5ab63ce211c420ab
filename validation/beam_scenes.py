"""Scenes of the reference problems of flexible beams, for the claims here and for the tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sympy as sp
from scenes import data

import mbdae as mb

INERTIA = {"mass_per_length": 1.0, "rotary_inertia": 1e-6}  #: where only statics matter


def bend45(load: float, elements: int, order: int) -> mb.Scene:
    """Bathe and Bolourchi: an eighth of a circle of radius 100, clamped, unit square section, under a load along z."""
    E, end = 1e7, (100 * math.sin(math.pi / 4), 100 * (1 - math.cos(math.pi / 4)), 0.0)
    section = mb.Section(E, E / 2 * 5 / 6, E / 2 * 5 / 6, E / 2 / 6, E / 12, E / 12, **INERTIA)
    s = mb.Scene("45 degree bend")
    beam = s.beam("bend", section=section, elements=elements, order=order,
                  curve=lambda a: (100 * math.sin(a * math.pi / 4), 100 * (1 - math.cos(a * math.pi / 4)), 0.0))
    s.weld("clamp", s.ground, beam.at((0, 0, 0)))
    s.force("load", beam.at(end), (0, 0, load))
    return s


def cantilever(section: mb.Section, elements: int, order: int, length: float = 1.0, force: Any = None, moment: Any = None,
               space: str = "auto", axis2: Any = None) -> mb.Scene:
    """A straight beam along x, clamped at the origin, with a dead force (N) and a moment (N m) on its tip."""
    s = mb.Scene("cantilever", space=space)
    beam = s.beam("beam", (0, 0), (length, 0), section=section, elements=elements, order=order, axis2=axis2)
    s.weld("clamp", s.ground, beam.at(0.0))
    if force is not None:
        s.force("force", beam.at(1.0), force)
    if moment is not None:
        s.torque("moment", beam.at(1.0), moment)
    return s


def slender(ratio: float) -> mb.Section:
    """Section with EI = 1 N m^2 of a beam of 1 m that is `ratio` times longer than high."""
    EA = 12 * ratio**2
    return mb.Section(EA, EA / 2.6, EA / 2.6, 1.0, 1.0, 1.0, **INERTIA)


def princeton(load: float, degrees: float, elements: int, order: int) -> mb.Scene:
    """The strip of Dowell and Traybar with a weight on its tip, turned by an angle about its axis; no gravity else."""
    section, L = strip()
    a = math.radians(degrees)
    return cantilever(section, elements, order, L, force=(0, load * math.sin(a), load * math.cos(a)), space="spatial",
                      axis2=(0, 1, 0))


def strip() -> tuple[mb.Section, float]:
    """Section (soft about axis 3) and length of the strip."""
    p = data("princeton_beam")["parameters"]
    return mb.Section(p["EA"], p["GA_k"], p["GA_k"], p["GJ"], p["EI_stiff"], p["EI_soft"], 0.1, 1e-7), p["L"]


def thin(rotary_inertia: float = 1e-10) -> mb.Section:
    """EI = 1 N m^2, 1 kg/m; shear and extension 1e8 times stiffer over a metre: next to Euler and Bernoulli."""
    return mb.Section(1e8, 1e8, 1e8, 1.0, 1.0, 1.0, 1.0, rotary_inertia)


def supported(ends: str, elements: int, order: int) -> mb.Scene:
    """A thin beam of 1 m in the plane; `ends` two letters of c (clamped), h (hinged), f (free)."""
    s = mb.Scene("supported beam")
    beam = s.beam("beam", (0, 0), (1, 0), section=thin(), elements=elements, order=order)
    for x, end in zip((0.0, 1.0), ends, strict=True):
        if end == "c":
            s.weld(f"clamp at {x:g}", s.ground, beam.at(x))
        elif end == "h":
            s.revolute(f"hinge at {x:g}", s.ground, beam, at=(x, 0))
    return s


def on_hub(section: mb.Section, rate: float, length: float, elements: int, order: int, space: str = "auto") -> mb.Scene:
    """A beam along x from the axis of a hub that turns about z at a rate (rad/s), clamped to it."""
    s = mb.Scene("beam on a hub", space=space)
    hub = s.rigid_body("hub", 1.0, 1.0 if space == "auto" else (1, 1, 1), at=(0, 0))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=rate * mb.t)
    beam = s.beam("beam", (0, 0), (length, 0), section=section, elements=elements, order=order)
    s.weld("root", hub, beam.at(0.0))
    return s


def spin_up_section() -> mb.Section:
    p = data("spin_up_beam")["parameters"]
    return mb.Section(p["EA"], p["GA"], p["GA"], p["EI"], p["EI"], p["EI"], p["rhoA"], p["rhoI"])


def spin_up(elements: int, order: int) -> mb.Scene:
    """Simo and Vu-Quoc: a beam in the plane whose root is turned from rest to 6 rad/s in 15 s."""
    p, t = data("spin_up_beam")["parameters"], mb.t
    T, w = p["T_s"], p["omega_s"]
    rising = w / T * (t**2 / 2 + (T / (2 * sp.pi)) ** 2 * (sp.cos(2 * sp.pi * t / T) - 1))
    s = mb.Scene("spin-up")
    beam = s.beam("beam", (0, 0), (p["L"], 0), section=spin_up_section(), elements=elements, order=order)
    s.revolute("root", s.ground, beam, at=(0, 0), angle=sp.Piecewise((rising, t < T), (w * (t - T / 2), True)))
    return s


def spin_up_angle(t: Any) -> Any:
    """Angle (rad) of the root at times t (s)."""
    p = data("spin_up_beam")["parameters"]
    T, w = p["T_s"], p["omega_s"]
    rising = w / T * (t**2 / 2 + (T / (2 * np.pi)) ** 2 * (np.cos(2 * np.pi * t / T) - 1))
    return np.where(t < T, rising, w * (t - T / 2))


CRANK, ROD, SLIDER, RATE = 0.1, 0.4, 0.5, 100.0  # m, m, kg, rad/s


def steel_rod() -> mb.Section:
    """A steel rod of 10 mm."""
    return mb.Section.circular(0.005, 2.1e11, 0.3, 7850.0)


def slider_crank(elements: int, order: int) -> mb.Scene:
    """A driven crank, a steel rod, unstrained at the start, and a block on a slide."""
    s, reach = mb.Scene("slider-crank"), CRANK + ROD
    crank = s.link("crank", (0, 0), (CRANK, 0), mass=1.0)
    rod = s.beam("rod", (CRANK, 0), (reach, 0), section=steel_rod(), elements=elements, order=order)
    block = s.rigid_body("block", SLIDER, 0.01, at=(reach, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=RATE * mb.t)
    s.revolute("B", crank, rod, at=(CRANK, 0))
    s.revolute("C", rod, block, at=(reach, 0))
    s.prismatic("D", s.ground, block, at=(reach, 0), axis=(1, 0, 0))
    return s


def steel_pendulum(slenderness: float, elements: int = 4, order: int = 2) -> mb.Scene:
    """A square steel rod of 1 m, hinged at one end and released from the horizontal, unstrained."""
    s = mb.Scene("steel pendulum", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(1 / slenderness, 1 / slenderness, 2.1e11, 0.3, 7850.0)
    s.revolute("A", s.ground, s.beam("rod", (0, 0), (1, 0), section=section, elements=elements, order=order), at=(0, 0))
    return s


def flexible_rotor(axes: int = 2, free: bool = False, space: str = "auto", model: Any = None, lag: float = 0.0) -> mb.Scene:
    """Ground resonance with blades of three cubic elements, EI = 1e4 N m^2; `model` of the five revolutes. A block on two
    axes is kept upright and held by a bushing, which looks the same from a hub that turns."""
    s = mb.Scene("flexible ground resonance", space=space)
    block = s.rigid_body("block", 30.0, 1.0, at=(0, 0))
    if axes == 1:
        s.prismatic("support", s.ground, block, at=(0, 0), axis=(1, 0, 0), spring=12000.0, damper=150.0)
    else:
        s.fixed_orientation("level", s.ground, block)
        s.bushing("support", s.ground, block, (0, 0), (12000.0, 12000.0, 0.0), (150.0, 150.0, 0.0))
    hub = s.rigid_body("hub", 0.0, 1.0 if free else 0.0, at=(0, 0))
    s.revolute("shaft", block, hub, at=(0, 0), model=model, **({"rate0": 20.01} if free else {"angle": 20.01 * mb.t}))
    section = mb.Section(1e7, 4e6, 4e6, 1e4, 1e4, 1e4, mass_per_length=3.0, rotary_inertia=3e-4)
    for i, d in enumerate(np.round([[np.cos(a), np.sin(a)] for a in np.arange(4) * np.pi / 2])):
        blade = s.beam(f"blade {i + 1}", tuple(0.25 * d), tuple(4.5 * d), section=section, elements=3, order=3)
        s.revolute(f"lag {i + 1}", hub, blade, at=tuple(0.25 * d), angle0=lag if i == 0 else 0.0, model=model)
    return s
