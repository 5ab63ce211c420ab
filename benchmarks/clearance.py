"""Joints with clearance: cost beside exudyn, cost of friction, limit of small clearance and hard contact.

    exudyn     slider-crank with clearance, steel and dry friction, half a turn: CPU at equal measured error
    friction   tanh from v_c = 1 to 1e-6 m/s and LuGre: cost relative to no friction, soft and steel contact
    limit      clearance 1e-3 to 1e-8 m and none, stiffness 1e6 to 1e13 N/m^1.5: deviation from ideal joints, error, cost

    python benchmarks/clearance.py [exudyn] [friction] [limit] [--exudyn PYTHON]

exudyn is looked for in the interpreter given by --exudyn or the environment variable EXUDYN_PYTHON. One thread, process time
of the solver alone, the smallest of three runs.
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
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "validation")]
from clearance_scenes import CRANK, MASSES, PIN, ROD, limit, orbit, slider_crank, turn
from recursive_joints import table

REPEATS = 3
LEVEL = 3e-3  #: error at which CPU is compared

def show(rows: Iterable[Sequence[Any]], head: Sequence[str]) -> None:
    """A table, line by line as it is measured."""
    table((dict(zip(head, row, strict=True)) for row in rows), head)


# -- beside exudyn

RATE, CLEARANCE = 200.0, 5e-4  # rad/s, m
STEEL, DAMPING, MU, V_C = 6.61e10, 0.1, 0.1, 0.05  # N/m^1.5, s/m, 1, m/s
HALF = turn(RATE) / 2
STEPS = (1e-6, 5e-7, 2.5e-7, 1.25e-7, 6e-8)  # s


def peer() -> mb.Scene:
    """The slider-crank that exudyn solves too."""
    return slider_crank("B", CLEARANCE, RATE, normal=mb.Hertz(STEEL, DAMPING), friction=mb.Coulomb(MU, V_C))


def motion(r: mb.Result, t: Any) -> tuple[Any, Any]:
    """Slider (nt,) and pin in its race (nt, 2) at some times, m."""
    at = r(t)
    return at["slider"].position[:, 0], orbit(at, RATE)


def apart(a: tuple[Any, Any], b: tuple[Any, Any]) -> float:
    """Largest difference: slider over the crank's length, pin over the clearance."""
    return float(max(np.max(np.abs(a[0] - b[0])) / CRANK, np.max(np.linalg.norm(a[1] - b[1], axis=1)) / CLEARANCE))


