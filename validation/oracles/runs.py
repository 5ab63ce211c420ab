"""Runs by SciPy's DOP853, split where an input jumps: a step never passes a break."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

RTOL, ATOL = 1e-12, 1e-13


def between_breaks(rates: Callable[[float, Any, float], Any], start: Any, instants: Sequence[float]) -> np.ndarray:
    """States (len(instants), n) at instants, which include every break; rates(t, y, inside) with a time inside the piece, at
    which a condition on time is read."""
    found = [np.asarray(start, dtype=float)]
    for a, b in pairwise(instants):
        run = solve_ivp(rates, (a, b), found[-1], "DOP853", rtol=RTOL, atol=ATOL, args=((a + b) / 2,))
        if not run.success:
            raise RuntimeError(f"DOP853 stopped at {run.t[-1]:g} s: {run.message}")
        found.append(run.y[:, -1])
    return np.array(found)
