"""Energy that a run gains or loses without a cause.

BDF of order above 2 feeds energy to undamped motion: measured, a pendulum gains a fifth of its energy in 1e4 periods at rtol =
1e-6, and a damped oscillator can be made to grow. Neither constraints nor local errors show it; the energy balance does.
"""

from __future__ import annotations

import numpy as np

from mbdae.results.energy import has_power
from mbdae.results.result import Result
from mbdae.run.control import Controlled

ALLOWED = 10.0  #: energy error over the energy exchanged, in units of the accuracy asked (or rtol)
SHARE = 1e-3  #: of the energy exchanged below which there is never a warning
POINTS = 1000  #: steps of a run at which energies are compared


def energy_drift(result: Result, run: Controlled, asked: float | None) -> list[str]:
    """A warning where the energy balance drifts, unless the run met its accuracy and has dissipation or drives.

    Constant steps, contacts and friction have a check of their own (`reliability`). Beams lose the energy of vibrations that long
    steps leave out (`lost_vibrations`), so that with beams only BDF is checked."""
    prepared, order = result.prepared, _order(run)
    supplied = has_power(prepared.mechanics)
    met = asked is not None and run.estimate <= asked
    elsewhere = prepared.contacts or prepared.mechanics.reactive or (prepared.model.lines and order <= 2)
    if run.solver.fixed or elsewhere or (met and supplied):
        return []
    t = result.solution.t
    if len(t) < 3:
        return []
    e = result(t[:: len(t) // POINTS + 1]).energy
    exchanged = max(float(x) for x in (np.max(e.kinetic), np.ptp(e.potential), np.ptp(e.dissipated), np.ptp(e.work)))
    off = float(e.balance[np.argmax(np.abs(e.balance))])
    if not abs(off) > max(SHARE, ALLOWED * (asked if asked is not None else run.solver.rtol or 0.0)) * exchanged:
        return []
    cause = "BDF of order above 2 feeds undamped motion: use mb.RadauIIA(3), or" if order > 2 else "use"
    return [f"the energy balance drifts: {abs(off):.2g} J {'gained' if off > 0 else 'lost'} without a cause, where "
            f"{exchanged:.2g} J are exchanged; {cause} a smaller rtol or step"]  # fmt: skip


def _order(run: Controlled) -> int:
    """Highest order of the BDF method of a run; 0 for other methods."""
    if run.solver.label == "IDA" or "BDF" in run.solver.label:
        return int(getattr(run.solver, "max_order", None) or 5)
    return 0
