"""Equations of a user's own: every unknown is right within three times the accuracy, or the run says that it is not."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from own_equations.judge import verdicts, wrong_indices
from own_equations.problems import AMPLIFIED, PROBLEMS, RING, amplifier, ring
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("own_equations", "problems of the test sets for initial value and differential algebraic equations, index 1 to 3, "
              "with every solver that admits them: no unknown, multipliers included, is more than three times the accuracy off "
              "without a word; a wrong index is named", 0.0, "runs",
              "closed forms, SciPy's Radau at 2e-13 on the ordinary differential equations, RadauIIA(5) at 1e-11 where there are "
              "none, which has the published digits of the amplifier and the ring")
ACCURACIES = (1e-3, 1e-5, 1e-7, 1e-9)
NEEDLESS = 0.25  #: share of runs with an error within the accuracy that may say that it is not


def honest(names: Sequence[str], accuracies: Sequence[float]) -> list[Found]:
    """Silent runs, and the share of those that warn without need."""
    found = list(verdicts(names, accuracies))
    silent = [one for one in found if one.silent]
    met = [one for one in found if one.ratio <= 1]
    return [Found(len(silent), 0, "runs", f"silent of {len(found)}", note="; ".join(map(str, silent))),
            Found(float(np.mean([one.needless for one in met])), NEEDLESS, "share", "needless warnings",
                  "; ".join(f"{one.solver} at {one.accuracy:g}: {one.ratio:.2g}" for one in met if one.needless))]


def published(make: Callable[[], mb.DAE], rtol: float, t_end: float, values: np.ndarray) -> Found:  # type: ignore[name-defined]
    """Largest error at the end beside the published digits, over the magnitude of each unknown."""
    found = mb.RadauIIA(5, rtol=rtol).solve(make(), t_end).y[-1]
    return Found(float(np.max(np.abs(found / values - 1))), 1e-8, "relative")


def cases() -> list[Case]:
    quick = ["pendulum, index 3", "Jay", "Akzo Nobel"]
    return [Case("three problems, 1e-4", "all", lambda: honest(quick, (1e-4,))),
            Case("every index declared wrongly", "none", lambda: Found(len(wrong_indices()), note=str(wrong_indices()))),
            Case("amplifier, published digits", "RadauIIA(5)", lambda: published(amplifier, 1e-10, 0.2, AMPLIFIED), slow=True),
            Case("ring modulator, published digits", "RadauIIA(5)", lambda: published(ring, 1e-9, 1e-3, RING), slow=True),
            Case("all accuracies", "all", lambda name: honest([name], ACCURACIES), slow=True, parts=list(PROBLEMS), each=True)]
