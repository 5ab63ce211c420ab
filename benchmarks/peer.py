"""Rigid and soft scenes beside exudyn: CPU at equal measured error, in the same run.

    python benchmarks/peer.py [SCENE ...] [--exudyn PYTHON] [--kernels] [--repeats N]

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
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import sympy

import mbdae as mb
from mbdae.compare.equations import Equations
from mbdae.results.result import Accuracy, Result, RunInfo
from mbdae.system.prepare import Prepared, prepare

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "validation"), str(HERE.parent / "examples")]
import andrews_squeezer
from recursive_joints import table
from scenes import ground_resonance, heavy_top

LEVELS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LONGEST = 2.0  #: CPU s of one run after which a ladder ends
HANGS = 90.0  #: s of wall time after which a method of exudyn is given up
ENOUGH = 1e-9  #: error after which a ladder of mbdae ends
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
            for solver in linear for radius in (0.6, 0.9)]  # fmt: skip


def tree(scene: str, solver: str = "DOPRI5") -> dict[str, Any]:
    """A kinematic tree of exudyn with an explicit method."""
    return {"name": f"kinematic tree, {solver}", "scene": scene, "solver": solver, "tolerances": [10.0**-k for k in range(4, 13)]}


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
                   [*found, tree("chain tree")], bodies)  # fmt: skip


def andrews_problem() -> Problem:
    scene = andrews_squeezer.scene()
    listed = list(scene.bodies)
    index = {b: i for i, b in enumerate(listed)}
    hinges = [(index.get(c.k, -1), index.get(c.l, -1), c.joint.at[:2].tolist()) for c in scene.joints]
    (spring,) = [c for c in scene.connections if c.kind == "spring"]
    law = spring.laws[0]
    springs = [{"k": index.get(spring.k, -1), "l": index.get(spring.l, -1), "at_k": law.at[:2].tolist(), "at_l": law.at_l[:2].tolist(),
                "stiffness": andrews_squeezer.STIFFNESS, "length": andrews_squeezer.NATURAL}]  # fmt: skip
    given = [{"mass": float(b.mass), "inertia": float(b.inertia[2, 2]), "at": b.position[:2].tolist(), "angle": 0.0} for b in listed]
    options = {"bodies": given, "hinges": hinges, "springs": springs, "torques": [[0, andrews_squeezer.TORQUE]]}

    def places(r: Result) -> list[Any]:
        return [r[b.name].position for b in listed]

    return Problem(lambda _: andrews_squeezer.scene(), 0.03, 0.1, {"scene": "linkage", "options": options}, alpha(3e-4, 8), places,
                   models=(None,))  # fmt: skip


def rotor_problem() -> Problem:
    blades = [(tuple(0.25 * d), tuple(4.5 * d)) for d in (np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)]) for i in range(4))]
    turn = np.array([[np.cos(0.01), -np.sin(0.01)], [np.sin(0.01), np.cos(0.01)]])
    root = np.array(blades[0][0])
    blades[0] = (tuple(root), tuple(root + turn @ (np.array(blades[0][1]) - root)))
    options = {"omega": 20.01, "block": 30.0, "inertia": 1.0, "stiffness": 12000.0, "damping": 150.0, "mass": 12.75,
               "blades": [[list(map(float, end)) for end in blade] for blade in blades]}  # fmt: skip
    names = ["hub", *(f"blade{i + 1}" for i in range(4))]
    return Problem(lambda model: ground_resonance(2, True, "auto", model), 2.0, 4.5, {"scene": "ground resonance", "options": options},
                   alpha(1e-2, 7), lambda r: [r[name].position for name in names])  # fmt: skip


def top_problem() -> Problem:
    options = {"mass": 15.0, "inertia": [0.234375, 0.46875, 0.234375], "at": [0, 1, 0], "spin": [0, 150, -4.61538]}
    methods = [*alpha(1e-3, 7), *alpha(1e-3, 7, rotation="lie group"), tree("top tree")]
    return Problem(lambda _: heavy_top(), 1.0, 1.0, {"scene": "heavy top", "options": options}, methods, bodies, models=(None,))


SECTION = {"EA": 1e4, "GA": 1e4, "EI": 500.0, "mass_per_length": 1.0, "rotary_inertia": 10.0}
BEAM, ELEMENTS, PULSE, PUSH, TWIST = 10.0, 10, 2.5, 8.0, -80.0  # m, -, s, N, N m


def flying_beam(_: Any = None, elements: int = ELEMENTS) -> mb.Scene:
    """A free beam with smooth pulses of force and torque at its end."""
    on = sympy.Piecewise((sympy.sin(sympy.pi * mb.t / PULSE) ** 4, mb.t < PULSE), (0, True))
    s = mb.Scene("flying beam")
    section = mb.Section(EA=SECTION["EA"], GA2=SECTION["GA"], GA3=SECTION["GA"], GJ=500.0, EI2=500.0, EI3=SECTION["EI"],
                         mass_per_length=1.0, rotary_inertia=SECTION["rotary_inertia"])  # fmt: skip
    beam = s.beam("beam", (0, 0), (BEAM, 0), section=section, elements=elements, order=1)
    s.force("push", beam, (PUSH * on, 0, 0), at=(0, 0))
    s.torque("twist", beam.at((0, 0)), (0, 0, TWIST * on))
    return s


def beam_problem() -> Problem:
    options = {"n": ELEMENTS, "length": BEAM, "force": PUSH, "torque": TWIST, "pulse": PULSE, "section": SECTION}

    def places(r: Result) -> list[Any]:
        return [r["beam"].at(i / ELEMENTS).position for i in range(ELEMENTS + 1)]

    waves = [Ladder(f"RadauIIA({s}), waves", lambda v, s=s: mb.RadauIIA(s, rtol=v), tolerances(2, 8), mb.ODE(waves=True)) for s in (2, 3)]
    return Problem(flying_beam, 5.0, BEAM, {"scene": "flying beam", "options": options}, alpha(5e-2, 7), places, models=(None,),
                   stiff=True, more=waves)  # fmt: skip


def tolerances(first: int, last: int) -> list[float]:
    """10^-first ... 10^-last in steps of 10^(1/2)."""
    return [10.0 ** (-k / 2) for k in range(2 * first, 2 * last + 1)]


PROBLEMS: dict[str, Callable[[], Problem]] = {
    **{f"planar-{n}": lambda n=n: chain_problem(n, 1.0, False) for n in (1, 4, 16, 64)},
    **{f"spatial-{n}": lambda n=n: chain_problem(n, 1.0, True) for n in (1, 4)},
    "spatial-10": lambda: chain_problem(10, 0.1, True), "short-planar-10": lambda: chain_problem(10, 0.1, False),
    "andrews": andrews_problem, "rotor": rotor_problem, "top": top_problem, "flying-beam": beam_problem,
}  # fmt: skip


# -- mbdae


def ladders(problem: Problem) -> Iterator[Ladder]:
    """Every method of mbdae that suits a scene."""
    for model in problem.models:
        name = f", {type(model).__name__.lower()}" if model is not None else ""
        yield Ladder("IDA" + name, lambda v: mb.IDA(rtol=v), tolerances(3, 12), model=model)
        yield Ladder("RadauIIA(3)" + name, lambda v: mb.RadauIIA(3, rtol=v), tolerances(2, 10), model=model)
        yield Ladder("CVODE (Adams)" + name, lambda v: mb.CVODE(rtol=v), tolerances(4, 12), model=model)
        if hasattr(mb, "Index1") and not isinstance(model, mb.Recursive):
            yield Ladder("CVODE (Adams), index 1" + name, lambda v: mb.CVODE(rtol=v), tolerances(4, 12), mb.Index1(), model)
    yield from problem.more


def cpu(solve: Callable[[], Any]) -> tuple[Any, float]:
    """A solution and its CPU s, the smallest of several runs."""
    seconds: list[float] = []
    while len(seconds) < (2 if not seconds or min(seconds) > 0.1 else 5):
        begin = time.process_time()
        solution = solve()
        seconds.append(time.process_time() - begin)
        if seconds[-1] > 0.3:
            break
    return solution, min(seconds)


def read(prepared: Prepared, solution: Any, problem: Problem, times: Any) -> np.ndarray:
    """(places, nt, 3) positions at some times, m."""
    result = Result(prepared, solution, RunInfo(solution.solver, "", Accuracy(None, None), solution.stats), np.asarray(times))
    return np.array(problem.places(result))


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
        self.doubt = self.error(read(self.equations.prepared, again, problem, times), times)

    def error(self, positions: np.ndarray, times: Any) -> float:
        """Largest distance of any place, over the scene's length."""
        times = np.clip(times, 0, self.problem.t_end)
        mine = read(self.equations.prepared, self.solution, self.problem, times)
        return float(np.max(np.linalg.norm(positions - mine, axis=2)) / self.problem.length)


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
                solution, seconds = cpu(lambda: solver.solve(system, problem.t_end, max_residuals=300000))
            except mb.OptionError:
                break
            except mb.MbdaeError as error:
                yield {"program": "mbdae", "method": ladder.label, "value": value, "error": float("nan"), "failed": str(error)[:60]}
                continue
            stats = solution.stats
            error = reference.error(read(equations.prepared, solution, problem, times), times)
            yield {"program": "mbdae", "method": ladder.label, "value": value, "error": error, "cpu_s": seconds,
                   "steps": stats.steps, "residuals": stats.residuals}  # fmt: skip
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
                subprocess.run(command, check=True, timeout=HANGS, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder)
            except subprocess.SubprocessError as error:
                print(f"exudyn, {method['name']}: {type(error).__name__}")
                continue
            runs = json.loads(out.read_text())["methods"][0]["runs"]
        for r in runs:
            row = {"program": "exudyn", "method": method["name"], "value": r["value"], "cpu_s": r["cpu_s"]}
            yield row | ({"error": float("nan"), "failed": r["failed"][:60]} if "failed" in r
                         else {"error": reference.error(np.array(r["positions"]), r["t"]), "steps": "", "residuals": ""})  # fmt: skip


