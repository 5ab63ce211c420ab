"""The scenes of benchmarks/peer.py, and what both programs run on them."""

# ruff: noqa: E402

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import sympy

import mbdae as mb
from mbdae.results.result import Result

sys.path[:0] = [str(Path(__file__).parent.parent / folder) for folder in ("validation", "examples")]
import andrews_squeezer
from recursive_joints import tolerances
from scenes import ground_resonance, heavy_top

AXES = [(0, 1, 0), (0, 1, 1)]  #: of the hinges of spatial chains, in turn


@dataclass
class Ladder:
    """A method of mbdae: solver of a tolerance, form, and the joint model."""

    label: str
    solver: Callable[[float], Any]
    values: Sequence[float]
    form: Any = None
    model: Any = None


@dataclass
class Problem:
    """A scene for both programs. places: sensors compared, (nt, 3) each, m; length: m, the unit of errors."""

    scene: Callable[[Any], mb.Scene]
    t_end: float
    length: float
    exudyn: dict[str, Any]
    methods: list[dict[str, Any]]
    places: Callable[[Result], Sequence[Any]]
    models: Sequence[Any] = (None, mb.Recursive())
    stiff: bool = False
    more: list[Ladder] = field(default_factory=list)


def steps(largest: float, count: int) -> list[float]:
    """`count` step sizes, each 1/sqrt(10) of the last."""
    return [largest * 10 ** (-k / 2) for k in range(count)]


def alpha(h: float, count: int = 7, linear: Sequence[str] = ("EXUdense",), **options: Any) -> list[dict[str, Any]]:
    """Generalised-alpha of exudyn, index 3, with two spectral radii."""
    return [{"name": f"generalised-alpha, radius {radius:g}, {solver}{''.join(', ' + str(o) for o in options.values())}",
             "steps": steps(h, count), "radius": radius, "linear": solver, "options": options}
            for solver in linear for radius in (0.6, 0.9)]


def tree(scene: str) -> dict[str, Any]:
    """A kinematic tree of exudyn with its explicit method of order 5."""
    return {"name": "kinematic tree, DOPRI5", "scene": scene, "solver": "DOPRI5", "tolerances": [10.0**-k for k in range(3, 13)]}


# -- the scenes


def chain(n: int, rod: float, spatial: bool, model: Any) -> mb.Scene:
    """n rods of 1 kg, released horizontally."""
    gravity = (0, 0, -9.81) if spatial else (0, -9.81, 0)
    s = mb.Scene(f"{'spatial' if spatial else 'planar'} chain of {n}", gravity=gravity)
    before = s.ground
    for i in range(n):
        body = s.link(f"rod{i + 1}", (i * rod, 0, 0), ((i + 1) * rod, 0, 0), mass=1.0)
        axis = np.array(AXES[i % 2]) / np.linalg.norm(AXES[i % 2]) if spatial else (0, 0, 1)
        s.revolute(f"J{i + 1}", before, body, at=(i * rod, 0, 0), axis=axis, model=model)
        before = body
    return s


def bodies(r: Result) -> list[Any]:
    """Positions of all bodies."""
    return [r[b.name].position for b in r.prepared.model.scene.bodies]


def chain_problem(n: int, rod: float, spatial: bool) -> Problem:
    options = {"n": n, "length": rod, "mass": 1.0} | ({"axes": AXES} if spatial else {})
    linear = ("EXUdense",) if n < 6 else ("EigenSparse",) if n > 30 else ("EXUdense", "EigenSparse")
    found = alpha(1e-2, 8 if n < 20 else 6, linear)
    if spatial:
        found += alpha(1e-2, 8 if n < 20 else 6, linear, rotation="lie group")
    name = "spatial chain" if spatial else "planar chain"
    return Problem(lambda model: chain(n, rod, spatial, model), 1.0, n * rod, {"scene": name, "options": options},
                   [*found, tree("chain tree")], bodies)


def andrews_problem() -> Problem:
    scene = andrews_squeezer.scene()
    listed = list(scene.bodies)
    index = {b: i for i, b in enumerate(listed)}
    hinges = [(index.get(c.k, -1), index.get(c.l, -1), c.joint.at[:2].tolist()) for c in scene.joints]
    (spring,) = [c for c in scene.connections if c.kind == "spring"]
    law = spring.laws[0]
    springs = [{"k": index.get(spring.k, -1), "l": index.get(spring.l, -1), "at_k": law.at[:2].tolist(),
                "at_l": law.at_l[:2].tolist(), "stiffness": andrews_squeezer.STIFFNESS, "length": andrews_squeezer.NATURAL}]
    given = [{"mass": float(b.mass), "inertia": float(b.inertia[2, 2]), "at": b.position[:2].tolist(), "angle": 0.0}
             for b in listed]
    options = {"bodies": given, "hinges": hinges, "springs": springs, "torques": [[0, andrews_squeezer.TORQUE]]}

    def places(r: Result) -> list[Any]:
        return [r[b.name].position for b in listed]

    return Problem(lambda _: andrews_squeezer.scene(), 0.03, 0.1, {"scene": "linkage", "options": options}, alpha(3e-4, 8),
                   places, models=(None,))


