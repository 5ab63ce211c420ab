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

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.sampling import motion_distance

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "examples"), str(HERE.parent / "validation")]
from beam_scenes import CRANK, RATE, ROD, SLIDER, flexible_rotor, slider_crank, steel_pendulum, steel_rod
from recursive_joints import cost, read, table

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
               max_wall: float = 200.0) -> Iterator[dict[str, Any]]:
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
                             "CPU s": time.process_time() - begin}


# -- exudyn


def exudyn_runs(python: str, elements: int, steps: Sequence[float], modified: bool = True) -> list[dict[str, Any]]:
    """Runs of exudyn's generalised-alpha method on the same mesh."""
    section = steel_rod()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "runs.json"
        problem = {"crank": CRANK, "rod": ROD, "elements": elements, "rate": RATE, "block": SLIDER, "t_end": 0.1, "radius": 0.8,
                   "modified": modified, "output": str(output), "steps": list(steps),
                   "section": {"mass_per_length": section.mass_per_length, "rotary_inertia": section.rotary_inertia[2],
                               "EI": section.EI3, "EA": section.EA, "GA": section.GA2}}
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
    solvers = [mb.RadauIIA(3, step=h, newton=1e-7) for h in (2e-3, 1.8e-3, 1e-3, 5e-4, 1.9e-4, 1.5e-4)]
    solvers += [mb.RadauIIA(3, rtol=r) for r in (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 5e-7)]
    for solver in solvers:
        error, seconds = rod.own(solver)
        what = f"step {solver.step:g}" if solver.fixed else f"rtol {solver.rtol:g}"
        yield {"program": f"mbdae, {elements} of order {order}", "run": what, "error": error, "CPU s": seconds}
    steps = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6)
    for modified in (True, False):
        for run in exudyn_runs(python, elements * order, steps, modified):
            what = f"step {run['h']:g}{'' if modified else ', full Newton'}"
            yield {"program": f"exudyn, {elements * order} linear", "run": what,
                   "error": theirs.theirs(run) if "t" in run else "fails", "CPU s": run["cpu_s"]}


def cheapest(rows: Sequence[dict[str, Any]], program: str, error: float) -> tuple[float, float]:
    """CPU s at most that wrong: of the cheapest run, and of the cheapest from which on every finer run is; nan: none."""
    runs = [r for r in rows if r["program"].startswith(program) and "," not in r["run"] and r["error"] != "fails"]
    lucky = min((r["CPU s"] for r in runs if r["error"] <= error), default=float("nan"))
    families = {r["run"].split()[0] for r in runs}
    lasting = [_lasting([r for r in runs if r["run"].startswith(family)], error) for family in families]
    return lucky, min((seconds for seconds in lasting if seconds == seconds), default=float("nan"))


def _lasting(runs: Sequence[dict[str, Any]], error: float) -> float:
    """CPU s of the first run, from loose to tight, from which on all are at most that wrong; between two runs log-log."""
    for k in reversed(range(len(runs))):
        if runs[k]["error"] > error:
            if k + 1 == len(runs):
                return float("nan")
            a, b = runs[k], runs[k + 1]
            share = np.log(a["error"] / error) / np.log(a["error"] / b["error"])
            return float(a["CPU s"] * (b["CPU s"] / a["CPU s"]) ** share)
    return float(runs[0]["CPU s"])


# -- size

SIZES = (10, 30, 100, 300, 1000)


