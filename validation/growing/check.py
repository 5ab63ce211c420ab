"""Motions that leave an unstable rest: every run is right, or says that it is not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from growing.draw import VERDICTS, Run
from growing.draw import run as one
from runner import Case, Claim, Found, Parts, allowed

claim = Claim("growing", "motions that begin 1e-3 to 1e-13 off an unstable rest are right within three times the accuracy asked, "
              "or the run says that they are not; at most 3 % say so without need", 0.0, "runs",
              "equations of motion by hand, DOP853 of SciPy at rtol 3e-14 and atol 1e-26")
QUICK, WHOLE = range(16), range(600)
NEEDLESS = 0.03  #: largest share of runs told needlessly


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of verdicts, with the seeds of what is wrong."""
    runs = [one(seed) for seed in seeds]
    counts = Counter(run.verdict for run in runs)
    rows = [Found(counts[v], 0, "runs", v, note=_named(runs, v)) for v in ("silent", "refused", "crashed")]
    said = ", ".join(f"{counts[v]} {v}" for v in VERDICTS)
    note = f"{len(runs)} runs: {said}; {_named(runs, 'told needlessly')}"
    return [*rows, Found(counts["told needlessly"] / len(runs), allowed(NEEDLESS, seeds), "share", "told needlessly", note=note)]


def _named(runs: list[Run], verdict: str) -> str:
    seeds = [str(run.seed) for run in runs if run.verdict == verdict]
    return f"seeds {', '.join(seeds)}" if seeds else ""


def cases() -> list[Case]:
    return [Case(f"{len(QUICK)} runs", "all", lambda: judge(Parts(QUICK, len(WHOLE)))),
            Case("runs", "all", judge, slow=True, parts=WHOLE)]
