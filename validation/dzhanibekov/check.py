"""Free body turning about its middle axis, which flips."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, dzhanibekov

import mbdae as mb

claim = Claim("dzhanibekov", "a free body flips about its middle axis at the right times and keeps its momentum", 1e-6, "1",
              "flips: closed form in elliptic functions; rotation: computed independently of mbdae, DOP853 at 3e-14")


def motion(solver: Any) -> list[Found]:
    """Rotation matrix, rates and angular momentum."""
    d = data("dzhanibekov")
    r = simulated(dzhanibekov(), d["t"], claim.tolerance, solver)
    rotation, rate = r["body"].rotation, r.u[:, 3:]
    momentum = np.einsum("tij,tj->ti", rotation, rate * np.array([1.0, 2.0, 3.0]))
    return [Found(largest(rotation.reshape(-1, 9), d["R"]), quantity="rotation matrix"),
            Found(largest(rate, d["omega"]), unit="rad/s", quantity="angular velocity"),
            Found(largest(momentum, momentum[0]), unit="kg m^2/s", quantity="angular momentum kept")]


def flips(solver: Any) -> Found:
    """At the exact instants the spin about the middle axis vanishes: what remains, over its rate, is the error in time."""
    times = np.array(data("dzhanibekov")["first_zero_crossings_w2"])
    r = simulated(dzhanibekov(), times, claim.tolerance, solver)
    return Found(float(np.max(np.abs(r.u[:, 4] / r.acceleration[:, 4]) / times)), unit="relative")


def cases() -> list[Case]:
    free = (mb.CVODE(), mb.CVODE(method="BDF"))
    return [*with_both("to 30 s", motion, more=free), *with_both("four flips to 53 s", flips, more=free)]
