"""Drift of the joints in a run whose equations hold their accelerations alone (index 1)."""

from __future__ import annotations

import numpy as np

from mbdae.run.control import Controlled
from mbdae.system.prepare import Prepared
from mbdae.ties import largest

SAMPLES = 200  #: steps at which it is evaluated


def joint_drift(prepared: Prepared, run: Controlled, asked: float | None) -> list[str]:
    """A warning where g over the scene's length, or G u + g_t over its speed, exceeds the accuracy asked for, or the one expected
    of the tolerance where none was asked."""
    m, solver = prepared.mechanics, run.solver
    if not m.m:
        return []
    if asked is None:
        factors = solver.factors.get(solver.label, {}).values()
        asked = solver.rtol / max(factors) if solver.rtol and factors else 1e-6
    t = run.solution.t[:: len(run.solution.t) // SAMPLES + 1]
    q, u, _ = prepared.states(t, run.solution(t))
    speed = max(prepared.length / prepared.time, float(np.max(np.abs(u) * m.velocity_units, initial=0.0)))
    units = max(prepared.length, 1.0), max(speed, speed / prepared.length)  # of rows in m, or in rad
    off = [np.abs(m.position_residual(t, q)) / units[0], np.abs(m.velocity_residual(t, q, u)) / units[1]]
    for values, what in zip(off, ("closed", "at rest in itself"), strict=True):
        worst = largest(np.max(values, axis=0))
        if np.max(values) > asked:
            return [f"joint row {m.rows[worst].name} does not stay {what}: off by {np.max(values):.1e} of the scene's size or "
                    f"speed; the index-1 form holds accelerations only: raise baumgarte, ask for a smaller accuracy, or use "
                    f"mb.GGL()"]  # fmt: skip
    return []
