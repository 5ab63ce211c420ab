"""Chains of 2 to 10 point masses on massless rods, released horizontally."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, n_points

claim = Claim("n_pendulum_point", "chains of 2 to 10 point masses are followed", 1e-7, "m",
              "computed independently of mbdae: equations in the N absolute angles, DOP853 at 3e-14")


def positions(solver: Any, n: int) -> Found:
    """Largest error of x and y of every mass."""
    e = data("n_pendulum_point")["results"][str(n)]
    r = simulated(n_points(n), e["t"], claim.tolerance, solver)
    theta = np.array(e["theta"])
    x, y = np.cumsum(np.sin(theta), axis=1), -np.cumsum(np.cos(theta), axis=1)
    return Found(max(largest(r[f"bob{i + 1}"].position[:, :2], np.c_[x[:, i], y[:, i]]) for i in range(n)))


def cases() -> list[Case]:
    return [case for n in (2, 3, 5, 10) for case in with_both(f"{n} points", lambda solver, n=n: positions(solver, n), n == 10)]
