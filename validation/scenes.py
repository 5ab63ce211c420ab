"""Scenes of the reference problems, for the claims here and for the tests."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb


def data(claim: str) -> Any:
    """The reference of a claim as it stands."""
    return json.loads((Path(__file__).parent / claim / "reference.json").read_text(encoding="utf-8"))


def a01(space: str = "auto") -> mb.Scene:
    s = mb.Scene("A01", gravity=(0, -9.81, 0), space=space)
    bob = s.point_mass("bob", 1.0, at=(-1, 0))
    s.distance("rod", s.ground, bob, (0, 0), (-1, 0))
    return s


def physical_pendulum(degrees: float, space: str = "auto") -> mb.Scene:
    s = mb.Scene("physical pendulum", gravity=(0, -9.81, 0), space=space)
    rod = s.link("rod", (0, 0), (0, -1), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), angle0=float(np.radians(degrees)))
    return s


def n_rods(n: int, space: str = "auto", model: Any = None) -> mb.Scene:
    s = mb.Scene(f"{n} rods", gravity=(0, -9.81, 0), space=space)
    before = s.ground
    for i in range(n):
        rod = s.link(f"rod{i + 1}", (i, 0), (i + 1, 0), mass=1.0)
        s.revolute(f"J{i + 1}", before, rod, at=(i, 0), model=model)
        before = rod
    return s


def n_points(n: int, space: str = "auto") -> mb.Scene:
    s = mb.Scene(f"{n} points", gravity=(0, -9.81, 0), space=space)
    before, where = s.ground, (0.0, 0.0)
    for i in range(n):
        here = (i + 1.0, 0.0)
        bob = s.point_mass(f"bob{i + 1}", 1.0, at=here)
        s.distance(f"rod{i + 1}", before, bob, where, here)
        before, where = bob, here
    return s


def heavy_top() -> mb.Scene:
    s = mb.Scene("heavy top", gravity=(0, 0, -9.81))
    top = s.rigid_body("top", 15.0, (0.234375, 0.46875, 0.234375), at=(0, 1, 0), angular_velocity=(0, 150, -4.61538))
    s.spherical("O", s.ground, top, at=(0, 0, 0))
    return s


def dzhanibekov() -> mb.Scene:
    s = mb.Scene("dzhanibekov")
    s.rigid_body("body", 1.0, (1.0, 2.0, 3.0), at=(0, 0, 0), angular_velocity=(1e-3, 2, 1e-3))
    return s


def n_four_bar(n: int, space: str = "auto") -> mb.Scene:
    s = mb.Scene(f"{n}-four-bar", gravity=(0, -9.81, 0), space=space)
    bars = [s.link(f"bar{i}", (i, 0), (i, 1), mass=1.0) for i in range(n + 1)]
    for i, bar in enumerate(bars):
        s.revolute(f"A{i}", s.ground, bar, at=(i, 0), rate0=-1.0 if i == 0 else None)
    for i in range(n):
        top = s.link(f"top{i}", (i, 1), (i + 1, 1), mass=1.0)
        s.revolute(f"B{i}", bars[i], top, at=(i, 1))
        s.revolute(f"C{i}", top, bars[i + 1], at=(i + 1, 1))
    return s


def ground_resonance(axes: int = 2, free: bool = False, space: str = "auto", model: Any = None) -> mb.Scene:
    """Four blades on a hub on an elastic block. With a joint model the block hangs on two slides in series instead of
    a guide and a bushing, so that all bodies form a tree of joints."""
    s = mb.Scene("ground resonance", space=space)
    given = {"model": model} if model is not None else {}
    block = s.rigid_body("block", 30.0, 1.0, at=(0, 0))
    spring = {"spring": 12000.0, "damper": 150.0}
    if axes == 1:
        s.prismatic("support", s.ground, block, at=(0, 0), axis=(1, 0, 0), **spring, **given)
    elif model is None:
        s.fixed_orientation("level", s.ground, block)
        s.bushing("support", s.ground, block, (0, 0), (12000.0, 12000.0, 0.0), (150.0, 150.0, 0.0))
    else:
        carriage = s.rigid_body("carriage", 0.0, 0.0, at=(0, 0))
        s.prismatic("support x", s.ground, carriage, at=(0, 0), axis=(1, 0, 0), **spring, **given)
        s.prismatic("support y", carriage, block, at=(0, 0), axis=(0, 1, 0), **spring, **given)
    hub = s.rigid_body("hub", 0.0, 1.0 if free else 0.0, at=(0, 0))
    s.revolute("rotor", block, hub, at=(0, 0), **({"rate0": 20.01} if free else {"angle": 20.01 * mb.t}), **given)
    for i in range(4):
        d = np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)])
        blade = s.link(f"blade{i + 1}", tuple(0.25 * d), tuple(4.5 * d), mass=12.75)
        s.revolute(f"lag{i + 1}", hub, blade, at=tuple(0.25 * d), angle0=0.01 if i == 0 else None, **given)
    return s


def rotation(a: float) -> np.ndarray:
    c, s = np.cos(a), np.sin(a)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def andrews() -> mb.Scene:
    """Andrews' squeezer: seven bodies K1..K7, ten revolutes (three of them close loops), a spring and a drive torque."""
    d = data("andrews_squeezer")
    p, q = d["parameters"], d["q0"]
    be, th, ga, ph, de, om, ep = q
    c, s_ = np.cos, np.sin
    A, B, C = (p["xa"], p["ya"]), (p["xb"], p["yb"]), (p["xc"], p["yc"])
    head = [be, be + th, ga, ph + de, de, om + ep, ep]
    com = [
        (p["ra"] * c(be), p["ra"] * s_(be)),
        (p["rr"] * c(be) - p["da"] * c(be + th), p["rr"] * s_(be) - p["da"] * s_(be + th)),
        (p["xb"] + p["sa"] * s_(ga) + p["sb"] * c(ga), p["yb"] - p["sa"] * c(ga) + p["sb"] * s_(ga)),
        (p["xa"] + p["zt"] * c(de) + (p["e"] - p["ea"]) * s_(ph + de),
         p["ya"] + p["zt"] * s_(de) - (p["e"] - p["ea"]) * c(ph + de)),
        (p["xa"] + p["ta"] * c(de) - p["tb"] * s_(de), p["ya"] + p["ta"] * s_(de) + p["tb"] * c(de)),
        (p["xa"] + p["u"] * s_(ep) + (p["zf"] - p["fa"]) * c(om + ep),
         p["ya"] - p["u"] * c(ep) + (p["zf"] - p["fa"]) * s_(om + ep)),
        (p["xa"] + p["ua"] * s_(ep) - p["ub"] * c(ep), p["ya"] - p["ua"] * c(ep) - p["ub"] * s_(ep)),
    ]
    s = mb.Scene("Andrews")
    K = [s.rigid_body(f"K{i + 1}", p[f"m{i + 1}"], p[f"i{i + 1}"], at=com[i], rotation=rotation(head[i])) for i in range(7)]
    E1 = (p["rr"] * c(be), p["rr"] * s_(be))
    P = (E1[0] - p["d"] * c(be + th), E1[1] - p["d"] * s_(be + th))
    D5 = (p["xa"] + p["zt"] * c(de), p["ya"] + p["zt"] * s_(de))
    F7 = (p["xa"] + p["u"] * s_(ep), p["ya"] - p["u"] * c(ep))
    s.revolute("O", s.ground, K[0], at=(0, 0), torque=p["mom"])
    s.revolute("Q", K[0], K[1], at=E1)
    s.revolute("B", s.ground, K[2], at=B)
    s.revolute("A5", s.ground, K[4], at=A)
    s.revolute("A7", s.ground, K[6], at=A)
    s.revolute("D5", K[4], K[3], at=D5)
    s.revolute("F7", K[6], K[5], at=F7)
    s.revolute("P3", K[1], K[2], at=P)
    s.revolute("P4", K[1], K[3], at=P)
    s.revolute("P6", K[1], K[5], at=P)
    D = (p["xb"] + p["sd"] * c(ga) + p["sc"] * s_(ga), p["yb"] + p["sd"] * s_(ga) - p["sc"] * c(ga))
    s.spring("spring", s.ground, K[2], C, D, stiffness=p["c0"], length=p["l0"])
    return s


