"""What one evaluation of a scene costs natively: us of CPU of residual, Jacobian and right-hand side, called by address.

    python benchmarks/native.py

The cost of a call from Python is taken off. The right-hand side is that of recursive joints where these leave no constraint, else
of eliminated multipliers (Index1).
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import mbdae as mb
from mbdae.native.program import core
from mbdae.system.prepare import prepare

sys.path[:0] = [str(Path(__file__).parent.parent / folder) for folder in ("examples", "benchmarks")]
import andrews_squeezer
import flapping_wing
import four_bar
import ground_resonance
import heavy_top
import pendulum

SCENES = {"pendulum": pendulum.scene, "four-bar": four_bar.scene, "Andrews": andrews_squeezer.scene, "heavy top": heavy_top.scene,
          "rotor": ground_resonance.scene, "flexible rotor": lambda: ground_resonance.scene(flexible=True),
          "flexible wing": lambda: flapping_wing.scene(flexible=True)}


def best(call: Callable[[], object], count: int = 400, repeats: int = 9) -> float:
    """us of CPU of a call."""
    found = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(count):
            call()
        found = min(found, (time.process_time() - begin) / count)
    return found * 1e6


def main() -> None:
    """Print the table."""
    c = core()
    empty = best(lambda: c.scene_residuals(0, 0, 0, 0, 0, 0))
    head = "scene", "unknowns (GGL)", "entries of the Jacobian", "residual", "Jacobian", "unknowns", "right-hand side"
    print(f"| {' | '.join(head)} |\n|" + "---|" * len(head))
    for name, make in SCENES.items():
        ggl = make().system("ggl")
        y, yp = ggl.y0.copy(), ggl.yp0.copy()
        e, out = ggl.assembly.evaluation, np.zeros((2, ggl.pattern.nnz))
        e.make("residual", "jacobian")
        at = y.ctypes.data, yp.ctypes.data, out[0].ctypes.data, out[1].ctypes.data
        cost = [best(lambda e=e, at=at: c.scene_residual(e.address, 0.0, *at[:3])) - empty,
                best(lambda e=e, at=at: c.scene_jacobian(e.address, 0.0, *at)) - empty]
        scene = make().recursive()
        free = not prepare(scene).rows
        system = (scene if free else make()).system(mb.ODE() if free else mb.Index1(multipliers="eliminated"))
        rates, y2, out2 = system.native and system.native.made("rates"), system.y0.copy(), np.zeros(system.n)
        at = y2.ctypes.data, out2.ctypes.data
        spent = "" if rates is None else f"{best(lambda r=rates, at=at: c.scene_rates(r.table.self, 0.0, *at)) - empty:.2f}"
        print(f"| {name} | {ggl.n} | {e.nnz} | {cost[0]:.2f} | {cost[1]:.2f} | {system.n} | {spent} |")


if __name__ == "__main__":
    main()
