"""Drawn scenes: every run is right or says that it is not, and the same scene stated in another way moves in the same way."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from runner import Case, Claim, Found, Row, measure

claim = Claim("strangers", "scenes drawn at random (trees, loops, couplings, contact, control, beams; smooth and hostile inputs) "
              "are right within three times the accuracy or say that they are not; turned, mirrored, in other units, order, "
              "joint models, forms, divided, later, stored or in space they move alike within ten times", 0.0, "scenes",
              "Newton and Euler for every body with multipliers, dense, by SciPy between the instants at which inputs jump")
WRONG = ("silent", "refused", "crashed", "wrong start", "differs")
TOLD = 0.2  #: share of runs that may say that they are not right, or not be judged
QUICK = 12  #: blocks of the quick case: two of every family


def judged(counts: Any) -> list[Found]:
    """A count of every verdict that must not be, and the share of what is told."""
    note = str(counts)
    rows = [Found(counts.of(verdict), 0, "scenes", verdict, note=note if verdict == "silent" else "") for verdict in WRONG]
    runs = [c for name, c in counts.verdicts.items() if name.startswith("run")]
    share = sum(c["told"] + c["not judged"] for c in runs) / max(1, sum(c["scenes"] for c in runs))
    return [*rows, Found(share, TOLD, "share", "told or not judged")]


def blocks(most: int) -> list[Found]:
    """So many blocks in a folder that nobody keeps."""
    from strangers.session import session  # needs hypothesis, of the extra `test`

    with tempfile.TemporaryDirectory() as folder:
        return judged(session(1.0, Path(folder), most=most))


def cases() -> list[Case]:
    return [Case("two blocks of every family", "all", lambda: blocks(QUICK), slow=True)]


def run() -> list[Row]:
    return measure(claim, cases())


def during(hours: float, out: Path | None) -> list[Row]:
    """For so many hours; the counts are all that the folder `out` ever had."""

    def measured() -> list[Found]:
        from strangers.session import session

        if out is not None:
            return judged(session(hours, out / "strangers"))
        with tempfile.TemporaryDirectory() as folder:
            return judged(session(hours, Path(folder)))

    return measure(claim, [Case(f"{hours:g} hours", "all", measured)])
