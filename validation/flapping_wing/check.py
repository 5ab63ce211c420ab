"""The flapping wing of the paper's first example: rigid and elastic links, joint models, refinement, energy."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both

import mbdae as mb

claim = Claim("flapping_wing", "the flapping wing turns through with rigid and with elastic links, equal with every joint model",
              1e-7, "rad", "rigid: three intersections of two circles in closed form; elastic: the kinematic joint model of the "
              "same scene, the same scene refined, and the rigid one")
EXAMPLE = Path(__file__).parents[2] / "examples" / "flapping_wing.py"
ANGLES = ("L4", "L8", "L9")
STEP = 5e-4  # s, constant, where runs are compared step by step


@lru_cache(maxsize=1)
def wing() -> Any:
    """The example."""
    spec = importlib.util.spec_from_file_location("example_flapping_wing", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# -- rigid links


def meeting(a: Any, b: Any, drawn: Any) -> Any:
    """Points (nt, 2) at the drawn distances from a and b (nt, 2), on the drawn side of the line from a to b."""
    c, a0, b0 = drawn
    ra, rb, d = np.linalg.norm(c - a0), np.linalg.norm(c - b0), b - a
    s2 = np.einsum("ti,ti->t", d, d)
    along = (s2 + ra**2 - rb**2) / (2 * s2)
    (x, y), (u, v) = b0 - a0, c - a0
    side = np.sign(x * v - y * u) * np.sqrt(ra**2 / s2 - along**2)
    return a + along[:, None] * d + side[:, None] * np.stack([-d[:, 1], d[:, 0]], axis=1)


def carried(points: Any, numbers: Sequence[int], a: tuple[int, Any], b: tuple[int, Any]) -> list[Any]:
    """Where points of a rigid body are when its points a and b are at (nt, 2)."""
    drawn, now = points[b[0]] - points[a[0]], b[1] - a[1]
    turn = (now[:, 0] + 1j * now[:, 1]) / complex(*drawn)
    moved = [turn * complex(*(points[n] - points[a[0]])) for n in numbers]
    return [a[1] + np.stack([z.real, z.imag], axis=1) for z in moved]


def closed_form(t: Any, sense: int) -> dict[str, Any]:
    """Angles of all hinges of the left half, rad (nt,), from the three four-bars."""
    p = {n: 0.01 * np.array(xy, dtype=float) for n, xy in wing().POINTS.items()}
    fixed = {n: np.tile(p[n], (len(t), 1)) for n in (1, 12)}
    crank = np.exp(1j * sense * wing().OMEGA * t) * complex(*(p[2] - p[1]))
    p2 = p[1] + np.stack([crank.real, crank.imag], axis=1)
    p4 = meeting(p2, fixed[12], (p[4], p[2], p[12]))
    (p3,), (p6, p8) = carried(p, [3], (2, p2), (4, p4)), carried(p, [6, 8], (12, fixed[12]), (4, p4))
    p7 = meeting(p3, p6, (p[7], p[3], p[6]))
    p9 = meeting(p7, p8, (p[9], p[7], p[8]))
    lines = {"A": (fixed[1], p2), "B": (p2, p4), "D": (fixed[12], p4), "E": (p6, p7), "F": (p3, p7), "G": (p7, p9), "H": (p8, p9)}
    heading = {name: np.unwrap(np.arctan2(*(b - a).T[::-1])) for name, (a, b) in lines.items()}
    turned = {name: h - h[0] for name, h in heading.items()}
    return {name: turned[l] - turned[k] for name, (k, l) in wing().HINGES.items()} | {"1": turned["A"], "12": turned["D"]}


def turns(solver: Any, sense: int) -> list[Found]:
    """Two turns of the rigid wing: every hinge against the circles, its rows at every step."""
    times = np.linspace(0, 4 * np.pi / wing().OMEGA, 201)
    r = simulated(wing().scene(sense=sense), times, 1e-8, solver)
    inside = r(r.solution.t)
    errors = [largest(r["L" + name].angle, angle) for name, angle in closed_form(times, sense).items()]
    mirrored = [largest(r["L" + name].angle, -r["R" + name].angle) for name in wing().HINGES]
    return [Found(max(errors), 1e-8, quantity="hinge angles"),
            Found(max(mirrored), 1e-8, quantity="right half, mirrored"),
            Found(inside.drift.position.max(), 1e-10, "m, rad", "constraints at every step")]


# -- elastic links


def histories(r: Any, times: Any) -> list[Any]:
    """Angles in 4, 8, 9 and torque of the drive at some times."""
    at = r(times)
    return [*(at[name].angle for name in ANGLES), at["L1"].torque[:, 2]]


def relative(a: Sequence[Any], b: Sequence[Any]) -> float:
    """Largest difference of histories over their largest value."""
    return max(largest(x, y) / largest(y) for x, y in zip(a, b, strict=True))


@lru_cache(maxsize=4)
def stepped(case: str, t_end: float, space: str = "auto") -> Any:
    """The elastic wing with constant steps."""
    return wing().scene(flexible=True, case=case, space=space).simulate(t_end, solver=mb.RadauIIA(3, step=STEP))


def equal_steps(case: str) -> list[Found]:
    """One flap with a joint model against case I, step by step."""
    one, other = stepped("I", wing().t_end), stepped(case, wing().t_end)
    return [Found(largest(one[name].angle, other[name].angle), quantity=f"angle in {name[1]}") for name in ANGLES]


def adaptive(case: str, accuracy: float = 1e-4) -> list[Found]:
    """The same from the accuracy alone, ten times of which two runs may differ."""
    r = [wing().scene(flexible=True, case=c).simulate(wing().t_end, accuracy=accuracy) for c in ("I", case)]
    return [Found(largest(r[0][name].angle, r[1][name].angle), 10 * accuracy, quantity=f"angle in {name[1]}") for name in ANGLES]


def refinement() -> Found:
    """Twice the elements at a tenth of the accuracy: largest change of angles and torque of the drive."""
    times = np.linspace(0, wing().t_end, 251)
    coarse, fine = (wing().scene(flexible=True, elements=n).simulate(wing().t_end, accuracy=a) for n, a in ((1, 1e-4), (2, 1e-5)))
    return Found(relative(histories(coarse, times), histories(fine, times)), 1e-2, "relative", note=f"{fine.stats.steps} steps")


def stiffening(factor: float) -> Found:
    """Difference of the angles from the rigid wing, times the factor of the stiffness: the motion is linear in the compliance."""
    t_end = 0.1
    elastic, rigid = (wing().scene(flexible=flexible, stiffness=factor).simulate(t_end, solver=mb.RadauIIA(3, step=STEP))
                      for flexible in (True, False))
    return Found(factor * max(largest(elastic[n].angle, rigid[n].angle) for n in ANGLES), 0.02)


def balance(rtol: float | None) -> Found:
    """Work of the drives against the change of energy over one flap, relative to the largest energy; None: constant step."""
    t_end = wing().t_end
    r = wing().scene(flexible=True).simulate(t_end, solver=mb.RadauIIA(3, rtol=rtol)) if rtol else stepped("I", t_end)
    return Found(largest(r.energy.balance) / largest(r.energy.total), 1e-6, "relative", note=f"{r.stats.steps} steps")


def multipliers(frame: bool = False) -> int:
    """Of the elastic wing in space, every hinge on nodes of beams."""
    names = wing().scene(flexible=True, space="spatial", bracket=True, frame=frame).system(mb.GGL()).names
    return sum(name.startswith("lambda") for name in names)


def space() -> list[Found]:
    """The spatial model moves as the planar one; with every hinge on nodes of beams (the bracket 5-12 a beam too) its
    multipliers are the paper's 42: two tilt rows per hinge, one per drive. Nodes that meet share their displacement."""
    t_end = 0.02
    flat, spatial = stepped("I", t_end), stepped("I", t_end, "spatial")
    found = [Found(max(largest(flat[n].angle, spatial[n].angle) for n in ANGLES), 1e-9, quantity="angles")]
    for frame in (False, True):
        found.append(Found(abs(multipliers(frame) - 42), 0.5, "rows",
                           f"multipliers, {'elastic frame' if frame else 'on the ground'}"))
    return found


