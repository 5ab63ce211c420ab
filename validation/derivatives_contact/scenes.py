"""The mechanisms of `own.py` as scenes of mbdae, with numbers drawn by a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from clearance_scenes import slider_crank
from derivatives_contact.own import BALL, SHAKEN, SLIDER_CRANK, TWO, Own

import mbdae as mb
from mbdae.study.statements import changed

RATE = 100.0  # rad/s, of the crank


@dataclass(frozen=True)
class Mechanism:
    """own: its equations; build: the scene of numbers; drawn: numbers by a random generator; names: of the numbers in the scene,
    by those of `own`; read: sensors with the place of their value in the state; most: of the relative error of a derivative at
    accuracy 1e-8; end: s, by numbers."""

    own: Own
    build: Callable[[Any], mb.Scene]
    drawn: Callable[[Any], dict[str, float]]
    names: dict[str, str]
    read: dict[str, int]
    most: float
    end: Callable[[Any], float]


def near(rng: Any, **values: float) -> dict[str, float]:
    """Each number times a factor between 0.6 and 1.6."""
    return {name: value * float(np.exp(rng.uniform(np.log(0.6), np.log(1.6)))) for name, value in values.items()}


def ball(p: Any) -> mb.Scene:
    s, J = mb.Scene("ball", gravity=(0, 0, -p["g"])), p["mass"] * p["gyration"] ** 2
    b = s.rigid_body("ball", p["mass"], (J, J, J), at=(0, 0, p["height"]), velocity=(p["speed"], 0, 0),
                     angular_velocity=(0, p["spin"], 0))
    s.contact("floor", s.ground, b, mb.Plane(), mb.Sphere(radius=p["radius"]),
              normal=mb.Hertz(p["stiffness"], damping=p["damping"]), friction=mb.Coulomb(p["mu"], p["v_c"]))
    return s


def shaken(p: Any) -> mb.Scene:
    s, w, reach = mb.Scene("shaken", gravity=(0, 0, -p["g"])), mb.number("w", p["w"]), mb.number("reach", p["reach"])
    plate = s.rigid_body("plate", 1.0, (1, 1, 1), at=(0, 0, 0))
    b = s.rigid_body("ball", p["mass"], (1, 1, 1), at=(0, 0, p["height"]))
    s.prismatic("drive", s.ground, plate, at=(0, 0, 0), axis=(0, 0, 1), position=reach * sympy.sin(w * mb.t))
    s.contact("hit", plate, b, mb.Plane(), mb.Sphere(radius=p["radius"]), normal=mb.Hertz(p["stiffness"], damping=p["damping"]))
    return s


def two(p: Any) -> mb.Scene:
    s = mb.Scene("two balls")
    a = s.rigid_body("a", p["mass_a"], (1, 1, 1), at=(0, 0, 0), velocity=(p["speed_a"], 0, 0))
    b = s.rigid_body("b", p["mass_b"], (1, 1, 1), at=(p["ahead"], p["aside"], 0), velocity=(p["speed_b"], 0, 0))
    s.contact("hit", a, b, mb.Sphere(radius=p["radius"]), mb.Sphere(radius=p["radius"]),
              normal=mb.Hertz(p["stiffness"], damping=p["damping"]))
    return s


def loose(p: Any) -> mb.Scene:
    s = slider_crank("B", p["outer"] - p["inner"], p["w"], normal=mb.Hertz(p["stiffness"], p["damping"]),
                     friction=mb.Coulomb(p["mu"], p["v_c"]))
    for name, value in (("slider.mass", p["slider"]), ("rod.mass", p["rod"])):
        s = changed(s, name, value)[0]  # type: ignore[assignment]
    return s


def of_contact(name: str) -> dict[str, str]:
    """Names of the numbers of a contact's laws."""
    return {"stiffness": f"{name}.normal.stiffness", "damping": f"{name}.normal.damping", "mu": f"{name}.friction.mu",
            "v_c": f"{name}.friction.v_c"}


def _loose_numbers(rng: Any) -> dict[str, float]:
    p = near(rng, stiffness=1e9, damping=0.5, mu=0.1, v_c=0.1, slider=1.5, rod=0.5, outer=5e-4)
    return p | {"outer": 0.01 + p["outer"], "inner": 0.01, "w": RATE}


MECHANISMS = {
    "ball": Mechanism(
        BALL, ball, lambda rng: near(rng, mass=1.0, stiffness=1e6, damping=0.2, mu=0.3, v_c=0.05, speed=0.7, spin=2.0,
                                     height=0.4, radius=0.1, gyration=0.06) | {"g": 9.81},
        of_contact("floor") | {"height": "ball.at.2", "speed": "ball.velocity.0", "mass": "ball.mass"},
        {"ball.position[0]": 0, "ball.position[2]": 1, "ball.velocity[2]": 3, "ball.angular_velocity[1]": 4}, 1e-4,
        lambda p: 2.6 * float(np.sqrt(2 * (p["height"] - p["radius"]) / p["g"]))),
    "shaken": Mechanism(
        SHAKEN, shaken, lambda rng: (
            p := near(rng, mass=1.0, stiffness=1e6, damping=0.3, gap=0.08, radius=0.08, w=20.0, reach=0.01))
        | {"height": p["radius"] + p["gap"], "g": 9.81},
        {"stiffness": "hit.normal.stiffness", "damping": "hit.normal.damping", "w": "w", "reach": "reach", "mass": "ball.mass"},
        {"ball.position[2]": 0, "ball.velocity[2]": 1}, 1e-4,
        lambda p: 2.6 * float(np.sqrt(2 * p["gap"] / p["g"]))),
    "two balls": Mechanism(
        TWO, two, lambda rng: near(rng, mass_a=1.0, mass_b=1.0, stiffness=1e8, damping=0.1, speed_a=1.0, radius=0.05, ahead=0.5)
        | {"aside": float(rng.uniform(-0.05, 0.05)), "speed_b": float(rng.uniform(-0.5, 0.2))},
        {"stiffness": "hit.normal.stiffness", "damping": "hit.normal.damping", "mass_a": "a.mass", "mass_b": "b.mass",
         "speed_a": "a.velocity.0", "speed_b": "b.velocity.0", "aside": "b.at.1"},
        {"a.position[0]": 0, "b.position[1]": 3, "a.velocity[0]": 4, "a.velocity[1]": 5, "b.velocity[0]": 6}, 1e-4,
        lambda p: 1.5 * p["ahead"] / (p["speed_a"] - p["speed_b"])),
    "slider-crank": Mechanism(
        SLIDER_CRANK, loose, _loose_numbers,
        of_contact("B.model") | {"slider": "slider.mass", "rod": "rod.mass", "outer": "B.model.outer"},
        {"slider.position[0]": 0, "slider.velocity[0]": 2, "rod.angular_velocity[2]": 3}, 1e-2, lambda p: 0.02),
}
