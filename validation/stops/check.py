"""Random mechanisms between stops: every run is right or says that it is not, and few say so without need."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from runner import Case, Claim, Found, allowed
from stops.draw import run as one

import mbdae as mb

claim = Claim("stops", "mechanisms that hit the stops of their joints, or hardly touch them, are right within three times the "
              "accuracy asked or say that they are not; hardly one says so without need", 0.0, "runs",
              "equations of motion by hand, DOP853 of SciPy at rtol 1e-12 in steps short for impacts")
QUICK, WHOLE, SOME, NEEDLESS = range(5), range(60), range(20), 0.03
ALL, TWO = (1e-3, 1e-4, 1e-5, 1e-6), (1e-3, 1e-5)  #: accuracies asked for


def judge(seeds: Sequence[int], accuracies: Iterable[float], solver: Any) -> list[Found]:
    """How many runs are silently wrong, and which part of them has a warning without need."""
    made = [one(seed, accuracy, solver) for seed in seeds for accuracy in accuracies]
    of = {verdict: [words for found, words in made if found == verdict] for verdict in ("right", "told", "needless", "silent")}
    counts = ", ".join(f"{len(words)} {verdict}" for verdict, words in of.items())
    return [Found(len(of["silent"]), quantity="silently wrong", note="; ".join([counts, *of["silent"][:3]])),
            Found(len(of["needless"]) / len(made), allowed(NEEDLESS, seeds), "of the runs", "needless words",
                  note="; ".join(of["needless"][:5]))]


def cases() -> list[Case]:
    solvers = [("RadauIIA(3)", mb.RadauIIA(3)), ("DOP853", mb.DOP853()), ("IDA", mb.IDA())]
    return [Case(f"{len(QUICK)} runs", "default", lambda: judge(QUICK, (1e-3,), None)),
            Case("scenes, four accuracies", "default", partial(judge, accuracies=ALL, solver=None), slow=True, parts=WHOLE),
            *(Case("scenes, two accuracies", name, partial(judge, accuracies=TWO, solver=solver), slow=True, parts=SOME)
              for name, solver in solvers)]
