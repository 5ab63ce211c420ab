"""How the cost of a scene grows with its size: preparation, equations, steps and memory, with fitted exponents, beside exudyn.

    python benchmarks/scale.py [SCENE ...] [--sizes N ...] [--exudyn PYTHON]

Scenes: planar (a chain of rods), spatial (a chain with hinges about two axes in turn), tree (every rod carries three), grid
(squares of hinged bars, N of them along each side), beam (a cantilever of N elements), contacts (N pendulums on pins with
play). All joints are kinematic. Every size runs in a process of its own: CPU s of the statements, of `prepare`, of the equations
with their first steps (orders of elimination are looked for there), and of a run by RadauIIA(3) at rtol 1e-6 with 201 outputs,
the least of three, per step and body; Newton iterations per step; peak of the memory of the process after one such run, that of
Python with mbdae alone about 100 MB. An exponent is the slope of log cost over log bodies, without the smallest size where there
are more than two.

exudyn runs the planar scenes with 20 steps of generalised-alpha and its sparse linear solver (EigenSparse), with a
factorisation in every Newton iteration; it is looked for in the interpreter given by --exudyn or the environment variable
EXUDYN_PYTHON.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare

HERE = Path(__file__).parent
GRAVITY = (0.0, -9.81, 0.0)
KEPT = mb.Kinematic()
RUNS = 3  #: of which the least CPU counts
Rod = tuple[tuple[float, float], tuple[float, float]]
Hinge = tuple[int, int, tuple[float, float]]  #: numbers of two rods (-1: ground), point
Row = dict[str, Any]


# -- planar scenes as data, for both programs


def chain_data(n: int) -> tuple[list[Rod], list[Hinge]]:
    """Rods of 1 m, released horizontally."""
    return [((i, 0.0), (i + 1.0, 0.0)) for i in range(n)], [(i - 1, i, (float(i), 0.0)) for i in range(n)]


def tree_data(n: int) -> tuple[list[Rod], list[Hinge]]:
    """Rods of 1 m, each of which carries three."""
    rods: list[Rod] = []
    hinges: list[Hinge] = []
    angles: list[float] = []
    for i in range(n):
        parent = (i - 1) // 3
        at, angle = (rods[parent][1], angles[parent] + 0.5 * ((i - 1) % 3 - 1)) if i else ((0.0, 0.0), 0.3)
        rods.append((at, (at[0] + math.sin(angle), at[1] - math.cos(angle))))
        angles.append(angle)
        hinges.append((parent if i else -1, i, at))
    return rods, hinges


def grid_data(n: int) -> tuple[list[Rod], list[Hinge]]:
    """n x n squares of bars, a square metre together, that hang from a corner; loops everywhere."""
    h = 1.0 / n
    rods: list[Rod] = []
    ends: dict[tuple[int, int], list[int]] = {(0, 0): [-1]}
    for i in range(n + 1):
        for j in range(n + 1):
            for di, dj in ((1, 0), (0, 1)):
                if i + di <= n and j + dj <= n:
                    rods.append(((i * h, -j * h), ((i + di) * h, -(j + dj) * h)))
                    for end in ((i, j), (i + di, j + dj)):
                        ends.setdefault(end, []).append(len(rods) - 1)
    return rods, [(first, other, (i * h, -j * h)) for (i, j), (first, *others) in ends.items() for other in others]


PLANAR = {"planar": chain_data, "tree": tree_data, "grid": grid_data}


def planar(name: str, n: int) -> mb.Scene:
    """The scene of such data."""
    s, (rods, hinges) = mb.Scene(name, gravity=GRAVITY), PLANAR[name](n)
    bodies = [s.link(f"b{i}", *ends, mass=1.0) for i, ends in enumerate(rods)]
    for i, (k, l, at) in enumerate(hinges):
        s.revolute(f"j{i}", s.ground if k < 0 else bodies[k], bodies[l], at=at, model=KEPT)
    return s


def spatial(n: int) -> mb.Scene:
    """A chain with hinges about y and z in turn."""
    s = mb.Scene("spatial", gravity=(0, 0, -9.81))
    before = s.ground
    for i in range(n):
        body = s.rigid_body(f"b{i}", 1.0, (0.01, 0.1, 0.1), at=(i + 0.5, 0, 0))
        s.revolute(f"j{i}", before, body, at=(i, 0, 0), axis=(0, 0, 1) if i % 2 else (0, 1, 0), model=KEPT)
        before = body
    return s


def beam(n: int) -> mb.Scene:
    """A cantilever of 1 m that falls by its weight."""
    s = mb.Scene("beam", gravity=GRAVITY)
    section = mb.Section.rectangular(0.02, 0.02, E=1e9, nu=0.3, rho=1000.0)
    line = s.beam("b", (0, 0), (1, 0), section=section, elements=n, order=1)
    s.weld("w", s.ground, line, at=(0, 0))
    return s


def contacts(n: int) -> mb.Scene:
    """Pendulums of 0.5 m on pins of 10 mm with 1 mm of play."""
    s = mb.Scene("contacts", gravity=GRAVITY)
    for i in range(n):
        body = s.link(f"b{i}", (2 * i, 0), (2 * i + 0.5, 0), mass=1.0)
        model = mb.Clearance(outer=0.011, inner=0.01, normal=mb.Hertz(1e9, 0.1))
        s.revolute(f"j{i}", s.ground, body, at=(2 * i, 0), model=model)
    return s


#: sizes and end of the run (s)
SIZES: dict[str, tuple[tuple[int, ...], float]] = {
    "planar": ((100, 250, 500, 1000, 2000), 2.0), "spatial": ((100, 250, 500, 1000, 2000), 2.0),
    "tree": ((100, 250, 500, 1000, 2000), 1.0), "grid": ((7, 11, 16, 22, 30), 0.1), "beam": ((100, 250, 500, 1000, 2000), 0.01),
    "contacts": ((10, 25, 50, 100, 200), 0.03),
}


def scene(name: str, n: int) -> mb.Scene:
    """A scene by its name and size."""
    made = {"spatial": spatial, "beam": beam, "contacts": contacts}.get(name)
    return made(n) if made is not None else planar(name, n)


# -- one size


def case(name: str, n: int, t_end: float) -> Row:
    """Cost of one scene in this process."""
    warnings.simplefilter("ignore")
    prepare(scene(name, 2))  # laws are derived and compiled
    clock = [time.process_time()]

    def lap() -> float:
        clock.append(time.process_time())
        return clock[-1] - clock[-2]

    s = scene(name, n)
    row: Row = {"scene": name, "size": n, "bodies": n if name == "beam" else len(s.bodies), "state, s": lap()}
    prepared = prepare(s)
    row["prepare, s"] = lap()
    solver = mb.RadauIIA(3, rtol=1e-6)
    system = system_for(prepared, mb.GGL() if prepared.rows else mb.ODE())
    solver.solve(system, 1e-3 * t_end)
    row |= {"unknowns": system.n, "begin, s": lap()}
    run = solver.solve(system, t_end, outputs=201)
    cpu, steps = [lap()], run.stats.steps
    row |= {"steps": steps, "iterations": run.stats.newton_iterations / steps,
            "memory, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}
    del run
    for _ in range(RUNS - 1):
        solver.solve(system, t_end, outputs=201)
        cpu.append(lap())
    return row | {"step, ms": 1e3 * min(cpu) / steps, "per body, us": 1e6 * min(cpu) / steps / row["bodies"]}


def alone(name: str, n: int, t_end: float) -> Row:
    """The same in a process of its own."""
    command = [sys.executable, __file__, "--case", json.dumps([name, n, t_end])]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    row: Row = json.loads(found.stdout.splitlines()[-1])
    return row


def theirs(name: str, n: int, t_end: float, python: str) -> float:
    """ms of a step of exudyn; nan where it fails."""
    rods, hinges = PLANAR[name](n)
    bodies = []
    for (x, y), (a, b) in rods:
        length = math.hypot(a - x, b - y)
        bodies.append({"mass": 1.0, "inertia": length**2 / 12, "at": [(x + a) / 2, (y + b) / 2],
                       "angle": math.atan2(b - y, a - x)})
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "in.json", Path(folder) / "out.json"
        options = {"bodies": bodies, "hinges": hinges, "springs": [], "torques": [], "gravity": 9.81}
        method = {"name": "generalised-alpha", "steps": [t_end / 20], "linear": "EigenSparse", "modified": False}
        given.write_text(json.dumps({"scene": "linkage", "options": options, "t_end": t_end, "methods": [method],
                                     "longest": 1.0, "output": str(out)}))
        try:
            subprocess.run([python, "-W", "ignore", str(HERE / "exudyn_scenes.py"), f"@{given}"], check=True, timeout=300,
                           capture_output=True, cwd=folder)
            (run,) = json.loads(out.read_text())["methods"][0]["runs"]
        except (subprocess.SubprocessError, OSError) as error:
            print(f"exudyn, {name} of {n}: {error}")
            return math.nan
        return math.nan if "failed" in run else 1e3 * float(run["cpu_s"]) / 20


# -- tables


def exponent(rows: list[Row], column: str) -> float:
    """Slope of log cost over log bodies."""
    used = rows[1:] if len(rows) > 2 else rows
    return float(np.polyfit(np.log([r["bodies"] for r in used]), np.log([r[column] for r in used]), 1)[0])


COLUMNS = ("size", "bodies", "unknowns", "state, s", "prepare, s", "begin, s", "steps", "iterations", "step, ms", "per body, us",
           "memory, MB", "exudyn, ms")


def table(rows: list[Row]) -> Iterator[str]:
    """The rows of one scene and their exponents."""
    yield " | ".join(COLUMNS)
    for row in rows:
        yield " | ".join(f"{row[c]:.3g}" if isinstance(row.get(c), float) else str(row.get(c, "")) for c in COLUMNS)
    if len(rows) > 1:
        fitted = {c: exponent(rows, c) for c in ("state, s", "prepare, s", "begin, s", "step, ms")}
        yield "exponents: " + ", ".join(f"{c.split(',')[0]} {value:.2f}" for c, value in fitted.items())
        per_body = [r["per body, us"] for r in rows]
        yield f"cost of a step per body, largest over smallest: {max(per_body) / min(per_body):.2f}"


def main() -> None:
    """Print the tables asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SIZES))
    parser.add_argument("--sizes", nargs="*", type=int, default=None)
    parser.add_argument("--exudyn", default=os.environ.get("EXUDYN_PYTHON"), metavar="PYTHON")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.case:
        print(json.dumps(case(*json.loads(given.case))))
        return
    for name in given.scenes or SIZES:
        sizes, t_end = SIZES[name]
        rows = [alone(name, n, t_end) for n in given.sizes or sizes]
        for row in rows if given.exudyn and name in PLANAR else ():
            row["exudyn, ms"] = theirs(name, row["size"], t_end, given.exudyn)
        print(f"\n{name}", *table(rows), sep="\n", flush=True)


if __name__ == "__main__":
    main()
