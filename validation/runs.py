"""How claims run a scene: from the accuracy alone, a third of the tolerance to show, with IDA and Radau IIA."""

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