def paper_size() -> list[Found]:
    """One flap of the paper's mesh in space: 211 nodal points, an elastic frame clamped in 16."""
    s = wing().scene(flexible=True, elements=2, frame=True, space="spatial")
    kinds = s.system(mb.GGL()).kinds
    q, v = kinds.count("q"), kinds.count("v")
    r = s.simulate(wing().t_end, accuracy=1e-4)
    said = f"{v} velocities, {r.stats.steps} steps, {r.stats.cpu_s:.1f} s CPU of the last of {r.info.runs} runs"
    return [Found(abs((v - 3 * (q - v)) / 3 - 211), 0.5, "points", "nodal points", note=said),
            Found(r.accuracy.estimated or 0.0, 1e-4, "relative", "estimated error")]


def cases() -> list[Case]:
    found = [case for sense, name in ((1, "forwards"), (-1, "backwards"))
             for case in with_both(f"rigid, cranks {name}", lambda solver, way=sense: turns(solver, way), sense < 0)]
    for model in ("II", "recursive", "classical"):
        runs = {"equal steps": lambda model=model: equal_steps(model), "adaptive": lambda model=model: adaptive(model)}
        found += [Case(f"elastic, case {model} against I, {how}", "RadauIIA(3)", run, model != "II" or how == "adaptive")
                  for how, run in runs.items()]
    found += [Case(f"elastic, {factor:g} times as stiff", "RadauIIA(3)", lambda factor=factor: stiffening(factor),
                   factor != 1e6) for factor in (1.0, 1e4, 1e6)]
    found += [Case(f"energy, {how}", "RadauIIA(3)", lambda rtol=rtol: balance(rtol), slow=rtol is not None)
              for how, rtol in (("constant step", None), ("rtol 1e-8", 1e-8))]
    return [*found, Case("elements and accuracy", "RadauIIA(3)", refinement, slow=True),
            Case("space", "RadauIIA(3)", space, slow=True),
            Case("paper's size", "RadauIIA(3)", paper_size, slow=True)]
