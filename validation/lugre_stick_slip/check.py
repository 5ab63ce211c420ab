"""Stick-slip with LuGre friction on a prismatic joint, and the curve of steady sliding."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, steady_sliding, stick_slip

claim = Claim("lugre_stick_slip", "friction on a prismatic joint sticks and slips as LuGre's law says", 1e-3, "s",
              "parameters: Canudas de Wit, Olsson, Astrom, Lischinsky 1995; values computed independently of mbdae")
ACCURACY = 3e-5
SLIPPING = 0.01  #: m/s, the velocity whose crossing counts as an instant of slip


def motion(solver: Any) -> list[Found]:
    """Instants of slip; displacement, velocity, deflection of the bristles over the largest, friction force over its peak."""
    d = data("lugre_stick_slip")
    instants = np.array(d["slip_events_v_cross_0p01"])
    near = (instants[:, None] + np.array([-1e-3, 1e-3])).ravel()
    times = np.union1d(d["t"], near)
    r = simulated(stick_slip(), times, ACCURACY, solver)
    at, around = np.searchsorted(times, d["t"]), np.searchsorted(times, near)
    before, after = r["slide"].rate[around].reshape(-1, 2).T
    found = near[::2] + 2e-3 * (SLIPPING - before) / (after - before)
    z = r.states(r.t)[2][at, 0]
    return [Found(largest(found, instants), quantity="instants of slip"),
            Found(largest(r["slide"].displacement[at], d["x"]), 1e-5, "m", "displacement"),
            Found(largest(r["slide"].rate[at], d["v"]), 1e-5, "m/s", "velocity"),
            Found(largest(z, d["z"]) / max(d["z"]), 1e-3, "relative", "deflection of the bristles"),
            Found(largest(-r["slide"].force[at, 0], d["F"]) / max(d["F"]), 1e-2, "relative", "friction force")]


def curve(solver: Any) -> Found:
    """Force of steady sliding at seven velocities: what is dissipated per metre."""
    d, worst = data("lugre_stick_slip")["steady_state"], 0.0
    for velocity, force in zip(d["v"], d["F"], strict=True):
        r = simulated(steady_sliding(velocity), [0.0, 1.0], ACCURACY, solver)
        worst = max(worst, abs(float(r.energy.dissipated[-1]) / velocity - force))
    return Found(worst, 1e-8, "N", "force of steady sliding")


def cases() -> list[Case]:
    return [*(replace(case, slow=case.solver == "IDA") for case in with_both("pulled by a spring, 25 s", motion)),
            *with_both("steady sliding", curve)]
