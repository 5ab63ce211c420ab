"""Period of a rod released from 5 to 179 degrees."""

from __future__ import annotations

from typing import Any

from runner import Case, Claim, Found
from runs import simulated, with_both
from scenes import data, physical_pendulum

claim = Claim("physical_pendulum", "a hinged rod has its exact period at amplitudes from 5 to 179 degrees", 1e-8, "relative",
              "closed form: T = 4 sqrt(I / (m g d)) K(sin^2(amplitude / 2))")


def period(solver: Any, amplitude: float, exact: float) -> Found:
    """After the exact period the rod rests again: its remaining rate over its acceleration is the error in time."""
    r = simulated(physical_pendulum(amplitude), [exact / 2, exact], claim.tolerance, solver)
    return Found(abs(r["A"].rate[-1] / r.acceleration[-1, 2]) / exact)


def cases() -> list[Case]:
    d = data("physical_pendulum")
    return [case for pair in zip(d["amplitude_deg"], d["period_s"], strict=True)
            for case in with_both(f"{pair[0]} degrees", lambda solver, pair=pair: period(solver, *pair))]
