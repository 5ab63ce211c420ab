"""The paper's first claim on its own problem: does the revolute with fewer constraints make the problem less stiff?

Ground resonance with Index3 and Radau IIA (3 stages): classical joints (the angle is an unknown, 4 rows where driven,
3 where free) against kinematic ones (3 and 2), with the scaling and the penalty of the paper's Eq. 2.

    python benchmarks/joint_models.py
"""

from __future__ import annotations

import copy
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare

T_END, STEP = 1.0, 1e-3  # s
LARGEST, SMALLEST = 0.1, 1e-9  # s, step sizes tried
MODELS = [(model, k, p) for model in (mb.Kinematic, mb.Classical) for k, p in ((1.0, 0.0), (1e6, 0.0), (1.0, 1e6), (1e6, 1e6))]


def system(scene: mb.Scene) -> tuple[object, object]:
    """The prepared scene and its index-3 equations."""
    prepared = prepare(scene)
    return prepared, system_for(prepared, mb.Index3(), 3)


def lag_angles(prepared: object, solution: object, times: np.ndarray) -> np.ndarray:
    """(nt, 4) rad, planar: heading of every blade minus that of the hub, less the drawing."""
    nodes = {n.name: n for n in prepared.model.nodes}
    y = solution(times)
    hub = y[:, nodes["hub"].q + 2]
    blades = [n for name, n in nodes.items() if name.startswith("blade")]
    return np.stack([y[:, n.q + 2] - hub - i * np.pi / 2 for i, n in enumerate(blades)], axis=1)


def conditions(system: object, h: float) -> tuple[float, float]:
    """Condition of the matrix of the real Radau stage: as it stands, and with columns h^(index-1) and rows equilibrated."""
    fy, fyp = system.jacobian_parts(system.t0, system.y0, system.yp0)
    dense = [system.sparsity.__class__((d, system.sparsity.indices, system.sparsity.indptr), shape=(system.n,) * 2).toarray()
             for d in (fy, fyp)] if system.sparsity is not None else [fy, fyp]
    K = dense[0] + 3.6378 / h * dense[1]
    scaled = K * (system.scale * h ** -(system.index - 1.0))
    return float(np.linalg.cond(K)), float(np.linalg.cond(scaled / np.abs(scaled).max(axis=1, keepdims=True)))


def converges(system: object, h: float) -> bool:
    """Whether ten steps of size h converge."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mb.RadauIIA(3, step=h).solve(system, 10 * h, max_wall=20.0)
    except mb.SolverError:
        return False
    return True


def smallest_step(system: object) -> float:
    """The smallest step of 1e-3, 1e-4, ... 1e-9 s at which ten steps converge, without a gap above it."""
    steps = 10.0 ** np.arange(-3, -10, -1)
    good = [h for h in steps if h >= SMALLEST]
    last = float("nan")
    for h in good:
        if not converges(system, h):
            break
        last = float(h)
    return last


def unscaled(system: object) -> object:
    """The same equations with every unknown in one norm, as if all had index 1: what Newton sees without h-scaling."""
    plain = copy.copy(system)
    plain.index = np.ones_like(system.index)
    return plain


def largest_step(system: object) -> float:
    """The largest of 0.1, 0.05, 0.02, ... s at which the whole run converges."""
    for h in (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001):
        try:
            mb.RadauIIA(3, step=h).solve(system, T_END, max_wall=20.0)
        except mb.SolverError:
            continue
        return h
    return float("nan")


def rows(build: object, free: bool, models: list[tuple[type, float, float]] = MODELS) -> Iterator[dict[str, object]]:
    """One row per joint model: unknowns, Newton iterations, steps that converge, condition, adaptive cost, difference."""
    times, reference = np.linspace(0.0, T_END, 501), {}
    for model, k, p in models:
        prepared, equations = system(build(2, free).replace(model=model(scaling=k, penalty=p)))
        begin = time.process_time()
        fixed = mb.RadauIIA(3, step=STEP).solve(equations, T_END)
        cpu = time.process_time() - begin
        tight = mb.RadauIIA(3, rtol=1e-9).solve(equations, T_END)
        angles = {"fixed": lag_angles(prepared, fixed, times), "adaptive": lag_angles(prepared, tight, times)}
        reference = reference or angles
        raw, scaled = conditions(equations, STEP)
        difference = {w: float(np.abs(a - reference[w]).max() / np.abs(reference[w]).max()) for w, a in angles.items()}
        yield difference | {"model": model.__name__, "k": k, "p": p, "unknowns": equations.n, "multipliers": prepared.mechanics.m,
               "newton": fixed.stats.newton_iterations / fixed.stats.steps, "cpu_fixed": cpu, "raw": raw, "scaled": scaled,
               "smallest": smallest_step(equations), "plain": smallest_step(unscaled(equations)),
               "largest": largest_step(equations), "steps": tight.stats.steps, "cpu": tight.stats.cpu_s}


COLUMNS = {
    "model": "s", "k": "g", "p": "g", "unknowns": "d", "newton": ".2f", "cpu_fixed": ".2f", "raw": ".1e", "scaled": ".1e",
    "smallest": ".0e", "plain": ".0e", "largest": "g", "steps": "d", "cpu": ".2f", "fixed": ".1e", "adaptive": ".1e",
}
HEAD = ("model", "k", "p", "unknowns", "Newton / step", "CPU s (h = 1 ms)", "cond", "cond scaled", "smallest h, s",
        "without h-scaling", "largest h, s", "steps (rtol 1e-9)", "CPU s",
        "difference at equal steps", "difference adaptive")


STEPS = 9  #: column with which the table of steps begins


def main() -> None:
    """Print the tables: equations and cost, and steps."""
    sys.path.insert(0, str(Path(__file__).parent.parent / "validation"))
    from scenes import ground_resonance as build

    found = [["rotor", *HEAD], ["---"] * (len(HEAD) + 1)]
    for free in (False, True):
        found += [["free" if free else "driven", *(format(row[column], spec) for column, spec in COLUMNS.items())]
                  for row in rows(build, free)]
    for columns in (slice(4, STEPS), slice(STEPS, None)):
        print(*("| " + " | ".join([*row[:4], *row[columns]]) + " |" for row in found), "", sep="\n")


if __name__ == "__main__":
    main()
