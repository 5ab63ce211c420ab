"""Elastic and loose scenes drawn by a seed: what people read forces of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import sympy as sp

import mbdae as mb

Rng = np.random.Generator
G = (0.0, -9.81, 0.0)


@dataclass(frozen=True)
class Drawn:
    """A scene, the end of its run (s), and the quantities that are read of it."""

    family: str
    scene: Callable[[], mb.Scene]
    t_end: float
    read: tuple[str, ...]


def section(rng: Rng, thick: float, wide: float = 2.0) -> mb.Section:
    """A rectangular section in steel or aluminium, `thick` (m) in the plane, with some damping or none."""
    E, rho = ((210e9, 7850.0), (70e9, 2700.0))[int(rng.integers(2))]
    damping = float(rng.choice([0.0, 1e-7, 1e-6, 1e-5, 1e-4]))
    return mb.Section.rectangular(wide * thick, thick, E=E, nu=0.3, rho=rho, damping=damping)


def model(rng: Rng) -> mb.Kinematic | None:
    """A joint model stated, or the one that is chosen."""
    return mb.Kinematic() if rng.random() < 0.3 else None


def rises(rate: float, time: float, sudden: bool) -> sp.Expr:
    """An angle whose rate (rad/s) is there at once, or grows smoothly over a time (s)."""
    t = mb.t
    x = t / time
    soft = rate * time * (x**4 * sp.Rational(5, 2) - 3 * x**5 + x**6)  # of the rate 10 x^3 - 15 x^4 + 6 x^5
    return rate * t if sudden else sp.Piecewise((soft, t < time), (rate * (t - time / 2), True))


def joints(**given: object) -> dict[str, object]:
    """Arguments that are stated."""
    return {name: value for name, value in given.items() if value is not None}


def slider_crank(rng: Rng) -> Drawn:
    """An engine with an elastic rod."""
    R, L = rng.uniform(0.03, 0.15), rng.uniform(0.2, 0.6)
    w, mass = rng.uniform(20, 200), rng.uniform(0.1, 1.0)
    of, n = section(rng, L * rng.uniform(0.015, 0.06)), int(rng.integers(2, 4))
    sudden, turns, kind = bool(rng.random() < 0.6), rng.uniform(0.5, 1.2), model(rng)

    def scene() -> mb.Scene:
        s = mb.Scene("engine")
        crank = s.link("crank", (0, 0), (R, 0), mass=1.0)
        rod = s.beam("rod", (R, 0), (R + L, 0), section=of, elements=n)
        ram = s.rigid_body("ram", mass, 1e-3, at=(R + L, 0))
        s.revolute("A", s.ground, crank, at=(0, 0), angle=rises(w, 0.5 * 2 * np.pi / w, sudden))
        s.revolute("B", crank, rod, at=(R, 0), **joints(model=kind))
        s.revolute("C", rod, ram, at=(R + L, 0))
        s.prismatic("D", s.ground, ram, at=(R + L, 0), axis=(1, 0, 0))
        return s

    return Drawn("slider-crank", scene, turns * 2 * np.pi / w, ("A.drive", "B.force", "C.force", "D.force",
                                                                "rod.at(0.5).stress_resultants[5]"))


def four_bar(rng: Rng) -> Drawn:
    """A four-bar with an elastic coupler or rocker."""
    A, B = (0.0, 0.0), (0.0, rng.uniform(0.1, 0.2))
    C, D = (rng.uniform(0.4, 0.6), rng.uniform(0.4, 0.5)), (rng.uniform(0.4, 0.6), 0.0)
    w, soft = rng.uniform(5, 50), str(rng.choice(["coupler", "rocker"]))
    of, n, sudden = section(rng, rng.uniform(0.004, 0.012)), int(rng.integers(2, 4)), bool(rng.random() < 0.6)
    turns, kind = rng.uniform(0.3, 1.0), model(rng)

    def scene() -> mb.Scene:
        s = mb.Scene("four-bar", gravity=G)
        crank = s.link("crank", A, B, mass=0.3)
        pair = {name: s.beam(name, *ends, section=of, elements=n) if name == soft else s.link(name, *ends, mass=0.5)
                for name, ends in (("coupler", (B, C)), ("rocker", (C, D)))}
        s.revolute("A", s.ground, crank, at=A, angle=rises(w, 0.3 * 2 * np.pi / w, sudden))
        s.revolute("B", crank, pair["coupler"], at=B, **joints(model=kind))
        s.revolute("C", pair["coupler"], pair["rocker"], at=C)
        s.revolute("D", s.ground, pair["rocker"], at=D)
        return s

    return Drawn("four-bar", scene, turns * 2 * np.pi / w, ("A.drive", "B.force", "D.force",
                                                            f"{soft}.at(0.4).stress_resultants[5]"))


def arm(rng: Rng) -> Drawn:
    """Two driven arms, the outer one elastic, with a load."""
    a, b, t_end = rng.uniform(0.3, 0.8), rng.uniform(0.3, 0.8), rng.uniform(0.1, 0.4)
    of, n, load = section(rng, b * rng.uniform(0.01, 0.04)), int(rng.integers(2, 4)), rng.uniform(0.05, 1.0)
    rates, sudden = rng.uniform(-4, 4, 2), bool(rng.random() < 0.5)

    def scene() -> mb.Scene:
        s = mb.Scene("arm", gravity=G)
        upper = s.link("upper", (0, 0), (a, 0), mass=1.0)
        lower = s.beam("lower", (a, 0), (a + b, 0), section=of, elements=n)
        s.weld("held", lower.at(1.0), s.rigid_body("load", load, 1e-3 * load, at=(a + b, 0)))
        s.revolute("J1", s.ground, upper, at=(0, 0), angle=rises(rates[0], t_end / 3, sudden))
        s.revolute("J2", upper, lower, at=(a, 0), angle=rises(rates[1], t_end / 2, False))
        return s

    return Drawn("arm", scene, t_end, ("J1.drive", "J2.drive", "held.force", "lower.at(0.1).stress_resultants[5]"))


def hub(rng: Rng) -> Drawn:
    """A hub that is turned up, with two elastic blades, in the plane or in space."""
    L, w, t_end = rng.uniform(0.3, 1.0), rng.uniform(5, 60), rng.uniform(0.1, 0.3)
    of, space, sudden = section(rng, L * rng.uniform(0.01, 0.03)), rng.random() < 0.4, bool(rng.random() < 0.4)
    heavy = rng.uniform(0.0, 0.5)

    def scene() -> mb.Scene:
        s = mb.Scene("rotor", gravity=(0, 0, -9.81) if space else (0, 0, 0))
        core = s.rigid_body("hub", 2.0, (0.01, 0.01, 0.02) if space else 0.02, at=(0, 0))
        blade = s.beam("blade", (0.05, 0), (L, 0), section=of, elements=3)
        s.weld("root", core, blade.at(0.0))
        if heavy > 0.2:
            s.weld("tip", blade.at(1.0), s.rigid_body("mass", heavy, (1e-4,) * 3 if space else 1e-4, at=(L, 0)))
        s.revolute("axis", s.ground, core, at=(0, 0), axis=(0, 0, 1), angle=rises(w, t_end / 2, sudden))
        return s

    return Drawn("rotor", scene, t_end, ("axis.drive", "axis.force", "root.torque", "blade.at(0.3).stress_resultants"))


def wing(rng: Rng) -> Drawn:
    """A wing that flaps about its root, which is driven from rest or at once, under pressure or none."""
    L, f, t_end = rng.uniform(0.2, 0.6), rng.uniform(2, 15), rng.uniform(0.1, 0.4)
    of, amplitude, start = section(rng, L * rng.uniform(0.008, 0.02), 4.0), rng.uniform(0.1, 0.6), int(rng.integers(3))
    t = mb.t
    angle = [amplitude * sp.sin(2 * sp.pi * f * t), amplitude * (1 - sp.cos(2 * sp.pi * f * t)),
             amplitude * sp.sin(2 * sp.pi * f * t) * (1 - sp.exp(-3 * f * t))][start]

    def scene() -> mb.Scene:
        s = mb.Scene("wing", gravity=G)
        spar = s.beam("spar", (0, 0), (L, 0), section=of, elements=3)
        s.revolute("root", s.ground, spar, at=(0, 0), angle=angle)
        return s

    return Drawn("wing", scene, t_end, ("root.drive", "root.force", "spar.at(0.05).stress_resultants[5]",
                                        f"spar.at(0.01, {of.shape[2] / 2 if of.shape else 0}).fibre_stress"))


def loaded(rng: Rng) -> Drawn:
    """A cantilever under its weight at once, with a sudden, a slow or a short force at its tip."""
    L, t_end = rng.uniform(0.3, 1.0), rng.uniform(0.05, 0.2)
    of, kind, size = section(rng, L * rng.uniform(0.01, 0.05)), int(rng.integers(3)), rng.uniform(1, 30)
    weight = bool(rng.random() < 0.6)
    t = mb.t
    force = [size, size * sp.sin(40 * t), size * sp.Piecewise((0, t < t_end / 3), (1, t < t_end / 2), (0, True))][kind]

    def scene() -> mb.Scene:
        s = mb.Scene("cantilever", gravity=G if weight else (0, 0, 0))
        beam = s.beam("beam", (0, 0), (L, 0), section=of, elements=3)
        s.weld("clamp", s.ground, beam.at(0.0))
        s.force("load", beam.at(1.0), (0, force))
        return s

    return Drawn("loaded", scene, t_end, ("clamp.force", "clamp.torque", "beam.at(0.5).stress_resultants[5]"))


def swinging(rng: Rng) -> Drawn:
    """A pendulum of an elastic rod that falls, with a body on it."""
    L, t_end = rng.uniform(0.3, 1.5), rng.uniform(0.2, 0.6)
    of, n, mass = section(rng, L * rng.uniform(0.01, 0.04)), int(rng.integers(2, 4)), rng.uniform(0.1, 2.0)

    def scene() -> mb.Scene:
        s = mb.Scene("pendulum", gravity=G)
        rod = s.beam("rod", (0, 0), (L, 0), section=of, elements=n)
        s.revolute("hinge", s.ground, rod, at=(0, 0))
        s.weld("bob", rod.at(1.0), s.rigid_body("mass", mass, 0.01 * mass, at=(L, 0)))
        return s

    return Drawn("swinging", scene, t_end, ("hinge.force", "bob.force", "bob.torque", "rod.at(0.5).stress_resultants[5]"))


def bushed(rng: Rng) -> Drawn:
    """A driven crank and a rod held by stiff bushings."""
    R, L, w = rng.uniform(0.05, 0.1), rng.uniform(0.2, 0.4), rng.uniform(10, 100)
    k, d = 10 ** rng.uniform(4, 8), 10 ** rng.uniform(-6, -3.5)
    sudden = bool(rng.random() < 0.6)

    def scene() -> mb.Scene:
        s = mb.Scene("bushed engine", gravity=G)
        crank, rod = s.link("crank", (0, 0), (R, 0), mass=0.5), s.link("rod", (R, 0), (R + L, 0), mass=0.5)
        ram = s.rigid_body("ram", 1.0, 1e-3, at=(R + L, 0))
        s.revolute("A", s.ground, crank, at=(0, 0), angle=rises(w, 0.5 * 2 * np.pi / w, sudden))
        s.bushing("B", crank, rod, at=(R, 0), stiffness=(k, k, k, 0, 0, 0), damping=(k * d, k * d, k * d, 0, 0, 0))
        s.revolute("C", rod, ram, at=(R + L, 0))
        s.prismatic("D", s.ground, ram, at=(R + L, 0), axis=(1, 0, 0))
        return s

    return Drawn("bushed", scene, 2 * np.pi / w, ("A.drive", "B.force", "C.force", "D.force"))


def sprung(rng: Rng) -> Drawn:
    """A beam of rigid links, joined by springs with dampers, which a drive shakes."""
    n, k, t_end = int(rng.integers(2, 6)), 10 ** rng.uniform(1, 4), rng.uniform(0.2, 1.0)
    d, f = k * 10 ** rng.uniform(-5, -2.5), rng.uniform(1, 10)

    def scene() -> mb.Scene:
        s = mb.Scene("links", gravity=G)
        links = [s.link(f"L{i}", (0.2 * i, 0), (0.2 * i + 0.2, 0), mass=0.3) for i in range(n)]
        s.revolute("J0", s.ground, links[0], at=(0, 0), angle=0.3 * sp.sin(2 * sp.pi * f * mb.t))
        for i in range(1, n):
            s.revolute(f"J{i}", links[i - 1], links[i], at=(0.2 * i, 0), spring=k, damper=d)
        return s

    return Drawn("sprung", scene, t_end, ("J0.drive", "J0.force", f"J{n - 1}.force", f"L{n - 1}.acceleration"))


def played(rng: Rng) -> Drawn:
    """A slider-crank with play in a joint."""
    w, play, k = rng.uniform(20, 100), 10 ** rng.uniform(-4.3, -3.2), 10 ** rng.uniform(8, 9.5)
    where, restitution = str(rng.choice(["B", "C"])), rng.uniform(0.2, 0.8)

    def scene() -> mb.Scene:
        s = mb.Scene("engine with play")
        crank, rod = s.link("crank", (0, 0), (0.05, 0), mass=0.3), s.link("rod", (0.05, 0), (0.17, 0), mass=0.5)
        ram = s.rigid_body("ram", 1.5, 1e-3, at=(0.17, 0))
        loose = mb.Clearance(0.01 + play, 0.01, normal=mb.Hertz(k, restitution), friction=mb.Coulomb(mu=0.1, v_c=0.1))
        s.revolute("A", s.ground, crank, at=(0, 0), angle=w * mb.t)
        s.revolute("B", crank, rod, at=(0.05, 0), **joints(model=loose if where == "B" else None))
        s.revolute("C", rod, ram, at=(0.17, 0), **joints(model=loose if where == "C" else None))
        s.prismatic("D", s.ground, ram, at=(0.17, 0), axis=(1, 0, 0))
        return s

    return Drawn("played", scene, 2 * np.pi / w, ("A.drive", "B.force", "C.force", "D.force"))


FAMILIES = (slider_crank, four_bar, arm, hub, wing, loaded, swinging, bushed, sprung, played)


def drawn(seed: int) -> Drawn:
    """Scene number `seed`: the families in turn."""
    return FAMILIES[seed % len(FAMILIES)](np.random.default_rng(seed))
