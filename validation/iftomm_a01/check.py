"""Point pendulum of IFToMM's library (A01)."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import a01, data

claim = Claim("iftomm_a01", "the point pendulum of IFToMM A01 is followed over 10 s", 1e-8, "m",
              "problem: IFToMM multibody benchmark library; values: closed form in Jacobi's elliptic functions")


def position(solver: Any) -> Found:
    """Largest error of x and y."""
    d = data("iftomm_a01")
    r = simulated(a01(), d["t"], claim.tolerance, solver)
    return Found(largest(r["bob"].position[:, :2], np.c_[d["x"], d["y"]]))


def cases() -> list[Case]:
    return with_both("position to 10 s", position)
