"""Drawn scenes: every run is right or says that it is not, and the same scene stated in another way moves in the same way."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runner import Case, Claim, Found, Row, allowed, measure

claim = Claim("strangers", "scenes drawn at random (trees, loops, couplings, contact, control, beams; smooth and hostile inputs) "
              "are right within three times the accuracy or say that they are not; turned, mirrored, in other units, order, "
              "joint models, forms, divided, later, stored or in space they move alike within ten times", 0.0, "scenes",
              "Newton and Euler for every body with multipliers, dense, by SciPy between the instants at which inputs jump")
FAMILIES = ("tree", "loop", "coupling", "contact", "control", "beam")  #: of strangers/draw.py
WRONG = ("silent", "refused", "crashed", "wrong start", "differs")
TOLD = 0.2  #: share of runs that may say that they are not right, or not be judged
ROUNDS = 10  #: blocks of runs and of checks of every family: the suite


def judged(counts: Any, blocks: Sequence[str] = ()) -> list[Found]:
    """A count of every verdict that must not be, and the share of what is told."""
    rows = [Found(counts.of(verdict), 0, "scenes", verdict, note=str(counts) if verdict == "silent" else "") for verdict in WRONG]
    runs = [c for name, c in counts.verdicts.items() if name.startswith("run")]
    share = sum(c["told"] + c["not judged"] for c in runs) / max(1, sum(c["scenes"] for c in runs))
    return [*rows, Found(share, allowed(TOLD, blocks), "share", "told or not judged")]


def measured(blocks: Sequence[str]) -> list[Found]:
    """Some blocks, "run tree 0", whose scripts of failures stay in a folder of their own."""
    from strangers.session import Counts, block  # needs hypothesis, of the extra `test`

    counts, folder = Counts(), Path(tempfile.mkdtemp(prefix="mbdae-strangers-"))
    for kind, family, seed in map(str.split, blocks):
        block(kind, family, int(seed), counts, folder, math.inf, lambda text: None)
    if not counts.failures:
        folder.rmdir()
    return judged(counts, blocks)


def cases() -> list[Case]:
    parts = [f"{kind} {family} {seed}" for seed in range(ROUNDS) for family in FAMILIES for kind in ("run", "check")]
    return [Case("blocks", "all", measured, slow=True, parts=parts)]


def during(hours: float, out: Path | None) -> list[Row]:
    """For so many hours; the counts are all that the folder `out` ever had."""

    def measured() -> list[Found]:
        from strangers.session import session

        if out is not None:
            return judged(session(hours, out / "strangers"))
        with tempfile.TemporaryDirectory() as folder:
            return judged(session(hours, Path(folder)))

    return measure(claim, [Case(f"{hours:g} hours", "all", measured)])