def sizes(space: str) -> Iterator[dict[str, Any]]:
    """CPU per step of RadauIIA(3) at 20 ms of the slender pendulum of linear elements, and memory."""
    before: tuple[int, float] | None = None
    for n in SIZES:
        s = mb.Scene("pendulum", gravity=(0, -9.81, 0), space=space)
        s.revolute("A", s.ground, s.beam("rod", (0, 0), (1, 0), section=steel_rod(), elements=n, order=1), at=(0, 0))
        begin = time.process_time()
        system = system_for(prepare(s), None, 3)
        ready = time.process_time() - begin
        solver = mb.RadauIIA(3, step=0.02)
        solver.solve(system, 0.02)
        solution, seconds = cost(lambda solver=solver, system=system: solver.solve(system, 0.4))
        per_step = seconds / solution.stats.steps
        grows = np.log(per_step / before[1]) / np.log(n / before[0]) if before else float("nan")
        before = n, per_step
        yield {"space": space, "elements": n, "unknowns": system.n, "to prepare, s": ready, "CPU ms / step": 1e3 * per_step,
               "Newton / step": solution.stats.newton_iterations / solution.stats.steps, "exponent": grows,
               "memory, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3}


# -- joints


def joints(space: str, free: bool, t_end: float = 0.5) -> Iterator[dict[str, Any]]:
    """Largest error of the lag angles (rad) and CPU s, all five revolutes recursive or kinematic, at equal steps or rtol."""
    exact, times = None, np.linspace(0.0, t_end, 101)
    solvers = [mb.RadauIIA(2, step=2e-3), mb.RadauIIA(2, step=1e-3), mb.RadauIIA(3, step=2e-3), mb.RadauIIA(3, rtol=1e-5),
               mb.RadauIIA(3, rtol=1e-6), mb.IDA(rtol=1e-6, max_order=2)]
    found: dict[str, list[tuple[float, float]]] = {}
    for model in (mb.Recursive(), mb.Kinematic()):
        prepared = prepare(flexible_rotor(1, free, space, model, 0.01))
        if exact is None:
            exact = _lags(prepared, resolved(prepared, t_end, 1e-6), times)
        for solver in solvers:
            system = system_for(prepared, None, solver.highest_index)
            solution, seconds = cost(lambda solver=solver, system=system: solver.solve(system, t_end))
            error = float(np.max(np.abs(_lags(prepared, solution, times) - exact)))
            what = f"{solver.label}, step {solver.step:g}" if solver.fixed else f"{solver.label}, rtol {solver.rtol:g}"
            found.setdefault(what, []).append((error, seconds))
    for what, ((error, seconds), (other_error, other)) in found.items():
        yield {"scene": f"{space}, speed {'free' if free else 'prescribed'}", "solver": what, "error": error, "CPU s": seconds,
               "kinematic: error": other_error, "kinematic: CPU s": other, "recursive / kinematic": seconds / other}


def _lags(prepared: Prepared, solution: Any, times: np.ndarray) -> np.ndarray:
    """(4, nt) lag angles, rad."""
    result = read(prepared, solution, times)
    return np.array([result[f"lag {i + 1}"].angle for i in range(4)])


def main() -> None:
    """Print the tables asked for, all without a name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", default=["accuracy", "exudyn", "size", "joints"])
    parser.add_argument("--exudyn", default=os.environ.get("EXUDYN_PYTHON", ""))
    given = parser.parse_args()
    warnings.simplefilter("ignore", mb.AccuracyWarning)
    if "accuracy" in given.tables:
        table(accuracies(list(SCENES), [None]), HEAD)
        table(accuracies(list(SCENES), [mb.IDA(), mb.IDA(max_order=2), mb.RadauIIA(2)], (1e-3, 1e-4), 20.0), HEAD)
    if "exudyn" in given.tables and not given.exudyn:
        print("exudyn: give --exudyn or EXUDYN_PYTHON, an interpreter that has it")
    for elements, order in ((8, 1), (8, 2)) if "exudyn" in given.tables and given.exudyn else ():
        rows = list(beside_exudyn(given.exudyn, elements, order))
        table(rows, ("program", "run", "error", "CPU s"))
        compared = [{"error": e, "mbdae": cheapest(rows, "mbdae", e), "exudyn": cheapest(rows, "exudyn", e)}
                    for e in (4e-5, 7e-5, 9.5e-5, 1.3e-4, 4e-4)]
        table([{k: v if k == "error" else ", ".join(f"{x:.3f}" for x in v) for k, v in row.items()} for row in compared],
              ("error", "mbdae", "exudyn"))
    if "size" in given.tables:
        table((row for space in ("planar", "spatial") for row in sizes(space)), tuple(next(sizes("planar"))))
    if "joints" in given.tables:
        rows = (row for space in ("planar", "spatial") for free in (False, True) for row in joints(space, free))
        table(rows, ("scene", "solver", "error", "CPU s", "kinematic: error", "kinematic: CPU s", "recursive / kinematic"))


if __name__ == "__main__":
    main()
