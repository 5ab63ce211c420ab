"""Rigid and soft scenes beside exudyn: CPU at equal measured error, in the same run.

    python benchmarks/peer.py [SCENE ...] [--exudyn PYTHON] [--list] [--verbose]

Scenes: planar chains of 1, 4, 16 and 64 rods, spatial chains of 1, 4 and 10, Andrews' mechanism, ground resonance, the heavy
top, a flying beam; their names are printed with --list. The error of a run is the largest distance of a centre of mass (or a
node of the beam) from the reference at exudyn's own output times, over the size of the scene. Every method of either program
runs over a ladder of steps or tolerances; at each level its cost is interpolated between runs (log-log), and the cheapest
method of exudyn is compared with the cheapest of mbdae. One thread, process time of the solver alone, smallest of several
runs; both programs have built and compiled their equations before.

exudyn is looked for in the interpreter given by --exudyn or the environment variable EXUDYN_PYTHON.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import argparse
import json
import math
import subprocess
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.compare.run import Equations
from mbdae.system.prepare import Prepared, prepare

HERE = Path(__file__).parent
from peer_scenes import PROBLEMS, Ladder, Problem
from recursive_joints import cost, read, table, tolerances

LEVELS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LONGEST = 2.0  #: CPU s of one run after which a ladder ends
HANGS = 90.0  #: s of wall time after which a method of exudyn is given up
ENOUGH = 1e-9  #: error after which a ladder of mbdae ends


# -- mbdae


def ladders(problem: Problem) -> Iterator[Ladder]:
    """Every method of mbdae that suits a scene."""
    for model in problem.models:
        name = f", {type(model).__name__.lower()}" if model is not None else ""
        yield Ladder("IDA" + name, lambda v: mb.IDA(rtol=v), tolerances(3, 12), model=model)
        yield Ladder("RadauIIA(3)" + name, lambda v: mb.RadauIIA(3, rtol=v), tolerances(2, 10), model=model)
        yield Ladder("CVODE (Adams)" + name, lambda v: mb.CVODE(rtol=v), tolerances(4, 12), model=model)
        yield Ladder("DOP853" + name, lambda v: mb.DOP853(rtol=v), tolerances(2, 12), model=model)
        if not isinstance(model, mb.Recursive):
            yield Ladder("DOP853, index 1" + name, lambda v: mb.DOP853(rtol=v), tolerances(2, 12), mb.Index1(), model)
            yield Ladder("CVODE (Adams), index 1" + name, lambda v: mb.CVODE(rtol=v), tolerances(4, 12), mb.Index1(), model)
    yield from problem.more


def positions(prepared: Prepared, solution: Any, problem: Problem, times: Any) -> np.ndarray:
    """(places, nt, 3) m at some times."""
    return np.array(problem.places(read(prepared, solution, np.asarray(times))))


class Reference:
    """The tightest Radau run, and what a second method says of it."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.equations = problem, Equations(prepare(problem.scene(None)))
        form = mb.ODE(waves=True) if problem.stiff else None
        solver, second = (mb.RadauIIA(3, rtol=r) for r in (3e-12, 1e-11))
        system = self.equations.for_solver(form, solver)
        self.solution = solver.solve(system, problem.t_end)
        other: Any = second if problem.stiff else mb.IDA(rtol=1e-12)
        again = other.solve(self.equations.for_solver(form, other), problem.t_end)
        times = np.linspace(0, problem.t_end, 101)
        self.doubt = self.error(positions(self.equations.prepared, again, problem, times), times)

    def error(self, found: np.ndarray, times: Any) -> float:
        """Largest distance of any place, over the scene's length."""
        times = np.clip(times, 0, self.problem.t_end)
        mine = positions(self.equations.prepared, self.solution, self.problem, times)
        return float(np.max(np.linalg.norm(found - mine, axis=2)) / self.problem.length)


Row = dict[str, Any]


def own(problem: Problem, reference: Reference) -> Iterator[Row]:
    """Error and CPU of every run of mbdae."""
    prepared: dict[Any, Equations] = {}
    times = np.linspace(0, problem.t_end, 101)
    for ladder in ladders(problem):
        equations = prepared.setdefault(ladder.model, Equations(prepare(problem.scene(ladder.model))))
        for value in ladder.values:
            solver = ladder.solver(value)
            try:
                system = equations.for_solver(ladder.form, solver)
                solver.check(system)
                solution, seconds = cost(partial(solver.solve, system, problem.t_end, max_residuals=300000))
            except mb.OptionError:
                break
            except mb.MbdaeError as error:
                yield {"program": "mbdae", "method": ladder.label, "value": value, "error": math.nan, "failed": str(error)[:60]}
                continue
            stats = solution.stats
            error = reference.error(positions(equations.prepared, solution, problem, times), times)
            yield {"program": "mbdae", "method": ladder.label, "value": value, "error": error, "cpu_s": seconds,
                   "steps": stats.steps, "residuals": stats.residuals}
            if seconds > LONGEST or error < ENOUGH:
                break


