"""What a user waits for: CPU time of whole processes, from the start of Python to the result; one thread, least of several runs.

    off           nothing is kept on disk (MBDAE_CACHE=off)
    first         the first process with an empty folder: derives, compiles and keeps
    second        every process after it
    first call    the first `simulate` of such a process, imports included that it causes
    second call   the same scene again in the same process

    python benchmarks/start.py [--repeats 5]

The bytecode of Python files is there, as pip leaves it. A busy machine makes every number larger: repeat before believing it.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PENDULUM = """
import mbdae as mb
def scene():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.1)
    return s
"""
FOUR_BAR = """
import mbdae as mb
def scene():
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, crank, at=A, angle=12.56 * mb.t)
    s.revolute("B", crank, coupler, at=B)
    s.revolute("C", coupler, rocker, at=C, spring=2.0, damper=0.01)
    s.revolute("D", s.ground, rocker, at=D)
    return s
"""
ARM = """
import mbdae as mb
def scene():
    s = mb.Scene("six-axis arm", gravity=(0, 0, -9.81))
    at = [(0, 0, 0), (0, 0, 0.4), (0, 0, 0.9), (0.45, 0, 0.9), (0.6, 0, 0.9), (0.75, 0, 0.9), (0.85, 0, 0.9)]
    axes, rates = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], [0.5, 0.3, -0.4, 1, 0.5, 2]
    before = s.ground
    for i, mass in enumerate([20.0, 15.0, 10.0, 5.0, 3.0, 1.0]):
        middle = tuple((a + b) / 2 for a, b in zip(at[i], at[i + 1]))
        body = s.rigid_body(f"b{i + 1}", mass, (0.02 * mass, 0.025 * mass, 0.015 * mass), at=middle)
        s.revolute(f"J{i + 1}", before, body, at=at[i], axis=axes[i], rate0=rates[i])
        before = body
    return s
"""
SCENES = {  # statement, end time, accuracy
    "pendulum (README)": (PENDULUM, 2.0, 1e-6), "four-bar (README)": (FOUR_BAR, 0.5, 1e-6), "six-axis arm": (ARM, 1.0, 1e-6),
    "Andrews' mechanism": ("from andrews_squeezer import scene", 0.03, 1e-6),
    "flexible rotor": ("import ground_resonance as e\ndef scene():\n    return e.scene(flexible=True)", None, 1e-4),
    "flexible wing": ("import flapping_wing as e\ndef scene():\n    return e.scene(flexible=True)", None, 1e-4),
    "clearance rotor": ("from clearance_rotor import scene", 0.2, 1e-4),
}
RUN = """
import time
s = scene()
begin = time.process_time()
s.simulate({t_end}, accuracy={accuracy})
first = time.process_time() - begin
if {twice}:
    s, begin = scene(), time.process_time()
    s.simulate({t_end}, accuracy={accuracy})
    print(__import__("json").dumps([first, time.process_time() - begin]))
"""


class Costs(NamedTuple):
    """CPU times in s."""

    off: float
    first: float
    second: float
    first_call: float
    second_call: float


def process(code: str, cache: str) -> tuple[float, str]:
    """CPU time of a process of this Python that runs some code, s, and what it prints."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"} | {
        "MBDAE_CACHE": cache, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "examples")])}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    made = subprocess.run([sys.executable, "-W", "ignore", "-c", code], env=environment, check=True, capture_output=True,
                          text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, made.stdout


def costs(statement: str, t_end: float | None, accuracy: float, repeats: int) -> Costs:
    """The least of several runs of everything."""
    end = "e.t_end" if t_end is None else t_end
    once, twice = (statement + RUN.format(t_end=end, accuracy=accuracy, twice=both) for both in (False, True))
    process(once, "off")  # bytecode
    off = min(process(once, "off")[0] for _ in range(repeats))
    firsts = []
    for _ in range(max(repeats // 2, 1)):
        with tempfile.TemporaryDirectory() as folder:
            firsts.append(process(once, f"{folder}/kept")[0])
    with tempfile.TemporaryDirectory() as folder:
        for code in (once, twice):
            process(code, f"{folder}/kept")
        second = min(process(once, f"{folder}/kept")[0] for _ in range(repeats))
        calls = [json.loads(process(twice, f"{folder}/kept")[1]) for _ in range(repeats)]
    return Costs(off, min(firsts), second, *map(min, zip(*calls, strict=True)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", default="", help="scenes whose names contain this")
    a = parser.parse_args()
    parts = {"Python": "", "NumPy, symengine": "import numpy, symengine", "the same, SymPy": "import numpy, symengine, sympy",
             "import mbdae": "import mbdae"}
    for name, code in parts.items():
        print(f"{name}: {min(process(code, 'off')[0] for _ in range(a.repeats)):.2f} s", flush=True)
    head = "scene", "accuracy", "off", "first", "second", "first call", "second call"
    print(f"| {' | '.join(head)} |\n|" + "---|" * len(head))
    for name, (statement, t_end, accuracy) in SCENES.items():
        if a.only in name:
            found = costs(statement, t_end, accuracy, a.repeats)
            calls = f"{found.first_call:.3f} | {found.second_call:.3f}"
            print(f"| {name} | {accuracy:.0e} | {' | '.join(f'{value:.2f}' for value in found[:3])} | {calls} |", flush=True)


if __name__ == "__main__":
    main()