# -- comparison


def at_level(rows: Sequence[Row], level: float) -> float:
    """Smallest CPU s that reaches an error: along every method's runs, sorted by cost, between the last run above the level and
    the first below (log-log); the loosest run where that is below already; nan where no run is."""
    best = float("nan")
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
              ("program", "method", "value", "error", "cpu_s", "steps", "residuals", "failed"))  # fmt: skip
    ours, peers = ([r for r in rows if r["program"] == p] for p in ("mbdae", "exudyn"))
    for level in LEVELS:
        mine = by_method(ours, level)
        family = {"generalised-alpha": [r for r in peers if r["method"].startswith("gen")],
                  "kinematic tree": [r for r in peers if r["method"].startswith("kin")]}  # fmt: skip
        method, best = next(iter(mine.items()))
        row = {"scene": name, "error": f"{level:.0e}", "mbdae, ms": f"{1e3 * best:.1f}", "method": method}
        for label, runs in family.items():
            cost = at_level(runs, level) if runs else float("nan")
            row |= {f"{label}, ms": f"{1e3 * cost:.1f}", f"over {label}": f"{cost / best:.2f}"}
        yield row


HEAD = ("scene", "error", "mbdae, ms", "method", "generalised-alpha, ms", "over generalised-alpha", "kinematic tree, ms",
        "over kinematic tree")  # fmt: skip


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