def theirs(problem: Problem, reference: Reference, python: str) -> Iterator[Row]:
    """Error and CPU of every run of exudyn; a method that hangs is left out and named."""
    for method in problem.methods:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out.json"
            given = problem.exudyn | {"t_end": problem.t_end, "methods": [method], "longest": LONGEST, "output": str(out)}
            command = [python, "-W", "ignore", str(HERE / "exudyn_scenes.py"), json.dumps(given)]
            try:
                subprocess.run(command, check=True, timeout=HANGS, capture_output=True, cwd=folder)
            except subprocess.SubprocessError as error:
                print(f"exudyn, {method['name']}: {type(error).__name__}")
                continue
            runs = json.loads(out.read_text())["methods"][0]["runs"]
        for r in runs:
            row = {"program": "exudyn", "method": method["name"], "value": r["value"], "cpu_s": r["cpu_s"]}
            if "failed" in r:
                yield row | {"error": math.nan, "failed": r["failed"][:60]}
            else:
                yield row | {"error": reference.error(np.array(r["positions"]), r["t"])}


# -- comparison


def at_level(rows: Sequence[Row], level: float) -> float:
    """Smallest CPU s that reaches an error: along every method's runs, sorted by cost, between the last run above the level and
    the first below (log-log); the loosest run where that is below already; nan where no run is."""
    best = math.nan
    for method in dict.fromkeys(r["method"] for r in rows):
        runs = sorted((r["cpu_s"], r["error"]) for r in rows if r["method"] == method and r["error"] == r["error"])
        before: tuple[float, float] | None = None
        for seconds, error in runs:
            if error <= level:
                share = np.log(before[1] / level) / np.log(before[1] / error) if before else 1.0
                cost = before[0] * (seconds / before[0]) ** share if before else seconds
                best = float(np.nanmin([best, cost]))
                break
            before = (seconds, error) if before is None or error < before[1] else before
    return best


def by_method(rows: Sequence[Row], level: float) -> dict[str, float]:
    """CPU s at a level by method, cheapest first."""
    found = {m: at_level([r for r in rows if r["method"] == m], level) for m in dict.fromkeys(r["method"] for r in rows)}
    return dict(sorted(found.items(), key=lambda item: (item[1] != item[1], item[1])))


def report(name: str, rows: Sequence[Row], verbose: bool) -> Iterator[Row]:
    """Cost of both programs at every level."""
    if verbose:
        table([r | {"error": f"{r['error']:.1e}", "cpu_s": f"{r.get('cpu_s', float('nan')):.4f}"} for r in rows],
              ("program", "method", "value", "error", "cpu_s", "steps", "residuals", "failed"))
    ours, peers = ([r for r in rows if r["program"] == p] for p in ("mbdae", "exudyn"))
    for level in LEVELS:
        mine = by_method(ours, level)
        family = {"generalised-alpha": [r for r in peers if r["method"].startswith("gen")],
                  "kinematic tree": [r for r in peers if r["method"].startswith("kin")]}
        method, best = next(iter(mine.items()))
        row = {"scene": name, "error": f"{level:.0e}", "mbdae, ms": f"{1e3 * best:.1f}", "method": method}
        for label, runs in family.items():
            cost = at_level(runs, level) if runs else math.nan
            row |= {f"{label}, ms": f"{1e3 * cost:.1f}", f"over {label}": f"{cost / best:.2f}"}
        yield row


HEAD = ("scene", "error", "mbdae, ms", "method", "generalised-alpha, ms", "over generalised-alpha", "kinematic tree, ms",
        "over kinematic tree")


def main() -> None:
    """Print the tables asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--exudyn", default=os.environ.get("EXUDYN_PYTHON"), metavar="PYTHON")
    parser.add_argument("--list", action="store_true", help="print the names of the scenes")
    parser.add_argument("--verbose", action="store_true", help="print every run")
    given = parser.parse_args()
    if given.list:
        print("\n".join(PROBLEMS))
        return
    warnings.simplefilter("ignore", mb.AccuracyWarning)
    if not given.exudyn:
        print("exudyn: give --exudyn or EXUDYN_PYTHON, an interpreter that has it")
    for name in given.scenes or PROBLEMS:
        problem = PROBLEMS[name]()
        reference = Reference(problem)
        print(f"\n{name}: reference confirmed to {reference.doubt:.1e}")
        rows = [*own(problem, reference), *(theirs(problem, reference, given.exudyn) if given.exudyn else ())]
        table(list(report(name, rows, given.verbose)), HEAD)


if __name__ == "__main__":
    main()
