"""Rolling without slip and knife edges: motions against own equations, roots of a bicycle against those published."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from rolling.drawn import COUNT, Drawn
from rolling.drawn import T_END as T_DRAWN
from rolling.own import PUBLISHED, SELF_STABLE, bicycle_roots
from rolling.scenes import PROBLEMS, T_END, bicycle, times
from runner import Case, Claim, Found

import mbdae as mb

ACCURACY = 1e-6
claim = Claim("rolling", "scenes that roll without slip or move along blades keep the accuracy asked, in every joint model, form "
              "and solver; all roots of the benchmark bicycle are those published", 3 * ACCURACY, "of the largest position",
              "equations of Lagrange and d'Alembert by SymPy, of Newton and Euler for the disc, DOP853 of SciPy at rtol 1e-12; a "
              "circle in closed form; Meijaard, Papadopoulos, Ruina, Schwab (2007)")
WAYS: dict[str, dict[str, Any]] = {
    "default": {}, "RadauIIA(3), GGL": {"solver": mb.RadauIIA(3), "form": mb.GGL()},
    "RadauIIA(5), Index3": {"solver": mb.RadauIIA(5), "form": mb.Index3()}, "RadauIIA(2), Index1": {
        "solver": mb.RadauIIA(2), "form": mb.Index1()}, "IDA, GGL": {"solver": mb.IDA()},
    "IDA, Index1": {"solver": mb.IDA(), "form": mb.Index1()}, "CVODE": {"solver": mb.CVODE()}, "DOP853": {"solver": mb.DOP853()},
}
#: a rotation by which scenes are stated turned
TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
SEEDS = 120
MODELS = {"kinematic": mb.Kinematic(), "classical": mb.Classical(), "recursive": mb.Recursive()}


def motion(problem: str, model: Any, way: dict[str, Any]) -> Found:
    """Largest error of the positions over the largest position."""
    scene, read, found = PROBLEMS[problem](model)
    r = scene.simulate(T_END, accuracy=ACCURACY, outputs=times(), **way)
    error = float(np.max(np.abs(read(r) - found)) / np.max(np.abs(found)))
    return Found(error if r.reliable else 0.0, note="" if r.reliable else "said to be unreliable")


def drawn(seed: int) -> Found:
    """Largest error of the positions of a scene at random, over the largest, as stated and as stated turned, moved and backwards;
    NaN where a force of what rolls does more work than by its errors. Forms and joint models by turns."""
    d, error = Drawn(seed), 0.0
    wanted = d.moved()
    model, way = list(MODELS.values())[seed % 3], list(WAYS.values())[seed % len(WAYS)]
    for Q, by, backwards in ((np.eye(3), np.zeros(3), False), (TURNED, np.array([0.3, -0.2, 0.5]), True)):
        r = d.scene(Q, by, backwards, model).simulate(T_DRAWN, accuracy=ACCURACY, outputs=COUNT, **way)
        if not r.reliable:
            return Found(0.0, note="said to be unreliable")
        found = np.stack([(r[b["name"]].position - by) @ Q for b in d.bodies], axis=1)
        error = max(error, float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))))
        for one in d.rollers:
            force, v = (np.linalg.norm(x, axis=1) for x in (r[one["name"]].force, r[d.bodies[one["l"]]["name"]].velocity))
            if np.max(np.abs(r[one["name"]].power)) > 100 * ACCURACY * max(1.0, float(np.max(force) * np.max(v))):
                return Found(float("nan"), note=f"the force of {one['name']} does work")
    return Found(error)


def constant_steps(problem: str, model: Any) -> Found:
    """As `motion`, by the HHT method at an accuracy that its order allows."""
    scene, read, found = PROBLEMS[problem](model)
    r = scene.simulate(T_END, accuracy=1e-3, outputs=times(), solver=mb.HHT())
    return Found(float(np.max(np.abs(read(r) - found)) / np.max(np.abs(found))) if r.reliable else 0.0, 3e-3)


def roots(speed: float) -> Found:
    """Largest distance of a published root from the nearest one found, 1/s."""
    found = bicycle(speed).linearize().eigenvalues
    wanted = [*bicycle_roots(speed), *PUBLISHED.get(speed, ())]
    return Found(max(float(np.min(np.abs(found - root))) for root in wanted), 1e-9, "1/s")


def stability(speed: float, model: Any) -> Found:
    """1 where `stable` is not True between the published speeds and False outside, or a root 0 has an error."""
    found = bicycle(speed, model=model).linearize()
    right = found.stable is (SELF_STABLE[0] < speed < SELF_STABLE[1]) and not np.any(found.errors[found.eigenvalues == 0])
    return Found(float(not right), 0.0, "wrong")


def energy(model: Any, way: dict[str, Any]) -> Found:
    """Change of the energy of a bicycle that wobbles freely, over its kinetic energy in the wobble's bodies."""
    r = bicycle(4.6, 0.5, model).simulate(T_END, accuracy=ACCURACY, **way)
    total = r.energy.total
    return Found(float(np.ptp(total) / abs(total[0])) if r.reliable else 0.0, unit="relative")


def cases() -> list[Case]:
    quick = [("coin", "kinematic", "default"), ("ball_on_turntable", "recursive", "RadauIIA(3), GGL"),
             ("snakeboard", "classical", "IDA, GGL")]
    found = [Case(f"{p}, {m}", w, partial(motion, p, MODELS[m], WAYS[w]), slow=(p, m, w) not in quick)
             for p in PROBLEMS for m in MODELS for w in WAYS]
    found += [Case(f"bicycle at {v:g} m/s", "linearize", partial(roots, float(v)), slow=v not in (5,)) for v in range(11)]
    found += [Case(f"{p}, {m}", "HHT", partial(constant_steps, p, MODELS[m]), slow=True) for p in PROBLEMS for m in MODELS]
    found += [Case(f"drawn by seed {seed}", list(WAYS)[seed % len(WAYS)], partial(drawn, seed), slow=seed not in (3, 9))
              for seed in range(SEEDS)]
    speeds = (1.0, SELF_STABLE[0] - 1e-6, SELF_STABLE[0] + 1e-6, 5.0, SELF_STABLE[1] - 1e-6, SELF_STABLE[1] + 1e-6, 10.0)
    found += [Case(f"stability at {v:.7g} m/s, {m}", "linearize", partial(stability, v, MODELS[m]), slow=v != 5)
              for v in speeds for m in MODELS]
    return found + [Case(f"energy of the bicycle, {m}", w, partial(energy, MODELS[m], WAYS[w]), slow=w != "default")
                    for m in MODELS for w in WAYS]
