"""Scenes with joint clearance, for claims and benchmarks: a driven slider-crank, and two free bodies joined by a loose pin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import mbdae as mb

CRANK, ROD, PIN = 0.05, 0.12, 0.01  # m
MASSES = {"crank": 0.3, "rod": 0.5, "slider": 1.5}  # kg
SOFT = {"normal": mb.Hertz(1e9, 0.5), "friction": mb.Coulomb(0.1, 0.1)}  # contact that converges at 100 rad/s and 0.5 mm


def slider_crank(play: str = "B", clearance: float = 5e-4, rate: float = 100.0, space: str = "auto", **contact: Any) -> mb.Scene:
    """Crank driven at `rate` (rad/s), rod and slider, with clearance (m) at B (crank pin), C (piston pin), BC or "" (none)."""
    s = mb.Scene("slider-crank with clearance", space=space)
    a, b = (CRANK, 0), (CRANK + ROD, 0)
    s.link("crank", (0, 0), a, mass=MASSES["crank"])
    s.link("rod", a, b, mass=MASSES["rod"])
    s.rigid_body("slider", MASSES["slider"], 1e-3, at=b)
    loose = mb.Clearance(PIN + clearance, PIN, **(SOFT | contact))
    s.revolute("A", s.ground, "crank", at=(0, 0), angle=rate * mb.t)
    s.revolute("B", "crank", "rod", at=a, model=loose if "B" in play else mb.Kinematic())
    s.revolute("C", "rod", "slider", at=b, model=loose if "C" in play else mb.Kinematic())
    s.prismatic("D", s.ground, "slider", at=b, axis=(1, 0, 0))
    return s


def turn(rate: float = 100.0) -> float:
    """Time of one turn of the crank, s."""
    return float(2 * np.pi / rate)


def orbit(result: mb.Result, rate: float = 100.0) -> Any:
    """Centre of the pin in its race at B (nt, 2), m, in inertial axes."""
    (x, y), a = result["B"].orbit.T, rate * result.t
    return np.stack([np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y], axis=1)


def free_pair(spatial: bool = False, length: float | None = None, clearance: float = 1e-3) -> mb.Scene:
    """Two free bodies, a pin of one in a race of the other, thrown against each other; no other force."""
    s = mb.Scene("two bodies and a loose pin", space="spatial" if spatial else "auto")
    j = (2e-3, 3e-3, 4e-3) if spatial else 4e-3
    at, away, v = ((0.1, 0, 0), (0.25, 0.1, 0), (0.3, 0.2, 0.1)) if spatial else ((0.1, 0), (0.25, 0.1), (0.3, 0.2))
    s.rigid_body("race", 1.0, j, at=(0, 0, 0) if spatial else (0, 0), angular_velocity=(0, 0, 3))
    s.rigid_body("pin", 0.7, j, at=away, velocity=v)
    law = {"normal": mb.Hertz(1e8, 0.05), "friction": mb.Coulomb(0.2, 0.01)}
    s.revolute("J", "race", "pin", at=at, model=mb.Clearance(PIN + clearance, PIN, length=length, **law))
    return s


def momenta(result: mb.Result, masses: dict[str, float], inertia: Any) -> tuple[Any, Any]:
    """Momentum and moment of momentum about the origin, (nt, 3) each, of bodies with equal principal moments."""
    linear, angular = 0.0, 0.0
    for name, mass in masses.items():
        body = result[name]
        R = body.rotation
        spin = np.einsum("tij,tj->ti", R, np.asarray(inertia) * np.einsum("tji,tj->ti", R, body.angular_velocity))
        linear = linear + mass * body.velocity
        angular = angular + spin + mass * np.cross(body.position, body.velocity)
    return linear, angular


@lru_cache(maxsize=4)
def ideal(play: str) -> tuple[mb.Result, float]:
    """One turn with ideal joints, and the largest force (N) in those that may have play."""
    r = slider_crank("").simulate(turn(), solver=mb.RadauIIA(3, rtol=1e-10))
    return r, max(float(np.max(np.linalg.norm(r[joint].force, axis=1))) for joint in play)


@dataclass(frozen=True)
class Limit:
    """One turn with clearance (m) and contact stiffness (N/m^1.5) against ideal joints.

    depth: static penetration (m) under the largest force of the ideal joint; deviation: of the slider from ideal joints over
    clearance + depth; deepest: largest penetration over depth; rtol and cost of the run.
    """

    clearance: float
    stiffness: float
    depth: float
    deviation: float
    deepest: float
    contacts: int
    rtol: float
    result: mb.Result


def limit(clearance: float, stiffness: float, play: str = "B", solver: Any = None, **contact: Any) -> Limit:
    """The run, its tolerance a hundredth of the static penetration over the length of the scene, at most 1e-6."""
    r, force = ideal(play)
    normal = mb.Hertz(stiffness, 0.5)
    depth = normal.penetration(force)
    rtol = min(1e-6, 1e-2 * depth / (CRANK + ROD))
    scene = slider_crank(play, clearance, normal=normal, **contact)
    loose = scene.simulate(turn(), solver=solver(rtol) if solver is not None else mb.RadauIIA(3, rtol=rtol))
    off = float(np.max(np.abs(loose["slider"].position - r["slider"].position))) / (clearance + depth)
    contacts = [loose[joint].contacts for joint in play]
    deepest = max(c.deepest for c in contacts) / depth
    return Limit(clearance, stiffness, depth, off, deepest, sum(map(len, contacts)), rtol, loose)
