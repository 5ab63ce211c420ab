"""The right-hand side f of y' = f(t, y), for methods that take ordinary differential equations."""

from __future__ import annotations

import numpy as np

from mbdae.deferred import splu
from mbdae.errors import OptionError
from mbdae.integrators.matrices.iteration import as_csc
from mbdae.system.base import Array, System


def check_rates(label: str, system: System) -> None:
    """Raise OptionError for a system without a right-hand side; label: of the solver."""
    if system.rhs is not None:
        return
    needs = f"{label} needs y' = f(t, y), but this system"
    if any(kind in ("lambda", "mu") for kind in system.kinds):
        raise OptionError(f"{needs} ({system.label}) has multipliers of constraints, or other algebraic unknowns: use "
                          "mb.RadauIIA(3); or, for a scene, form=mb.Index1(multipliers='eliminated'), which solves for the "
                          "multipliers at every state, or s.recursive() if its joints form a tree")  # fmt: skip
    raise OptionError(f"{needs} ({system.label}) gives only F(t, y, y') = 0, no right-hand side: use mb.IDA() or mb.RadauIIA(3), "
                      f"or give the DAE its rhs=, a function (t, y, out) that fills out with y'")  # fmt: skip


def rate_jacobian(system: System, t: float, y: Array, yp: Array) -> Array:
    """df/dy (n, n) of y' = f(t, y) at yp = f(t, y), from the system, or as -(dF/dy')^-1 dF/dy from F(t, y, y') = 0."""
    if system.rate_jacobian is not None:
        return np.asarray(system.rate_jacobian(t, y))
    fy, fyp = system.jacobian_parts(t, y, yp)
    try:
        if not system.sparse:
            return np.asarray(-np.linalg.solve(fyp, fy))
        return np.asarray(-splu(as_csc(system, fyp)).solve(as_csc(system, fy).toarray()))
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise OptionError(
            f"dF/dy' is singular at t = {t:.9g} s: an equation contains no derivative (such as a motion without mass), or the "
            "derivatives of several depend on each other, so there is no y' = f(t, y); use mb.IDA() or mb.RadauIIA(3)"
        ) from error
