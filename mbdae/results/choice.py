"""Which solver a run takes where the user names none, and why."""

from __future__ import annotations

import numpy as np

from mbdae.integrators.base import Solver
from mbdae.system.assembly import SceneSystem
from mbdae.system.prepare import Prepared

STIFF = 100.0  #: fastest decay rate times the characteristic time of the motion above which Adams methods waste steps


def chosen_solver(system: SceneSystem, prepared: Prepared) -> tuple[Solver, str]:
    """A solver for the equations, with the reason in words."""
    from mbdae.integrators.cvode import CVODE
    from mbdae.integrators.ida import IDA
    from mbdae.integrators.radau import RadauIIA

    if prepared.model.lines:
        return RadauIIA(3), "RadauIIA(3): elastic beams, whose fast modes BDF feeds or follows for ever"
    if prepared.contacts:
        return RadauIIA(3), "RadauIIA(3): contacts, on which its steps land; BDF gains or loses more energy there"
    if system.rhs is None:
        return IDA(), "IDA: a rigid scene with constraints"
    decay = fastest_decay(system)
    if decay is None or decay * prepared.time > STIFF:
        rate = "too large for an eigenvalue analysis" if decay is None else f"stiff: something decays at {decay:.3g} 1/s"
        return IDA(), f"IDA: an ordinary differential equation, {rate}"
    return CVODE(), "CVODE (Adams): an ordinary differential equation that is not stiff"


def fastest_decay(system: SceneSystem) -> float | None:
    """Largest decay rate (1/s) of small disturbances at the start of an ODE; None where it is too large for that."""
    if system.sparsity is not None:
        return None
    fy, fyp = system.jacobian_parts(system.t0, system.y0, system.yp0)
    return float(-np.min(np.linalg.eigvals(np.linalg.solve(fyp, -fy)).real, initial=0.0))
