"""From the accuracy a user asks for to a run that has it: companion runs measure the error instead of trusting rtol.

Every controlled run is made twice, at ten times the tolerance and at the tolerance itself; their difference, times
the ratio by which the error falls, estimates the error of the second. Where that is above what was asked, the run is
repeated with a tighter tolerance. The measured factors between accuracy and rtol (`Solver.factors`) only choose where
to begin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Solution
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared

COMPANION = 10.0  #: tolerance of the companion over that of the run
ATTEMPTS = 4
BETWEEN = 3  #: points compared inside every step of the coarser run


@dataclass(frozen=True)
class Controlled:
    """A run, the estimate of its error, how many runs it took and their CPU seconds."""

    solution: Solution
    solver: Solver
    estimate: float
    runs: int
    cpu_s: float


def distance(prepared: Prepared, a: Array, b: Array) -> Array:
    """(nt,) difference of two trajectories (nt, n): positions over the scene's length, angles in rad, velocities over
    the largest of length / characteristic time and the speed reached."""
    m = prepared.mechanics
    worst = np.zeros(len(a))
    rotational = m.rotational
    u_a, u_b = a[:, m.nq : m.nq + m.nu], b[:, m.nq : m.nq + m.nu]
    for mask, unit in ((~rotational, prepared.length), (rotational, 1.0)):
        if mask.any():
            reference = max(unit / prepared.time, float(np.max(np.abs(u_b[:, mask]))))
            worst = np.maximum(worst, np.max(np.abs(u_a - u_b)[:, mask], axis=1) / reference)
    for node in m.model.nodes:
        n = 2 if node.kind.flat else 3
        q_a, q_b = a[:, node.q : node.q + node.kind.sizes[0]], b[:, node.q : node.q + node.kind.sizes[0]]
        worst = np.maximum(worst, np.linalg.norm(q_a[:, :n] - q_b[:, :n], axis=1) / prepared.length)
        if q_a.shape[1] == 3 and node.kind.turns:
            worst = np.maximum(worst, np.abs(q_a[:, 2] - q_b[:, 2]))
        elif q_a.shape[1] == 7:
            worst = np.maximum(worst, _angle_between(q_a[:, 3:], q_b[:, 3:]))
    return worst


def _angle_between(P: Array, Q: Array) -> Array:
    """Angle (nt,) of the rotation between quaternions (nt, 4) of any length."""
    p, q = P / np.linalg.norm(P, axis=1, keepdims=True), Q / np.linalg.norm(Q, axis=1, keepdims=True)
    gap = np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    return 4 * np.arcsin(np.clip(gap / 2, 0, 1))


def scaled_distance(system: System, a: Array, b: Array) -> Array:
    """(nt,) largest difference of any unknown but multipliers over its scale, for equations without a scene."""
    keep = np.array([kind not in ("lambda", "mu") for kind in system.kinds])
    unit = np.maximum(system.scale, np.max(np.abs(b), axis=0))
    return np.asarray(np.max((np.abs(a - b) / unit)[:, keep], axis=1))


def measure_of(system: System, prepared: Prepared | None) -> Callable[[Array, Array], Array]:
    """The distance between trajectories of a system."""
    if prepared is not None and isinstance(system, SceneSystem):
        return lambda a, b: distance(prepared, a, b)
    return lambda a, b: scaled_distance(system, a, b)


def check_times(coarse: Solution, outputs: Array) -> Array:
    """Outputs, steps and points between steps at which runs are compared."""
    t = coarse.t
    if len(t) > 2000:
        t = t[:: len(t) // 2000 + 1]
    inner = (t[:-1, None] + np.diff(t)[:, None] * (np.arange(BETWEEN) + 0.5) / BETWEEN).ravel()
    last = coarse.t[-1]
    return np.unique(np.concatenate([outputs[outputs <= last], t, inner]))


def run_controlled(system: System, prepared: Prepared | None, solver: Solver, accuracy: float, t_end: float, outputs: Array,
                   **options: Any) -> Controlled:  # fmt: skip
    """Integrate until the estimated error is below `accuracy`, or as near as the solver comes."""
    fine_solver = solver.at_accuracy(accuracy, system.label)
    measure = measure_of(system, prepared)
    coarse = replace(fine_solver, rtol=min(COMPANION * fine_solver.rtol, 1e-2)).solve(system, t_end, **options)  # type: ignore[type-var]
    cpu, runs = coarse.stats.cpu_s, 1
    while True:
        fine = fine_solver.solve(system, t_end, **options)
        cpu, runs = cpu + fine.stats.cpu_s, runs + 1
        if not (fine.complete and coarse.complete):
            return Controlled(fine, fine_solver, float("nan"), runs, cpu)
        times = check_times(coarse, outputs)
        ratio = fine_solver.rtol / (coarse.solver.rtol)  # type: ignore[attr-defined]
        estimate = float(np.max(measure(coarse(times), fine(times)))) * max(ratio**0.6, 0.05)
        tighter = fine_solver.rtol * float(np.clip(0.3 * accuracy / max(estimate, 1e-300), 1e-3, 0.1))
        limit = solver.tightest.get(system.label, solver.tightest[""]) / 3
        if estimate <= accuracy or runs >= ATTEMPTS or fine_solver.rtol <= limit:
            return Controlled(fine, fine_solver, estimate, runs, cpu)
        coarse, fine_solver = fine, replace(fine_solver, rtol=max(tighter, limit))  # type: ignore[type-var]


def plausible(accuracy: float) -> None:
    """Refuse an accuracy nobody can mean."""
    if not (np.isfinite(accuracy) and 1e-12 <= accuracy <= 1e-1):
        raise OptionError(f"accuracy = {accuracy}: give a number from 1e-12 to 1e-1 (1e-6 is the default)")
