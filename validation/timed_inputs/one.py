"""Some seeds alone, printed in full: python validation/timed_inputs/one.py SEED ..., or FIRST-LAST for the tables; with the
word `laws` before the seeds those of the claim local_laws."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[up]) for up in (1, 2)]  # the checkout that this file belongs to

from local_laws import scenes as laws  # noqa: E402
from timed_inputs import scenes  # noqa: E402
from timed_inputs.draw import draw, run  # noqa: E402
from timed_inputs.tables import text  # noqa: E402

of = scenes.SCENES
if sys.argv[1] == "laws":
    of = laws.SCENES
    del sys.argv[1]
first, _, last = sys.argv[1].partition("-")
if last:
    runs = []
    for seed in range(int(first), int(last) + 1):
        runs.append(run(seed, of))
        print(runs[-1], flush=True)
    print(text(runs))
else:
    for seed in map(int, sys.argv[1:]):
        for i in draw(seed, of)[0].inputs:
            print(f"  {i.kind}: {i.said}")
        print(run(seed, of), flush=True)
