"""Random laws of users that are narrow in space: every run is right, or says that it is not."""

from __future__ import annotations

from collections.abc import Sequence

from local_laws.scenes import SCENES
from runner import Case, Claim, Found
from runs import few_and_all
from timed_inputs.draw import run as one
from timed_inputs.tables import found

claim = Claim("local_laws", "barriers, wells, stops, kinks and brakes of users' laws, at any width in space, are right within "
              "three times the accuracy asked, or the run says that they are not; none is refused", 0.0, "runs",
              "equations of motion by hand, DOP853 of SciPy at rtol 1e-12 with short steps where the law is narrow")
QUICK, WHOLE = range(6), range(100)


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of verdicts, with the seeds of what is wrong."""
    return found([one(seed, SCENES) for seed in seeds], seeds)


def cases() -> list[Case]:
    return few_and_all(judge, QUICK, WHOLE)
