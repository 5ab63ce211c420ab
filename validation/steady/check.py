"""Periodic motions of drawn oscillators against shooting by SciPy on the same equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from runner import Case, Claim, Found, allowed
from steady.cost import SCENES, cost
from steady.draw import judged

claim = Claim("steady", "the periodic motion of every drawn oscillator, its period, multipliers and stability are those of "
              "SciPy, rest is never returned as one, families are told, and at most 3 % are refused or told without need", 0.0,
              "oscillators", "the same equations by hand, SciPy's DOP853 and fsolve; elliptic integrals")
QUICK, WHOLE = range(24), range(400)
TOLD = 0.03


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of what is wrong, with the seeds."""
    found = [judged(seed) for seed in seeds]
    wrong, told = [v for v in found if v.wrong], [v for v in found if v.told]
    spare = max(len(told) - np.ceil(allowed(TOLD, seeds) * len(found)), 0.0)
    said = "; ".join(f"{v.seed} ({v.kind}): {v.wrong}" for v in wrong)
    return [Found(len(wrong), note=f"wrong: {said or 'none'}"),
            Found(spare, note=f"refused or told without need: {', '.join(str(v.seed) for v in told) or 'none'}")]


def cheap(name: str) -> list[Found]:
    """What the periodic motion costs beside a run until transients have died out, and how far both are apart."""
    make, sensor = SCENES[name]
    found = cost(make(), sensor)
    most = 0.1 if found.periods > 1000 else 1.0 if found.periods > 100 else np.inf
    rows = [Found(found.ratio, most, "CPU of settling", "cost", f"settles in {found.periods} periods")]
    return rows + ([] if found.off is None else [Found(found.off, 10.0, "accuracies", "beside a long run")])


def cases() -> list[Case]:
    costs = [Case(name, "cost", lambda name=name: cheap(name), slow=not name.startswith("Duffing")) for name in SCENES]
    return [*costs, Case(f"{len(QUICK)} oscillators", "shooting", lambda: judge(list(QUICK))),
            Case("oscillators", "shooting", judge, slow=True, parts=list(WHOLE))]
