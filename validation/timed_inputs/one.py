"""Runs of some seeds alone, told in full: python validation/timed_inputs/one.py SEED ..., or FIRST-LAST for the tables."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from timed_inputs.draw import draw, run  # noqa: E402
from timed_inputs.tables import text  # noqa: E402

first, _, last = sys.argv[1].partition("-")
if last:
    runs = []
    for seed in range(int(first), int(last) + 1):
        runs.append(run(seed))
        print(runs[-1], flush=True)
    print(text(runs))
else:
    for seed in map(int, sys.argv[1:]):
        for i in draw(seed)[0].inputs:
            print(f"  {i.kind}: {i.said}")
        print(run(seed), flush=True)