def _of_canudas() -> mb.LuGre:
    """Parameters of Canudas de Wit et al. 1995, for a normal force of 1 N; sigma1 at every velocity, as there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        return mb.LuGre(1.0, 1.5, 1e-3, 1e5, np.sqrt(1e5), 0.4, damping_decay=False)


def stick_slip(model: Any = None) -> mb.Scene:
    """1 kg on a rail with LuGre friction, pulled by a spring (2 N/m) whose other end moves at 0.1 m/s."""
    s = mb.Scene("stick-slip")
    mass, hand = s.rigid_body("mass", 1.0, 0.1, at=(0, 0)), s.rigid_body("hand", 1.0, 0.1, at=(1, 0))
    s.prismatic("slide", s.ground, mass, at=(0, 0), axis=(1, 0, 0), friction=_of_canudas(), normal_force=1.0, model=model)
    s.prismatic("guide", s.ground, hand, at=(1, 0), axis=(1, 0, 0), position=0.1 * mb.t)
    s.spring("spring", mass, hand, at_k=(0, 0), at_l=(1, 0), stiffness=2.0)
    return s


def steady_sliding(velocity: float) -> mb.Scene:
    """The same mass on its rail at a prescribed velocity (m/s)."""
    s = mb.Scene("steady sliding")
    mass = s.rigid_body("mass", 1.0, 0.1, at=(0, 0))
    s.prismatic("slide", s.ground, mass, at=(0, 0), axis=(1, 0, 0), position=velocity * mb.t, friction=_of_canudas(),
                normal_force=1.0)
    return s
