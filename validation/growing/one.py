"""Some seeds alone: python validation/growing/one.py SEED ... or FIRST-LAST for counts too."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[up]) for up in (1, 2)]  # the checkout that this file belongs to

from growing.draw import run  # noqa: E402

runs = []
for text in sys.argv[1:]:
    first, _, last = text.partition("-")
    for seed in range(int(first), int(last or first) + 1):
        runs.append(run(seed))
        print(runs[-1], flush=True)
print(Counter(one.verdict for one in runs), f"{sum(one.wall for one in runs):.0f} s of wall time")
for name in sorted({one.problem for one in runs}):
    print(f"{name:14s}", dict(Counter(one.verdict for one in runs if one.problem == name)))