def quickest(scene: mb.Scene, t_end: float, solver: Any) -> tuple[mb.Result, float]:
    """A run and the smallest CPU s of the solver in some repeats."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        runs = [scene.simulate(t_end, solver=solver) for _ in range(REPEATS)]
    return runs[0], min(r.stats.cpu_s for r in runs)


def with_exudyn(python: str) -> list[dict[str, Any]]:
    """Runs of exudyn with two spectral radii; modified Newton, three to four times cheaper here than the full one."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.json"
        problem = {"crank": CRANK, "rod": ROD, "rate": RATE, "masses": MASSES, "outer": PIN + CLEARANCE, "inner": PIN,
                   "stiffness": STEEL, "damping": DAMPING, "mu": MU, "v_c": V_C, "t_end": HALF, "newton": 1e-8,
                   "steps": STEPS, "radii": [0.6, 0.9], "modified": [True], "output": str(out)}
        script = str(HERE / "exudyn_clearance.py")
        subprocess.run([python, script, json.dumps(problem)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        runs: list[dict[str, Any]] = json.loads(out.read_text())["runs"]
    return runs


def at_level(rows: Sequence[tuple[float, float]]) -> float:
    """CPU s at an error of LEVEL from (error, CPU s), on a straight line in logarithmic axes: through the cheapest run that
    reaches it and the best one that does not, or the two best."""
    reached, missed = sorted(r[::-1] for r in rows if r[0] <= LEVEL), sorted(r for r in rows if r[0] > LEVEL)
    first, other = (reached[0][::-1], missed[0]) if reached and missed else sorted(rows)[:2]
    slope = np.log(first[1] / other[1]) / np.log(first[0] / other[0])
    return float(first[1] * (LEVEL / first[0]) ** slope)


def beside(python: str | None) -> None:
    """Error and CPU of every run, then the ratio of CPU at equal error."""
    scene = peer()
    best = scene.simulate(HALF, solver=mb.RadauIIA(3, rtol=1e-12))
    second = scene.simulate(HALF, solver=mb.RadauIIA(3, rtol=1e-11))
    times = np.linspace(0, HALF, 201)
    print(f"reference: rtol 1e-12, {len(best['B'].contacts)} contacts; rtol 1e-11 differs by "
          f"{apart(motion(second, times), motion(best, times)):.1e}\n")
    found: dict[str, list[tuple[float, float]]] = {}
    lines = []
    for solver in [mb.RadauIIA(3, rtol=r) for r in (1e-6, 1e-7, 1e-8, 1e-9)] + [mb.IDA(rtol=r) for r in (1e-8, 1e-9, 1e-10)]:
        r, cpu = quickest(scene, HALF, solver)
        error = apart(motion(r, times), motion(best, times))
        found.setdefault(solver.label, []).append((error, cpu))
        lines.append((solver.label, f"rtol {solver.rtol:.0e}", f"{error:.1e}", f"{cpu:.3f}", r.stats.steps))
    for run in with_exudyn(python) if python else []:
        name, step = f"exudyn, radius {run['radius']:g}", f"h = {run['h']:.3g} s"
        if "failed" in run:
            lines.append((name, step, "failed", f"{run['cpu_s']:.3f}", "-"))
            continue
        t = np.clip(run["t"], 0, HALF)
        error = apart((np.array(run["slider"]), np.array(run["pin"])), motion(best, t))
        found.setdefault(name, []).append((error, run["cpu_s"]))
        lines.append((name, step, f"{error:.1e}", f"{run['cpu_s']:.3f}", round(HALF / run["h"])))
    show(lines, ("solver", "tolerance or step", "error", "CPU s", "steps"))
    cpu = {name: at_level(rows) for name, rows in found.items()}
    theirs = min((c for name, c in cpu.items() if name.startswith("exudyn")), default=float("nan"))
    print(f"\nCPU s at error {LEVEL:g}: " + ", ".join(f"{name} {c:.3f}" for name, c in cpu.items()))
    print("exudyn over " + ", ".join(f"{n}: {theirs / cpu[n]:.1f}" for n in ("RadauIIA(3)", "IDA")) + "\n")


# -- friction

FRICTIONS: dict[str, Any] = {"none": None} | {f"tanh, v_c = {v:g} m/s": mb.Coulomb(0.1, v) for v in 10.0 ** -np.arange(7)} | {
    "LuGre, sigma1 = 31 s/m": mb.LuGre(0.1, 0.15, 1e-2, 1e4, 31.0),
    "LuGre, sigma1 = 0": mb.LuGre(0.1, 0.15, 1e-2, 1e4, 0.0)}


def frictions(stiffness: float, rtol: float) -> Iterator[tuple[Any, ...]]:
    """Cost of every friction law over a turn, relative to none: evaluations and CPU; what it dissipates."""
    base: dict[str, tuple[int, float]] = {}
    for name, law in FRICTIONS.items():
        row: list[Any] = [name]
        for solver in (mb.RadauIIA(3, rtol=rtol), mb.IDA(rtol=rtol)):
            scene = slider_crank("B", normal=mb.Hertz(stiffness, 0.5), friction=law)
            try:
                r, cpu = quickest(scene, turn(), solver)
            except mb.errors.MbdaeError as error:
                row += ["refused" if isinstance(error, mb.errors.OptionError) else "stopped", "-", "-"]
                continue
            work, first = base.setdefault(solver.label, (r.stats.residuals, cpu))
            row += [f"{r.stats.residuals / work:.2f}", f"{cpu / first:.2f}", f"{r.energy.friction[-1]:.4g}"]
        yield tuple(row)


# -- limit of ideal joints

CLEARANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 0.0)  # m
STIFFNESSES = (1e6, 1e9, 1e11, 1e13)  # N/m^1.5


def limits(friction: Any) -> Iterator[tuple[Any, ...]]:
    """Every clearance and stiffness: deviation of the slider from ideal joints, change at a tenth of the tolerance, cost."""
    for k in STIFFNESSES:
        for c in CLEARANCES:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", mb.AccuracyWarning)
                one = limit(c, k, friction=friction)
                finer = limit(c, k, solver=lambda rtol: mb.RadauIIA(3, rtol=rtol / 10), friction=friction)
            off = np.max(np.abs(one.result["slider"].position - finer.result["slider"].position)) / (c + one.depth)
            e, stats = one.result.energy, one.result.stats
            energy = np.max(np.abs(e.balance)) / max(e.dissipated[-1], 1e-3 * np.max(e.kinetic))
            yield (f"{k:g}", f"{c:g}", f"{one.depth:.1e}", f"{one.deviation:.2f}", f"{one.deepest:.1f}", one.contacts,
                   f"{one.rtol:.0e}", f"{off:.1e}", f"{energy:.1e}", stats.steps, f"{stats.cpu_s:.2f}")


def main() -> None:
    """Print the tables asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", choices=[[], "exudyn", "friction", "limit"])
    parser.add_argument("--exudyn", default=os.environ.get("EXUDYN_PYTHON"), metavar="PYTHON")
    args = parser.parse_args()
    chosen = args.what or ["exudyn", "friction", "limit"]
    if "exudyn" in chosen:
        beside(args.exudyn)
    if "friction" in chosen:
        head = [f"{s}: {what}" for s in ("RadauIIA(3)", "IDA") for what in ("evaluations", "CPU", "friction, J")]
        for name, k, rtol in (("soft", 1e9, 1e-8), ("steel", 6.6e10, 1e-8)):
            print(f"{name}, k = {k:g} N/m^1.5, rtol {rtol:g}, relative to no friction\n")
            show(frictions(k, rtol), ("friction", *head))
            print()
    if "limit" in chosen:
        show(limits(mb.Coulomb(0.1, 0.1)), ("k", "c, m", "a, m", "deviation / (c + a)", "penetration / a", "contacts", "rtol",
                                            "change / (c + a)", "energy error / dissipated", "steps", "CPU s"))


if __name__ == "__main__":
    main()
