"""Speeds 1e-3 to 10 m/s, paths 1e-3 to 1e3 m, accuracies 1e-3 to 1e-8: no exit speed is wrong without a warning."""

from __future__ import annotations

from itertools import product
from typing import Any

from contact_scenes import ball
from runner import Case, Claim, Found

import mbdae as mb

SPEEDS, WAYS, DAMPING, STIFFNESS = (1e-3, 1e-2, 0.1, 1.0, 10.0), (1e-3, 0.1, 10.0, 1e3), 0.3, 1e9

claim = Claim("single_impacts", "an impact ends with the exact speed to ten times the accuracy, or the run says that it does not",
              0.5, "silent errors", "closed form: (1 - d e) exp(d e) = (1 + d) exp(-d), d = damping times speed")


def error_of(v0: float, way: float, accuracy: float, solver: Any) -> tuple[float, bool]:
    """Relative error of the exit speed over the accuracy, and whether the run says anything."""
    law = mb.Hertz(STIFFNESS, DAMPING)
    _, lasts = mb.Hertz(STIFFNESS).impact(1.0, v0)
    end = 1.1 * way / v0 + 2 * float(lasts)
    try:
        r = ball(v0, law, way).simulate(end, accuracy=accuracy, solver=solver, outputs=[end])
    except mb.MbdaeError:
        return float("inf"), True
    wanted = -law.coefficient_of_restitution(v0) * v0
    return abs(r["m"].velocity[-1, 0] / wanted - 1) / accuracy, bool(r.warnings)


def grid(accuracy: float, solver: Any) -> Found:
    found = [error_of(v0, way, accuracy, solver) for v0, way in product(SPEEDS, WAYS)]
    silent = sum(error > 10 and not told for error, told in found)
    told = sum(error > 10 and told for error, told in found)
    within = max((error for error, _ in found if error <= 10), default=0.0)
    return Found(silent, note=f"of {len(found)}: {told} told, the others within {within:.2g} times the accuracy")


def cases() -> list[Case]:
    solvers = [("default", None), ("IDA", mb.IDA()), ("RadauIIA(2)", mb.RadauIIA(2))]
    return [Case(f"accuracy {accuracy:g}", name, lambda solver=solver, accuracy=accuracy: grid(accuracy, solver),
                 slow=solver is not None or accuracy in (1e-4, 1e-6, 1e-7))
            for name, solver in solvers for accuracy in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)]
