"""Flexible beams: accuracy asked and delivered, cost beside exudyn, cost against size, recursive beside kinematic joints.

    accuracy   error / asked, estimate and warnings on stiff scenes, 1e-3 to 1e-7, and IDA with an rtol of its own
    exudyn     slider-crank with a steel rod on the same mesh: CPU at equal measured error
    size       CPU per step and memory from 10 to 1000 elements
    joints     ground resonance with flexible blades: recursive beside kinematic joints at equal measured error

    python benchmarks/beams.py [accuracy] [exudyn] [size] [joints] [--exudyn PYTHON]

exudyn is looked for in the interpreter given by --exudyn or the environment variable EXUDYN_PYTHON. One thread, process time.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.results.control import motion_distance
from mbdae.system.prepare import Prepared, prepare

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "examples"), str(HERE.parent / "validation")]
from beam_scenes import slider_crank, steel_pendulum
from recursive_joints import cost

ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


def resolved(prepared: Prepared, t_end: float, rtol: float = 1e-8) -> Any:
    """The motion by Radau IIA with all elastic vibrations resolved."""
    form = replace(default_form(prepared), waves=True)  # type: ignore[type-var]
    return mb.RadauIIA(3, rtol=rtol).solve(system_for(prepared, form, 3), t_end)


# -- accuracy

SCENES: dict[str, tuple[Any, float]] = {
    "slider-crank, 8 linear": (lambda: slider_crank(8, 1), 0.1),
    "slider-crank, 8 quadratic": (lambda: slider_crank(8, 2), 0.1),
    "pendulum, slenderness 20": (lambda: steel_pendulum(20), 0.5),
    "pendulum, slenderness 100": (lambda: steel_pendulum(100), 0.5),
    "pendulum, slenderness 1000": (lambda: steel_pendulum(1000), 0.5),
}
HEAD = ("scene", "solver", "asked", "error / asked", "estimate / asked", "told", "runs", "steps", "CPU s")


def accuracies(names: Sequence[str], solvers: Sequence[Any], asked: Sequence[float] = ACCURACIES,
               max_wall: float = 60.0) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Error / asked at 2001 times for every scene and solver (None: the default); a solver with an rtol is run as it is."""
    for name in names:
        make, t_end = SCENES[name]
        scene, times = make(), np.linspace(0.0, t_end, 2001)
        prepared = prepare(scene, t_end=t_end)
        exact = resolved(prepared, t_end)(times)
        for solver in solvers:
            for accuracy in asked if solver is None or solver.rtol is None else (solver.rtol,):
                begin = time.process_time()
                row = {"scene": name, "solver": solver.label if solver else "default", "asked": f"{accuracy:.0e}"}
                try:
                    r = scene.simulate(t_end, accuracy, solver=solver, max_wall=max_wall)
                except mb.MbdaeError as error:
                    yield row | {"told": type(error).__name__, "CPU s": time.process_time() - begin}
                    continue
                states = [p.states(times, y)[:2] for p, y in ((r.prepared, r.solution(times)), (prepared, exact))]
                error = float(np.max(motion_distance(prepared, *states)))
                told = "warned" if r.warnings else ""
                if error > 10 * accuracy and not told:
                    told = "SILENT"
                yield row | {"error / asked": error / accuracy, "estimate / asked": (r.accuracy.estimated or np.nan) / accuracy,
                             "told": told, "runs": r.info.runs, "steps": r.stats.steps,
                             "CPU s": time.process_time() - begin}  # fmt: skip


# -- exudyn


