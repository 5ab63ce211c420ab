"""Error over accuracy asked, on five scenes from 1e-3 to 1e-8 with IDA and Radau IIA; the table of docs/accuracy.md.

    python benchmarks/accuracy.py
"""

from __future__ import annotations

import importlib.util
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.system.prepare import prepare
from mbdae.system.sampling import distance

EXAMPLES = Path(__file__).parent.parent / "examples"
SCENES = {"pendulum": 5.0, "four_bar": 1.0, "andrews_squeezer": 0.03, "heavy_top": 1.0, "ground_resonance": 2.0}
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def example_module(name: str) -> Any:
    """An example file as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def example(name: str) -> mb.Scene:
    """The scene of an example file."""
    return example_module(name).scene()


def reference(scene: mb.Scene, t_end: float, times: np.ndarray) -> tuple[object, np.ndarray]:
    """The prepared scene and its positions and velocities (nt, n) by Radau IIA at 1e-11."""
    prepared = prepare(scene)
    solution = mb.RadauIIA(3, rtol=1e-11).solve(system_for(prepared, None, 3), t_end)
    return prepared, solution(times)[:, : prepared.mechanics.nq + prepared.mechanics.nu]


def ratios(name: str, accuracies: tuple[float, ...] = ACCURACIES) -> list[dict[str, object]]:
    """Error / asked at 2001 times between the steps, estimate / asked, runs and CPU for every accuracy and solver."""
    t_end = SCENES[name]
    times = np.linspace(0.0, t_end, 2001)
    scene, rows = example(name), []
    prepared, exact = reference(scene, t_end, times)
    for solver in (mb.IDA(), mb.RadauIIA(3)):
        for accuracy in accuracies:
            begin = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", mb.AccuracyWarning)
                r = scene.simulate(t_end, accuracy, solver=solver)
            error = float(np.max(distance(prepared, times, r.solution(times)[:, : exact.shape[1]], exact)))
            rows.append({"scene": name, "solver": solver.label, "accuracy": accuracy, "error": error / accuracy,
                         "estimate": r.accuracy.estimated / accuracy, "warned": bool(r.warnings), "runs": r.info.runs,
                         "rtol": r.info.solver.rtol, "cpu_s": time.process_time() - begin})
    return rows


def main() -> None:
    """Print the table."""
    print("| scene | solver | asked | error / asked | estimate / asked | warned | rtol | runs | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or SCENES:
        for r in ratios(name):
            print(f"| {r['scene']} | {r['solver']} | {r['accuracy']:.0e} | {r['error']:.3f} | {r['estimate']:.2f} | "
                  f"{'yes' if r['warned'] else 'no'} | {r['rtol']:.1e} | {r['runs']} | "
                  f"{r['cpu_s']:.2f} |", flush=True)


if __name__ == "__main__":
    main()
