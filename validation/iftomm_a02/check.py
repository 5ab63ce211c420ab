"""The N-four-bar of IFToMM's library (A02): in its flat positions the constraints lose rank, and other branches are near."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest
from scenes import data, n_four_bar

import mbdae as mb

claim = Claim("iftomm_a02", "the N-four-bar passes its flat positions on the right branch over 10 s, or warns",
              1e-6, "m", "problem: IFToMM multibody benchmark library; values: its one-coordinate equation, DOP853")
#: bars, accuracies asked for in each form, from loose to tight
RUNS = [
    (2, {"GGL": (1e-3, 1e-6), "Index3": (1e-3,)}),
    (2, {"GGL": (1e-3, 1e-4, 1e-5, 1e-6), "Index3": (1e-3, 1e-4, 1e-5, 1e-6)}),
    (10, {"GGL": (1e-3, 1e-4, 1e-6), "Index3": (1e-3, 1e-4)}),
    (40, {"GGL": (1e-3, 1e-4, 1e-5), "Index3": (1e-3, 1e-4)}),
]
FORMS = {"GGL": mb.GGL(), "Index3": mb.Index3()}


def deviation(n: int, accuracy: float, form: Any) -> tuple[float, mb.Result]:  # type: ignore[name-defined]
    """Largest error of the first bar's tip over the reference times, and the run."""
    d = data("iftomm_a02")["results"][str(n)]
    r = n_four_bar(n).simulate(10.0, accuracy, solver=mb.RadauIIA(3), form=form, outputs=np.array([0.0, *d["t"]]))
    return largest(r["bar0"].at((0, 1)).position[1:, :2], np.c_[d["B0x"], d["B0y"]]), r


def reach(n: int, runs: dict[str, tuple[float, ...]]) -> list[Found]:
    """The best of all runs, whether the error falls, and the worst run that claims success."""
    errors, silent, told = {}, 0.0, []
    for form, accuracies in runs.items():
        for accuracy in accuracies:
            try:
                errors[form, accuracy], r = deviation(n, accuracy, FORMS[form])
            except mb.SolverError as error:
                told.append(f"{form} asked {accuracy:.0e}: stopped at t = {error.time:.3f} s")
                continue
            told.append(f"{form} asked {accuracy:.0e}: {errors[form, accuracy]:.1e}{' warned' if r.warnings else ''}")
            silent = silent if r.warnings else max(silent, errors[form, accuracy] / accuracy)
    best = min(errors, key=errors.__getitem__)
    worst = max((error for (form, _), error in errors.items() if form == best[0]), default=math.nan)
    return [Found(errors[best], quantity=f"best reached ({best[0]})", note="error in m: " + ", ".join(told)),
            Found(errors[best] / worst, 0.5, "1", f"best over largest ({best[0]})"),
            Found(silent, 10.0, "times asked", "largest error without a warning")]


def cases() -> list[Case]:
    return [Case(f"N = {n}, {sum(map(len, runs.values()))} runs", "RadauIIA(3)", lambda n=n, runs=runs: reach(n, runs),
                 slow=(n, runs) != RUNS[0]) for n, runs in RUNS]
