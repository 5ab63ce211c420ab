"""Random inputs of time in small scenes: every run is right, or says that it is not."""

from __future__ import annotations

from collections.abc import Sequence

from runner import Case, Claim, Found
from runs import few_and_all
from timed_inputs.draw import run as one
from timed_inputs.tables import found

claim = Claim("timed_inputs", "loads and prescribed motions that act for a part of a run, at any width, are right within three "
              "times the accuracy asked, or the run says that they are not; none is refused", 0.0, "runs",
              "equations of motion by hand, DOP853 of SciPy at rtol 1e-12 between breaks that the maker of the inputs knows")
QUICK, WHOLE = range(5), range(600)


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of verdicts, with the seeds of what is wrong."""
    return found([one(seed) for seed in seeds], seeds)


def cases() -> list[Case]:
    return few_and_all(judge, QUICK, WHOLE)
