"""How claims run a scene, from the accuracy alone, a third of the tolerance to show, with IDA and Radau IIA; and how claims of
scenes drawn by seeds count their verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from runner import Case, Found

import mbdae as mb

SOLVERS = (mb.IDA(), mb.RadauIIA(3))


def simulated(scene: mb.Scene, times: Any, tolerance: float, solver: Any) -> mb.Result:
    """The scene at `times` (s)."""
    outputs = np.array(times, dtype=float)
    return scene.simulate(float(outputs[-1]), accuracy=tolerance / 3, solver=solver, outputs=outputs)


def largest(a: Any, b: Any = 0.0) -> float:
    """Largest |a - b|."""
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b))))


def with_both(name: str, measure: Callable[[Any], Found | Sequence[Found]], slow: bool = False,
              more: Sequence[Any] = ()) -> list[Case]:
    """The same measurement with IDA, with Radau IIA, and with the solvers in `more`."""
    return [Case(name, solver.label, lambda solver=solver: measure(solver), slow) for solver in (*SOLVERS, *more)]  # type: ignore[misc]


FACTOR = 3.0  #: an error up to so many times the accuracy counts as right
Judge = Callable[[Sequence[int]], Any]  #: seeds -> findings


def verdict_of(ratio: float, said: bool) -> str:
    """"right", "told", "silent" or "needless". ratio: the error over the accuracy; said: whether the run told of its error."""
    return ("told" if said else "silent") if ratio > FACTOR else ("needless" if said and ratio < 1 else "right")


def counted(verdicts: Sequence[tuple[str, str]]) -> list[Found]:
    """Counts of the verdicts, each with a remark, that must not be, and of which there may be a twentieth."""
    rows = []
    for name, most in (("silent", 0.0), ("needless", max(1.0, 0.05 * len(verdicts)))):
        wrong = [text for found, text in verdicts if found == name]
        rows.append(Found(len(wrong), most, "runs", name, note=" | ".join(wrong)))
    return rows


def few_and_all(judge: Judge, few: Sequence[int], every: Sequence[int]) -> list[Case]:
    """The cases of a claim whose scenes are drawn by seeds: a few of them, and all."""
    return [Case(f"{len(few)} runs", "all", lambda: judge(few)), Case("runs", "all", judge, slow=True, parts=every)]
