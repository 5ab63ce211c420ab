"""A rotor of four lagging blades on an elastic support, near its instability."""

from __future__ import annotations

from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import largest, simulated, with_both
from scenes import data, ground_resonance

import mbdae as mb

claim = Claim("ground_resonance", "four blades on a hub: one and two axes of support, prescribed and free speed", 1e-6, "rad",
              "computed independently of mbdae in minimal coordinates, DOP853; compared where it agrees with a looser run within "
              "1e-9, that is to 5 s, or to 4 s where the blades' motion turns chaotic")
KNOWN = 1e-9  #: largest difference of the reference from its looser run
TIGHT = 1e-8  #: rad and m, with recursive joints


def motion(solver: Any, case: str, t_end: float) -> list[Found]:
    """Lag angles, hub and rotor speed."""
    e = data("ground_resonance")["nonlinear"][case]
    axes, keep = e["settings"]["axes"], (np.array(e["self_diff"]) < KNOWN) & (np.array(e["t"]) <= t_end)
    r = simulated(ground_resonance(axes, e["settings"]["free"]), np.array(e["t"])[keep], claim.tolerance, solver)
    lag = np.array([r[f"lag{i + 1}"].angle for i in range(4)]).T
    return [Found(largest(lag, np.array(e["lag_angles"])[keep]), quantity="lag angles"),
            Found(largest(r["block"].position[:, :axes], np.array(e["hub"])[keep]), unit="m", quantity="hub"),
            Found(largest(r["rotor"].rate, np.array(e["rotor_speed"])[keep]), 1e-5, "rad/s", "rotor speed")]


def recursive(solver: Any, case: str, space: str) -> list[Found]:
    """Lag angles and hub with all joints recursive, to 2 s."""
    e = data("ground_resonance")["nonlinear"][case]
    axes, keep = e["settings"]["axes"], np.array(e["t"]) <= 2.0
    scene = ground_resonance(axes, e["settings"]["free"], space, mb.Recursive())
    r = simulated(scene, np.array(e["t"])[keep], TIGHT, solver)
    lag = np.array([r[f"lag{i + 1}"].angle for i in range(4)]).T
    return [Found(largest(lag, np.array(e["lag_angles"])[keep]), TIGHT, quantity="lag angles"),
            Found(largest(r["block"].position[:, :axes], np.array(e["hub"])[keep]), TIGHT, "m", "hub")]


def cases() -> list[Case]:
    tight = [case for space in ("planar", "spatial") for name in data("ground_resonance")["nonlinear"]
             for case in with_both(f"{name.replace('_', ' ')}, recursive joints, {space}",
                                   lambda solver, run=(name, space): recursive(solver, *run),
                                   (space, name[:2]) not in (("planar", "B1"), ("spatial", "A2")), [mb.CVODE()])]
    return tight + [case for t_end in (2.0, 5.0) for name in data("ground_resonance")["nonlinear"]
            for case in with_both(f"{name.replace('_', ' ')}, to {t_end:g} s",
                                  lambda solver, run=(name, t_end): motion(solver, *run),
                                  t_end > 2 or name[:2] != "B2")]
