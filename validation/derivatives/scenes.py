"""Scenes whose derivatives are compared with differences of runs."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@dataclass(frozen=True)
class Scene:
    """build: makes the scene; end: s; read: quantities at the end; to: names of numbers; options: of the run."""

    build: Callable[[], mb.Scene]
    end: float
    read: tuple[str, ...]
    to: tuple[str, ...]
    options: dict[str, Any] = field(default_factory=dict)


def pendulum() -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), spring=3.0, damper=0.2, angle0=0.1, rate0=0.5)
    return s


def four_bar() -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank, coupler = s.link("crank", (0, 0), (0, 0.3), mass=1.0), s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.6)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=2.0)
    s.revolute("B", crank, coupler, at=(0, 0.3), damper=0.02)
    s.revolute("C", coupler, rocker, at=(0.5, 0.6), spring=2.0, damper=0.01)
    s.revolute("D", s.ground, rocker, at=(0.6, 0))
    return s


def top() -> mb.Scene:
    s = mb.Scene("top", gravity=(0, 0, -9.81))
    body = s.rigid_body("body", 15.0, (0.3, 0.46875, 0.3), at=(0, 1, 0), angular_velocity=(0, 150.0, -4.6))
    s.spherical("O", s.ground, body, at=(0, 0, 0))
    return s


def rotor(free: bool) -> mb.Scene:
    s = mb.Scene("rotor")
    block = s.rigid_body("block", 100.0, 0.0, at=(0, 0))
    carriage = s.rigid_body("carriage", 0.0, 0.0, at=(0, 0))
    s.prismatic("sx", s.ground, carriage, at=(0, 0), axis=(1, 0, 0), spring=3e4, damper=60.0, position0=0.01)
    s.prismatic("sy", carriage, block, at=(0, 0), axis=(0, 1, 0), spring=3e4, damper=60.0)
    hub = s.rigid_body("hub", 0.0, 1.0 if free else 0.0, at=(0, 0))
    drive = {"rate0": 20.01} if free else {"angle": mb.number("speed", 20.01) * mb.t}
    s.revolute("shaft", block, hub, at=(0, 0), **drive)
    for i in range(4):
        d = np.array([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)])
        blade = s.link(f"blade{i + 1}", tuple(0.6 * d), tuple(4.85 * d), mass=12.75)
        s.revolute(f"lag{i + 1}", hub, blade, at=tuple(0.6 * d), angle0=0.05 if i == 0 else 0.0, spring=50.0, damper=5.0)
    return s.recursive()


def arm(recursive: bool) -> mb.Scene:
    s = mb.Scene("arm", gravity=(0, 0, -9.81))
    previous, at = s.ground, np.zeros(3)
    axes = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))
    for i, axis in enumerate(axes):
        length = 0.4 / (1 + 0.3 * i)
        body = s.rigid_body(f"L{i + 1}", 5.0 / (1 + i), tuple(0.02 / (1 + i) * np.array([1, 1.2, 0.8])),
                            at=tuple(np.add(at, (length / 2, 0, 0.05))))
        s.revolute(f"J{i + 1}", previous, body, at=tuple(at), axis=axis, spring=20.0 / (1 + i), damper=0.5,
                   rate0=0.3 * (-1) ** i, model=None if recursive else mb.Kinematic())
        previous, at = body, at + np.array([length, 0, 0.05])
    return s.recursive() if recursive else s


def beam() -> mb.Scene:
    s = mb.Scene("beam", gravity=(0, 0, -9.81))
    rod = s.beam("rod", (0, 0, 0), (1, 0.2, 0), elements=3, section=mb.Section.circular(radius=0.02, E=1e8, nu=0.3, rho=1000.0))
    tip = s.point_mass("tip", 0.05, at=(1, 0.2, 0))
    s.revolute("A", s.ground, rod, at=(0, 0, 0), axis=(0, 1, 0), spring=3.0, damper=0.1)
    s.spherical("T", rod, tip, at=(1, 0.2, 0))
    return s


def wing() -> mb.Scene:
    """One elastic four-bar of the flapping wing, its crank driven."""
    s = mb.Scene("wing")
    tube = mb.Section.tube(4.87043354e-3, 4.42000712e-3, E=210e9, nu=0.28, rho=7850.0)
    crank = s.link("crank", (0, 0), (0.03, 0.02), mass=0.1)
    rod = s.beam("rod", (0.03, 0.02), (0.3, 0.2), elements=1, section=tube)
    rocker = s.beam("rocker", (0.3, 0.2), (0.3, 0), elements=1, section=tube)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=mb.number("omega", 12.56) * mb.t)
    s.revolute("B", crank, rod, at=(0.03, 0.02))
    s.revolute("C", rod, rocker, at=(0.3, 0.2))
    s.revolute("D", s.ground, rocker, at=(0.3, 0), damper=0.01)
    return s


def car() -> mb.Scene:
    """A quarter car on a table, smooth between its points."""
    x = np.linspace(0, 2, 21)
    road = mb.table(x, 0.03 * np.sin(5 * x), kind="cubic", outside="hold")
    s = mb.Scene("car")
    wheel, body = s.rigid_body("wheel", 40.0, (1, 1, 1), at=(0, 0.3, 0)), s.rigid_body("body", 300.0, (1, 1, 1), at=(0, 0.8, 0))
    s.prismatic("tyre", s.ground, wheel, at=(0, 0.3, 0), axis=(0, 1, 0), spring=180e3, force=mb.number("gain", 180e3) * road)
    s.prismatic("strut", wheel, body, at=(0, 0.8, 0), axis=(0, 1, 0), spring=20e3, damper=1.2e3)
    return s


def friction() -> mb.Scene:
    """A slider crank whose friction follows from the reaction, without stops of its motion."""
    s = mb.Scene("friction", gravity=(0, -9.81, 0))
    crank, rod = s.link("crank", (0, 0), (0, 0.3), mass=0.3), s.link("rod", (0, 0.3), (1, 0), mass=1.0)
    slide = s.rigid_body("slide", 2.0, 0.1, at=(1, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=8.0)
    s.revolute("B", crank, rod, at=(0, 0.3), friction=mb.Coulomb(mu=0.1, v_c=0.05), radius=0.02)
    s.revolute("C", rod, slide, at=(1, 0))
    s.prismatic("D", s.ground, slide, at=(1, 0), axis=(1, 0, 0), damper=3.0)
    return s


def example(name: str) -> mb.Scene:
    """The scene of an example, which may import its neighbours."""
    if str(EXAMPLES) not in sys.path:
        sys.path.append(str(EXAMPLES))
    found: mb.Scene = importlib.import_module(name).scene()
    return found


JOINTS = tuple(f"J{i}.{name}" for i in range(1, 7) for name in ("spring", "damper", "rate0"))
LINKS = tuple(f"L{i}.{name}" for i in range(1, 7) for name in ("mass", "inertia.0"))
SCENES = {
    "pendulum": Scene(pendulum, 2.0, ("A.angle",), ("rod.mass", "A.spring", "A.damper", "A.angle0", "A.rate0")),
    "four-bar": Scene(four_bar, 0.4, ("C.angle", "B.force[0]"),
                      ("crank.mass", "coupler.mass", "rocker.mass", "C.spring", "C.damper", "B.damper", "A.rate0")),
    "andrews": Scene(lambda: example("andrews_squeezer"), 0.02, ("O.angle",),
                     ("K1.mass", "K2.mass", "K3.mass", "spring.stiffness", "spring.length", "O.torque")),
    "top": Scene(top, 0.3, ("body.position[2]",), ("body.mass", "body.inertia.0", "body.inertia.1", "body.angular_velocity.1")),
    "driven rotor": Scene(lambda: rotor(False), 0.5, ("lag1.angle", "sx.displacement"),
                          ("speed", "block.mass", "sx.spring", "sy.damper", "lag1.angle0", "lag2.spring", "blade3.mass")),
    "free rotor": Scene(lambda: rotor(True), 0.5, ("lag1.angle", "sx.displacement"),
                        ("shaft.rate0", "block.mass", "sx.spring", "sy.damper", "lag1.angle0", "lag2.spring", "blade3.mass")),
    "arm": Scene(lambda: arm(True), 0.6, ("L6.position[2]",), JOINTS + LINKS),
    "kinematic arm": Scene(lambda: arm(False), 0.6, ("L6.position[2]",), JOINTS + LINKS),
    "beam": Scene(beam, 0.15, ("tip.position[2]",), ("tip.mass", "A.spring", "A.damper", "rod.section.EA", "rod.section.EI3")),
    "wing": Scene(wing, 0.1, ("D.angle",), ("omega", "crank.mass", "D.damper", "rod.section.EI3")),
    "car": Scene(car, 1.5, ("strut.displacement",),
                 ("gain", "wheel.mass", "body.mass", "tyre.spring", "strut.spring", "strut.damper")),
    "friction": Scene(friction, 0.3, ("D.displacement", "B.force[0]"),
                      ("crank.mass", "rod.mass", "A.rate0", "D.damper", "B.friction.mu")),
}
