"""Starts of equations of a user's own that violate a derivative of a constraint."""

from __future__ import annotations

import warnings

import numpy as np

from mbdae.errors import AccuracyWarning, SolverError
from mbdae.integrators.base import Asked
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.system.dae import DAE
from mbdae.system.shown_index import measured

#: longer of the two steps that look for a jump at the start, over the time of the run; their ratio; smallest jump that counts,
#: over the magnitude of the unknown
FIRST, SHORTER, JUMP = 1e-5, 8.0, 1e-3


def inconsistency(system: DAE, span: float) -> str:
    """How the start violates a derivative of a constraint, in words; "" where it does not, or where nothing has index 2 or 3.

    Steps of two lengths are made from the start: what changes in both by the same amount, or more in the shorter one, does not
    begin where y0 says."""
    found = measured(system, span)
    hidden = np.array([k is not None and k > 1 for k in found])
    if not hidden.any():
        return ""
    apart = []
    for h in (FIRST * span, FIRST * span / SHORTER):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                made = RadauIIA(2, step=h).run(system, Asked(system.t0 + h))
        except SolverError:
            return ""
        apart.append(np.abs(made.y[-1] - system.y0))
    unit = np.maximum(np.abs(system.y0), system.scale)
    jumps = hidden & (apart[1] > JUMP * unit) & (apart[1] > apart[0] / 2)
    if not jumps.any():
        return ""
    index = np.where(jumps, system.index, 9)
    j = int(np.argmin(index))
    value = float(made.y[-1, j])
    return (f"the start is not consistent: {system.names[j]} = {system.y0[j]:g} in y0, but the derivatives of the constraints "
            f"make it {value:.6g} just after t = {system.t0:g} s: correct y0 (and yp0)")
