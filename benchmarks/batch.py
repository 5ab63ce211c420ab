"""What a point costs in a batch of 1000 runs of a six-axis arm, 2 s of free motion with another mass of its elbow each.

    python benchmarks/batch.py [--pinocchio <python>]

us and ms of CPU on one thread, the smallest of several repeats. error: the largest distance of a centre of mass from runs at
rtol = 1e-13, over the size of the scene, at 101 times of a tenth of the points. --pinocchio: an interpreter with the package pin
(pip install pin), whose forward dynamics is called from Python beside ours, as a check of the numbers and a bound of the cost.
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
import time
from pathlib import Path

import numpy as np

import mbdae as mb
from mbdae.integrators.batch import solve_batch
from mbdae.native.program import core
from mbdae.system.prepare import prepare

sys.path.insert(0, str(Path(__file__).parent))
from native import best

JOINTS = ((0, 0, 0.0892), (0, 0.1358, 0.0892), (0.425, 0.0161, 0.0892), (0.8172, 0.0161, 0.0892), (0.8172, 0.1091, 0.0892),
          (0.8172, 0.1091, -0.0054))
AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, -1), (0, 1, 0))
MASSES = (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879)
CENTRES = ((0, 0.08, 0.0892), (0.2125, 0.1358, 0.0892), (0.62, 0.0161, 0.0892), (0.8172, 0.07, 0.0892), (0.8172, 0.1091, 0.05),
           (0.8172, 0.15, -0.0054))
INERTIAS = ((0.0103, 0.0103, 0.0067), (0.0151, 0.2269, 0.2269), (0.0041, 0.0312, 0.0312), (0.0022,) * 3, (0.0022,) * 3,
            (0.0001,) * 3)
END, POINTS, REPEATS = 2.0, 1000, 5
THEIRS = """
import json, sys, time, numpy as np, pinocchio as pin
joints, axes, masses, centres, inertias, q, u = json.load(sys.stdin)
m, parent, before = pin.Model(), 0, np.zeros(3)
for p, a, mass, c, J in zip(joints, axes, masses, centres, inertias):
    made = {(0, 0, 1): pin.JointModelRZ, (0, 1, 0): pin.JointModelRY}.get(tuple(a))
    made = made() if made else pin.JointModelRevoluteUnaligned(np.array(a, float))
    parent = m.addJoint(parent, made, pin.SE3(np.eye(3), np.array(p) - before), str(parent))
    m.appendBodyToJoint(parent, pin.Inertia(mass, np.array(c) - np.array(p), np.diag(J)), pin.SE3.Identity())
    before = np.array(p)
d, q, u, tau = m.createData(), np.array(q), np.array(u), np.zeros(6)
least = np.inf
for _ in range(15):
    begin = time.process_time()
    for _ in range(5000):
        pin.aba(m, d, q, u, tau)
    least = min(least, (time.process_time() - begin) / 5000)
print(json.dumps([pin.__version__, 1e6 * least, pin.aba(m, d, q, u, tau).tolist()]))
"""


def arm() -> mb.Scene:
    """Six bodies on hinges (the proportions of a UR5)."""
    s = mb.Scene("arm", gravity=(0, 0, -9.81))
    before = s.ground
    for i, name in enumerate(("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")):
        body = s.rigid_body(name, MASSES[i], INERTIAS[i], at=CENTRES[i])
        s.revolute(f"q{i + 1}", before, body, at=JOINTS[i], axis=AXES[i])
        before = body
    return s


def smallest(call, repeats: int = REPEATS) -> float:  # type: ignore[no-untyped-def]
    """ms of CPU."""
    found = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        call()
        found = min(found, time.process_time() - begin)
    return 1e3 * found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pinocchio")
    asked = parser.parse_args()
    scene = arm().recursive()
    prepared, system = prepare(scene), scene.system(mb.ODE())
    masses, times = np.linspace(2, 3, POINTS), np.linspace(0, END, 101)
    some = slice(0, POINTS, 10)

    def centres(y: np.ndarray) -> np.ndarray:
        q = prepared.states(np.tile(times, len(y)), y.reshape(-1, system.n))[0]
        return np.stack([q[:, node.q : node.q + 3] for node in prepared.model.nodes if node.body is not None], axis=1)

    exact = centres(solve_batch(system, END, mb.DOP853(rtol=1e-13), numbers={"elbow.mass": masses[some]}, outputs=times).y)
    print("| rtol | error, median | error, largest | steps | evaluations | ms a point | ms alone |\n|" + 7 * "---|")
    for rtol in (1e-6, 2e-7, 1e-7, 3e-8, 1e-8):
        solver = mb.DOP853(rtol=rtol)
        found = solve_batch(system, END, solver, numbers={"elbow.mass": masses[some]}, outputs=times)
        off = np.linalg.norm(centres(found.y) - exact, axis=-1).reshape(len(found.y), -1).max(axis=1) / prepared.length
        made = solve_batch(system, END, solver, numbers={"elbow.mass": masses})
        point = smallest(lambda s=solver: solve_batch(system, END, s, numbers={"elbow.mass": masses})) / POINTS
        alone = smallest(lambda s=solver: s.solve(system, END), 50)
        print(f"| {rtol:g} | {np.median(off):.1e} | {off.max():.1e} | {made.steps.mean():.0f} | {made.evaluations.mean():.0f} "
              f"| {point:.2f} | {alone:.2f} |")
    c, out = core(), np.zeros(system.n)
    y = np.random.default_rng(1).normal(size=system.n)
    at = system.native.table.self, 0.0, y.ctypes.data, out.ctypes.data
    ours = best(lambda: c.scene_rates(*at), 4000) - best(lambda: c.scene_residuals(0, 0, 0, 0, 0, 0), 4000)
    print(f"\none evaluation of y' in C: {ours:.2f} us")
    if asked.pinocchio:
        given = json.dumps([JOINTS, AXES, MASSES, CENTRES, INERTIAS, y[:6].tolist(), y[6:].tolist()])
        said = subprocess.run([asked.pinocchio, "-c", THEIRS], input=given, capture_output=True, text=True, check=True).stdout
        version, theirs, rates = json.loads(said)
        off = np.max(np.abs(out[6:] - rates)) / np.max(np.abs(rates))
        print(f"pinocchio {version}, aba from Python: {theirs:.2f} us, {theirs / ours:.1f} times ours; difference {off:.0e}")


if __name__ == "__main__":
    main()