def rotor_problem() -> Problem:
    along = [np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)]) for i in range(4)]
    blades = [(tuple(0.25 * d), tuple(4.5 * d)) for d in along]
    turn = np.array([[np.cos(0.01), -np.sin(0.01)], [np.sin(0.01), np.cos(0.01)]])
    root = np.array(blades[0][0])
    blades[0] = (tuple(root), tuple(root + turn @ (np.array(blades[0][1]) - root)))
    options = {"omega": 20.01, "block": 30.0, "inertia": 1.0, "stiffness": 12000.0, "damping": 150.0, "mass": 12.75,
               "blades": [[list(map(float, end)) for end in blade] for blade in blades]}
    names = ["hub", *(f"blade{i + 1}" for i in range(4))]
    return Problem(lambda model: ground_resonance(2, True, "auto", model), 2.0, 4.5,
                   {"scene": "ground resonance", "options": options}, alpha(1e-2, 7),
                   lambda r: [r[name].position for name in names])


def top(model: Any) -> mb.Scene:
    """The heavy top on a spherical joint; with a joint model on three hinges in one point, as the peer's tree has it."""
    if model is None:
        return heavy_top()
    s = mb.Scene("heavy top on hinges", gravity=(0, 0, -9.81))
    outer, inner = (s.rigid_body(name, 0.0, 0.0, at=(0, 0, 0)) for name in ("outer", "inner"))
    body = s.rigid_body("top", 15.0, (0.234375, 0.46875, 0.234375), at=(0, 1, 0))
    for name, k, l, axis, rate in (("x", s.ground, outer, (1, 0, 0), 0.0), ("z", outer, inner, (0, 0, 1), -4.61538),
                                   ("y", inner, body, (0, 1, 0), 150.0)):
        s.revolute(name, k, l, at=(0, 0, 0), axis=axis, rate0=rate, model=model)
    return s


def top_problem() -> Problem:
    options = {"mass": 15.0, "inertia": [0.234375, 0.46875, 0.234375], "at": [0, 1, 0], "spin": [0, 150, -4.61538]}
    methods = [*alpha(1e-3, 7), *alpha(1e-3, 7, rotation="lie group"), tree("top tree")]
    return Problem(top, 1.0, 1.0, {"scene": "heavy top", "options": options}, methods, lambda r: [r["top"].position])


SECTION = {"EA": 1e4, "GA": 1e4, "EI": 500.0, "mass_per_length": 1.0, "rotary_inertia": 10.0}
BEAM, ELEMENTS, PULSE, PUSH, TWIST = 10.0, 10, 2.5, 8.0, -80.0  # m, -, s, N, N m


def flying_beam(_: Any = None, elements: int = ELEMENTS) -> mb.Scene:
    """A free beam with smooth pulses of force and torque at its end."""
    on = sympy.Piecewise((sympy.sin(sympy.pi * mb.t / PULSE) ** 4, mb.t < PULSE), (0, True))
    s = mb.Scene("flying beam")
    section = mb.Section(EA=SECTION["EA"], GA2=SECTION["GA"], GA3=SECTION["GA"], GJ=500.0, EI2=500.0, EI3=SECTION["EI"],
                         mass_per_length=1.0, rotary_inertia=SECTION["rotary_inertia"])
    beam = s.beam("beam", (0, 0), (BEAM, 0), section=section, elements=elements, order=1)
    s.force("push", beam, (PUSH * on, 0, 0), at=(0, 0))
    s.torque("twist", beam.at((0, 0)), (0, 0, TWIST * on))
    return s


def beam_problem() -> Problem:
    options = {"n": ELEMENTS, "length": BEAM, "force": PUSH, "torque": TWIST, "pulse": PULSE, "section": SECTION}

    def places(r: Result) -> list[Any]:
        return [r["beam"].at(i / ELEMENTS).position for i in range(ELEMENTS + 1)]

    waves = [Ladder(f"RadauIIA({s}), waves", lambda v, s=s: mb.RadauIIA(s, rtol=v), tolerances(2, 8), mb.ODE(waves=True))
             for s in (2, 3)]
    return Problem(flying_beam, 5.0, BEAM, {"scene": "flying beam", "options": options}, alpha(5e-2, 7), places,
                   models=(None,), stiff=True, more=waves)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    **{f"planar-{n}": lambda n=n: chain_problem(n, 1.0, False) for n in (1, 4, 16, 64)},
    **{f"spatial-{n}": lambda n=n: chain_problem(n, 1.0, True) for n in (1, 4)},
    "spatial-10": lambda: chain_problem(10, 0.1, True), "short-planar-10": lambda: chain_problem(10, 0.1, False),
    "andrews": andrews_problem, "rotor": rotor_problem, "top": top_problem, "flying-beam": beam_problem,
}
