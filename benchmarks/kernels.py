"""CPU cost of the building blocks, against the bars of the design: one thread, least of several repeats.

    residual, Jacobian    spatial chain of three bodies and three revolutes, GGL form, one call
    derive and compile    every variant of every law from cleared caches: derivation, derivatives, LLVM
    processes             `import mbdae` and `mbdae check examples/four_bar.py`, start of Python included

Run it from a checkout:  python benchmarks/kernels.py [--json]
Exit 1 where a bar is not met. A busy machine makes every number larger: repeat before believing it.
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
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.contracts.variants import variants
from mbdae.formulations import ggl_outputs
from mbdae.kernels.plan import linearised_plan, plan
from mbdae.laws import bodies as elements
from mbdae.laws import forces, joints
from mbdae.symbolic.derive import derive

ROOT = Path(__file__).resolve().parent.parent
LAWS = [getattr(module, name) for module in (elements, joints, forces) for name in module.__all__]


@dataclass(frozen=True)
class Line:
    """One line of the table: what was measured, its CPU seconds and the bar, with a remark."""

    what: str
    seconds: float
    bar: float
    remark: str = ""

    @property
    def met(self) -> bool:
        """Whether the cost is within the bar."""
        return self.seconds <= self.bar


def chain(bodies: int = 3) -> mb.Scene:
    """Rods one after the other, their hinges about changing axes: a spatial scene."""
    s = mb.Scene("chain", gravity=(0, 0, -9.81), space="spatial")
    before = s.ground
    for i in range(bodies):
        rod = s.rigid_body(f"rod {i}", 1.0, (0.01, 0.09, 0.1), at=(i + 0.5, 0, 0))
        s.revolute(f"hinge {i}", before, rod, at=(i, 0, 0), axis=((0, 1, 0), (0, 0, 1), (0, 1, 1))[i % 3])
        before = rod
    return s


def per_call(function: Callable[[], object], calls: int = 2000, repeats: int = 7) -> float:
    """CPU s of one call, least over the repeats."""
    function()
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(calls):
            function()
        found.append((time.process_time() - begin) / calls)
    return min(found)


def evaluations() -> Iterator[Line]:
    """Residual and Jacobian of the chain."""
    system = chain().system(mb.GGL())
    y = system.y0 + 1e-3 * np.sin(np.arange(system.n))
    out, matrix = np.empty(system.n), np.zeros((system.n, system.n))
    size = f"{system.n} unknowns"
    residual = per_call(lambda: system.residual(0.0, y, system.yp0, out))
    jacobian = per_call(lambda: system.jacobian(0.0, y, system.yp0, 1.0, matrix))
    yield Line("residual, 3 bodies 3 revolutes, GGL", residual, 60e-6, size)
    yield Line("Jacobian, 3 bodies 3 revolutes, GGL", jacobian, 150e-6, size)


def derivations() -> Iterator[Line]:
    """The slowest variant of every law: the three that look slowest are measured three times more."""
    for law in LAWS:
        all_of_it = [(sum(from_nothing(law, *rest)), name, rest) for name, *rest in variants(law, {}, {})]
        slowest = sorted(all_of_it, key=lambda cost: cost[0])[-3:]
        again = [(min((from_nothing(law, *rest) for _ in range(3)), key=sum), name) for _, name, rest in slowest]
        parts, name = max(again, key=lambda cost: sum(cost[0]))
        split = ", ".join(f"{what} {readable(part)}" for what, part in zip(("derive", "plan", "LLVM"), parts, strict=True))
        yield Line(f"derive and compile {law.__name__}", sum(parts), 0.3, f"{split}; worst of {len(all_of_it)}: {name}")


def from_nothing(law: Any, structure: Any, sides: Any) -> tuple[float, float, float]:
    """CPU s of the derivation, of the derivatives and their sorting, and of the compilation of one variant."""
    for cache in (derive, plan, linearised_plan):
        cache.cache_clear()
    t0 = time.process_time()
    derived = derive(law, structure, sides)
    t1 = time.process_time()
    made = linearised_plan(derived, ggl_outputs)
    t2 = time.process_time()
    for kernel in (made.residual, made.jacobian):
        if kernel.expressions:
            _ = kernel.compiled
    return t1 - t0, t2 - t1, time.process_time() - t2


def processes() -> Iterator[Line]:
    """Commands in processes of their own."""
    example = str(ROOT / "examples" / "four_bar.py")
    yield Line("import mbdae", child("-c", "import mbdae"), 0.3, "new process")
    yield Line("mbdae check examples/four_bar.py", child("-m", "mbdae", "check", example), 2.0, "new process")


def child(*arguments: str, repeats: int = 3) -> float:
    """CPU s of a Python process, least over the repeats."""
    found = []
    for _ in range(repeats):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found)


def readable(seconds: float) -> str:
    """Seconds with a unit that suits."""
    unit, factor = ("us", 1e6) if seconds < 1e-3 else ("ms", 1e3) if seconds < 1 else ("s", 1.0)
    return f"{seconds * factor:.3g} {unit}"


def main() -> int:
    """Measure everything and print the table."""
    parser = argparse.ArgumentParser(description="CPU cost of the building blocks against their bars.")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    as_json = parser.parse_args().json
    lines = []
    for measure in (evaluations, derivations, processes):
        for line in measure():
            lines.append(line)
            if not as_json:
                costs = f"{readable(line.seconds):>9s}  bar {readable(line.bar):>7s} {'' if line.met else 'ABOVE':6s}"
                print(f"{line.what:40s} {costs} {line.remark}", flush=True)
    if as_json:
        print(json.dumps([asdict(line) | {"met": line.met} for line in lines], indent=1))
    return 0 if all(line.met for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
