"""What a judged run costs beside a bare one: CPU of `simulate` by default over that of the one run it returns.

Every scene is run by default to its accuracy; then the same joints, form and solver once more with the tolerance (or step) of the
run that was returned, so that both have the same error to the last bit: as `simulate` with that solver, and the solver's own time
in it. All is measured after a run that compiles.

    python benchmarks/companions.py [--accuracy 1e-6] [--profile] [scene ...]

One thread, process time, smallest of several. --profile prints where a default run spends its time.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import argparse
import cProfile
import pstats
import statistics
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

from choice import EXAMPLES, cases

import mbdae as mb

LONG = 0.1  #: s of CPU from which two runs are enough
LEAST = 0.05  #: s of CPU of a default run from which its ratio counts


def cpu_of(job: Callable[[], Any]) -> tuple[float, Any]:
    """The smallest CPU time (s) of a job, and what it returned."""
    found, times = None, list[float]()
    while len(times) < (2 if times and times[-1] > LONG else 5):
        begin = time.process_time()
        found = job()
        times.append(time.process_time() - begin)
    return min(times), found


def main() -> None:
    """Print the table and the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--accuracy", type=float, default=1e-6)
    parser.add_argument("--profile", action="store_true")
    wanted, known = parser.parse_args(), cases()
    warnings.simplefilter("ignore", mb.AccuracyWarning)
    print("| scene | default, s | runs | same run alone, s | its solver, s | default / alone | default / solver |")
    print("|---" * 7 + "|")
    ratios = []
    for name in wanted.scenes or EXAMPLES:
        scene, t_end = known[name].scene(), known[name].t_end
        accuracy = max(wanted.accuracy, min(known[name].accuracies))
        scene.simulate(t_end, accuracy)
        whole, r = cpu_of(partial(scene.simulate, t_end, accuracy))
        same, own = r.prepared.model.scene, {"solver": r.info.solver, "form": r.info.form}
        alone, single = cpu_of(partial(same.simulate, t_end, accuracy, **own))
        ratios += [whole / alone] if whole > LEAST else []
        print(f"| {name} | {whole:.3f} | {r.info.runs} | {alone:.3f} | {single.info.stats.cpu_s:.3f} | {whole / alone:.2f} | "
              f"{whole / single.info.stats.cpu_s:.2f} |", flush=True)
        if wanted.profile:
            profile = cProfile.Profile()
            profile.runcall(scene.simulate, t_end, accuracy)
            pstats.Stats(profile).sort_stats("cumulative").print_stats(35)
    if ratios:
        print(f"\nabove {LEAST} s: median {statistics.median(ratios):.2f}, largest {max(ratios):.2f}")


if __name__ == "__main__":
    main()
