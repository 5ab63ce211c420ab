"""Two methods to integrate the bristle of LuGre friction inside the 2 stages of Radau IIA, its sliding velocity given."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.system.base import Array

SIGMA0, MU_K, MU_S, V_S = 1e5, 0.3, 0.5, 1e-3
STAGES = np.array([1 / 3, 1.0])
END, SPACING = 0.5, 1e-3  # s
TIMES = np.linspace(0.0, END, round(END / SPACING) + 1)

claim = Claim("lugre_bristle", "the bristle as a stage unknown has order 3, paper Eq. 55 corrected order 2, as printed none",
              0.25, "order", "LSODA at 1e-12; the order between halved steps")


def velocity(t: Any) -> Any:
    """Sliding velocity, m/s."""
    return 5e-3 * np.sin(4 * math.pi * t)


def curve(v: float) -> float:
    """g(v), m."""
    return (MU_K + (MU_S - MU_K) * math.exp(-((v / V_S) ** 2))) / SIGMA0


def rate(v: float, z: float) -> float:
    return v - abs(v) * z / curve(v)


def trapezoidal(h: float, printed: bool = False) -> Array:
    """z at TIMES by Eq. 55 in the stages of steps h: z_i = (v_i + z'_(i-1) + 2 z_(i-1)/h_i) / (2/h_i + |v_i|/g(v_i)) with
    h_i = (c_i - c_(i-1)) h; as printed h_i is h and the last term is sigma0 |v_i|/g(v_i)."""
    z, slope, out = 0.0, float(velocity(0.0)), [0.0]
    for k in range(round(END / h)):
        before = 0.0
        for c in STAGES:
            width, factor = (h, SIGMA0) if printed else ((c - before) * h, 1.0)
            v, before = float(velocity((k + c) * h)), c
            z = (v + slope + 2 * z / width) / (2 / width + factor * abs(v) / curve(v))
            slope = rate(v, z)
        out.append(z)
    return np.array(out)[:: round(SPACING / h)]


def stage_unknown(h: float) -> Array:
    """z at TIMES by Radau IIA with 2 stages, z among its unknowns."""

    def residual(t: float, y: Any, yp: Any, out: Any) -> Any:
        return np.array([yp[0] - rate(float(velocity(t)), y[0])])

    def jacobian(t: float, y: Any, yp: Any, cj: float, out: Any) -> Any:
        v = float(velocity(t))
        return np.array([[cj + abs(v) / curve(v)]])

    system = mb.DAE(residual, [0.0], [0.0], jacobian=jacobian, scale=MU_K / SIGMA0)
    return np.asarray(mb.RadauIIA(2, step=h).solve(system, END).y[:: round(SPACING / h), 0])


@cache
def reference() -> Array:
    """z at TIMES."""
    run = solve_ivp(lambda t, z: [rate(float(velocity(t)), z[0])], (0, END), [0.0], method="LSODA", t_eval=TIMES, rtol=1e-12,
                    atol=1e-18, max_step=1e-4)
    return np.asarray(run.y[0])


def error(z: Array) -> float:
    """Largest error of sigma0 z, the friction coefficient."""
    return float(SIGMA0 * np.max(np.abs(z - reference())))


def order(method: Callable[[float], Array], expected: float, h: float) -> Found:
    coarse, fine = error(method(h)), error(method(h / 2))
    found = math.log2(coarse / fine)
    return Found(abs(found - expected), note=f"order {found:.2f}; errors {coarse:.1e}, {fine:.1e} with h = {h:g}, {h / 2:g} s")


def printed() -> Found:
    """Halving the step must not help: the ratio of errors stays near 1."""
    coarse, fine = (error(trapezoidal(h, printed=True)) for h in (2.5e-4, 1.25e-4))
    return Found(abs(math.log2(coarse / fine)), note=f"errors {coarse:.3f} and {fine:.3f} of the coefficient: does not converge")


def cases() -> list[Case]:
    return [Case("stage unknown, order 3", "RadauIIA(2)", lambda: order(stage_unknown, 3, 2.5e-4)),
            Case("Eq. 55 corrected, order 2", "trapezoid", lambda: order(trapezoidal, 2, 2.5e-4)),
            Case("Eq. 55 as printed, order 0", "trapezoid", printed)]