def exudyn_runs(python: str, elements: int, steps: Sequence[float], modified: bool = True) -> list[dict[str, Any]]:
    """Runs of exudyn's generalised-alpha method on the same mesh."""
    from beam_scenes import CRANK, RATE, ROD, SLIDER, steel_rod

    section = steel_rod()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "runs.json"
        problem = {"crank": CRANK, "rod": ROD, "elements": elements, "rate": RATE, "block": SLIDER, "t_end": 0.1, "radius": 0.8,
                   "modified": modified, "output": str(output), "steps": list(steps),
                   "section": {"mass_per_length": section.mass_per_length, "rotary_inertia": section.rotary_inertia[2],
                               "EI": section.EI3, "EA": section.EA, "GA": section.GA2}}  # fmt: skip
        command = [python, "-W", "ignore", str(HERE / "exudyn_slider_crank.py"), json.dumps(problem)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        found: list[dict[str, Any]] = json.loads(output.read_text())["runs"]
    return found


class Rod:
    """Errors of the rod's nodes (m over the scene's length) against a resolved run on the same mesh."""

    def __init__(self, elements: int, order: int, rtol: float = 1e-8) -> None:
        self.prepared = prepare(slider_crank(elements, order), t_end=0.1)
        self.exact = resolved(self.prepared, 0.1, rtol)
        line = self.prepared.model.lines[0]
        self.at = line.places("q")[:, :, :2]
        nodes = [line.nodes.index(n) for n in line.nodes]
        self.columns = np.array([[line.nodes[i].q, line.nodes[i].q + 1] for i in nodes])

    def nodes(self, t: Any, y: Any) -> np.ndarray:
        """(nt, nodes, 2) m."""
        return np.asarray(self.prepared.states(t, y)[0][:, self.columns])

    def error(self, t: Any, nodes: np.ndarray) -> float:
        """Largest distance of any node over the scene's length."""
        t = np.asarray(t)
        gap = np.linalg.norm(nodes - self.nodes(t, self.exact(t)), axis=2)
        return float(np.max(gap)) / self.prepared.length

    def own(self, solver: Any) -> tuple[float, float]:
        """Error at 101 times and CPU s of a run."""
        system = system_for(self.prepared, None, solver.highest_index)
        solution, seconds = cost(lambda: solver.solve(system, 0.1))
        t = np.linspace(0, 0.1, 101)
        return self.error(t, self.nodes(t, solution(t))), seconds

    def theirs(self, run: dict[str, Any]) -> float:
        """Error of a run of exudyn, at its own times."""
        moved = np.array(run["nodes"]).transpose(1, 0, 2)
        return self.error(run["t"], moved + self.nodes(np.zeros(1), self.exact(np.zeros(1))))


def beside_exudyn(python: str, elements: int, order: int) -> Iterator[dict[str, Any]]:
    """Error and CPU of both; exudyn's elements are linear: as many nodes."""
    rod = Rod(elements, order)
    theirs = rod if order == 1 else Rod(elements * order, 1)
    solvers = [mb.RadauIIA(3, step=h) for h in (2e-3, 1e-3, 5e-4, 2e-4)]
    solvers += [mb.RadauIIA(3, rtol=r) for r in (1e-4, 3e-5, 1e-5, 3e-6, 1e-6)]
    for solver in solvers:
        error, seconds = rod.own(solver)
        what = f"step {solver.step:g}" if solver.fixed else f"rtol {solver.rtol:g}"
        yield {"program": f"mbdae, {elements} of order {order}", "run": what, "error": error, "CPU s": seconds}
    steps = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6)
    for modified in (True, False):
        for run in exudyn_runs(python, elements * order, steps, modified):
            yield {"program": f"exudyn, {elements * order} linear", "run": f"step {run['h']:g}{'' if modified else ', full Newton'}",
                   "error": theirs.theirs(run) if "t" in run else "fails", "CPU s": run["cpu_s"]}  # fmt: skip


def cheapest(rows: Sequence[dict[str, Any]], program: str, error: float) -> float:
    """CPU s of the cheapest run at most that wrong; nan where there is none."""
    fit = [r["CPU s"] for r in rows if r["program"].startswith(program) and r["error"] != "fails" and r["error"] <= error]
    return min(fit, default=float("nan"))
